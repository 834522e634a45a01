"""Noise of light that is baked to vertices, from two halves of its samples that share none."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...support.arrays import Array

#: Directions that the share of indirect light is looked for in, their width, and how far below the horizon they go.
_DIRECTIONS, _WIDE_DEG, _LOWEST_DEG = 12, 60.0, 60.0


def measure_bake_noise(halves: Sequence[Array], triangles: Array) -> float:
    """Standard error within triangles (n, 3 vertices) of the mean of two halves (vertices, bands), over that mean.

    The halves differ by the root of two times the error of one, and their mean has that error over the root of two.
    Light within a triangle is linear between its corners, so the mean square of a difference d there is the mean of
    ((d1 + d2 + d3)² + d1² + d2² + d3²) / 12, which is half of d² where the noise of vertices is independent. 0 without
    light.
    """
    mean = _mean_of_halves(halves)
    if mean <= 0 or not len(triangles):
        return 0.0
    off = (halves[0] - halves[1]).astype(np.float64)
    corners = [off[triangles[:, k]] for k in range(3)]
    square = (sum(corners) ** 2 + sum(each**2 for each in corners)) / 12
    return float(np.sqrt(np.mean(square))) / 2 / mean


def find_largest_share(direct: Array, indirect: Array, positions: Array, triangles: Array, eye: Array) -> float:
    """Share of ``indirect`` light in all light that an ``eye`` (3,) gets from ground, in the direction where it is
    largest.

    Both lights are (vertices, bands), and the ground is ``positions`` (vertices, 3) and ``triangles`` (n, 3), which
    count by their solid angles, and not if they face away. Occlusion is ignored, and ground nearly below the eye is
    left out. 0 without light.
    """
    a, b, c = (positions[triangles[:, k]].astype(np.float64) for k in range(3))
    way = eye - (a + b + c) / 3
    far = np.linalg.norm(way, axis=1)
    solid_angle = np.maximum((np.cross(b - a, c - a) / 2 * way).sum(axis=1), 0.0) / np.maximum(far, 1e-9) ** 3
    solid_angle[way[:, 2] > math.sin(math.radians(_LOWEST_DEG)) * far] = 0.0
    bearing = np.arctan2(way[:, 1], way[:, 0])
    some, other = (light.mean(axis=1)[triangles].mean(axis=1) * solid_angle for light in (indirect, direct))
    largest = 0.0
    for middle in np.linspace(0, 2 * math.pi, _DIRECTIONS, endpoint=False):
        within = np.cos(bearing - middle) >= math.cos(math.radians(_WIDE_DEG / 2))
        of_indirect, of_direct = float(some[within].sum()), float(other[within].sum())
        largest = max(largest, of_indirect / (of_indirect + of_direct) if of_indirect > 0 else 0.0)
    return largest


def count_samples_needed(noise: float, share: float, count: int, limit: float, most: int) -> int:
    """Samples of each half with which ``noise`` that ``count`` samples have, in indirect light that is ``share`` of all
    light, is ``limit`` of all light; ``most`` at most. Noise falls with the root of the samples.
    """
    seen = noise * share
    if seen <= 0:
        return count
    if limit <= 0:
        return most
    return max(count, min(most, math.ceil(count * (seen / limit) ** 2)))


def _mean_of_halves(halves: Sequence[Array]) -> float:
    return float((halves[0] + halves[1]).mean(dtype=np.float64)) / 2
