"""A pair made ready for matching and measuring: checked, read, developed, its truth worked out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import IcyMoonError
from ..render.pair import EYES, Pair, changed_files, read_pair
from ..settings import Settings, defaults, merged
from . import pictures
from .develop import Images, develop, grey
from .exr import View, read_view
from .selfcheck import SelfCheck, self_check
from .strata import classify, texture
from .truth import scene_depth, visible_in_other

#: Entries of pair.json, on how the pair was rendered, that the report repeats.
_REPEATED = ("versions", "device", "denoiser", "osl", "platform", "edited_by_hand", "seeds")


@dataclass(frozen=True)
class Prepared:
    """What all methods on a pair share."""

    pair: Pair
    left: np.ndarray  # uint8 (H, W), for the matchers
    right: np.ndarray
    truth: np.ndarray  # float64 (H, W), planar metres, NaN for sky
    visible: np.ndarray  # bool (H, W), seen by the right eye too
    gradient: np.ndarray  # float64 (H, W), see strata.texture
    classes: dict[str, np.ndarray]  # of every pixel by every factor, see strata.classify
    check: SelfCheck
    scale: pictures.Scale  # for pictures of depth
    facts: dict[str, Any]  # what the report says of the pair


def prepare(folder: Path, sensor: Mapping[str, Any]) -> Prepared:
    """Check, read and develop one pair; ``sensor`` overrides settings of the camera response.

    Raises IcyMoonError, naming the file, if anything in the folder is not as it was rendered.
    """
    pair, settings = _checked(folder)
    left, right = (_view(pair, eye) for eye in EYES)
    settings = merged(settings, {"sensor": sensor})
    images = develop(pair, left, right, settings["sensor"])
    truth = scene_depth(left)
    right_truth = scene_depth(right)
    visible = visible_in_other(truth, right_truth, pair.camera)
    light = {"left": grey(left.radiance), "right": grey(right.radiance)}
    check = self_check(light["left"], light["right"], truth, right_truth, visible, pair.camera)
    left_image, right_image = images.for_matchers()
    gradient = texture(left_image)
    classes = classify(truth, visible, gradient, light["left"], left.normal, left.semantic, _toward_sun(pair))
    scale = pictures.depth_scale(truth)
    facts = _facts(pair, settings, images, truth, visible)
    facts |= {"depth_scale_m": [scale.low, scale.high], "self_check": check.to_json()}
    return Prepared(pair, left_image, right_image, truth, visible, gradient, classes, check, scale, facts)


def none_for_nan(value: float) -> float | None:
    """The number, or None, which is JSON's null, where it is not finite."""
    return value if math.isfinite(value) else None


def _checked(folder: Path) -> tuple[Pair, Settings]:
    try:
        pair = read_pair(folder)
        changed = changed_files(pair)
        settings = merged(defaults(), pair.settings)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise IcyMoonError(f"{folder / 'pair.json'} does not describe a pair; delete the folder and render the pair "
                           "again.") from None
    if changed:
        raise IcyMoonError(f"{folder / changed[0]} is not the file that was rendered (its checksum differs); delete "
                           "the folder and render the pair again.")
    return pair, settings


def _view(pair: Pair, eye: str) -> View:
    view = read_view(pair.image(eye), eye)
    height, width = view.depth.shape
    if (width, height) != (pair.camera.width_px, pair.camera.height_px):
        raise IcyMoonError(f"{pair.image(eye)} is {width} x {height} px, its camera {pair.camera.width_px} x "
                           f"{pair.camera.height_px} px; render the pair again.")
    return view


def _toward_sun(pair: Pair) -> list[float] | None:
    """Unit vector to the Sun in world axes, where the pair says it."""
    try:
        x, y, z = (float(value) for value in pair.data["light"]["sun"]["direction_to_world"])
    except (KeyError, TypeError, ValueError):
        return None
    return [x, y, z]


def _facts(pair: Pair, settings: Settings, images: Images, truth: np.ndarray, visible: np.ndarray) -> dict[str, Any]:
    known = np.isfinite(truth)
    some = bool(known.any())
    return {"pair": pair.folder.name, "width_px": pair.camera.width_px, "height_px": pair.camera.height_px,
            "focal_baseline_px_m": pair.camera.focal_baseline_px_m, "baseline_m": pair.camera.baseline_m,
            "saturation_radiance": images.saturation_radiance, "saturated": images.saturated,
            "true": float(known.mean()), "visible": float(visible.sum() / known.sum()) if some else None,
            "depth_m": [float(q) for q in np.quantile(truth[known], (0, 0.5, 1))] if some else None,
            "settings": settings, "rendered": {key: pair.data[key] for key in _REPEATED if key in pair.data}}
