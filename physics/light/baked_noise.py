"""Noise of light that is baked to vertices, from two halves of its samples that share none."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

#: Sides from which ground is looked at to find where most of its light is indirect, and the height of the eye there
#: above the horizon: ground 4 m before an eye that is 1 m high.
_SIDES, _EYE_DEG = 8, 14.0


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


def largest_share(direct: np.ndarray, indirect: np.ndarray, normals: np.ndarray) -> float:
    """Share of ``indirect`` light in all light of ground, as seen from the side from which it is largest.

    Both lights are (vertices, bands). From a side, ground is weighted by the cosine between its ``normals`` (vertices,
    3) and the way to the eye, and ground that faces away is not seen. What hides what is left out. 0 without light.
    """
    around = np.linspace(0, 2 * math.pi, _SIDES, endpoint=False)
    up = math.radians(_EYE_DEG)
    to_eye = np.stack([math.cos(up) * np.cos(around), math.cos(up) * np.sin(around), np.full(_SIDES, math.sin(up))])
    weights = np.maximum(normals @ to_eye, 0.0).T
    some, other = weights @ indirect.mean(axis=1), weights @ direct.mean(axis=1)
    return float(np.divide(some, some + other, out=np.zeros(_SIDES), where=some > 0).max())


def samples_needed(noise: float, share: float, count: int, limit: float, most: int) -> int:
    """Samples of each half with which ``noise`` that ``count`` samples have, in indirect light that is ``share`` of all
    light, is ``limit`` of all light; ``most`` at most. Noise falls with the root of the samples.
    """
    seen = noise * share
    if seen <= 0:
        return count
    if limit <= 0:
        return most
    return max(count, min(most, math.ceil(count * (seen / limit) ** 2)))


def _mean(halves: Sequence[np.ndarray]) -> float:
    return float((halves[0] + halves[1]).mean(dtype=np.float64)) / 2
