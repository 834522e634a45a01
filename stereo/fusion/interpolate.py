"""Interpolates disparities between sparse points: linearly on Delaunay's triangles.

It also predicts each point from its neighbours. A plane in space is a plane in disparity over the image, so both are
exact on planes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError

#: Columns are divided by this in fits, so that their numbers are near 1.
_SCALE_PX = 100.0
#: Largest shift of a point. Points are often centres of pixels; after the shift no three of them lie on one line.
_MOVED_PX = 1e-4
#: Least width of a triangle; narrower ones are left out.
_FLAT_PX = 1e-2
#: Share of a triangle's corner below which a place counts as outside the triangle.
_INSIDE = -1e-9
#: Most neighbours from which a point is predicted. Of more neighbours, the farthest are left out.
_MAX_NEIGHBOURS = 14


def interpolate(column: Array, row: Array, disparity: Array) -> Interpolation:
    """Interpolate disparities (n,), px, at columns and rows (n,), px from the centre of the first pixel.

    Raises IcyMoonError for fewer than 3 points, and for points on one line.
    """
    if len(column) < 3:
        raise IcyMoonError(
            f"An interpolation needs 3 points in the left image, and there are {len(column)}; give more points."
        )
    design = _design(column, row)
    width = np.linalg.svd(design - design.mean(axis=0), compute_uv=False)[1]
    if width * _SCALE_PX < 0.5:
        raise IcyMoonError(
            "All range points lie on one line of the image, so no surface follows from them; give points beside it."
        )
    plane, _ = _fit_plane(design, disparity)
    moved = np.random.default_rng(0).uniform(-_MOVED_PX, _MOVED_PX, (2, len(column)))
    # Moved points follow the slope of the plane, so that planes stay exact.
    return Interpolation(
        column + moved[0], row + moved[1], disparity + (plane[1] * moved[0] + plane[2] * moved[1]) / _SCALE_PX
    )


@dataclass(frozen=True)
class Interpolation:
    """Points at columns and rows (n,) in px of pixel centres, no three on one line, with disparities (n,) in px."""

    column: Array
    row: Array
    disparity: Array

    @cached_property
    def triangulation(self) -> Any:
        """Delaunay's triangles of the points."""
        from matplotlib.tri import Triangulation  # imported here, because few runs need it

        found = Triangulation(self.column, self.row)
        # Triangles along a straight border of points have no width, so a place there counts as beside all triangles.
        x, y = self.column[found.triangles], self.row[found.triangles]
        longest = np.hypot(x - np.roll(x, 1, axis=1), y - np.roll(y, 1, axis=1)).max(axis=1)
        double = np.abs((x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0]))
        found.set_mask(double / longest < _FLAT_PX)
        return found

    def with_values(self, values: Array) -> Interpolation:
        """Return the interpolation of other values (n,) at the same points, by the same triangles."""
        other = replace(self, disparity=values)
        other.__dict__["triangulation"] = self.triangulation  # what cached_property would find
        return other

    @cached_property
    def _plane(self) -> tuple[Array, Array]:
        """Least-squares plane (3,) of all points, and the inverse (3, 3) of its normal equations."""
        return _fit_plane(_design(self.column, self.row), self.disparity)

    def fill(self, shape: tuple[int, ...]) -> Array:
        """Return the disparities (H, W), px: linear on each triangle.

        Outside of all triangles, they are the least-squares plane of all points, plus the difference from this plane at
        the nearest place on the edge of the triangles.
        """
        rows, columns = np.indices(shape[:2], dtype=np.float64)
        where = self.triangulation.get_trifinder()(columns, rows)
        slope = _fit_triangles(self.triangulation.triangles, self.column, self.row, self.disparity)
        inside = where >= 0
        found = np.empty(shape[:2])
        a, b, c = slope[where[inside]].T
        found[inside] = a * columns[inside] + b * rows[inside] + c
        found[~inside] = self._extend(columns[~inside], rows[~inside])
        return found

    def _extend(self, column: Array, row: Array) -> Array:
        plane, _ = self._plane
        rest: Array = self.disparity - _follow_plane(plane, _design(self.column, self.row))
        sides = self.triangulation.neighbors < 0
        if self.triangulation.mask is not None:
            sides &= ~self.triangulation.mask[:, None]
        triangle, side = np.nonzero(sides)
        edges = self.triangulation.triangles[triangle[:, None], (side[:, None] + np.arange(2)) % 3]
        nearest, value = np.full(len(column), np.inf), np.zeros(len(column))
        for one, other in edges:
            far, share = _find_nearest_on_segment(
                column, row, *(each[k] for k in (one, other) for each in (self.column, self.row))
            )
            nearer = far < nearest
            nearest[nearer] = far[nearer]
            value[nearer] = (rest[one] + share * (rest[other] - rest[one]))[nearer]
        return _follow_plane(plane, _design(column, row)) + value

    def add_neighbours(self, values: Array, own: bool) -> Array:
        """Return the sums (n,) of values (n,) over the neighbours of each point, and with ``own`` the point itself."""
        total = values.copy() if own else np.zeros_like(values)
        for one, other in (self.triangulation.edges.T, self.triangulation.edges.T[::-1]):
            np.add.at(total, one, values[other])
        return total

    def find_spacing(self) -> Array:
        """Return for each point (n,) the distance, px, to the nearest neighbour, averaged over the point and its
        neighbours.
        """
        one, other = self.triangulation.edges.T
        length = np.hypot(self.column[one] - self.column[other], self.row[one] - self.row[other])
        nearest = np.full(len(self.column), np.inf)
        np.minimum.at(nearest, one, length)
        np.minimum.at(nearest, other, length)
        nearest[~np.isfinite(nearest)] = 0.0  # beside a triangle without width
        return self.add_neighbours(nearest, True) / self.add_neighbours(np.ones_like(nearest), True)

    def predict_left_out(self) -> Array:
        """Predict the disparities (n,) at the points, each interpolated as if the point was missing.

        Delaunay's triangles without a point are the same, except in the hole that it leaves, and the corners of the
        hole are its neighbours. So the triangle around the point has three neighbours as corners, and its circle
        contains no other.
        """
        found = np.full(len(self.column), np.nan)
        for chosen, neighbours in self._group_by_neighbours():
            found[chosen] = self._predict_from(chosen, neighbours)
        outside = np.flatnonzero(np.isnan(found))
        if len(outside):
            found[outside] = self._extend_left_out(outside)
        return found

    @cached_property
    def _neighbours(self) -> list[Array]:
        edges = self.triangulation.edges
        both = np.concatenate([edges, edges[:, ::-1]])
        both = both[np.lexsort((both[:, 1], both[:, 0]))]
        ends = np.searchsorted(both[:, 0], np.arange(len(self.column) + 1))
        return [both[ends[k] : ends[k + 1], 1] for k in range(len(self.column))]

    def _group_by_neighbours(self) -> Iterator[tuple[Array, Array]]:
        """Group points by their number of neighbours k.

        Yield for each group the points' indices (g,), and their neighbours' indices (g, k), the nearest first.
        """
        listed = [
            near[np.argsort(np.hypot(self.column[near] - self.column[k], self.row[near] - self.row[k]), kind="stable")][
                :_MAX_NEIGHBOURS
            ]
            for k, near in enumerate(self._neighbours)
        ]
        count = np.array([len(each) for each in listed])
        for k in np.unique(count[count >= 3]):
            chosen = np.flatnonzero(count == k)
            yield chosen, np.array([listed[each] for each in chosen])

    def _predict_from(self, chosen: Array, neighbours: Array) -> Array:
        """Predict disparities (g,) from neighbours (g, k).

        NaN for points outside of all triangles of their neighbours.
        """
        x = self.column[neighbours] - self.column[chosen, None]
        y = self.row[neighbours] - self.row[chosen, None]
        z = self.disparity[neighbours]
        corners = np.array([*combinations(range(neighbours.shape[1]), 3)])
        share, radius = _solve_triangles(x[:, corners], y[:, corners], x, y)
        radius[share.min(axis=2) < _INSIDE] = np.inf
        best = np.arange(len(chosen)), np.argmin(radius, axis=1)
        found = (share[best] * z[:, corners][best]).sum(axis=1)
        return np.where(np.isfinite(radius[best]), found, np.nan)

    def _extend_left_out(self, chosen: Array) -> Array:
        """Predict the disparities of points on the edge of all triangles, by ``_extend`` without them."""
        plane, inverse = self._plane
        design = _design(self.column, self.row)
        rest: Array = self.disparity - _follow_plane(plane, design)
        found = np.empty(len(chosen))
        for place, k in enumerate(chosen.tolist()):
            own = design[k]
            # The plane without the point, by Sherman and Morrison; with three points there is no plane without one.
            left = 1.0 - own @ inverse @ own
            without = plane - inverse @ own * rest[k] / left if left > 1e-9 else plane
            near = self._neighbours[k]
            beside = self.disparity[near] - _follow_plane(without, design[near])
            pairs = np.array([*combinations(range(len(near)), 2)])
            far, share = _find_nearest_on_segment(
                self.column[k],
                self.row[k],
                *(each[near[pairs[:, end]]] for end in (0, 1) for each in (self.column, self.row)),
            )
            best = int(np.argmin(far))
            one, other = beside[pairs[best]]
            found[place] = own @ without + one + share[best] * (other - one)
        return found


def _design(column: Array, row: Array) -> Array:
    return np.stack([np.ones_like(column), column / _SCALE_PX, row / _SCALE_PX], axis=-1)


def _fit_plane(design: Array, values: Array) -> tuple[Array, Array]:
    """Fit a least-squares plane (3,) to values (n,) with a ``design`` matrix (n, 3).

    Return it and the inverse (3, 3) of the normal matrix. The products are summed row by row: with BLAS their last bits
    depend on where arrays lie in memory.
    """
    inverse = np.linalg.pinv((design[:, :, None] * design[:, None, :]).sum(axis=0))
    return (inverse * (design * values[:, None]).sum(axis=0)).sum(axis=1), inverse


def _follow_plane(plane: Array, design: Array) -> Array:
    """Evaluate a plane (3,) at the rows of a ``design`` matrix (n, 3). Returns the values (n,)."""
    return np.asarray(design[:, 0] * plane[0] + design[:, 1] * plane[1] + design[:, 2] * plane[2])


def _fit_triangles(triangles: Array, column: Array, row: Array, disparity: Array) -> Array:
    """Return the plane (a, b, c) of each triangle, (t, 3): disparity = a column + b row + c."""
    x, y, z = column[triangles], row[triangles], disparity[triangles]
    dx, dy, dz = x[:, 1:] - x[:, :1], y[:, 1:] - y[:, :1], z[:, 1:] - z[:, :1]
    area = dx[:, 0] * dy[:, 1] - dx[:, 1] * dy[:, 0]
    a = (dz[:, 0] * dy[:, 1] - dz[:, 1] * dy[:, 0]) / area
    b = (dx[:, 0] * dz[:, 1] - dx[:, 1] * dz[:, 0]) / area
    return np.stack([a, b, z[:, 0] - a * x[:, 0] - b * y[:, 0]], axis=1)


def _find_nearest_on_segment(
    column: Any, row: Any, from_column: Any, from_row: Any, to_column: Any, to_row: Any
) -> tuple[Array, Array]:
    """Find the nearest point of a segment.

    Return its squared distance, and its position along the segment from 0 to 1.
    """
    dx, dy = to_column - from_column, to_row - from_row
    share = np.clip(((column - from_column) * dx + (row - from_row) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
    return (column - from_column - share * dx) ** 2 + (row - from_row - share * dy) ** 2, share


def _solve_triangles(x: Array, y: Array, other_x: Array, other_y: Array) -> tuple[Array, Array]:
    """Return the shares (g, t, 3) of the corners (g, t, 3) at the origin, and the squared radius (g, t) of the
    circumcircle.

    The radius is infinite if the circle contains one of the other points (g, k).
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        next_x, next_y, last_x, last_y = (np.roll(each, step, axis=2) for step in (-1, 1) for each in (x, y))
        area = (x[..., 1] - x[..., 0]) * (y[..., 2] - y[..., 0]) - (x[..., 2] - x[..., 0]) * (y[..., 1] - y[..., 0])
        share = (next_x * last_y - last_x * next_y) / area[..., None]
        square = x**2 + y**2
        centre_x = np.sum(square * (next_y - last_y), axis=2) / (2 * area)
        centre_y = np.sum(square * (last_x - next_x), axis=2) / (2 * area)
        radius = (x[..., 0] - centre_x) ** 2 + (y[..., 0] - centre_y) ** 2
        nearest = (other_x[:, None] - centre_x[..., None]) ** 2 + (other_y[:, None] - centre_y[..., None]) ** 2
    empty = np.isfinite(radius) & (nearest.min(axis=2) >= radius * (1 - 1e-6))
    return np.where(np.isfinite(share), share, -1.0), np.where(empty, radius, np.inf)
