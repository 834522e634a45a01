"""Voronoi cells of one random point per lattice square, exactly.

After Worley, "A Cellular Texture Basis Function", SIGGRAPH 1996. The two nearest points of the 3 x 3
squares around a position are not always the two nearest of all; where a point outside could be
nearer, the next ring of squares is searched too, which is enough.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .noise import Cells, hashed, uniform

_SQUARES = [(i, j) for j in (-1, 0, 1) for i in (-1, 0, 1)]
_RING = [(i, j) for j in range(-2, 3) for i in range(-2, 3) if max(abs(i), abs(j)) == 2]
_HALF_WORD = np.uint32(0xFFFF)


def _point_x(h: np.ndarray) -> np.ndarray:
    return (h & _HALF_WORD) * (1.0 / 65536)


def _point_y(h: np.ndarray) -> np.ndarray:
    return (h >> np.uint32(16)) * (1.0 / 65536)


@dataclass(frozen=True)
class Voronoi:
    """The two nearest points of each position: ``x1``, ``y1``, ``x2``, ``y2`` are their places relative
    to it, ``f1`` and ``f2`` their distances, all in lattice units and of the shape of the positions."""

    x1: np.ndarray
    y1: np.ndarray
    x2: np.ndarray
    y2: np.ndarray
    f1: np.ndarray
    f2: np.ndarray
    _column: np.ndarray
    _row: np.ndarray

    def random(self, key: int) -> np.ndarray:
        """A number in [0, 1) for each position that all positions of a cell share."""
        return uniform(hashed(self._column, self._row, key))

    def edge_distance(self, length_x: float = 1.0, length_y: float = 1.0) -> np.ndarray:
        """Distance to the edge between the two nearest points, in units of which a lattice square is
        ``length_x`` by ``length_y``: exact where that edge is the nearest one, an upper bound elsewhere."""
        across = np.sqrt(((self.x2 - self.x1) / length_x) ** 2 + ((self.y2 - self.y1) / length_y) ** 2)
        return 0.5 * (self.f2**2 - self.f1**2) / np.maximum(across, 1e-12)


def _searched(cells: Cells, nearest: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the 3 x 3 squares may not hold the two nearest points, as ``nearest`` (2, n), the squared
    distances found in them, tells; and the square (column, row) that each such position is in."""
    margin = np.minimum(np.minimum(cells.dx, 1.0 - cells.dx), np.minimum(cells.dy, 1.0 - cells.dy))
    margin += 1.0
    unsure = np.flatnonzero(nearest[1] > margin * margin)
    column, row = cells.squares(unsure)
    return unsure, column, row


def distances(x: np.ndarray, y: np.ndarray, key: int) -> tuple[np.ndarray, np.ndarray]:
    """Distances F1 and F2 to the two nearest of the random points, as ``voronoi`` has them, at half its cost."""
    shape = np.shape(x)
    cells = Cells.of(np.asarray(x, np.float64).ravel(), np.asarray(y, np.float64).ravel(), key, reach=1)
    points = cells.lookup(_point_x, _point_y)
    nearest = np.full((2, cells.dx.size), np.inf)
    first, second = nearest

    def squared(i: int, j: int, point: list[np.ndarray], who: Any) -> np.ndarray:
        px, py = point
        px += i
        px -= cells.dx[who]
        px *= px
        py += j
        py -= cells.dy[who]
        py *= py
        px += py
        return px

    for i, j in _SQUARES:
        distance = squared(i, j, points(i, j), slice(None))
        np.minimum(second, np.maximum(first, distance), out=second)
        np.minimum(first, distance, out=first)
    unsure, column, row = _searched(cells, nearest)
    for i, j in _RING if unsure.size else ():
        h = hashed(column + i, row + j, key)
        distance = squared(i, j, [_point_x(h), _point_y(h)], unsure)
        second[unsure] = np.minimum(second[unsure], np.maximum(first[unsure], distance))
        first[unsure] = np.minimum(first[unsure], distance)
    f1, f2 = np.sqrt(nearest)
    return f1.reshape(shape), f2.reshape(shape)


def voronoi(x: np.ndarray, y: np.ndarray, key: int) -> Voronoi:
    """The two nearest of the random points, one in each unit square, to positions in lattice units."""
    shape = np.shape(x)
    cells = Cells.of(np.asarray(x, np.float64).ravel(), np.asarray(y, np.float64).ravel(), key, reach=1)
    points = cells.lookup(_point_x, _point_y)
    n = cells.dx.size
    nearest = np.full((2, n), np.inf)  # squared distances
    places = np.zeros((4, n))  # x1, y1, x2, y2
    owner = np.zeros(n, np.int8)

    def offer(i: int, j: int, px: np.ndarray, py: np.ndarray, who: Any) -> None:
        """Let the points of square (i, j) compete at the positions ``who`` (a slice or an index array)."""
        px += i
        px -= cells.dx[who]
        py += j
        py -= cells.dy[who]
        distance = px * px + py * py
        first, second = nearest[0, who], nearest[1, who]
        wins, places_second = distance < first, distance < second
        nearest[1, who] = np.minimum(second, np.maximum(first, distance))
        nearest[0, who] = np.minimum(first, distance)
        for now, before, new in ((2, 0, px), (3, 1, py)):
            places[now, who] = np.where(wins, places[before, who], np.where(places_second, new, places[now, who]))
            places[before, who] = np.where(wins, new, places[before, who])
        owner[who] = np.where(wins, np.int8(5 * (j + 2) + i + 2), owner[who])

    for i, j in _SQUARES:
        px, py = points(i, j)
        offer(i, j, px, py, slice(None))
    unsure, column, row = _searched(cells, nearest)
    for i, j in _RING if unsure.size else ():
        h = hashed(column + i, row + j, key)
        offer(i, j, _point_x(h), _point_y(h), unsure)
    f1, f2 = np.sqrt(nearest)
    column, row = cells.squares(slice(None))
    return Voronoi(*(a.reshape(shape) for a in (*places, f1, f2, column + (owner % 5 - 2), row + (owner // 5 - 2))))
