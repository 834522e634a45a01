"""What was dug out between two elevation models: volume and depth, with the least that can be told from noise.

Heights of neighbouring cells err together, so the error of a volume is not that of its cells over the root of their
number. It is measured on null pairs, in which nothing was dug, and which differ in all noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from .dem import Grid
from .footprints import make_disc, sum_under_footprint

#: Standard deviations of a difference beyond which a cell has changed, at 95 % (Lane et al. 2003).
_LEVEL = 1.96
#: Standard deviations of a volume that is noticed at 95 % with 5 % false alarms: twice 1.645.
NOTICED = 3.29
#: Fewest null pairs beside the first that tell a standard deviation: five, within a factor of three.
FEWEST_NULLS = 5
#: True changes of a cell below this are none; chosen far below what any matcher's heights tell.
UNCHANGED_M = 1e-4
#: Share of a region's cells that must be known in both models.
_LEAST_KNOWN = 0.5
#: Share of the lowered cells that lie above the depth that is stated: one flying cell is no depth.
_DEEPEST = 0.95


@dataclass(frozen=True)
class Change:
    """What left a region: ``volume_m3`` (negative where material came), ``depth_m`` and the share of cells known."""

    volume_m3: float
    depth_m: float
    known: float


def find_region_cells(grid: Grid, region_m: Sequence[float]) -> Array:
    """Boolean (rows, columns): cells whose centre is in [x_min, y_min, x_max, y_max], metres."""
    east, north = grid.centres()
    west, south, last_east, last_north = region_m
    return np.asarray((east >= west) & (east <= last_east) & (north >= south) & (north <= last_north))


def measure_change(before_m: Array, after_m: Array, region: Array, cell_m: float) -> Change | None:
    """The change of heights (rows, columns), NaN unknown, over *all* cells of a region.

    Summing only those beyond a level of detection would lose shallow cuts. Unknown cells count as the mean of the known
    ones. None if less than half of the region is known, or there is none.
    """
    lowered = (before_m - after_m)[region]
    known = np.isfinite(lowered)
    if not lowered.size or known.mean() < _LEAST_KNOWN:
        return None
    found = lowered[known]
    return Change(
        float(found.mean() * lowered.size * cell_m**2), float(np.quantile(found, _DEEPEST)), float(known.mean())
    )


def measure_local_sigma(error_m: Array, cell_m: float, diameter_m: float) -> Array:
    """The standard deviation of the heights of each cell about the truth (rows, columns), metres: the root mean square
    of the known errors in a disc around it, NaN where there is none."""
    known, around = np.isfinite(error_m), make_disc(diameter_m, cell_m)
    count = np.rint(sum_under_footprint(known, around))
    square = np.maximum(
        sum_under_footprint(np.where(known, error_m, 0.0) ** 2, around), 0.0
    )  # the filter may give less than 0
    return np.sqrt(np.divide(square, count, out=np.full(count.shape, np.nan), where=count > 0))


def find_detection_level(before_sigma_m: Array, after_sigma_m: Array) -> Array:
    """The level of detection of each cell at 95 %, metres, from the standard deviations of both heights."""
    return np.asarray(_LEVEL * np.hypot(before_sigma_m, after_sigma_m))


@dataclass(frozen=True)
class Detection:
    """Cells whose change is beyond their ``level_m`` (rows, columns), and how right they are."""

    level_m: Array
    changed_m: Array  # measured, positive where ground was taken; NaN where a height is not known

    @property
    def significant(self) -> Array:
        """Boolean (rows, columns)."""
        return np.asarray(np.abs(self.changed_m) > self.level_m)

    def score(self, true_m: Array) -> dict[str, float | None]:
        """``level_m``, its median over the known cells; of those that truly changed by more than their level, the
        share that is ``noticed``; of those that did not change, the share that is a ``false_alarm``. None where there
        is no such cell."""
        known = np.isfinite(self.changed_m) & np.isfinite(true_m) & np.isfinite(self.level_m)
        more, same = known & (np.abs(true_m) > self.level_m), known & (np.abs(true_m) < UNCHANGED_M)
        return {
            "level_m": float(np.median(self.level_m[known])) if known.any() else None,
            "noticed": float(self.significant[more].mean()) if more.any() else None,
            "false_alarm": float(self.significant[same].mean()) if same.any() else None,
        }


def detect_change(
    before_m: Array,
    after_m: Array,
    truth_before_m: Array,
    truth_after_m: Array,
    cell_m: float,
    diameter_m: float,
) -> Detection:
    """Which cells changed beyond the errors of two elevation models (rows, columns) against their truths."""
    sigmas = [
        measure_local_sigma(found - true, cell_m, diameter_m)
        for found, true in ((before_m, truth_before_m), (after_m, truth_after_m))
    ]
    return Detection(find_detection_level(*sigmas), before_m - after_m)


@dataclass(frozen=True)
class VolumeNoise:
    """Volumes of null pairs: their mean, their standard deviation, and the smallest volume that is noticed, m3."""

    bias_m3: float
    sigma_m3: float
    smallest_m3: float
    bounds_m3: tuple[float, float]  # of the smallest volume, at 95 %: few pairs tell a standard deviation badly
    pairs: int


def find_volume_noise(volumes_m3: Sequence[float]) -> VolumeNoise | None:
    """What null pairs tell of a volume; None of fewer than ``FEWEST_NULLS``. The volumes are differences to one common
    model, whose own error they share, so it is estimated from them: a difference of two has twice the variance of one.
    """
    if len(volumes_m3) < FEWEST_NULLS:
        return None
    values = np.asarray(volumes_m3, np.float64)
    sigma, free = math.sqrt(2.0) * float(values.std(ddof=1)), len(values) - 1
    low, high = (NOTICED * sigma * math.sqrt(free / _chi_square_quantile(free, z)) for z in (_LEVEL, -_LEVEL))
    return VolumeNoise(float(values.mean()), sigma, NOTICED * sigma, (low, high), len(values))


def _chi_square_quantile(free: int, z: float) -> float:
    """The quantile of chi-square at the normal deviate ``z`` (Wilson and Hilferty 1931): from four degrees of freedom
    on its root is within 4 % at both ends of 95 %."""
    return float(free * (1 - 2 / (9 * free) + z * math.sqrt(2 / (9 * free))) ** 3)
