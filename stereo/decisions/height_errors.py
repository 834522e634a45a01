"""Standard deviations of the heights, slopes and roughnesses of a map: a stated shape times one scale of a matcher.

The shape follows from the elevation model alone, for any matcher. The error of a height is proportional to the
variation of the heights within the cells around it, see ``cell_errors``; the error of a filled cell follows from its
ring. The scale is measured on grounds of known heights. With it, the shares of errors within one and two standard
deviations differ least from the shares of normal errors, where each ground counts once. So the scale is right on
average over grounds, although the errors may not be normal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...support.arrays import Array
from ...support.number_text import format_count
from ..inference.scene_means import find_mean_intervals
from .cell_errors import CellErrors, average_square_coordinate, pool_errors
from .dem import Dem

#: Quantities of a map, by the names of files and tables.
QUANTITIES = ("height", "slope", "roughness")
#: Shares of normal errors within one and two standard deviations.
NORMAL_SHARES = (0.6827, 0.9545)
#: Ratios of error to shape up to which cells are counted.
RATIOS = tuple(float(each) for each in np.geomspace(0.01, 1000.0, 231))
#: Scales from which one is chosen.
_SCALES = np.geomspace(RATIOS[0], RATIOS[-1] / 2, 5001)
#: Least error of a shape, m or degrees: exact heights have none.
_LEAST = 1e-6


@dataclass(frozen=True)
class ErrorShape:
    """Errors of a map up to a scale, arrays (rows, columns), NaN where unknown.

    Heights and roughness are in m, slopes in degrees.
    """

    height: Array
    slope: Array
    roughness: Array

    def scaled(self, scales: Mapping[str, float | None]) -> dict[str, Array]:
        """Return the standard deviations, float32, of the quantities that have a scale."""
        return {
            name: (scale * getattr(self, name)).astype(np.float32)
            for name in QUANTITIES
            if (scale := scales.get(name)) is not None
        }


def state_shape(dem: Dem, errors: CellErrors, slope_deg: Array, disc_m: float) -> ErrorShape:
    """Return the errors of a map up to a scale.

    By least squares a slope errs by √(σ²/(nq)) along its direction, where σ² is the mean variance of the heights under
    the footprint of n cells and q the mean square of a coordinate, see ``cell_errors``. The error of a roughness is
    proportional to σ.
    """
    pooled, effective, _ = pool_errors(dem, errors, disc_m)
    noise = np.maximum(pooled, 0.0)  # sums under footprints are rounded
    rise = np.sqrt(noise / (effective * average_square_coordinate(disc_m, dem.grid.cell_m)))
    variance = np.where(errors.filled, errors.filled_variance_m2, errors.variance_m2)
    found = np.sqrt(variance), np.degrees(rise * np.cos(np.radians(slope_deg)) ** 2), np.sqrt(noise)
    return ErrorShape(*(np.maximum(each, _LEAST) for each in found))


def count_errors(error: Array, shape: Array, among: Array) -> dict[str, Any]:
    """Count the ``cells`` of ``among`` with a known error, and the number ``within`` each of ``RATIOS`` times the
    shape.
    """
    ratio = np.abs(error[among]) / shape[among]
    ratio = np.sort(ratio[np.isfinite(ratio)])
    return {"cells": int(ratio.size), "within": [int(n) for n in np.searchsorted(ratio, RATIOS, side="right")]}


def fit_scales(grounds: Sequence[Sequence[Mapping[str, Any]]]) -> dict[str, float | None]:
    """Fit the scale of each quantity to the ``numbers`` of the rows of each ground.

    A scale is None without a known error, and if too many errors are beyond all ``RATIOS``.
    """
    found: dict[str, float | None] = {}
    for name in QUANTITIES:
        shares = _average_shares(grounds, name)
        mean = shares.mean(axis=0) if len(shares) else np.zeros(len(RATIOS))
        off = np.abs(_read_shares(mean, _SCALES) / NORMAL_SHARES - 1).max(axis=1)
        found[name] = float(_SCALES[off.argmin()]) if mean[-1] >= NORMAL_SHARES[1] else None
    return found


def _read_shares(within: Array, scales: Array) -> Array:
    """Read the shares (scales, 2) of errors within one and two standard deviations from the shares ``within`` each
    ratio.
    """
    return np.stack([np.interp(np.log(k * scales), np.log(RATIOS), within) for k in (1, 2)], axis=1)


def check_scale(grounds: Sequence[Sequence[Mapping[str, Any]]], name: str, scale: float) -> dict[str, Any] | None:
    """Return the shares of errors within one and two standard deviations, with 95 % intervals over grounds.

    None without a known error.
    """
    shares = _average_shares(grounds, name)
    if not len(shares):
        return None
    values = np.concatenate([_read_shares(each, np.array([scale])) for each in shares])
    bounds = find_mean_intervals(values, np.arange(len(values)), np.array([True, True]))
    return {
        "grounds": len(values),
        "within": values.mean(axis=0).tolist(),
        "bounds": [[None if np.isnan(each) else float(each) for each in pair] for pair in bounds],
    }


def _average_shares(grounds: Sequence[Sequence[Mapping[str, Any]]], name: str) -> Array:
    """Return the shares (grounds, ratios) of errors within each ratio.

    They are averaged over the pairs of each ground with a known error.
    """
    found = []
    for own in grounds:
        counts = [each["errors"][name] for each in own if each["errors"][name]["cells"]]
        if counts:
            found.append(np.mean([np.array(each["within"]) / each["cells"] for each in counts], axis=0))
    return np.array(found).reshape(-1, len(RATIOS))


def make_check_sentence(name: str, who: str, found: Mapping[str, Any]) -> str:
    """Describe the result of ``check_scale`` in a sentence."""
    shown = [
        f"{100 * share:.0f} %" + ("" if low is None or high is None else f" ({100 * low:.0f} to {100 * high:.0f})")
        for share, (low, high) in zip(found["within"], found["bounds"], strict=True)
    ]
    return (
        f"With {who}, the {name} errs by less than one stated standard deviation in {shown[0]} of the cells and by "
        f"less than two in {shown[1]}; normal errors have 68 % and 95 % ({format_count(found['grounds'], 'ground')})."
    )
