"""Noise of light that is baked at vertices, estimated from two independent halves of its samples."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...support.arrays import Array

#: Number of bearings at which the share of indirect light is computed.
_VIEW_DIRECTIONS = 12
#: Width in degrees of the view at each bearing.
_VIEW_WIDTH_DEG = 60.0
#: Largest angle below the horizon.
_VIEW_LOWEST_DEG = 60.0


def measure_bake_noise(halves: Sequence[Array], triangles: Array) -> float:
    """Measure the relative standard error, within triangles (n, 3 vertices), of the mean of two halves (vertices,
    bands); 0 without light.

    The difference of the halves has √2 times the error of one half, and their mean has that error over √2. Light is
    linear within a triangle. The mean square of a difference d there is therefore the mean of ((d1 + d2 + d3)² + d1² +
    d2² + d3²) / 12, which is half of d² if the noise of vertices is independent.
    """
    mean = _mean_of_halves(halves)
    if mean <= 0 or not len(triangles):
        return 0.0
    off = (halves[0] - halves[1]).astype(np.float64)
    corners = [off[triangles[:, k]] for k in range(3)]
    square = (sum(corners) ** 2 + sum(each**2 for each in corners)) / 12
    return float(np.sqrt(np.mean(square))) / 2 / mean


def find_largest_share(direct: Array, indirect: Array, positions: Array, triangles: Array, eye: Array) -> float:
    """Find the share of ``indirect`` light in all light that an ``eye`` (3,) receives from ground, in the direction of
    the largest share; 0 without light.

    Both lights are (vertices, bands). The ground has ``positions`` (vertices, 3) and ``triangles`` (n, 3), weighted by
    their solid angles; triangles that face away are left out. Occlusion is ignored, and ground nearly below the eye is
    left out.
    """
    a, b, c = (positions[triangles[:, k]].astype(np.float64) for k in range(3))
    way = eye - (a + b + c) / 3
    far = np.linalg.norm(way, axis=1)
    solid_angle = np.maximum((np.cross(b - a, c - a) / 2 * way).sum(axis=1), 0.0) / np.maximum(far, 1e-9) ** 3
    solid_angle[way[:, 2] > math.sin(math.radians(_VIEW_LOWEST_DEG)) * far] = 0.0
    bearing = np.arctan2(way[:, 1], way[:, 0])
    some, other = (light.mean(axis=1)[triangles].mean(axis=1) * solid_angle for light in (indirect, direct))
    largest = 0.0
    for middle in np.linspace(0, 2 * math.pi, _VIEW_DIRECTIONS, endpoint=False):
        within = np.cos(bearing - middle) >= math.cos(math.radians(_VIEW_WIDTH_DEG / 2))
        of_indirect, of_direct = float(some[within].sum()), float(other[within].sum())
        largest = max(largest, of_indirect / (of_indirect + of_direct) if of_indirect > 0 else 0.0)
    return largest


def count_samples_needed(noise: float, share: float, count: int, limit: float, most: int) -> int:
    """Count the samples of each half, at most ``most``, with which the noise falls to ``limit`` of all light. With
    ``count`` samples indirect light has the relative ``noise``, and ``share`` of all light is indirect. Noise falls
    with the square root of the number of samples.
    """
    seen = noise * share
    if seen <= 0:
        return count
    if limit <= 0:
        return most
    return max(count, min(most, math.ceil(count * (seen / limit) ** 2)))


def _mean_of_halves(halves: Sequence[Array]) -> float:
    return float((halves[0] + halves[1]).mean(dtype=np.float64)) / 2
