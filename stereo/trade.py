"""What a cheaper way of computing a scene does to its images, to its truth and to what matchers make of them.

Everything is against a reference of the same scene: its radiance, its depth, its exposure. A matcher is measured
against the reference's depth too, so an error of the ground's mesh counts as well as noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import IcyMoonError
from ..render.pair import EYES, Pair
from ..settings import Settings, merged
from .develop import develop, grey
from .exr import Light
from .matchers import match
from .methods import Method
from .metrics import disparity_metrics
from .prepare import Loaded, load, none_for_nan

#: What is said of a matcher: share of the pixels that both eyes see with a measurement; of these the mean disparity
#: error, px, and the share that is off by more than 1 px; share of all that are missing or off by more than 1 px.
STEREO = ("coverage", "epe_px", "bad_1", "wrong_or_missing")


@dataclass(frozen=True)
class Reference:
    """The reference of a scene: the mean of its renders, and how well that is known."""

    pair: Pair
    settings: Settings  # exposed as the reference was metered, whatever is exposed with them
    light: dict[str, Light]
    depth: np.ndarray  # float64 (H, W) of the left eye, m, NaN for sky
    visible: np.ndarray  # bool (H, W)
    noise: float  # standard deviation over mean radiance, of the mean of the renders
    cpu_s: float | None  # of all renders
    stereo: dict[str, dict[str, float | None]]  # per matcher


def read_reference(folders: Sequence[Path], methods: Sequence[Method],
                   response: Mapping[str, Mapping[str, Any]]) -> Reference:
    """The reference from its renders, equal but for their noise.

    Raises IcyMoonError if a render cannot be read, or if the scene is black, of which nothing can be said.
    """
    renders = [load(folder, response) for folder in folders]
    first = renders[0]
    light = {eye: replace(first.light[eye], groups={}, radiance=np.mean(
        [render.light[eye].radiance for render in renders], axis=0, dtype=np.float64).astype(np.float32))
        for eye in EYES}
    mean = float(grey(light["left"].radiance).mean())
    if not mean > 0:
        raise IcyMoonError(f"{folders[0]} is black, so there is nothing to compare; put the Sun above the horizon.")
    exposed = merged(first.settings, {"sensor": {"auto_exposure": False, "exposure_s": first.images.exposure_s}})
    cost = _cost(renders)["cpu_s"]
    unmeasured = Reference(first.pair, exposed, light, first.depth["left"], first.visible["left"],
                           _noise(renders) / len(renders) ** 0.5 / mean,
                           cost and len(renders) * cost, {})
    return replace(unmeasured, stereo=_stereo(unmeasured, light, methods))


def measure(folders: Sequence[Path], reference: Reference, methods: Sequence[Method]) -> dict[str, Any]:
    """One variant, from its renders, against the reference.

    * ``cpu_s``, ``wall_s``: of a pair, mean of the renders, building the scene and writing included, and in ``cpu_s``
      (for a process that renders one pair) the start of Blender; ``memory_mib``: the most that a process held.
    * ``bias``: mean radiance over the reference's, less 1; ``rmse``: root mean square difference of a pixel from the
      reference over its mean, the reference's own noise taken off; ``noise``: its random part, the standard deviation
      between renders over the mean, None of a single render; ``structure``: its other part.
    * ``depth_px``: 95th percentile of the difference of the true depths, as disparity; ``depth_m``: their median.
    * ``stereo``: per matcher what STEREO names, mean of the renders; ``loss``: how much worse that is than on the
      reference's own images.

    All are fractions but where a unit is named. Raises IcyMoonError if a render cannot be read or is of another view.
    """
    renders = [load(folder, {}) for folder in folders]
    for render in renders:
        if render.pair.camera != reference.pair.camera:
            raise IcyMoonError(f"{render.pair.folder} has another camera than {reference.pair.folder}; render both "
                               "again.")
    stereo = [_stereo(reference, render.light, methods) for render in renders]
    mean_stereo = {method.label: {key: _mean([each[method.label][key] for each in stereo]) for key in STEREO}
                   for method in methods}
    return {**_cost(renders), **_radiance(renders, reference), **_depth(renders[0], reference), "stereo": mean_stereo,
            "loss": {label: {key: _difference(numbers[key], reference.stereo[label][key], key) for key in STEREO}
                     for label, numbers in mean_stereo.items()}}


def _cost(renders: Sequence[Loaded]) -> dict[str, float | None]:
    facts = [render.pair.data for render in renders]
    return {"cpu_s": _mean([sum(each["cpu_seconds"].values()) if "cpu_seconds" in each else None for each in facts]),
            "wall_s": _mean([sum(each.get("seconds", {}).values()) for each in facts]),
            "memory_mib": max((each["peak_memory_mib"] for each in facts if each.get("peak_memory_mib")), default=None)}


def _radiance(renders: Sequence[Loaded], reference: Reference) -> dict[str, float | None]:
    true = grey(reference.light["left"].radiance)
    mean = float(true.mean())
    lights = [grey(render.light["left"].radiance) for render in renders]
    square = float(np.mean([np.mean((light - true) ** 2) for light in lights])) / mean ** 2 - reference.noise ** 2
    noise = _noise(renders) / mean if len(renders) > 1 else None
    return {"bias": float(np.mean(lights)) / mean - 1, "rmse": max(square, 0.0) ** 0.5, "noise": noise,
            "structure": max(square - noise ** 2, 0.0) ** 0.5 if noise is not None else None}


def _noise(renders: Sequence[Loaded]) -> float:
    """Standard deviation of a pixel's radiance between renders, root mean square over the left image."""
    if len(renders) < 2:
        return 0.0
    return float(np.mean(np.var([grey(render.light["left"].radiance) for render in renders], axis=0, ddof=1))) ** 0.5


def _depth(render: Loaded, reference: Reference) -> dict[str, float | None]:
    depth = render.depth["left"]
    both = np.isfinite(depth) & np.isfinite(reference.depth)
    if not both.any():
        return {"depth_px": None, "depth_m": None}
    camera = reference.pair.camera
    off = np.abs(camera.disparity(depth[both]) - camera.disparity(reference.depth[both]))
    return {"depth_px": float(np.quantile(off, 0.95)),
            "depth_m": float(np.median(np.abs(depth - reference.depth)[both]))}


def _stereo(reference: Reference, light: Mapping[str, Light],
            methods: Sequence[Method]) -> dict[str, dict[str, float | None]]:
    """Each matcher on images of the reference's exposure, against the reference's depth where both eyes see."""
    left, right = develop(reference.pair, light["left"], light["right"], reference.settings).for_matchers()
    true = np.where(reference.visible, reference.pair.camera.disparity(reference.depth), np.nan)
    known = np.isfinite(true)
    found: dict[str, dict[str, float | None]] = {}
    for method in methods:
        disparity, _, _ = match(method.name, left, right, method.options, reference.pair.camera)
        numbers = disparity_metrics(disparity, true)
        coverage = float(np.mean(np.isfinite(disparity[known]))) if known.any() else float("nan")
        wrong = 1 - coverage * (1 - numbers["bad_1"]) if coverage > 0 else 1.0
        found[method.label] = {key: none_for_nan(value) for key, value in (
            ("coverage", coverage), ("epe_px", numbers["epe_px"]), ("bad_1", numbers["bad_1"]),
            ("wrong_or_missing", wrong if known.any() else float("nan")))}
    return found


def _difference(value: float | None, own: float | None, key: str) -> float | None:
    """How much worse; of coverage more is better."""
    if value is None or own is None:
        return None
    return own - value if key == "coverage" else value - own


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def front(rows: Sequence[Mapping[str, Any]], cost: str, error: Sequence[str]) -> list[int]:
    """Places of the rows that no other beats in both cost and error, cheapest first.

    ``error`` is a path such as ("loss", "sgbm", "epe_px"); rows without a number there have no place.
    """
    points = [(number(row, cost), number(row, *error), k) for k, row in enumerate(rows)]
    best, found = float("inf"), []
    for _, wrong, k in sorted((a, b, k) for a, b, k in points if a is not None and b is not None):
        if wrong < best:
            best = wrong
            found.append(k)
    return found


def number(row: Mapping[str, Any], *path: str) -> float | None:
    """The number at a path such as "loss", "sgbm", "epe_px", or None if there is none."""
    value: Any = row
    for key in path:
        value = value.get(key) if isinstance(value, Mapping) else None
    return float(value) if isinstance(value, (int, float)) and np.isfinite(value) else None
