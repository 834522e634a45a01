"""Finds, without rays, the points that nothing can shelter from falling grains.

A path that begins outside a closed surface enters it through a face that looks away from the origin of the grains. So
only such faces, and rocks, can shelter anything. On a path up along d, the place x less z times the middle lean of all
paths changes by at most z rho, with the largest difference rho of the leans d_xy / d_z from their middle. So in places
that are moved in this way, an object with its top at z_b shelters nothing that is higher than z_b - D / rho at the
horizontal distance D. The envelope of these bounds is kept in cells of rings and azimuths, whose widths grow with the
distance from the origin of the world, as the spacing of a ground's vertices does.

A distance between two cells is bounded from below. With the difference d of the radii, the inner radius r and the angle
a, D² = d² + 4 r (r + d) sin²(a / 2) is at least d² + (2 r a / pi)², so D is at least (d + 2 r a / pi) / sqrt(2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..support.arrays import Array
from .shapes import Placed, World

#: Number of azimuths, and radius of the disc at the origin that is one cell, in metres.
_AZIMUTHS, _DISC_M = 512, 0.5
_STEP = 2.0 * math.pi / _AZIMUTHS
#: Least difference of leans that counts, which keeps bounds finite for parallel paths.
_MIN_SPREAD = 0.01


@dataclass(frozen=True)
class _Paths:
    """Directions (k, 3) of paths, the middle (2,) of their leans, and the slope of the bounds."""

    directions: Array
    lean: Array
    steepness: float

    @classmethod
    def of(cls, directions: Array) -> _Paths:
        """Make the paths along unit vectors (k, 3), which all rise."""
        leans = directions[:, :2] / directions[:, 2:]
        middle = (leans.min(axis=0) + leans.max(axis=0)) / 2
        spread = np.linalg.norm(leans - middle, axis=1).max()
        return cls(directions, middle, 1.0 / max(float(spread), _MIN_SPREAD))

    def move(self, points: Array) -> Array:
        """Move points (…, 3) against the lean of the paths, by their height times the lean."""
        return np.concatenate([points[..., :2] - points[..., 2:] * self.lean, points[..., 2:]], axis=-1)


def find_uncertain(world: World, points: Array, directions: Array) -> Array:
    """Find the indices of the points (n, 3) of the world that something may shelter on a path to one of the unit
    vectors ``directions`` (k, 3), which all rise."""
    paths = _Paths.of(directions)
    tops = np.concatenate([np.zeros((0, 3)), *(_list_tops(each, paths) for each in world.placed)])
    if not len(tops):
        return np.zeros(0, np.intp)
    (rings, cells), (rings_of_tops, cells_of_tops) = (_find_cells(each) for each in (paths.move(points), tops))
    count = 2 + int(max(rings.max(), rings_of_tops.max()))
    highest = np.full(count * _AZIMUTHS, -np.inf)
    np.maximum.at(highest, cells_of_tops, tops[:, 2])
    envelope = _spread_cones(highest.reshape(count, _AZIMUTHS), paths.steepness)
    return np.flatnonzero(points[:, 2] < envelope.ravel()[cells])


def _list_tops(placed: Placed, paths: _Paths) -> Array:
    """List the moved tips (k, 3) of cones, one over each object that can shelter. A cone has the slope of the bounds
    and covers its object."""
    shape = placed.shape
    if len(placed.places) == 1 and np.array_equal(placed.places[0], np.eye(4)):
        corners = shape.vertices[_find_faces_away(shape.vertices, shape.triangles, paths)].astype(np.float64)
    else:
        low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
        ends = np.stack(np.meshgrid(*np.stack([low, high], axis=1)), axis=-1).reshape(-1, 3).astype(np.float64)
        corners = ends @ placed.places[:, :3, :3].swapaxes(1, 2) + placed.places[:, None, :3, 3]
    corners = paths.move(corners)
    middle = corners[..., :2].mean(axis=1)
    radius = np.linalg.norm(corners[..., :2] - middle[:, None], axis=2).max(axis=1)
    return np.column_stack([middle, corners[..., 2].max(axis=1) + paths.steepness * radius])


def _find_faces_away(vertices: Array, triangles: Array, paths: _Paths) -> Array:
    """Find those triangles (m, 3) that look away from the end of at least one path."""
    first, second, third = (vertices[corner] for corner in triangles.T)
    normal = np.cross(second - first, third - first)
    toward = np.full(len(normal), np.inf, np.float32)
    for direction in paths.directions.astype(np.float32):
        np.minimum(toward, normal @ direction, out=toward)
    return np.asarray(triangles[toward <= 0.0])


def _find_cells(points: Array) -> tuple[Array, Array]:
    """Find the rings (n,) and the cells (n,) of points (n, 3). Ring 0 is the disc. A cell is the ring times the number
    of azimuths, plus the azimuth."""
    radius = np.maximum(np.hypot(points[:, 0], points[:, 1]), 1e-9)
    rings = np.maximum(1.0 + np.floor(np.log(radius / _DISC_M) / _STEP), 0.0).astype(np.intp)
    azimuth = np.floor(np.arctan2(points[:, 1], points[:, 0]) / _STEP).astype(np.intp) % _AZIMUTHS
    return rings, rings * _AZIMUTHS + azimuth


def _spread_cones(highest: Array, steepness: float) -> Array:
    """Return the envelope (rings, azimuths) of cones of a slope whose tips are as high as ``highest`` of their
    cells."""
    count = len(highest)
    inner = np.concatenate([[0.0], _DISC_M * np.exp(_STEP * np.arange(count))])
    fall_out = steepness / math.sqrt(2.0) * np.diff(inner)
    fall_around = steepness / math.sqrt(2.0) * (2.0 / math.pi) * inner[:-1] * _STEP
    # Points of neighbouring cells may touch, so a cone has its full height in the neighbours of its cell too.
    near = np.max([np.roll(highest, k, axis=1) for k in (-1, 0, 1)], axis=0)
    near[0] = near[0].max()
    made = near.copy()
    np.maximum(made[1:], near[:-1], out=made[1:])
    np.maximum(made[:-1], near[1:], out=made[:-1])
    for ring in range(count):
        if ring:
            np.maximum(made[ring], made[ring - 1] - fall_out[ring - 1], out=made[ring])
        made[ring] = _spread_around(made[ring], fall_around[ring])
    for ring in range(count - 2, -1, -1):
        np.maximum(made[ring], made[ring + 1] - fall_out[ring + 1], out=made[ring])
        made[ring] = _spread_around(made[ring], fall_around[ring])
    return made


def _spread_around(heights: Array, fall: float) -> Array:
    """Return, for each azimuth, the largest of the heights (azimuths,) less ``fall`` for each step around."""
    step = 1
    while step < _AZIMUTHS:
        both = np.maximum(np.roll(heights, step), np.roll(heights, -step))
        heights = np.maximum(heights, both - step * fall)
        step *= 2
    return heights
