"""Photographed pairs: the assignment of files to pairs, and their images on the pixels of the rectified rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig, rectifying_rotations
from ...physics.camera.stereo_camera import StereoCamera
from ...render.pairs.pair_folder import EYES
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import explain_errors
from ...support.number_text import format_count
from ..datasets.data_files import MapFile, read_image, read_map
from ..datasets.foreign_pair import make_safe_name
from ..datasets.input_faults import check_map_size
from ..images.image_values import describe_size, to_grey
from ..images.masks import sample_at_pixels

#: Suffixes of images that are read, and of formats that lose detail.
_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp")
LOSSY_SUFFIXES = (".jpg", ".jpeg", ".webp")
#: Largest shift, px, between the pixels of a rectified image and of the photograph at which the numbers are copied.
_SAME_PX = 0.01
#: Least median disparity, px; a smaller one comes from depths in millimetres.
_MIN_DISPARITY_PX = 0.5


@dataclass(frozen=True)
class Photographs:
    """A photographed pair: a name for results, the files of both eyes, and the file of the left image's true depth, if
    any.
    """

    name: str
    left: Path
    right: Path
    depth: Path | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """All files of the pair."""
        return (self.left, self.right, *([self.depth] if self.depth else []))


def find_photographs(paths: Sequence[Path], depths: Sequence[Path] = ()) -> list[Photographs]:
    """Find the pairs of LEFT RIGHT LEFT RIGHT …, or of one folder, with true depths in the same order.

    A folder has images in ``left`` and ``right`` with the same names, or images whose names differ in left and right.
    Raises IcyMoonError for an image without its partner, and for another number of depths.
    """
    if len(paths) == 1 and paths[0].is_dir():
        files = _find_in_folder(paths[0])
    elif len(paths) == 1 and not paths[0].exists():
        raise IcyMoonError(f"{paths[0]} is missing; give one folder with both eyes' images, or LEFT RIGHT.")
    elif len(paths) % 2:
        raise IcyMoonError(
            f"{paths[-1]} has no partner; give LEFT RIGHT, several of these, or one folder with both eyes' images."
        )
    else:
        files = list(zip(paths[::2], paths[1::2], strict=True))
    for left, right in files:
        if left.exists() and right.exists() and left.samefile(right):
            raise IcyMoonError(f"{left} and {right} are one file; give the image of each eye.")
    if depths and len(depths) != len(files):
        raise IcyMoonError(
            f"--depth names {format_count(len(depths), 'file')} for {format_count(len(files), 'pair')}; give one "
            "for each pair, in their order."
        )
    names = [make_safe_name(left.stem) for left, _ in files]
    if len(set(names)) < len(names):
        names = [f"{number:03d}_{name}" for number, name in enumerate(names, 1)]
    return [
        Photographs(name, left, right, depths[k] if depths else None)
        for k, (name, (left, right)) in enumerate(zip(names, files, strict=True))
    ]


def _find_in_folder(folder: Path) -> list[tuple[Path, Path]]:
    """Find the files of both eyes in a folder, in the order of their names. Raises IcyMoonError without pairs, and for
    an image without its partner.
    """
    sides = [folder / eye for eye in EYES]
    if all(side.is_dir() for side in sides):
        left, right = ({path.stem: path for path in _list_images(side)} for side in sides)
        partner = {name: right.get(name) for name in left}
        found = {path: partner[name] for name, path in left.items()}
    else:
        there = {path.name.lower(): path for path in _list_images(folder)}
        found = {path: there.get(name.replace("left", "right")) for name, path in there.items() if "left" in name}
    if not found:
        raise IcyMoonError(
            f"{folder} has no pairs of images; put them into its folders left and right with the same names, or name "
            "them as in left01.png and right01.png."
        )
    pairs = []
    for path, other in found.items():
        if other is None:
            raise IcyMoonError(f"{path} has no image of the right eye beside it; add it, or leave out this one.")
        pairs.append((path, other))
    return pairs


def _list_images(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in _IMAGE_SUFFIXES and path.is_file())


@dataclass(frozen=True)
class Rectification:
    """The resampling of photographs to the images of the parallel rig ``camera``.

    ``pixels``, by eye: columns and rows (H, W, 2) in the photograph, counted from its corner, of the pixels of the
    rectified image; None if both have the same pixels. ``seen``, by eye: bool (H, W), whether the photograph has the
    pixel. ``further``: (H, W), the planar depth along the rig's axis over the planar depth along the left photograph's
    axis.
    """

    camera: StereoCamera
    sizes: Mapping[str, tuple[int, int]]
    pixels: Mapping[str, Array | None]
    seen: Mapping[str, Array]
    further: Array

    @property
    def interpolates(self) -> bool:
        """Whether the photographs are interpolated."""
        return any(pixels is not None for pixels in self.pixels.values())

    def read_grey(self, path: Path, eye: str) -> Array:
        """Read the grey levels of a photograph from 0 to 255, float32 (H, W), on the pixels of the rig.

        Raises IcyMoonError for an image that cannot be read, and for another size than the calibration's.
        """
        image = to_grey(read_image(path))
        if image.shape[::-1] != self.sizes[eye]:
            width, height = self.sizes[eye]
            raise IcyMoonError(
                f"{path} is {describe_size(image)}, and the calibration is for {width} x {height} px; give the "
                "calibration of these images, or images that were neither cropped nor scaled."
            )
        pixels = self.pixels[eye]
        return image.astype(np.float32) if pixels is None else sample_at_pixels(image, pixels)

    def read_disparity(self, path: Path) -> Array:
        """Read the true disparity of the left image, float64 (H, W) in px, NaN where unknown, from planar depths in
        metres at the pixels of the left photograph.

        Depths are never interpolated. Raises IcyMoonError for a map that cannot be read, of another size, or in
        millimetres.
        """
        depth = read_map(MapFile(path, "depth"))
        width, height = self.sizes["left"]
        check_map_size(path, depth.shape, (height, width), "depth", "the photograph is")
        depth[depth <= 0] = np.nan
        pixels = self.pixels["left"]
        if pixels is not None:
            column, row = (
                np.clip(np.nan_to_num(pixels[..., k]), 0, depth.shape[1 - k] - 1).astype(int) for k in (0, 1)
            )
            depth = np.where(self.seen["left"], depth[row, column], np.nan) * self.further
        disparity = self.camera.disparity(depth)
        if np.isnan(disparity).all():
            raise IcyMoonError(f"{path} has no depth above 0 in the image; give planar depths in metres.")
        if np.nanmedian(disparity) < _MIN_DISPARITY_PX:
            raise IcyMoonError(
                f"{path} has a median depth of {np.nanmedian(depth):.4g} m, at which the eyes see points "
                f"{np.nanmedian(disparity):.2g} px apart; if it is in millimetres, divide it by 1000."
            )
        return disparity


def make_rectification(rig: CalibratedRig, camera: StereoCamera, where: str) -> Rectification:
    """Make the resampling of the photographs of the first two cameras of a rig to the images of the parallel rig
    ``camera``.

    The eyes turn as in OpenCV's stereoRectify. Raises IcyMoonError, naming the calibration ``where``, for eyes that are
    not side by side.
    """
    with explain_errors(where, "a calibration of two eyes side by side", "calibrate two eyes side by side"):
        turns = rectifying_rotations(rig)
    grid = np.stack(np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5), axis=-1)
    flat = (grid - [camera.cx_px, camera.cy_px]) / camera.focal_px
    rays = np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1)
    pixels: dict[str, Array | None] = {}
    seen: dict[str, Array] = {}
    for eye, eyes_own, turn in zip(EYES, rig.cameras, turns, strict=False):
        at = _project_rays(eyes_own, rays @ turn)
        with np.errstate(invalid="ignore"):
            seen[eye] = np.asarray(((at >= 0.5) & (at <= np.array(eyes_own.size_px) - 0.5)).all(axis=-1))
            same = eyes_own.size_px == (camera.width_px, camera.height_px) and bool(
                (np.abs(at - grid) < _SAME_PX).all()
            )
        if same:
            seen[eye] = np.ones(grid.shape[:2], bool)
        pixels[eye] = None if same else np.nan_to_num(at, nan=-1.0)
    along = (rays @ turns[0])[..., 2]
    further = np.divide(1.0, along, out=np.full(along.shape, np.nan), where=along > 0)
    return Rectification(
        camera, dict(zip(EYES, (each.size_px for each in rig.cameras), strict=False)), pixels, seen, further
    )


def _project_rays(camera: CalibratedCamera, rays: Array) -> Array:
    """Project rays (..., 3) in a camera's own axes to columns and rows (..., 2), counted from the image's corner."""
    return camera.placed(np.eye(3), np.zeros(3)).project(rays) + 0.5
