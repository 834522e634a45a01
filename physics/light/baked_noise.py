"""Noise of light that is baked to vertices, from two halves of its samples that share none."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np


def noise_of(halves: Sequence[np.ndarray], triangles: np.ndarray) -> float:
    """Standard error within triangles (n, 3 vertices) of the mean of two halves (vertices, bands), over that mean.

    The halves differ by the root of two times the error of one, and their mean has that error over the root of two.
    Light within a triangle is linear between its corners, so the mean square of a difference d there is that of
    ((d1 + d2 + d3)² + d1² + d2² + d3²) / 12, which is half of d² where the noise of vertices is independent. 0 without
    light.
    """
    mean = _mean(halves)
    if mean <= 0 or not len(triangles):
        return 0.0
    off = (halves[0] - halves[1]).astype(np.float64)
    corners = [off[triangles[:, k]] for k in range(3)]
    square = (sum(corners) ** 2 + sum(each ** 2 for each in corners)) / 12
    return float(np.sqrt(np.mean(square))) / 2 / mean


def samples_needed(halves: Sequence[np.ndarray], triangles: np.ndarray, direct: float, count: int, limit: float,
                   most: int) -> int:
    """Samples of each half with which noise that is seen is ``limit`` of the mean light, ``most`` at most.

    ``halves`` were made with ``count`` samples, ``direct`` is the mean of the direct light. Noise falls with the root
    of the samples.
    """
    mean = _mean(halves)
    if mean <= 0:
        return count
    if limit <= 0:
        return most
    noise = noise_of(halves, triangles) * mean / (mean + direct)
    return max(count, min(most, math.ceil(count * (noise / limit) ** 2)))


def _mean(halves: Sequence[np.ndarray]) -> float:
    return float((halves[0] + halves[1]).mean(dtype=np.float64)) / 2
