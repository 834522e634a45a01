"""A rendered pair as arrays: light, truth, images of any sensor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.camera.stereo_camera import StereoCamera
from ..render.pairs.pair_folder import Pair, find_pair_folders, read_unchanged_pair
from ..settings import description, preset_files
from ..settings.table import TOPICS
from ..settings.topics.declaration import Parts
from ..settings.topics.scene import Settings
from ..stereo.images.develop import DevelopedImages, develop
from ..stereo.images.disparity_and_occlusion import find_scene_depth, find_visible_in_right
from ..stereo.images.exr import Light, View
from ..stereo.images.lens import make_lens
from ..stereo.images.views import read_eye
from ..support.arrays import Array
from ..support.errors import IcyMoonError


class RenderedEye:
    """One camera's view in a pair, on the pixels of the parallel rig: ``H`` rows from the top, ``W`` columns.

    Everything is read from the disk at its first use and then stays in memory.
    """

    def __init__(self, pair: Pair, name: str) -> None:
        self._pair = pair
        #: 'left' or 'right'.
        self.name = name

    def __repr__(self) -> str:
        rows, columns = self._pair.camera.height_px, self._pair.camera.width_px
        return f"<{self.name} eye of pair {self._pair.id}: {columns} x {rows} px>"

    @cached_property
    def _read_once(self) -> tuple[Light, View]:
        return read_eye(self._pair, self.name)

    @property
    def radiance(self) -> Array:
        """Linear radiance in W/(m² sr), float32 (H, W, 3), in the bands that the file states."""
        return self._read_once[1].radiance

    @cached_property
    def depth_m(self) -> Array:
        """Planar depth in metres at pixel centres, float64 (H, W); NaN for sky and for pixels that are not ``seen``."""
        depth, seen = find_scene_depth(self._read_once[1]), self.seen
        return depth if seen.all() else np.where(seen, depth, np.nan)

    @cached_property
    def seen(self) -> Array:
        """Whether the sensor sees the pixel, bool (H, W). Some are not seen if the eyes are toed in or calibrated."""
        camera = self._pair.camera
        lens = make_lens(camera, self._pair.settings.rig, self.name) if camera.looks_elsewhere else None
        return np.ones((camera.height_px, camera.width_px), bool) if lens is None else lens.sees

    @property
    def normal(self) -> Array | None:
        """Unit normals in world axes (east, north, up), float32 (H, W, 3); None without full truth."""
        return self._read_once[1].normal

    @property
    def semantic(self) -> Array | None:
        """Labels, int32 (H, W): 0 sky, others as ``pair.labels`` names them; None without full truth."""
        return self._read_once[1].semantic

    @property
    def instance(self) -> Array | None:
        """Numbers of objects and rocks, int32 (H, W), see the manual's page on the pair folder; None without full
        truth."""
        return self._read_once[1].instance

    @property
    def loose_thickness_m(self) -> Array | None:
        """Thickness of loose material above the hard ground in metres, along the vertical, float32 (H, W): talus,
        mantle, skirts and spoil. It is 0 on rocks, objects and sky; None without ``quality.loose_thickness``."""
        return self._read_once[1].loose_m

    @property
    def pose_to_world(self) -> Array:
        """The matrix (4, 4) from this camera's axes (x right, y down, z forward) to the world's (east, north, up), in
        metres; with a rolling shutter, the pose at the middle of the exposure. Raises IcyMoonError if the pair does not
        contain it."""
        pose = self._pair.rectified_pose(self.name)
        if pose is None:
            raise IcyMoonError(
                f"{self._pair.folder / 'pair.json'} does not contain the pose of the camera; render the pair again."
            )
        return pose

    @property
    def row_poses_to_world(self) -> Array:
        """The poses (H, 4, 4) as in ``pose_to_world``, each at the time of its row; they differ with a rolling shutter
        only."""
        pose, rows = self.pose_to_world, self._pair.row_poses(self.name)
        return np.array(np.broadcast_to(pose if rows is None else rows, (self._pair.camera.height_px, 4, 4)))


class RenderedPair:
    """A complete pair on the disk. Each array is read at its first use."""

    def __init__(self, pair: Pair) -> None:
        self._pair = pair
        #: The left camera. Truth and disparity are on its pixels.
        self.left = RenderedEye(pair, "left")
        #: The right camera.
        self.right = RenderedEye(pair, "right")

    def __repr__(self) -> str:
        camera = self.camera
        return (
            f"<RenderedPair {self.id}: {camera.width_px} x {camera.height_px} px, f {camera.focal_px:.6g} px, "
            f"baseline {camera.baseline_m:.6g} m, in {self.folder}>"
        )

    @property
    def id(self) -> str:
        """The id of the pair: twelve hexadecimal digits, a hash of everything that its pixels depend on."""
        return self._pair.id

    @property
    def folder(self) -> Path:
        """The folder of the pair."""
        return self._pair.folder

    @property
    def settings(self) -> Settings:
        """A copy of the complete settings of the render."""
        return description.merged(self._pair.settings)

    @property
    def facts(self) -> dict[str, Any]:
        """The complete content of ``pair.json``: versions, seeds, light, times, checksums."""
        return self._pair.data

    @property
    def camera(self) -> StereoCamera:
        """The parallel rig: ``focal_px``, ``cx_px``, ``cy_px``, ``baseline_m``, ``matrix``, ``disparity()``, …"""
        return self._pair.camera.rectified

    @property
    def labels(self) -> dict[int, str]:
        """The names of the numbers in ``semantic``; empty if only depth was rendered."""
        stated = self._pair.data.get("channels", {}).get("semantic", {})
        return {int(number): str(name) for number, name in stated.items()}

    @property
    def depth_m(self) -> Array:
        """True planar depth of the left camera in metres, float64 (H, W); NaN for sky."""
        return self.left.depth_m

    @cached_property
    def disparity_px(self) -> Array:
        """True disparity of the left image, left column minus right column, in px, float64 (H, W); NaN for sky."""
        return self.camera.disparity(self.left.depth_m)

    @cached_property
    def visible(self) -> Array:
        """Whether the right camera also sees the point that a left pixel shows, bool (H, W)."""
        if self._pair.camera.looks_elsewhere:
            from ..stereo.measure.prepare_pair import make_self_check_eyes
            from ..stereo.measure.self_check import find_visibility

            views = {eye.name: eye._read_once[1] for eye in (self.left, self.right)}
            return find_visibility(*make_self_check_eyes(self._pair, self._pair.settings, views), self._pair.camera)[
                "left"
            ]
        # The right depth is needed only if no rays have found the hidden pixels.
        hidden = self.left._read_once[1].hidden
        right = self.left.depth_m if hidden is not None else self.right.depth_m
        return find_visible_in_right(self.left.depth_m, right, self.camera, hidden)

    @cached_property
    def occluded(self) -> Array:
        """Whether a left pixel has a depth, but the right camera does not see its point, bool (H, W)."""
        return np.isfinite(self.left.depth_m) & ~self.visible

    def develop(self, *presets: str | Path, **changes: Mapping[str, Any]) -> DevelopedImages:
        """Make the images that a camera takes of this pair: ``left`` and ``right``, uint16 (H, W) digital numbers.

        ``presets`` and ``changes`` are of sensors and other settings that need no new render, such as
        ``develop("sensors/mer_ccd", sensor={"gain": 2.0})``; others keep the values of the pair. The same pair and
        settings always give the same noise. Raises IcyMoonError for a setting that needs a new render.
        """
        settings = description.merged(self._pair.settings, read_response(presets, changes))
        left, right = (eye._read_once[0] for eye in (self.left, self.right))
        return develop(self._pair, left, right, settings)


def read_response(presets: tuple[str | Path, ...], changes: Parts) -> Settings:
    """Read the settings of presets and changes. Raises IcyMoonError for a setting that needs a new render."""
    found = read_settings(presets, changes)
    for topic, values in found.items():
        for key in values:
            if TOPICS[topic][key].effect not in ("response", "run"):
                raise IcyMoonError(f"{topic}.{key} needs a new render; render the scene with it, or leave it out here.")
    return found


def read_settings(presets: tuple[str | Path, ...], changes: Parts) -> Settings:
    """Read the partial settings of presets (names, or paths of TOML files), with changes over them.

    Raises IcyMoonError for an unknown name, with the nearest one, and for values of a wrong type or out of range.
    """
    parts = [
        preset_files.load(Path(preset))
        if isinstance(preset, Path) or str(preset).endswith(".toml")
        else preset_files.load_preset(str(preset))
        for preset in presets
    ]
    return description.merged(*parts, description.check(_to_plain_numbers(changes), "settings"))


def _to_plain_numbers(value: object) -> Any:
    """Convert NumPy's numbers in tables and lists to Python's numbers."""
    if isinstance(value, dict):
        return {key: _to_plain_numbers(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_to_plain_numbers(each) for each in value]
    if isinstance(value, Path):
        return str(value)
    return value.item() if isinstance(value, np.generic) else value


def open_pair(folder: str | Path) -> RenderedPair:
    """Open the pair in a folder, or the only pair of a data set, and check its files against their checksums.

    Raises IcyMoonError if there is no pair, if there are several, or if a file has changed since it was rendered.
    """
    folders = find_pair_folders(Path(folder))
    if len(folders) > 1:
        raise IcyMoonError(f"{folder} contains {len(folders)} pairs; open them with icymoon.open_pairs.")
    return RenderedPair(read_unchanged_pair(folders[0]))


def open_pairs(folder: str | Path) -> Iterator[RenderedPair]:
    """Yield the pairs of a data set in the order of their ids, each checked just before; see ``open_pair``."""
    return (RenderedPair(read_unchanged_pair(each)) for each in find_pair_folders(Path(folder)))
