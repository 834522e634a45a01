"""Light on rocks as a few numbers for each rock, fitted to light that is baked at points of its surface.

Rocks are instances of a few shapes, so their vertices cannot carry light. But a rock is convex, and small beside the
surfaces that light it. Its light depends mostly and smoothly on the direction of the surface's normal: nine terms of
second order in the normal suffice for light from afar (Ramamoorthi and Hanrahan 2001, SIGGRAPH). Near things, such as
the rock's own shadow on the ground, make a difference from side to side and from foot to top, so three more terms are
linear in the place on the rock. The twelve coefficients are fitted to light at random points of the surface. Their
noise is less than the noise of the points, and the same all over a rock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array

#: Number of terms of the light on a rock: 1, x, y, z, xy, yz, zx, x² - y² and 3 z² - 1 of the normal, and x, y, z of
#: the place.
TERM_COUNT = 12
#: Number of points of a rock by its level of detail, finest first.
POINTS_BY_DETAIL = (64, 32, 16)
#: Penalty in the fit on the square of each term, per point: the constant, the terms of first order, and the terms of
#: second order and of place. The penalty is so small that it changes only rocks with few points.
_RIDGE_PENALTY = np.array([1e-6] + [3e-4] * 3 + [1e-3] * 8)
#: Width of the triangle that represents a point, over the rock's diameter.
_TRIANGLE_WIDTH = 1e-3
#: Height of this triangle above the surface, over the rock's diameter.
_TRIANGLE_HEIGHT = 1e-4


@dataclass(frozen=True)
class RockPoints:
    """``n`` points of rocks: their ``rock`` (n,), their ``place`` on the unit shape (n, 3), the unit ``normal`` (n, 3),
    and the ``corners`` (n, 3, 3) in metres of a small triangle just above each.
    """

    rock: Array
    place: Array
    normal: Array
    corners: Array


def evaluate_terms(normal: Array, place: Array) -> Array:
    """Evaluate the terms (n, 12) at unit normals (n, 3) and places (n, 3)."""
    x, y, z = normal.T
    return np.column_stack([np.ones_like(x), x, y, z, x * y, y * z, z * x, x * x - y * y, 3 * z * z - 1, place])


def draw_points(
    vertices: Array,
    triangles: Array,
    rocks: Array,
    matrices: Array,
    positions: Array,
    count: int,
    random: np.random.Generator,
) -> RockPoints:
    """Draw ``count`` random points of each of the ``rocks`` (k,), all with one unit shape (vertices and triangles).

    ``matrices`` (k, 3, 3) rotate and scale the shape; ``positions`` (k, 3) are its origins after that. The probability
    of a triangle is proportional to its area on the unit shape.
    """
    corners = vertices[triangles]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    shares = np.cumsum(areas) / areas.sum()
    # Stratify: one point in each of ``count`` equal parts of the surface. Consecutive triangles are neighbours.
    drawn = (np.arange(count) + random.random((len(rocks), count))) / count
    chosen = np.searchsorted(shares, drawn.ravel(), side="right").clip(max=len(triangles) - 1)
    weights = random.dirichlet((1.0, 1.0, 1.0), len(chosen))
    place = np.einsum("nk,nkj->nj", weights, corners[chosen])
    rock = np.repeat(np.arange(len(rocks)), count)
    matrix = matrices[rock]
    sides = np.einsum("nij,nkj->nki", matrix, corners[chosen])
    across = sides[:, 1] - sides[:, 0]
    normal = np.cross(across, sides[:, 2] - sides[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    size = np.cbrt(np.abs(np.linalg.det(matrices)))[rock, None]
    middle = np.einsum("nij,nj->ni", matrix, place) + positions[rock] + _TRIANGLE_HEIGHT * size * normal
    up = np.cross(normal, across)
    ways = np.stack([across, -0.5 * across + 0.75**0.5 * up, -0.5 * across - 0.75**0.5 * up], axis=1)
    return RockPoints(rocks[rock], place, normal, middle[:, None] + _TRIANGLE_WIDTH * size[:, None] * ways)


def fit_terms(points: RockPoints, light: Array, used: Array, rocks: int) -> Array:
    """Fit the coefficients (rocks, 12, 3) of the terms to ``light`` (n, 3) at the points ``used`` (n,). A rock without
    used points, which no camera sees, gets zeros.
    """
    found = np.zeros((rocks, TERM_COUNT, 3))
    terms = evaluate_terms(points.normal, points.place)
    order = np.argsort(points.rock, kind="stable")
    order = order[used[order]]
    of = points.rock[order]
    for rock, start, count in zip(*np.unique(of, return_index=True, return_counts=True), strict=True):
        rows = order[start : start + count]
        some = terms[rows]
        found[rock] = np.linalg.solve(some.T @ some + count * np.diag(_RIDGE_PENALTY), some.T @ light[rows])
    return found
