"""The fine square grid on which ground is dug, and the paths of a scoop in its coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array


@dataclass(frozen=True)
class ExcavationGrid:
    """Vertices ``cell_m`` apart: ``columns`` from ``x_m`` eastward, ``rows`` from ``y_m`` northward. A cell is the
    square around a vertex.
    """

    x_m: float
    y_m: float
    columns: int
    rows: int
    cell_m: float

    @property
    def east_m(self) -> Array:
        """East coordinates (columns,) in metres, rounded to single precision."""
        return (self.x_m + self.cell_m * np.arange(self.columns)).astype(np.float32).astype(np.float64)

    @property
    def north_m(self) -> Array:
        """North coordinates (rows,) in metres, rounded to single precision."""
        return (self.y_m + self.cell_m * np.arange(self.rows)).astype(np.float32).astype(np.float64)

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """West, south, east and north limits in metres."""
        return (
            self.x_m,
            self.y_m,
            self.x_m + self.cell_m * (self.columns - 1),
            self.y_m + self.cell_m * (self.rows - 1),
        )

    def window(self, west: float, south: float, east: float, north: float) -> tuple[slice, slice]:
        """Find the rows and columns of the vertices in a rectangle, with one more on each side."""
        columns, rows = (
            slice(
                max(math.floor((low - first) / self.cell_m) - 1, 0),
                max(min(math.ceil((high - first) / self.cell_m) + 2, count), 0),
            )
            for low, high, first, count in ((west, east, self.x_m, self.columns), (south, north, self.y_m, self.rows))
        )
        return rows, columns

    def points(self, window: tuple[slice, slice]) -> tuple[Array, Array]:
        """Return the east (1, columns) and north (rows, 1) coordinates of the vertices in a window, in metres."""
        return self.east_m[None, window[1]], self.north_m[window[0], None]

    def interpolate(self, values: Array, x_m: Array, y_m: Array, outside: Array) -> Array:
        """Interpolate ``values`` (rows, columns) bilinearly at points; beyond the grid, return the values
        ``outside``.
        """
        u, v = (np.asarray(x_m) - self.x_m) / self.cell_m, (np.asarray(y_m) - self.y_m) / self.cell_m
        inside = (u >= 0) & (v >= 0) & (u <= self.columns - 1) & (v <= self.rows - 1)
        i, j = (
            np.clip(np.floor(np.where(inside, a, 0)).astype(int), 0, n - 2)
            for a, n in ((u, self.columns), (v, self.rows))
        )
        du, dv = np.where(inside, u - i, 0.0), np.where(inside, v - j, 0.0)
        found = (1 - dv) * ((1 - du) * values[j, i] + du * values[j, i + 1]) + dv * (
            (1 - du) * values[j + 1, i] + du * values[j + 1, i + 1]
        )
        return np.where(inside, found, outside)


def make_covering_grid(west: float, south: float, east: float, north: float, cell_m: float) -> ExcavationGrid:
    """Make the smallest grid over a rectangle whose cells end at multiples of their side. Vertices are half a cell off
    these multiples, so that the edges of a blade along an axis often lie between cells.
    """
    first = [math.floor(round(low / cell_m - 0.5, 6)) for low in (west, south)]
    last = [math.ceil(round(high / cell_m - 0.5, 6)) for high in (east, north)]
    columns, rows = (b - a + 1 for a, b in zip(first, last, strict=True))
    return ExcavationGrid((first[0] + 0.5) * cell_m, (first[1] + 0.5) * cell_m, columns, rows, cell_m)
