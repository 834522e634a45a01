"""Noise of light that is baked to vertices, from two halves of its samples that share none."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

#: Light within a triangle is a mean of that of its corners. The mean over the triangle of the sum of the squares of the
#: weights: each weight has a mean square of 1/6.
_INTERPOLATED = 0.5


def noise_of(halves: Sequence[np.ndarray]) -> float:
    """Standard error of the mean of two halves, each (n, bands), over that mean; 0 without light.

    The halves differ by the root of two times the error of one, and their mean has that error over the root of two.
    """
    mean = _mean(halves)
    return float(np.sqrt(np.mean((halves[0] - halves[1]).astype(np.float64) ** 2))) / 2 / mean if mean > 0 else 0.0


def noise_seen(noise: float) -> float:
    """Noise in an image, where light is interpolated between vertices, of that at the vertices."""
    return math.sqrt(_INTERPOLATED) * noise


def samples_needed(halves: Sequence[np.ndarray], direct: float, count: int, limit: float, most: int) -> int:
    """Samples of each half with which noise that is seen is ``limit`` of the mean light, ``most`` at most.

    ``halves`` were made with ``count`` samples, ``direct`` is the mean of the direct light. Noise falls with the root
    of the samples.
    """
    mean = _mean(halves)
    if mean <= 0:
        return count
    if limit <= 0:
        return most
    noise = noise_seen(noise_of(halves)) * mean / (mean + direct)
    return max(count, min(most, math.ceil(count * (noise / limit) ** 2)))


def _mean(halves: Sequence[np.ndarray]) -> float:
    return float((halves[0] + halves[1]).mean(dtype=np.float64)) / 2
