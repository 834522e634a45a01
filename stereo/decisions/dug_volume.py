"""Excavated volume and depth from two elevation models, and the smallest change that is detectable above the noise.

Errors of neighbouring cells correlate, so the error of a volume is larger than independent cells would give. The error
is measured on null pairs, in which nothing was dug and all noise differs.
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
_DETECTION_DEVIATIONS = 1.96
#: Standard deviations of a volume that is detected in 95 % of cases with 5 % false alarms: twice 1.645.
NOTICED_DEVIATIONS = 3.29
#: Fewest null pairs besides the first for a standard deviation. Five give it within a factor of three.
FEWEST_NULL_PAIRS = 5
#: True changes of a cell below this count as none. It is far below the precision of matchers' heights.
UNCHANGED_M = 1e-4
#: Least share of a region's cells that must be known in both models.
_MIN_KNOWN_SHARE = 0.5
#: Quantile of the lowered cells' depths that counts as the depth, so that one outlier cannot set it.
_DEPTH_QUANTILE = 0.95


@dataclass(frozen=True)
class Change:
    """Material that left a region: ``volume_m3`` (negative for added material), ``depth_m``, and the ``known`` share of
    cells.
    """

    volume_m3: float
    depth_m: float
    known: float


def find_region_cells(grid: Grid, region_m: Sequence[float]) -> Array:
    """Find the cells (rows, columns), bool, whose centres are in [x_min, y_min, x_max, y_max], m."""
    east, north = grid.centres()
    west, south, last_east, last_north = region_m
    return np.asarray((east >= west) & (east <= last_east) & (north >= south) & (north <= last_north))


def measure_change(before_m: Array, after_m: Array, region: Array, cell_m: float) -> Change | None:
    """Measure the change of heights (rows, columns), m, NaN unknown, over *all* cells of a region.

    A sum over cells beyond a level of detection would lose shallow cuts. Unknown cells count as the mean of the known
    cells. None if the region is empty, or if less than half of it is known.
    """
    lowered = (before_m - after_m)[region]
    known = np.isfinite(lowered)
    if not lowered.size or known.mean() < _MIN_KNOWN_SHARE:
        return None
    found = lowered[known]
    return Change(
        float(found.mean() * lowered.size * cell_m**2), float(np.quantile(found, _DEPTH_QUANTILE)), float(known.mean())
    )


def measure_local_sigma(error_m: Array, cell_m: float, diameter_m: float) -> Array:
    """Return the standard deviation (rows, columns), m, of each cell's height about the truth.

    It is the root mean square of the known errors in a disc around the cell, NaN without known errors.
    """
    known, around = np.isfinite(error_m), make_disc(diameter_m, cell_m)
    count = np.rint(sum_under_footprint(known, around))
    square = np.maximum(
        sum_under_footprint(np.where(known, error_m, 0.0) ** 2, around), 0.0
    )  # the filter may give slightly less than 0
    return np.sqrt(np.divide(square, count, out=np.full(count.shape, np.nan), where=count > 0))


def find_detection_level(before_sigma_m: Array, after_sigma_m: Array) -> Array:
    """Return the level of detection (rows, columns), m, at 95 %, from the standard deviations of both heights."""
    return np.asarray(_DETECTION_DEVIATIONS * np.hypot(before_sigma_m, after_sigma_m))


@dataclass(frozen=True)
class Detection:
    """Changes of cells with their levels of detection ``level_m`` (rows, columns)."""

    level_m: Array
    changed_m: Array  # measured change, positive for removed ground; NaN for an unknown height

    @property
    def significant(self) -> Array:
        """The cells (rows, columns), bool, whose change exceeds its level of detection."""
        return np.asarray(np.abs(self.changed_m) > self.level_m)

    def score(self, true_m: Array) -> dict[str, float | None]:
        """Score the detection against the true changes ``true_m`` (rows, columns). A number is None without its cells.

        ``level_m`` is the median level of the known cells. ``noticed`` is the detected share of the cells that truly
        changed by more than their level. ``false_alarm`` is the share of unchanged cells with a detection.
        """
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
    """Detect the cells whose change exceeds the errors of two elevation models (rows, columns) from their truths."""
    sigmas = [
        measure_local_sigma(found - true, cell_m, diameter_m)
        for found, true in ((before_m, truth_before_m), (after_m, truth_after_m))
    ]
    return Detection(find_detection_level(*sigmas), before_m - after_m)


@dataclass(frozen=True)
class VolumeNoise:
    """Noise of the volumes of null pairs, m3: mean, standard deviation, and the smallest detectable volume."""

    bias_m3: float
    sigma_m3: float
    smallest_m3: float
    # Limits of the smallest volume at 95 %, because few pairs give an inexact standard deviation.
    bounds_m3: tuple[float, float]
    pairs: int


def find_volume_noise(volumes_m3: Sequence[float]) -> VolumeNoise | None:
    """Find the noise of a volume from null pairs; None with fewer than ``FEWEST_NULL_PAIRS``.

    All volumes are differences from one common model and share its error, so their spread is the error of a single
    model. A difference of two models has twice this variance.
    """
    if len(volumes_m3) < FEWEST_NULL_PAIRS:
        return None
    values = np.asarray(volumes_m3, np.float64)
    sigma, free = math.sqrt(2.0) * float(values.std(ddof=1)), len(values) - 1
    low, high = (
        NOTICED_DEVIATIONS * sigma * math.sqrt(free / _chi_square_quantile(free, z))
        for z in (_DETECTION_DEVIATIONS, -_DETECTION_DEVIATIONS)
    )
    return VolumeNoise(float(values.mean()), sigma, NOTICED_DEVIATIONS * sigma, (low, high), len(values))


def _chi_square_quantile(free: int, z: float) -> float:
    """Return the quantile of chi-square at the normal deviate ``z`` (Wilson and Hilferty 1931).

    From four degrees of freedom on, its root is within 4 % at both ends of 95 %.
    """
    return float(free * (1 - 2 / (9 * free) + z * math.sqrt(2 / (9 * free))) ** 3)
