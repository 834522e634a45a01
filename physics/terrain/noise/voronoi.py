"""Exact Voronoi cells of one random point per lattice square.

After Worley, "A Cellular Texture Basis Function", SIGGRAPH 1996. The two nearest points of the 3 x 3 squares around a
position are not always the two nearest of all. If a point outside could be nearer, the next ring of squares is searched
too; this is sufficient.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ....support.arrays import Array
from .lattice_noise import LatticeCells, hash_lattice, to_uniform

#: The 3 x 3 squares around a position.
_NEAR_SQUARES = [(i, j) for j in (-1, 0, 1) for i in (-1, 0, 1)]
#: The ring of squares around these.
_OUTER_SQUARES = [(i, j) for j in range(-2, 3) for i in range(-2, 3) if max(abs(i), abs(j)) == 2]
_HALF_WORD = np.uint32(0xFFFF)


def _find_point(h: Array) -> tuple[Array, Array]:
    return (h & _HALF_WORD) * (1.0 / 65536), (h >> np.uint32(16)) * (1.0 / 65536)


@dataclass(frozen=True)
class Voronoi:
    """The nearest point of each position. ``x1``, ``y1`` are the position relative to that point, ``f1`` is its
    distance, and ``f2`` the distance of the second nearest point, all in lattice units and in the shape of the
    positions.
    """

    x1: Array
    y1: Array
    f1: Array
    f2: Array
    _column: Array
    _row: Array
    _cells: LatticeCells
    _points: Callable[[int, int], list[Array]]

    def random(self, key: int) -> Array:
        """Compute a number in [0, 1) for each position; all positions of a cell share it."""
        return to_uniform(hash_lattice(self._column, self._row, key))

    def edge_distance(self, length_x: float = 1.0, length_y: float = 1.0) -> Array:
        """Compute the distance to the nearest edge of the cell, in the unit of ``length_x`` and ``length_y``, the sides
        of a lattice square. Only points of the 5 x 5 squares around a position are tested: the distance is exact below
        0.29 lattice squares, and seldom too large above.
        """
        x1, y1, square = self.x1.ravel(), self.y1.ravel(), self.f1.ravel() ** 2
        nearest = np.full(square.size, np.inf)
        for i, j in _NEAR_SQUARES + _OUTER_SQUARES:
            px, py = self._points(i, j)
            px += i
            px -= self._cells.dx
            py += j
            py -= self._cells.dy
            # Excess of this point's squared distance over the nearest, divided by its rate of change across the edge.
            further: Array = px * px + py * py
            further -= square
            px -= x1
            py -= y1
            across = (px / length_x) ** 2 + (py / length_y) ** 2
            itself = across == 0.0
            across[itself] = 1.0
            further /= np.sqrt(across)
            further[itself] = np.inf
            np.minimum(nearest, further, out=nearest)
        nearest *= 0.5
        return np.maximum(nearest, 0.0).reshape(self.f1.shape)


def _find_unsure(cells: LatticeCells, nearest: Array) -> tuple[Array, Array, Array]:
    """Find the positions whose 3 x 3 squares may lack one of the two nearest points; ``nearest`` (2, n) are the squared
    distances found so far. Return their indices, and the column and row of the square of each.
    """
    margin = np.minimum(np.minimum(cells.dx, 1.0 - cells.dx), np.minimum(cells.dy, 1.0 - cells.dy))
    margin += 1.0
    unsure = np.flatnonzero(nearest[1] > margin * margin)
    column, row = cells.squares(unsure)
    return unsure, column, row


def nearest_distances(x: Array, y: Array, key: int) -> tuple[Array, Array]:
    """Compute the distances F1 and F2 to the two nearest random points, as in ``find_voronoi_cells`` at half its
    cost.
    """
    shape = np.shape(x)
    cells = LatticeCells.of(np.asarray(x, np.float64).ravel(), np.asarray(y, np.float64).ravel(), key, reach=1)
    points = cells.make_corner_reader(_find_point)
    nearest = np.full((2, cells.dx.size), np.inf)
    first, second = nearest

    def squared(i: int, j: int, point: list[Array], who: Array | slice) -> Array:
        px, py = point
        px += i
        px -= cells.dx[who]
        px *= px
        py += j
        py -= cells.dy[who]
        py *= py
        px += py
        return px

    for i, j in _NEAR_SQUARES:
        distance = squared(i, j, points(i, j), slice(None))
        np.minimum(second, np.maximum(first, distance), out=second)
        np.minimum(first, distance, out=first)
    unsure, column, row = _find_unsure(cells, nearest)
    for i, j in _OUTER_SQUARES if unsure.size else ():
        h = hash_lattice(column + i, row + j, key)
        distance = squared(i, j, [*_find_point(h)], unsure)
        second[unsure] = np.minimum(second[unsure], np.maximum(first[unsure], distance))
        first[unsure] = np.minimum(first[unsure], distance)
    f1, f2 = np.sqrt(nearest)
    return f1.reshape(shape), f2.reshape(shape)


def find_voronoi_cells(x: Array, y: Array, key: int) -> Voronoi:
    """Find the nearest of the random points, one in each unit square, to positions in lattice units."""
    shape = np.shape(x)
    cells = LatticeCells.of(np.asarray(x, np.float64).ravel(), np.asarray(y, np.float64).ravel(), key, reach=2)
    points = cells.make_corner_reader(_find_point)
    n = cells.dx.size
    nearest = np.full((2, n), np.inf)  # squared distances
    x1, y1 = np.zeros(n), np.zeros(n)
    owner = np.zeros(n, np.int8)

    def offer(i: int, j: int, px: Array, py: Array, who: Array | slice) -> None:
        """Let the points of square (i, j) compete at the positions ``who`` (a slice or an index array)."""
        px += i
        px -= cells.dx[who]
        py += j
        py -= cells.dy[who]
        distance = px * px + py * py
        first, second = nearest[0, who], nearest[1, who]
        wins = distance < first
        nearest[1, who] = np.minimum(second, np.maximum(first, distance))
        nearest[0, who] = np.minimum(first, distance)
        x1[who] = np.where(wins, px, x1[who])
        y1[who] = np.where(wins, py, y1[who])
        owner[who] = np.where(wins, np.int8(5 * (j + 2) + i + 2), owner[who])

    for i, j in _NEAR_SQUARES:
        px, py = points(i, j)
        offer(i, j, px, py, slice(None))
    unsure, column, row = _find_unsure(cells, nearest)
    for i, j in _OUTER_SQUARES if unsure.size else ():
        h = hash_lattice(column + i, row + j, key)
        offer(i, j, *_find_point(h), unsure)
    f1, f2 = np.sqrt(nearest)
    column, row = cells.squares(slice(None))
    column, row = column + (owner % 5 - 2), row + (owner // 5 - 2)
    x1, y1, f1, f2, column, row = (each.reshape(shape) for each in (x1, y1, f1, f2, column, row))
    return Voronoi(x1, y1, f1, f2, column, row, cells, points)
