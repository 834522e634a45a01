"""Prepare a pair for matching and measuring: check, read and develop it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...formats.geotiff import describe_map_place
from ...physics.camera.calibration_error import make_assumed_camera
from ...physics.camera.stereo_camera import StereoCamera
from ...physics.light.lamps import is_light_scaled
from ...physics.light.photons import pixel_pitch_m
from ...render.pairs.pair_folder import EYES, Pair, find_pair_folders, read_pair, read_unchanged_pair
from ...settings.description import merged
from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from ...support.errors import IcyMoonError
from ...support.labels import BAKED_ERROR_PASSES, GROUP_PASSES, LIGHT_GROUPS, NOT_SEEN
from ..images import colours
from ..images.develop import Channels, DevelopedImages, average_bands, describe_exposure, develop, scale_radiance
from ..images.disparity_and_occlusion import ESTIMATED, RAYS, find_scene_depth
from ..images.exr import NORMAL_PASSES, OBJECT_PASSES, Light, View
from ..images.lens import make_lens
from ..images.views import read_baked_error, read_eye
from .by_pixel_class import ClassCells, classify_pixels, measure_texture
from .depth_order import TrueOrder
from .metrics import is_usable, sort_by_confidence
from .render_noise import RenderNoise, judge_render_noise
from .self_check import Eye, SelfCheck, find_visibility, run_self_check

#: Entries of pair.json on the render that the report shows.
_RENDER_FACTS = ("versions", "device", "denoiser", "osl", "platform", "edited_by_hand", "seeds")


@dataclass(frozen=True)
class LoadedPair:
    """A pair that was checked, read and developed, with its truth; the dicts have an entry per eye."""

    pair: Pair
    settings: Settings
    light: dict[str, Light]  # the light at the eyes, see views.read_eye
    views: dict[str, View]  # on the parallel rig; the labels are NOT_SEEN where the sensor sees nothing
    images: DevelopedImages
    depth: dict[str, Array]  # float64 (H, W), planar metres, NaN for sky and outside the sensor's view
    visible: dict[str, Array]  # bool (H, W), seen by the other eye too
    check: SelfCheck


class MeasuredPair(Protocol):
    """The facts about a pair that a measurement needs, for pairs of Icy Moon and of other data sets."""

    @property
    def name(self) -> str:
        """The name of the pair in results."""

    @property
    def folder(self) -> Path:
        """The folder of the pair, for messages."""

    @property
    def camera(self) -> StereoCamera:
        """The parallel rig of the pair's images."""

    def rectified_pose(self, eye: str) -> Array | None:
        """Return the matrix (4, 4) from an eye, in OpenCV's axes, to the axes of its points; None if it is not
        known.
        """

    def row_poses(self, eye: str) -> Array | None:
        """Return the ``rectified_pose``; with a rolling shutter one pose for each row, (H, 4, 4)."""


@dataclass(frozen=True)
class PreparedPair:
    """The data of a pair that all methods need."""

    pair: MeasuredPair
    left: Array  # uint8 (H, W), or (H, W, 3) in the order B, G, R, for the matchers
    right: Array
    truth: Array  # float64 (H, W), planar metres, NaN for sky and outside the sensor's view
    visible: Array  # bool (H, W), seen by the right eye too
    gradient: Array  # float64 (H, W), see by_pixel_class.measure_texture
    classes: dict[str, Array]  # of every pixel by every factor, see by_pixel_class.classify_pixels
    check: SelfCheck
    scale: colours.Scale  # for pictures of depth
    facts: dict[str, Any]  # about the pair, for the report
    occlusion_known: bool = True  # if false, ``visible`` is only false for points outside the right image
    images: DevelopedImages | None = None  # as developed; None for a pair that was not rendered here
    assumed_camera: StereoCamera | None = None  # the camera of an erroneous calibration; None if it is the pair's

    @property
    def depth_camera(self) -> StereoCamera:
        """The parallel rig that converts measured disparities to depths."""
        return self.assumed_camera or self.pair.camera

    @cached_property
    def known(self) -> Array:
        """Mask (H, W), bool, of the pixels that have a true depth."""
        return is_usable(self.truth)

    @cached_property
    def cells(self) -> ClassCells:
        """The ``known`` pixels by their ``classes``."""
        return ClassCells(self.classes, self.known)

    @cached_property
    def true_order(self) -> TrueOrder:
        """The order of the depths of the ``known`` pixels."""
        return TrueOrder(self.truth[self.known])

    @cached_property
    def by_texture(self) -> Array:
        """The indices of all pixels, those with the largest ``gradient`` first."""
        return sort_by_confidence(self.gradient)


def list_distinct_pairs(paths: Sequence[Path]) -> list[Path]:
    """List the folders of all pairs at ``paths``, each pair once.

    Raises IcyMoonError if no pair is found, or if two different pairs have the same name.
    """
    found: dict[str, Path] = {}
    for folder in (folder for path in paths for folder in find_pair_folders(path)):
        same = found.setdefault(folder.name, folder)
        if same != folder and read_pair(same).id != read_pair(folder).id:
            raise IcyMoonError(f"{same} and {folder} are different pairs of the same name; give one of them at a time.")
    return list(found.values())


def load_pair(folder: Path, response: Mapping[str, Mapping[str, Any]], measuring: bool = False) -> LoadedPair:
    """Check, read and develop one pair; ``response`` overrides settings that need no new render.

    For ``measuring``, data that only exports need is skipped, for speed. Raises IcyMoonError with the name of the file
    if a file in the folder has changed since it was rendered.
    """
    pair = read_unchanged_pair(folder)
    settings = merged(pair.settings, response)
    eyes = {eye: read_eye(pair, eye, _list_unneeded_passes(eye, settings) if measuring else ()) for eye in EYES}
    light, views = ({eye: taken for eye, (taken, _) in eyes.items()}, {eye: flat for eye, (_, flat) in eyes.items()})
    images = develop(pair, light["left"], light["right"], settings)
    left, right = make_self_check_eyes(pair, settings, views)
    views = {name: _label_unseen(views[name], eye.seen) for name, eye in (("left", left), ("right", right))}
    depth = {name: np.where(eye.seen, eye.depth, np.nan) for name, eye in (("left", left), ("right", right))}
    visible = find_visibility(left, right, pair.camera)
    check = run_self_check(left, right, visible, pair.camera)
    return LoadedPair(pair, settings, light, views, images, depth, visible, check)


def prepare_pair(folder: Path, response: Mapping[str, Mapping[str, Any]]) -> PreparedPair:
    """Load one pair and compute the inputs of matchers and metrics; see ``load_pair``."""
    return prepare_loaded(load_pair(folder, response, measuring=True))


def prepare_loaded(loaded: LoadedPair) -> PreparedPair:
    """Compute the inputs of matchers and metrics for a pair."""
    view, truth, visible = loaded.views["left"], loaded.depth["left"], loaded.visible["left"]
    left, right = loaded.images.for_matchers()
    gradient = measure_texture(left)
    sun = loaded.pair.sun
    classes = classify_pixels(
        truth,
        visible,
        gradient,
        average_bands(view.radiance),
        view.normal,
        view.semantic,
        sun.direction.tolist() if sun else None,
        loaded.images.blocked.get("left"),
    )
    scale = colours.make_depth_scale(truth)
    facts = _describe_pair(loaded.pair, loaded.settings, loaded.images, truth, visible)
    facts |= {
        "depth_scale_m": [scale.low, scale.high],
        "self_check": loaded.check.to_json(),
        "noise": _judge_noise(loaded).to_json(),
        "occlusion": ESTIMATED if view.hidden is None else RAYS,
        "baked": _describe_baked_light(loaded.pair),
    }
    return PreparedPair(
        loaded.pair,
        left,
        right,
        truth,
        visible,
        gradient,
        classes,
        loaded.check,
        scale,
        facts,
        images=loaded.images,
        assumed_camera=make_assumed_camera(loaded.pair.camera, loaded.settings.calibration_error),
    )


def _judge_noise(loaded: LoadedPair) -> RenderNoise:
    return judge_render_noise(
        compute_noise_free_level(loaded, "left"),
        compute_noise_free_level(loaded, "right"),
        loaded.pair.camera.disparity(loaded.depth["left"]),
        loaded.visible["left"],
        find_baked_error_level(loaded),
    )


def _describe_baked_light(pair: Pair) -> dict[str, float] | None:
    """Return the noise of baked light over all light, the share of baked light, and the limit in the settings; None
    without baked light.
    """
    stated = pair.data.get("indirect")
    if not isinstance(stated, dict) or stated.get("method") != "BAKED":
        return None
    # Pairs of older versions state only one noise, as if it were the same everywhere on the ground.
    numbers = {"noise": stated.get("noise_of_image", stated.get("noise")), "share": stated.get("share")}
    return {key: float(value) for key, value in numbers.items() if isinstance(value, (int, float))} | {
        "bound": float(pair.settings.quality.bake_noise)
    }


def _list_unneeded_passes(eye: str, settings: Settings) -> tuple[str, ...]:
    """List the passes of an eye that a measurement does not need, or that are read separately. Light groups are needed
    only to scale them.
    """
    scaled = is_light_scaled(settings)
    return (
        *OBJECT_PASSES,
        *BAKED_ERROR_PASSES.values(),
        *(() if scaled else GROUP_PASSES),
        *(() if eye == "left" else NORMAL_PASSES),
    )


def find_baked_error_level(loaded: LoadedPair) -> Numbers | None:
    """Find the grey levels of 255 by which the error of baked light may change the matchers' left image; the possible
    error is as large as the actual one. 0 if no light is baked, None if the pair does not contain the error.
    """
    if _describe_baked_light(loaded.pair) is None:
        return 0.0
    errors = read_baked_error(loaded.pair, "left")
    if not errors or not all(np.isfinite(error).all() for error in errors.values()):
        return None
    error = np.sum([loaded.settings.light[LIGHT_GROUPS[group]] * each for group, each in errors.items()], axis=0)
    return compute_noise_free_level(loaded, "left", error) - compute_noise_free_level(loaded, "left")


def compute_noise_free_level(loaded: LoadedPair, eye: str, more: Numbers = 0.0) -> Array:
    """Compute an eye's image as the matchers see it, in grey levels of 255, but without the sensor's noise and
    rounding. ``more`` light (H, W) is added in all bands.
    """
    settings = loaded.settings
    channels = Channels(settings.light, settings.sensor, pixel_pitch_m(settings.sensor, settings.rig))
    radiance = scale_radiance(loaded.views[eye], loaded.pair, settings)
    level = channels.matcher_level(
        radiance + np.asarray(more)[..., None] if np.ndim(more) else radiance, loaded.images.saturation_radiance
    )
    return np.asarray(255 * (np.sqrt(level) if loaded.images.encoding == "SQUARE_ROOT" else level))


def none_if_not_finite(value: float) -> float | None:
    """Return the number, or None, which is JSON's null, if it is not finite."""
    return value if math.isfinite(value) else None


def make_self_check_eyes(pair: Pair, settings: Settings, views: Mapping[str, View]) -> tuple[Eye, Eye]:
    """Make the left and the right eye of a pair for its self-check, from the views of ``views.read_eye``."""
    left, right = (
        Eye(
            average_bands(views[eye].radiance),
            find_scene_depth(views[eye]),
            _find_sensor_view(pair, settings, eye),
            views[eye].hidden,
        )
        for eye in EYES
    )
    return left, right


def _find_sensor_view(pair: Pair, settings: Settings, eye: str) -> Array:
    """Find the pixels, bool (H, W), in the sensor's field of view. Eyes that are toed in or calibrated do not cover all
    pixels.
    """
    lens = make_lens(pair.camera, settings.rig, eye) if pair.camera.looks_elsewhere else None
    return np.ones((pair.camera.height_px, pair.camera.width_px), bool) if lens is None else lens.sees


def _label_unseen(view: View, seen: Array) -> View:
    """Return the view, with NOT_SEEN as its label where nothing is ``seen``."""
    if seen.all():
        return view
    return replace(
        view,
        instance=None if view.instance is None else np.where(seen, view.instance, 0),
        semantic=None if view.semantic is None else np.where(seen, view.semantic, NOT_SEEN),
    )


def _describe_pair(
    pair: Pair, settings: Settings, images: DevelopedImages, truth: Array, visible: Array
) -> dict[str, Any]:
    known = np.isfinite(truth)
    some = bool(known.any())
    return {
        "pair": pair.folder.name,
        "width_px": pair.camera.width_px,
        "height_px": pair.camera.height_px,
        "focal_baseline_px_m": pair.camera.focal_baseline_px_m,
        "baseline_m": pair.camera.baseline_m,
        **describe_exposure(images),
        "true": float(known.mean()),
        "visible": float(visible.sum() / known.sum()) if some else None,
        "depth_m": [float(q) for q in np.quantile(truth[known], (0, 0.5, 1))] if some else None,
        "settings": settings,
        "rendered": {key: pair.data[key] for key in _RENDER_FACTS if key in pair.data},
        **({"map": place} if (place := describe_map_place(pair.data.get("ground"))) else {}),
    }
