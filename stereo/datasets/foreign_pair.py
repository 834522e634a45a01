"""A pair of another data set: its files, and the measurements that they permit."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ...physics.camera.occlusion import find_matching_column, is_in_frame
from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import FILE_NAME
from ...support.files import read_checksum
from ...support.foreign_bytes import MAX_BYTES, note_on_backslashes
from ..images import colours
from ..images.disparity_and_occlusion import ESTIMATED, MASK, find_visible_in_right
from ..images.image_values import describe_size, to_grey
from ..matchers.search_range import FIXED, MAX_SEARCHED_PX, STEP_PX, SearchRange
from ..measure.by_pixel_class import OCCLUSION, classify_pixels, measure_texture
from ..measure.fit_check import MatchedPlaces, compute_ray_lengths, find_common_places, is_confirmed
from ..measure.metrics import is_usable
from ..measure.prepare_pair import PreparedPair
from ..measure.self_check import SelfCheck
from .data_files import MapFile, read_image, read_map, read_radiance
from .input_faults import (
    WRONG_SIGN_SHARE,
    check_map_size,
    check_truth,
    find_rotated_images,
    refuse_rotated_images,
    warn_dark_images,
    warn_unlikely_camera,
)
from .markers import find_markers, is_possible
from .visibility import Mask, check_right_truth, make_right_camera, read_mask

#: Share of the image width that matchers search if a data set states no range.
_SEARCHED_SHARE = 0.25
#: Largest row difference of matching pixels, px, that is not reported.
_UNREPORTED_ROW_OFFSET_PX = 0.5
#: A function that makes the camera of images of a width and a height.
CameraReader = Callable[[int, int], StereoCamera]


@dataclass(frozen=True)
class ForeignPair:
    """The files of a pair in the layout of another data set. They are read in ``prepare``."""

    name: str
    folder: Path  # the folder in which the pair was found
    layout: str
    scene: str  # pairs of one scene are not independent
    left: Path
    right: Path
    truth: MapFile
    camera_reader: CameraReader
    calibration: tuple[Path, ...] = ()
    truth_right: MapFile | None = None
    mask: Mask | None = None
    white: float | None = None  # the radiance of white, in images of radiance (PFM)
    linear: bool = False  # the images are proportional to light, as our own are
    either_sign: bool = False  # the sign of disparities differs between releases of the data set
    notes: tuple[str, ...] = ()  # facts about the data
    row_offset_reader: Callable[[], float] | None = None  # reads the largest row difference of matching pixels, px
    # Reads the number of disparities that are enough according to the data set.
    disparities_reader: Callable[[], int | None] | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """All files on which the pair's results depend."""
        right = (self.truth_right.path,) if self.truth_right else ()
        return (
            self.left,
            self.right,
            self.truth.path,
            *right,
            *(self.mask.files if self.mask else ()),
            *self.calibration,
        )

    def list_dependencies(self) -> list[Any]:
        """List everything that determines the pair's numbers: its layout, and the checksums of its files.

        The checksum of an unreadable file is empty.
        """
        described = [self.layout, self.truth.kind, self.truth.steps, self.white]
        return [*described, *(read_checksum(path, MAX_BYTES) for path in self.files)]

    def prepare(self, response: Mapping[str, Mapping[str, Any]]) -> PreparedPair:
        """Read the pair, and compute the inputs of matchers and metrics. No sensor model is applied.

        Raises IcyMoonError with the name of the file and the remedy if one is missing, damaged or does not fit.
        """
        for path in self.files:
            if not os.path.lexists(path):
                raise IcyMoonError(f"{path} is missing{note_on_backslashes(path)}; add it, or leave out this pair.")
        left, right = (self._read_grey_image(path) for path in (self.left, self.right))
        turned = find_rotated_images((self.left, self.right))
        if left.shape[:2] != right.shape[:2]:
            refuse_rotated_images(turned)
            raise IcyMoonError(
                f"{self.left} is {describe_size(left)}, and {self.right} is {describe_size(right)}; "
                "give two rectified images of one size."
            )
        camera = self.camera_reader(left.shape[1], left.shape[0])
        if (camera.width_px, camera.height_px) != left.shape[1::-1]:
            raise IcyMoonError(
                f"{self.left} is {describe_size(left)}, and "
                f"{(self.calibration or (self.folder,))[0]} is for {camera.width_px} x "
                f"{camera.height_px} px; give the calibration of these images."
            )
        grey = to_grey(left), to_grey(right)
        places = find_common_places(*grey)
        disparity, markers, notes, warnings = self._read_true_disparity(camera, left, places, turned)
        truth = camera.depth(disparity)
        visible, known, doubts = self._find_visible(disparity, truth, camera, left, markers)
        gradient = measure_texture(grey[0])
        classes = classify_pixels(truth, visible, gradient, grey[0], None, None, None)
        if not known:
            classes[OCCLUSION.key] = np.full(truth.shape, -1)
        stated = self.disparities_reader() if self.disparities_reader else None
        count = stated or math.ceil(_SEARCHED_SHARE * camera.width_px)
        most = STEP_PX * math.ceil(min(count, camera.width_px, MAX_SEARCHED_PX) / STEP_PX) - 1
        pair = PhotographedPair(self.name, self.folder, camera, SearchRange(0, most, FIXED))
        scale = colours.make_depth_scale(truth)
        warnings = [*self._doubt_rows(), *warn_unlikely_camera(camera), *warn_dark_images(*grey), *warnings, *doubts]
        facts = self._describe_facts(camera, truth, visible if known else None, notes, warnings)
        facts["depth_scale_m"] = [scale.low, scale.high]
        return PreparedPair(pair, left, right, truth, visible, gradient, classes, _NO_SELF_CHECK, scale, facts, known)

    def _read_grey_image(self, path: Path) -> Array:
        if path.suffix != ".pfm":
            return read_image(path)
        radiance = read_radiance(path)
        level = np.clip(radiance / (self.white or float(radiance.max()) or 1.0), 0, 1)
        return np.asarray(np.rint(255 * level).astype(np.uint8))

    def _read_true_disparity(
        self, camera: StereoCamera, image: Array, places: MatchedPlaces, turned: Mapping[Path, int]
    ) -> tuple[Array, tuple[float, ...], list[str], list[str]]:
        """Return the true disparity of the left eye, the numbers that mean "unknown", notes on how it was read, and
        warnings.

        Raises IcyMoonError if viewers show images ``turned`` and the truth does not confirm their stored pixels.
        """
        values, kind = self._read_map_values(self.truth, camera, image, turned), self.truth.kind
        markers = find_markers(values, kind, camera, places)
        values[np.isin(values, markers)] = np.nan
        notes = [
            f"{self.truth.path}: many pixels have {_describe_marker(value, kind)} to the bit, far from all others "
            "and not as the images show it, so it counts as unknown."
            for value in markers
        ]
        if turned:
            if not is_confirmed(values, kind, camera, places):
                refuse_rotated_images(turned)
            notes.append(
                "Images state an EXIF orientation by which viewers turn them; their pixels were taken as they "
                "are stored, which the truth confirms."
            )
        warnings = check_truth(self, values, camera, places)
        disparity, doubts = self._drop_impossible(_to_disparity(values, kind, camera))
        return disparity, markers, notes, [*warnings, *doubts]

    def _drop_impossible(self, disparity: Array) -> tuple[Array, list[str]]:
        """Replace disparities that are impossible in images of this width by NaN, and warn about them.

        Raises IcyMoonError if no possible disparity remains.
        """
        fits = is_possible(disparity)
        if fits.all():
            return disparity, []
        width, what = disparity.shape[1], "depths" if self.truth.kind == "depth" else "disparities"
        if not np.isfinite(disparity[fits]).any():
            raise IcyMoonError(
                f"{self.truth.path} has {what} for which no point is in both images of {width} px; "
                "correct them, or the steps, the focal length or the baseline that are stated."
            )
        return np.where(fits, disparity, np.nan), [
            f"{self.truth.path} has {what} by which points are {width} px and more apart in images of that width, "
            f"which cannot be; these {100 * np.mean(~fits):.2g} % of the pixels were taken for unknown."
        ]

    def _read_map_values(
        self, file: MapFile, camera: StereoCamera, image: Array, turned: Mapping[Path, int] = MappingProxyType({})
    ) -> Array:
        """Read the depths along the optical axis, or the disparities, of a map."""
        values = read_map(file)
        if values.shape != image.shape[:2]:
            refuse_rotated_images(turned)
            check_map_size(file.path, values.shape, image.shape[:2], file.kind, "the images are")
        if file.along_ray:
            values = values / compute_ray_lengths(camera)
        known = np.isfinite(values)
        return (
            -values if self.either_sign and known.any() and np.mean(values[known] < 0) >= WRONG_SIGN_SHARE else values
        )

    def _find_visible(
        self,
        disparity: Array,
        truth: Array,
        camera: StereoCamera,
        image: Array,
        markers: tuple[float, ...],
    ) -> tuple[Array, bool, list[str]]:
        """Find the pixels of the left eye whose point is visible in the right eye.

        Also return whether this is known beyond the image frame, and warnings. ``markers`` are the values in the truth
        that mean "unknown".
        """
        inside = np.isfinite(truth) & is_in_frame(find_matching_column(disparity))
        if self.mask:
            return inside & read_mask(self.mask, disparity), True, []
        if self.truth_right:
            values = self._read_map_values(self.truth_right, make_right_camera(camera), image)
            values[np.isin(values, markers)] = np.nan
            warnings = check_right_truth(self.truth_right, values, camera, disparity)
            seen = _to_disparity(values, self.truth_right.kind, camera)
            other = camera.depth(np.where(is_possible(seen), seen, np.nan))
            return find_visible_in_right(truth, other, camera), True, warnings
        return inside, False, []

    def _describe_facts(
        self,
        camera: StereoCamera,
        truth: Array,
        visible: Array | None,
        notes: Sequence[str],
        warnings: Sequence[str],
    ) -> dict[str, Any]:
        known = np.isfinite(truth)
        return {
            "pair": self.name,
            "width_px": camera.width_px,
            "height_px": camera.height_px,
            "focal_baseline_px_m": camera.focal_baseline_px_m,
            "baseline_m": camera.baseline_m,
            "doffs_px": camera.doffs_px,
            "image_bits": 8,
            "linear": self.linear,
            "layout": self.layout,
            "scene": f"{self.layout} {self.scene}",
            "true": float(known.mean()),
            "visible": None if visible is None else float(visible.sum() / known.sum()),
            "depth_m": [float(q) for q in np.quantile(truth[known], (0, 0.5, 1))],
            "notes": [self._describe_missing(visible is not None), *self.notes, *notes],
            "warnings": list(warnings),
            "settings": {},
            "rendered": {},
            "noise": None,
            "occlusion": MASK if self.mask else ESTIMATED if visible is not None else None,
            "self_check": _NO_SELF_CHECK.to_json(),
        }

    def _doubt_rows(self) -> list[str]:
        offset = self.row_offset_reader() if self.row_offset_reader else 0.0
        return (
            [
                f"Rows of matching pixels differ by up to {offset:g} px (dymax in calib.txt), which matchers here do "
                "not search."
            ]
            if offset > _UNREPORTED_ROW_OFFSET_PX
            else []
        )

    def _describe_missing(self, occlusion_known: bool) -> str:
        """Describe in one or two sentences the errors and metrics that are unavailable for such a pair."""
        hidden = "" if occlusion_known else " Without a mask of hidden pixels there are no metrics of visible pixels."
        return (
            f"{self.layout}: without normals, labels and the direction of the Sun there are no errors by slope, "
            f"light and material.{hidden}"
        )


@dataclass(frozen=True)
class UnusablePair:
    """A pair with a file that is missing, damaged or outside its data set. ``fault`` describes it in a sentence."""

    name: str
    folder: Path
    left: Path
    fault: str

    def list_dependencies(self) -> list[Any]:
        """List everything that determines the pair's failure."""
        return [self.fault]

    def prepare(self, response: Mapping[str, Mapping[str, Any]]) -> PreparedPair:
        """Raise IcyMoonError with the fault of the pair."""
        raise IcyMoonError(self.fault)


def open_foreign_pair(
    name: str, folder: Path, left: Path, find: Callable[[], ForeignPair]
) -> ForeignPair | UnusablePair:
    """Return the result of ``find``, or an unusable pair if it raises IcyMoonError.

    So other pairs remain usable.
    """
    try:
        return find()
    except IcyMoonError as error:
        return UnusablePair(name, folder, left, str(error))


def _describe_marker(value: float, kind: str) -> str:
    return f"the depth {value:g} m" if kind == "depth" else f"the disparity {value:g} px"


def _to_disparity(values: Array, kind: str, camera: StereoCamera) -> Array:
    """Convert a map of depths, m, to disparities, px, NaN where unusable. A map of ``kind`` "disparity" stays
    unchanged.
    """
    if kind == "disparity":
        return values
    return np.where(is_usable(values), camera.disparity(np.where(is_usable(values), values, 1.0)), np.nan)


@dataclass(frozen=True)
class PhotographedPair:
    """A foreign pair as a measurement needs it. Its points are in the axes of the left camera."""

    name: str
    folder: Path
    camera: StereoCamera
    search_range: SearchRange

    def rectified_pose(self, eye: str) -> Array | None:
        """Return the pose of an ``eye`` in the axes of the left eye, which the points use too: x right, y down, z
        ahead.
        """
        pose = np.eye(4)
        pose[0, 3] = self.camera.find_offset_m(eye)
        return pose

    def row_poses(self, eye: str) -> Array | None:
        """Return the ``rectified_pose``, because all rows have one pose."""
        return self.rectified_pose(eye)


#: Photographs have no self-check: the brightness of their eyes differs, and their truth has errors too.
_NO_SELF_CHECK = SelfCheck(None, None, None, None, None, ())


def make_safe_name(text: str) -> str:
    """Make a name for results: replace characters that some systems forbid in file names."""
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", text).strip("._ ") or "pair"
    return name if FILE_NAME.fits(name) else f"pair_{name}"
