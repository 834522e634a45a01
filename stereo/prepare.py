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
from .develop import Images, develop, exposure_facts, grey
from .exr import View, read_view
from .truth import photometric_disagreement, scene_depth, visible_in_right

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
    scale: pictures.Scale  # for pictures of depth
    facts: dict[str, Any]  # what the report says of the pair


def prepare(folder: Path, response: Mapping[str, Mapping[str, Any]]) -> Prepared:
    """Check, read and develop one pair; ``response`` overrides settings that need no new render.

    Raises IcyMoonError, naming the file, if anything in the folder is not as it was rendered.
    """
    pair, settings = checked(folder)
    left, right = (_view(pair, eye) for eye in EYES)
    settings = merged(settings, response)
    images = develop(pair, left, right, settings)
    truth = scene_depth(left)
    visible = visible_in_right(truth, scene_depth(right), pair.camera)
    disagreement = photometric_disagreement(grey(left.radiance), grey(right.radiance), truth, visible, pair.camera)
    scale = pictures.depth_scale(truth)
    facts = _facts(pair, settings, images, truth, visible)
    facts |= {"depth_scale_m": [scale.low, scale.high], "photometric_disagreement": none_for_nan(disagreement)}
    return Prepared(pair, *images.for_matchers(), truth, visible, scale, facts)


def none_for_nan(value: float) -> float | None:
    """The number, or None, which is JSON's null, where it is not finite."""
    return value if math.isfinite(value) else None


def checked(folder: Path) -> tuple[Pair, Settings]:
    """A pair whose files are as they were rendered, and its complete settings. Raises IcyMoonError otherwise."""
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


def _facts(pair: Pair, settings: Settings, images: Images, truth: np.ndarray, visible: np.ndarray) -> dict[str, Any]:
    known = np.isfinite(truth)
    some = bool(known.any())
    return {"pair": pair.folder.name, "width_px": pair.camera.width_px, "height_px": pair.camera.height_px,
            "focal_baseline_px_m": pair.camera.focal_baseline_px_m, "baseline_m": pair.camera.baseline_m,
            **exposure_facts(images),
            "true": float(known.mean()), "visible": float(visible.sum() / known.sum()) if some else None,
            "depth_m": [float(q) for q in np.quantile(truth[known], (0, 0.5, 1))] if some else None,
            "settings": settings, "rendered": {key: pair.data[key] for key in _REPEATED if key in pair.data}}
