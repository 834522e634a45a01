"""What a cheaper way of computing a scene does to its images, to its truth and to what matchers make of them.

Everything is against a reference of the same scene: its radiance, its depth, its exposure. A matcher is measured
against the reference's depth too, so an error of the ground's mesh counts as well as noise.

A reference has noise too, and a matcher errs for it. A small error of noise grows with the noise's variance, so with
one over the light paths; from n renders the reference's mean errs by 1 / (n - 1) of what a single render errs more
than the mean. That is taken off, so a loss is against an image without noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import IcyMoonError
from ...render.pairs.pair_folder import EYES, Pair
from ...settings.description import Settings, merged
from ..images.develop import develop, grey
from ..images.exr import Light
from ..matchers import match
from ..matchers.methods import Method
from ..measure.jackknife import jackknife, tile_sums
from ..measure.metrics import usable
from ..measure.prepare import Loaded, load, none_for_nan

#: What is said of a matcher: share of the pixels that both eyes see with a measurement; of these the mean disparity
#: error, px, and the share that is off by more than 1 px; share of all that are missing or off by more than 1 px.
STEREO = ("coverage", "epe_px", "bad_1", "wrong_or_missing")
#: Which way is worse.
_WORSE = np.array([-1.0, 1.0, 1.0, 1.0])
#: What is taken off for the reference's noise may be off by so much of itself: an error that grows with the noise, not
#: with its variance, as where noise is all there is, would be 1 / (√2 - 1) = 2.4 times what two renders tell.
_LAW_DOUBT = 1.4


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
    tallies: dict[str, np.ndarray]  # per matcher, (1 + renders, tiles, 4) of ``tally``: of the mean, of each render

    @property
    def stereo(self) -> dict[str, dict[str, float | None]]:
        """What STEREO names of each matcher on the reference's own images."""
        return {label: _named(stereo_numbers(sums[0].sum(axis=0))) for label, sums in self.tallies.items()}

    @property
    def own(self) -> dict[str, dict[str, float | None]]:
        """How much of that is worse for the reference's noise."""
        return {label: _named(_noise_loss(sums.sum(axis=1))) for label, sums in self.tallies.items()}


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
    untallied = Reference(first.pair, exposed, light, first.depth["left"], first.visible["left"],
                          _noise(renders) / len(renders) ** 0.5 / mean,
                          cost and len(renders) * cost, {})
    seen = [light, *(render.light for render in renders if len(renders) > 1)]
    return replace(untallied, tallies=_tally_images(untallied, seen, methods))


def measure(folders: Sequence[Path], reference: Reference, methods: Sequence[Method]) -> dict[str, Any]:
    """One variant, from its renders, against the reference.

    * ``cpu_s``, ``wall_s``: of a pair, mean of the renders, building the scene and writing included, and in ``cpu_s``
      (for a process that renders one pair) the start of Blender; ``memory_mib``: the most that a process held.
    * ``bias``: mean radiance over the reference's, less 1; ``rmse``: root mean square difference of a pixel from the
      reference over its mean, the reference's own noise taken off; ``noise``: its random part, the standard deviation
      between renders over the mean, None of a single render; ``structure``: its other part.
    * ``depth_px``: 95th percentile of the difference of the true depths, as disparity; ``depth_m``: their median.
    * ``stereo``: per matcher what STEREO names, mean of the renders; ``loss``: how much worse that is than on an image
      without noise, as the module says.
    * ``bias_doubt``, ``loss_doubt``: what these may be off by, in 19 of 20 cases, for noise: two standard errors over
      tiles of the image (``tiles.jackknife``), and for a loss what the law of the reference's noise may be off by.
    * ``cpu_range``: the least and the most of ``cpu_s``.

    All are fractions but where a unit is named. Raises IcyMoonError if a render cannot be read or is of another view.
    """
    renders = [load(folder, {}) for folder in folders]
    for render in renders:
        if render.pair.camera != reference.pair.camera:
            raise IcyMoonError(f"{render.pair.folder} has another camera than {reference.pair.folder}; render both "
                               "again.")
    tallies = _tally_images(reference, [render.light for render in renders], methods)
    losses = {label: _loss(sums, reference.tallies[label]) for label, sums in tallies.items()}
    return {**_cost(renders), **_radiance(renders, reference), **_depth(renders[0], reference),
            "stereo": {label: _named(stereo_numbers(sums.sum(axis=1)).mean(axis=0)) for label, sums in tallies.items()},
            "loss": {label: _named(loss) for label, (loss, _) in losses.items()},
            "loss_doubt": {label: _named(doubt) for label, (_, doubt) in losses.items()}}


def _cost(renders: Sequence[Loaded]) -> dict[str, Any]:
    facts = [render.pair.data for render in renders]
    cpu = [sum(each["cpu_seconds"].values()) for each in facts if "cpu_seconds" in each]
    return {"cpu_s": _mean(cpu), "cpu_range": [min(cpu), max(cpu)] if cpu else None,
            "wall_s": _mean([sum(each.get("seconds", {}).values()) for each in facts]),
            "memory_mib": max((each["peak_memory_mib"] for each in facts if each.get("peak_memory_mib")), default=None)}


def _radiance(renders: Sequence[Loaded], reference: Reference) -> dict[str, float | None]:
    true = grey(reference.light["left"].radiance)
    mean = float(true.mean())
    lights = [grey(render.light["left"].radiance) for render in renders]
    square = float(np.mean([np.mean((light - true) ** 2) for light in lights])) / mean ** 2 - reference.noise ** 2
    noise = _noise(renders) / mean if len(renders) > 1 else None
    _, error = jackknife(lambda sums: sums[..., :1] / sums[..., 1:] - 1, tile_sums(np.mean(lights, axis=0), true))
    return {"bias": float(np.mean(lights)) / mean - 1, "bias_doubt": none_for_nan(2 * float(error[0])),
            "rmse": max(square, 0.0) ** 0.5, "noise": noise,
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


def _tally_images(reference: Reference, lights: Sequence[Mapping[str, Light]],
             methods: Sequence[Method]) -> dict[str, np.ndarray]:
    """Per matcher, sums (images, tiles, 4) over images of the reference's exposure, against the reference's depth
    where both eyes see: pixels, of these measured, their disparity error in px, of these off by more than 1 px."""
    true = np.where(reference.visible, reference.pair.camera.disparity(reference.depth), np.nan)
    images = [develop(reference.pair, light["left"], light["right"], reference.settings).for_matchers()
              for light in lights]
    return {method.label: np.stack([tally(match(method.name, left, right, method.options, reference.pair.camera)[0],
                                           true) for left, right in images]) for method in methods}


def tally(disparity: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Sums (tiles, 4) over an image's tiles, disparities (H, W) in px and NaN where there is none: pixels that are
    true, of these measured, their disparity error in px, of these off by more than 1 px."""
    known = np.isfinite(true)
    measured = known & usable(disparity)
    error = np.where(measured, np.abs(disparity - true), 0.0)
    return tile_sums(known, measured, error, error > 1)


def stereo_numbers(sums: np.ndarray) -> np.ndarray:
    """What STEREO names (..., 4), of sums (..., 4) of ``tally``; NaN where it is not defined."""
    known, measured, error, bad = np.moveaxis(sums, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([measured / known, error / measured, bad / measured, 1 - (measured - bad) / known], axis=-1)


def _noise_loss(sums: np.ndarray) -> np.ndarray:
    """How much worse a reference is for its own noise, of sums (1 + renders, ..., 4): see the module."""
    if len(sums) < 3:
        return np.zeros_like(sums[0])
    whole, *each = stereo_numbers(sums)
    return _WORSE * (np.mean(each, axis=0) - whole) / (len(each) - 1)


def _loss(sums: np.ndarray, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How much worse a variant is than an image without noise, (4,), and what that may be off by."""
    def loss_of(own: np.ndarray, best: np.ndarray) -> np.ndarray:
        return _WORSE * (stereo_numbers(own).mean(axis=0) - stereo_numbers(best[0])) + _noise_loss(best)

    loss, error = jackknife(loss_of, sums, reference)
    return loss, np.hypot(2 * error, _LAW_DOUBT * _noise_loss(reference.sum(axis=1)))


def _named(numbers: np.ndarray) -> dict[str, float | None]:
    return {key: none_for_nan(float(value)) for key, value in zip(STEREO, numbers, strict=True)}


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def pareto_front(rows: Sequence[Mapping[str, Any]], cost: str, error: Sequence[str]) -> list[int]:
    """Places of the rows that no other beats in both cost and error, cheapest first.

    ``error`` is a path such as ("loss", "sgbm", "epe_px"); rows without a number there have no place.
    """
    points = [(number_at(row, cost), number_at(row, *error), k) for k, row in enumerate(rows)]
    best, found = float("inf"), []
    for _, wrong, k in sorted((a, b, k) for a, b, k in points if a is not None and b is not None):
        if wrong < best:
            best = wrong
            found.append(k)
    return found


def number_at(row: Mapping[str, Any], *path: str) -> float | None:
    """The number at a path such as "loss", "sgbm", "epe_px", or None if there is none."""
    value: Any = row
    for key in path:
        value = value.get(key) if isinstance(value, Mapping) else None
    return float(value) if isinstance(value, (int, float)) and np.isfinite(value) else None
