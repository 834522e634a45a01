"""The changes from a cheaper rendering of a scene: in its images, its truth, and the errors of matchers.

All numbers are relative to a reference of the same scene: its radiance, its depth, its exposure. Matchers are measured
against the depth of the reference, so errors of the mesh count as well as noise.

The reference has noise too, which adds to the errors of matchers. A small error from noise is proportional to its
variance, and so to 1 / (number of light paths). If a single render errs by d more than the mean of n renders, noise
adds d / (n - 1) to the error of this mean. This error is subtracted, so a loss is relative to an image without noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.scene_requirements import count_images_per_bake
from ...render.pairs.pair_folder import EYES, Pair
from ...settings.description import merged
from ...settings.topics.scene import Settings
from ...settings.topics.trust_boundary import split_lidar
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..decisions.rules import Rules
from ..fusion.fuse import match_method
from ..images.develop import average_bands, develop
from ..images.exr import Light
from ..matchers.methods import Method
from ..matchers.search_range import find_known_ranges
from ..measure.jackknife import jackknife, sum_over_tiles
from ..measure.metrics import is_usable
from ..measure.prepare_pair import LoadedPair, load_pair, none_if_not_finite
from .same_decisions import DecisionReference, MatchedRender, open_decision_reference

#: The numbers of a matcher, over pixels that both eyes see: the share that is measured; over measured pixels the mean
#: disparity error, px, and the share wrong by more than 1 px; the share that is missing or wrong by more than 1 px.
STEREO_KEYS = ("coverage", "epe_px", "bad_1", "wrong_or_missing")
#: The sign of a change for the worse.
_WORSE_SIGNS = np.array([-1.0, 1.0, 1.0, 1.0])
#: Relative uncertainty of the subtracted noise of the reference. If noise is the only error, errors are proportional to
#: the noise, not to its variance, and 1 / (√2 - 1) = 2.4 times the difference of two renders.
_LAW_DOUBT = 1.4


@dataclass(frozen=True)
class Reference:
    """The reference of a scene: the mean of its renders, and its noise."""

    pair: Pair
    settings: Settings  # with the exposure that was metered for the reference
    light: dict[str, Light]
    depth: Array  # float64 (H, W) of the left eye, m, NaN for sky
    visible: Array  # bool (H, W)
    noise: float  # standard deviation of the mean of the renders, over its mean radiance
    cpu_s: float | None  # processor seconds of all renders
    tallies: dict[str, Array]  # per matcher, (1 + renders, tiles, 4) of ``tally_errors``: of the mean, of each render
    # The decisions of matchers on the mean of the renders, or the reason why there are none.
    deciding: DecisionReference | str
    own_decisions: dict[str, dict[str, Any]]  # differences of the decisions on each render from these

    @property
    def stereo(self) -> dict[str, dict[str, float | None]]:
        """The STEREO_KEYS numbers of each matcher on the images of the reference."""
        return {
            label: _name_numbers(compute_stereo_numbers(sums[0].sum(axis=0))) for label, sums in self.tallies.items()
        }

    @property
    def own(self) -> dict[str, dict[str, float | None]]:
        """The increase of the ``stereo`` numbers by the noise of the reference."""
        return {label: _name_numbers(_compute_loss_by_noise(sums.sum(axis=1))) for label, sums in self.tallies.items()}


def read_reference(
    folders: Sequence[Path],
    methods: Sequence[Method],
    response: Mapping[str, Mapping[str, Any]],
    rules: Rules | None = None,
) -> Reference:
    """Read the reference from its renders, which differ only by their noise. With ``rules``, decisions are compared
    too.

    Raises IcyMoonError if a render cannot be read, or if the scene is black.
    """
    renders = [load_pair(folder, response) for folder in folders]
    first, light = renders[0], average_light(renders)
    mean = float(average_bands(light["left"].radiance).mean())
    if not mean > 0:
        raise IcyMoonError(f"{folders[0]} is black, so it cannot be compared; put the Sun above the horizon.")
    exposed = merged(first.settings, {"sensor": {"auto_exposure": False, "exposure_s": first.images.exposure_s}})
    cost = _measure_cost(renders)["cpu_s"]
    untallied = Reference(
        first.pair,
        exposed,
        light,
        first.depth["left"],
        first.visible["left"],
        _measure_noise(renders) / len(renders) ** 0.5 / mean,
        cost and len(renders) * cost,
        {},
        "Decisions were not asked for.",
        {},
    )
    matched = _match_images(untallied, [light, *(render.light for render in renders if len(renders) > 1)], methods)
    tallied = replace(untallied, tallies=_tally_matches(untallied, matched, methods))
    if rules is None:
        return tallied
    deciding = open_decision_reference(folders[0], matched[0], rules)
    own = {} if isinstance(deciding, str) or len(matched) < 2 else deciding.compare(matched[1:])
    return replace(tallied, deciding=deciding, own_decisions=own)


def average_light(renders: Sequence[LoadedPair]) -> dict[str, Light]:
    """Average renders of the same view, by eye, without their light groups."""
    return {
        eye: replace(
            renders[0].light[eye],
            groups={},
            radiance=np.mean([render.light[eye].radiance for render in renders], axis=0, dtype=np.float64).astype(
                np.float32
            ),
        )
        for eye in EYES
    }


def measure_variant(
    folders: Sequence[Path], reference: Reference, methods: Sequence[Method], images: int = 1
) -> dict[str, Any]:
    """Measure one variant, from its renders, against the reference. ``images`` images share the bake of their light.

    * ``cpu_s``, ``wall_s``: seconds of a pair, mean of the renders, including building the scene and writing. ``cpu_s``
      also includes the start of Blender, if a process renders one pair, and a share of the seconds of baking its light.
      ``memory_mib``: the peak memory of a process. ``megabytes``: the size of a pair's files.
    * ``bias``: mean radiance divided by the reference's mean radiance, minus 1. ``rmse``: root mean square difference
      of a pixel from the reference, divided by the reference's mean, without the noise of the reference. ``noise``: the
      random part of ``rmse``, the standard deviation between renders divided by the mean; None for a single render.
      ``structure``: the other part.
    * ``depth_px``: 95th percentile of the difference of the true depths, as disparity; ``depth_m``: its median in m.
    * ``stereo``: per matcher the STEREO_KEYS numbers, mean of the renders. ``loss``: their increase for the worse over
      an image without noise, see the module.
    * ``bias_doubt``, ``loss_doubt``: uncertainty of ``bias`` and ``loss`` from noise, in 19 of 20 cases: two standard
      errors over tiles of the image (``jackknife``) and, for a loss, the uncertainty of the amount that is subtracted
      for the reference's noise.
    * ``fused``: per method that joins a matcher with range points, if the matcher alone (``plain``) is among
      ``methods`` too: its ``loss`` over the matcher alone on an image without noise, and the ``doubt`` of this loss.
    * ``decisions``: per matcher the differences of its decisions from those on the reference, see
      ``same_decisions.DecisionReference``; empty where they are not compared.
    * ``cpu_range``: the smallest and the largest ``cpu_s``.

    All are fractions unless a unit is named. Raises IcyMoonError if a render cannot be read or shows another view.
    """
    renders = [load_pair(folder, {}) for folder in folders]
    for render in renders:
        if render.pair.camera != reference.pair.camera:
            raise IcyMoonError(
                f"{render.pair.folder} and {reference.pair.folder} have different cameras; render both again."
            )
    matched = _match_images(reference, [render.light for render in renders], methods)
    tallies = _tally_matches(reference, matched, methods)
    losses = {label: _compute_loss_of_variant(sums, reference.tallies[label]) for label, sums in tallies.items()}
    return {
        **_measure_cost(renders, images),
        **_compare_radiance(renders, reference),
        **_compare_depth(renders[0], reference),
        "stereo": {
            label: _name_numbers(compute_stereo_numbers(sums.sum(axis=1)).mean(axis=0))
            for label, sums in tallies.items()
        },
        "loss": {label: _name_numbers(loss) for label, (loss, _) in losses.items()},
        "loss_doubt": {label: _name_numbers(doubt) for label, (_, doubt) in losses.items()},
        "fused": {
            fused: _compare_with_plain(tallies[fused], plain, reference.tallies[plain])
            for fused, plain in find_plain_methods([method.label for method in methods]).items()
        },
        "decisions": {} if isinstance(reference.deciding, str) else reference.deciding.compare(matched),
    }


def _measure_cost(renders: Sequence[LoadedPair], images: int = 1) -> dict[str, Any]:
    facts = [render.pair.data for render in renders]
    cpu = [
        sum(pair.data["cpu_seconds"].values()) + read_bake_seconds(pair) / count_images_per_bake(pair.settings, images)
        for pair in (render.pair for render in renders)
        if "cpu_seconds" in pair.data
    ]
    return {
        "cpu_s": _average_known(cpu),
        "cpu_range": [min(cpu), max(cpu)] if cpu else None,
        "wall_s": _average_known([sum(each.get("seconds", {}).values()) for each in facts]),
        "memory_mib": max((each["peak_memory_mib"] for each in facts if each.get("peak_memory_mib")), default=None),
        "megabytes": _average_known(
            [sum(file["bytes"] for file in each["files"].values()) / 1e6 for each in facts if each.get("files")]
        ),
    }


def read_bake_seconds(pair: Pair) -> float:
    """Read the processor seconds of baking the light of a pair."""
    lights = pair.data.get("indirect", {}).get("lights", {})
    return sum(float(light["cpu_seconds_of_bake"]) for light in lights.values())


def _compare_radiance(renders: Sequence[LoadedPair], reference: Reference) -> dict[str, float | None]:
    true = average_bands(reference.light["left"].radiance)
    mean = float(true.mean())
    lights = [average_bands(render.light["left"].radiance) for render in renders]
    square = float(np.mean([np.mean((light - true) ** 2) for light in lights])) / mean**2 - reference.noise**2
    noise = _measure_noise(renders) / mean if len(renders) > 1 else None
    _, error = jackknife(lambda sums: sums[..., :1] / sums[..., 1:] - 1, sum_over_tiles(np.mean(lights, axis=0), true))
    return {
        "bias": float(np.mean(lights)) / mean - 1,
        "bias_doubt": none_if_not_finite(2 * float(error[0])),
        "rmse": max(square, 0.0) ** 0.5,
        "noise": noise,
        "structure": max(square - noise**2, 0.0) ** 0.5 if noise is not None else None,
    }


def _measure_noise(renders: Sequence[LoadedPair]) -> float:
    """Measure the standard deviation of the radiance of a pixel between renders, root mean square over the left image;
    0 for a single render.
    """
    if len(renders) < 2:
        return 0.0
    return (
        float(np.mean(np.var([average_bands(render.light["left"].radiance) for render in renders], axis=0, ddof=1)))
        ** 0.5
    )


def _compare_depth(render: LoadedPair, reference: Reference) -> dict[str, float | None]:
    depth = render.depth["left"]
    both = np.isfinite(depth) & np.isfinite(reference.depth)
    if not both.any():
        return {"depth_px": None, "depth_m": None}
    camera = reference.pair.camera
    off = np.abs(camera.disparity(depth[both]) - camera.disparity(reference.depth[both]))
    return {
        "depth_px": float(np.quantile(off, 0.95)),
        "depth_m": float(np.median(np.abs(depth - reference.depth)[both])),
    }


def _match_images(
    reference: Reference, lights: Sequence[Mapping[str, Light]], methods: Sequence[Method]
) -> list[MatchedRender]:
    """Run matchers on images with the exposure of the reference; return the disparities of each image."""
    images = [
        develop(reference.pair, light["left"], light["right"], reference.settings).for_matchers() for light in lights
    ]
    ranges = find_known_ranges(
        reference.pair.settings, _find_true_disparity(reference), bool(reference.pair.data.get("edited_by_hand"))
    )
    return [
        MatchedRender(
            left,
            {
                method.label: match_method(
                    method, left, right, reference.pair.camera, ranges, reference.pair, reference.depth
                )[0]
                for method in methods
            },
        )
        for left, right in images
    ]


def _tally_matches(
    reference: Reference, matched: Sequence[MatchedRender], methods: Sequence[Method]
) -> dict[str, Array]:
    """Tally the errors of each matcher against the depth of the reference where both eyes see: (images, tiles, 4), see
    ``tally_errors``.
    """
    true = _find_true_disparity(reference)
    return {
        method.label: np.stack([tally_errors(each.disparities[method.label], true) for each in matched])
        for method in methods
    }


def _find_true_disparity(reference: Reference) -> Array:
    return np.where(reference.visible, reference.pair.camera.disparity(reference.depth), np.nan)


def tally_errors(disparity: Array, true: Array) -> Array:
    """Sum over the tiles of an image, (tiles, 4), from disparities (H, W) in px, NaN where unknown: the number of true
    pixels, the number of these that are measured, their disparity error in px, and the number wrong by more than 1 px.
    """
    known = np.isfinite(true)
    measured = known & is_usable(disparity)
    error = np.where(measured, np.abs(disparity - true), 0.0)
    return sum_over_tiles(known, measured, error, error > 1)


def compute_stereo_numbers(sums: Array) -> Array:
    """Compute the STEREO_KEYS numbers (..., 4) from sums (..., 4) of ``tally_errors``; NaN where undefined."""
    known, measured, error, bad = np.moveaxis(sums, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([measured / known, error / measured, bad / measured, 1 - (measured - bad) / known], axis=-1)


def _compute_loss_by_noise(sums: Array) -> Array:
    """Compute the increase of a reference's errors by its own noise, from sums (1 + renders, ..., 4); see the
    module.
    """
    if len(sums) < 3:
        return np.zeros_like(sums[0])
    whole, *each = compute_stereo_numbers(sums)
    return _WORSE_SIGNS * (np.mean(each, axis=0) - whole) / (len(each) - 1)


def _compute_loss_of_variant(sums: Array, reference: Array) -> tuple[Array, Array]:
    """Compute the increase of a variant's errors over an image without noise, (4,), and its uncertainty."""

    def loss_of(own: Array, best: Array) -> Array:
        return _WORSE_SIGNS * (
            compute_stereo_numbers(own).mean(axis=0) - compute_stereo_numbers(best[0])
        ) + _compute_loss_by_noise(best)

    loss, error = jackknife(loss_of, sums, reference)
    return loss, np.hypot(2 * error, _LAW_DOUBT * _compute_loss_by_noise(reference.sum(axis=1)))


def find_plain_methods(labels: Sequence[str]) -> dict[str, str]:
    """Find the methods that join a matcher with range points, each with the label of the matcher alone. Both must be
    among ``labels``.
    """
    found = {label: split_lidar(label) for label in labels}
    return {
        label: matcher
        for label, (matcher, points) in found.items()
        if points is not None and matcher in found and found[matcher][1] is None
    }


def _compare_with_plain(sums: Array, plain: str, reference: Array) -> dict[str, Any]:
    loss, doubt = _compute_loss_of_variant(sums, reference)
    return {"plain": plain, "loss": _name_numbers(loss), "doubt": _name_numbers(doubt)}


def _name_numbers(numbers: Array) -> dict[str, float | None]:
    return {key: none_if_not_finite(float(value)) for key, value in zip(STEREO_KEYS, numbers, strict=True)}


def _average_known(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def find_pareto_front(rows: Sequence[Mapping[str, Any]], error: Sequence[str]) -> list[int]:
    """Find the indices of the rows that no other beats in both CPU time and error, cheapest first.

    ``error`` is a path such as ("loss", "sgbm", "epe_px"); rows without a number there are left out.
    """
    points = [(find_number(row, "cpu_s"), find_number(row, *error), k) for k, row in enumerate(rows)]
    best, found = float("inf"), []
    for _, wrong, k in sorted((a, b, k) for a, b, k in points if a is not None and b is not None):
        if wrong < best:
            best = wrong
            found.append(k)
    return found


def find_number(row: Mapping[str, Any], *path: str) -> float | None:
    """Find the number at a path such as "loss", "sgbm", "epe_px"; None without it."""
    value: object = row
    for key in path:
        value = value.get(key) if isinstance(value, Mapping) else None
    return float(value) if isinstance(value, (int, float)) and np.isfinite(value) else None
