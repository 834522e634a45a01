"""Means over scenes and their intervals: by Student's t, and by Wilson of what either is or is not so in a scene.

Pairs of one scene share its ground, so they are not independent, and pixels even less; scenes are. Student's t holds
for few scenes if their means are nearly normal. An interval does not hold for scenes of another kind.
"""

from __future__ import annotations

import math
from functools import cache
from statistics import NormalDist

import numpy as np

LEVEL = 0.95


def scene_means(values: np.ndarray, scenes: np.ndarray) -> np.ndarray:
    """The mean (scenes, K) over the pairs of each scene, of each column of ``values`` (pairs, K); NaN is undefined.

    ``scenes`` is a whole number per pair.
    """
    sums, counts = _sums(values, scenes)
    return np.divide(sums, counts, out=np.full(sums.shape, np.nan), where=counts > 0)


def intervals(values: np.ndarray, scenes: np.ndarray) -> np.ndarray:
    """Lower and upper bound (K, 2) of the mean over pairs of each column of ``values`` (pairs, K); NaN is undefined.

    The mean is a ratio of sums over scenes, and its variance that of a ratio (Cochran 1977, section 6.3), so scenes may
    have different numbers of pairs. A bound is NaN if fewer than two scenes have a value.
    """
    sums, counts = _sums(values, scenes)
    number, pairs = (counts > 0).sum(axis=0), counts.sum(axis=0)
    bounds = np.full((values.shape[1], 2), np.nan)
    for k in np.flatnonzero(number >= 2):
        n, mean = int(number[k]), sums[:, k].sum() / pairs[k]
        residual = sums[:, k] - mean * counts[:, k]
        half = student_quantile(n - 1) * math.sqrt(n / (n - 1) * float(residual @ residual)) / pairs[k]
        bounds[k] = mean - half, mean + half
    return bounds


def within_range(bounds: np.ndarray, signed: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Bounds (K, 2) inside the range of their numbers: 0 and more unless ``signed`` (K,), and 1 at most of ``shares``.

    A mean is in that range, so this takes nothing from how often an interval holds it.
    """
    low = np.where(signed[:, None], bounds, np.maximum(bounds, 0.0))
    return np.asarray(np.where(shares[:, None], np.minimum(low, 1.0), low))


def wilson_interval(share: float, number: int) -> tuple[float, float]:
    """Lower and upper bound of the probability behind a share of ``number`` scenes (Wilson 1927).

    Unlike Student's t it is not of width 0 where the outcome of all scenes is the same.
    """
    z = NormalDist().inv_cdf(0.5 + LEVEL / 2)
    middle = (share + z**2 / (2 * number)) / (1 + z**2 / number)
    half = z / (1 + z**2 / number) * math.sqrt(share * (1 - share) / number + (z / (2 * number)) ** 2)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def _sums(values: np.ndarray, scenes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    label, scene = np.unique(scenes, return_inverse=True)
    defined = ~np.isnan(values)
    sums, counts = np.zeros((len(label), values.shape[1])), np.zeros((len(label), values.shape[1]))
    np.add.at(sums, scene, np.where(defined, values, 0.0))
    np.add.at(counts, scene, defined)
    return sums, counts


@cache
def student_quantile(freedom: int, level: float = LEVEL) -> float:
    """The t that |t| exceeds with probability 1 - ``level``, at a whole number of degrees of freedom."""
    low, high = 0.0, 1.0
    while _student_share(high, freedom) < level:
        high *= 2
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if _student_share(middle, freedom) < level else (low, middle)
    return high


def _student_share(t: float, freedom: int) -> float:
    """The probability of a |t| below ``t`` (Abramowitz and Stegun 26.7.3 and 26.7.4)."""
    angle = math.atan(t / math.sqrt(freedom))
    squared = math.cos(angle) ** 2
    odd = freedom % 2
    term, total = (math.cos(angle), 0.0) if odd else (1.0, 0.0)
    for k in range(freedom // 2):
        total += term
        term *= squared * (2 * k + 1 + odd) / (2 * k + 2 + odd)
    return 2 / math.pi * (angle + math.sin(angle) * total) if odd else math.sin(angle) * total
