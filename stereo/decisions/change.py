"""What was dug out between two elevation models: volume and depth, with the least that can be told from noise.

Heights of neighbouring cells err together, so the error of a volume is not that of its cells over the root of their
number. It is measured on null pairs, in which nothing was dug.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .dem import Grid

#: Standard deviations of a difference beyond which a cell has changed, at 95 % (Lane et al. 2003).
_LEVEL = 1.96
#: Standard deviations of a volume that is noticed at 95 % with 5 % false alarms: twice 1.645.
NOTICED = 3.29
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


def region_cells(grid: Grid, region_m: Sequence[float]) -> np.ndarray:
    """Boolean (rows, columns): cells whose centre is in [x_min, y_min, x_max, y_max], metres."""
    east, north = grid.centres()
    west, south, last_east, last_north = region_m
    return np.asarray((east >= west) & (east <= last_east) & (north >= south) & (north <= last_north))


def measure_change(before_m: np.ndarray, after_m: np.ndarray, region: np.ndarray, cell_m: float) -> Change | None:
    """The change of heights (rows, columns), NaN unknown, over *all* cells of a region.

    Summing only those beyond a level of detection would lose shallow cuts. Unknown cells count as the mean of the known
    ones. None if less than half of the region is known, or there is none.
    """
    lowered = (before_m - after_m)[region]
    known = np.isfinite(lowered)
    if not lowered.size or known.mean() < _LEAST_KNOWN:
        return None
    found = lowered[known]
    return Change(float(found.mean() * lowered.size * cell_m ** 2), float(np.quantile(found, _DEEPEST)),
                  float(known.mean()))


def find_level(before_sigma_m: float, after_sigma_m: float) -> float:
    """The level of detection of a cell at 95 %, metres, from the standard deviations of both heights."""
    return _LEVEL * math.hypot(before_sigma_m, after_sigma_m)


def volume_sigma(area_m2: float, sigma_m: float, correlation_m: float) -> float:
    """The standard deviation of a volume, m3, over an area whose differences have ``sigma_m`` and the correlation
    exp(-r²/2L²): they are as good as A / (2πL²) independent ones, at least one (Wheaton et al. 2010)."""
    together = min(2 * math.pi * correlation_m ** 2, area_m2)
    return area_m2 * sigma_m * math.sqrt(together / area_m2)


@dataclass(frozen=True)
class Noise:
    """Volumes of null pairs: their mean, their standard deviation, and the smallest volume that is noticed, m3."""

    bias_m3: float
    sigma_m3: float
    smallest_m3: float
    pairs: int


def find_noise(volumes_m3: Sequence[float]) -> Noise | None:
    """What null pairs tell of a volume; None of fewer than two. The volumes are differences to one common model, whose
    own error they share, so it is estimated from them: a difference of two has twice the variance of one."""
    if len(volumes_m3) < 2:
        return None
    values = np.asarray(volumes_m3, np.float64)
    sigma = math.sqrt(2.0) * float(values.std(ddof=1))
    return Noise(float(values.mean()), sigma, NOTICED * sigma, len(values))
