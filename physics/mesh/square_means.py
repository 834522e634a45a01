"""Mean heights of a map over squares, accumulated from pieces of the map.

The map is the surface that is bilinear between the centres of its pixels. Its mean over a square is therefore exact on
a plane, the mean of the pixels over a square of many pixels, and the height itself over a square much smaller than a
pixel. Missing pixels do not count. Positions are in pixels: the centre of pixel 0 is at 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...support.arrays import Array

#: Share of the area of a square below which it counts as empty.
_EMPTY = 1e-9


@dataclass(frozen=True)
class Squares:
    """Squares on a lattice of a map: their centres along x (columns) and y (rows), ascending, and half of their width
    along each, in pixels.
    """

    columns: Array
    rows: Array
    half: tuple[float, float]

    def widened(self, times: float) -> Squares:
        """Return wider squares with the same centres."""
        return Squares(self.columns, self.rows, (self.half[0] * times, self.half[1] * times))

    def at_least(self, half: float) -> Squares:
        """Return squares with the same centres and at least this half width. Differences of sums would round smaller
        squares.
        """
        return Squares(self.columns, self.rows, (max(self.half[0], half), max(self.half[1], half)))

    @property
    def window(self) -> tuple[float, float, float, float]:
        """First and last column, and first and last row, that count, in pixels."""
        (a, b), (c, d) = (
            (float(at[0]) - half - 1.0, float(at[-1]) + half + 1.0)
            for at, half in ((self.columns, self.half[0]), (self.rows, self.half[1]))
        )
        return a, b, c, d


def integrate_along(values: Array, first: int, low: Array, high: Array) -> Array:
    """Integrate rows of pixels from ``low`` to ``high`` (n,); returns (rows, n). Each pixel is a triangle of two
    pixels' width about its centre; ``first`` is the number of the first pixel of ``values`` (rows, pixels).
    """
    count = values.shape[1]
    total = np.concatenate([np.zeros((len(values), 1)), np.cumsum(values, axis=1)], axis=1)
    padded = np.concatenate([values, np.zeros((len(values), 1))], axis=1)  # column -1 and column count are 0

    def up_to(at: Array) -> Array:
        left = np.floor(at - first).astype(np.int64)
        u = at - first - left
        here, after = (np.where((k >= 0) & (k < count), k, count) for k in (left, left + 1))
        whole = total[:, np.clip(left, 0, count)]
        part: Array = whole + padded[:, here] * (1.0 - (1.0 - u) ** 2 / 2) + padded[:, after] * (u**2 / 2)
        return part

    return up_to(high) - up_to(low)


@dataclass
class SquareSums:
    """Sums of heights and of their weights over squares, and the known share of ``wide`` squares around the same
    middles; pieces of the map are added one after the other.
    """

    squares: Squares
    wide: Squares
    total: Array = field(init=False)
    weight: Array = field(init=False)
    wide_weight: Array = field(init=False)

    def __post_init__(self) -> None:
        shape = len(self.squares.rows), len(self.squares.columns)
        self.total, self.weight, self.wide_weight = (np.zeros(shape) for _ in range(3))

    def add(self, values: Array, first_row: int, first_column: int) -> None:
        """Add pixels (rows, columns), rows ascending as positions do; NaN for missing pixels."""
        known = np.isfinite(values)
        if not known.any():
            return
        whole = bool(known.all())
        heights = values if whole else np.where(known, values, 0.0)
        weights = known.astype(np.float64)
        _add_block(self.total, self.squares, heights, first_row, first_column)
        for sums, squares in ((self.weight, self.squares), (self.wide_weight, self.wide)):
            if whole:
                _add_full_block(sums, squares, len(known), known.shape[1], first_row, first_column)
            else:
                _add_block(sums, squares, weights, first_row, first_column)

    @property
    def means(self) -> Array:
        """Mean heights (rows, columns), NaN where a square has no known pixel."""
        some = self.weight > _EMPTY * _area(self.squares)
        return np.where(some, self.total / np.where(some, self.weight, 1.0), np.nan)

    @property
    def wide_share(self) -> Array:
        """Known share (rows, columns) of the wide squares, 0 to 1."""
        return np.clip(self.wide_weight / _area(self.wide), 0.0, 1.0)


def _area(squares: Squares) -> float:
    return 4 * squares.half[0] * squares.half[1]


def _find_touched(at: Array, half: float, first: int, count: int) -> slice:
    """Find the ascending places whose squares touch some pixels."""
    low, high = np.searchsorted(at, (first - 1 - half, first + count + half))
    return slice(int(low), int(high))


def _add_block(sums: Array, squares: Squares, values: Array, first_row: int, first_column: int) -> None:
    across = _find_touched(squares.columns, squares.half[0], first_column, values.shape[1])
    down = _find_touched(squares.rows, squares.half[1], first_row, values.shape[0])
    x, y = squares.columns[across], squares.rows[down]
    if len(x) and len(y):
        along = integrate_along(values, first_column, x - squares.half[0], x + squares.half[0])
        sums[down, across] += integrate_along(along.T, first_row, y - squares.half[1], y + squares.half[1]).T


def _add_full_block(sums: Array, squares: Squares, rows: int, columns: int, first_row: int, first_column: int) -> None:
    """Add as ``_add_block`` does, for values that are all 1, computed as a product."""
    across = _find_touched(squares.columns, squares.half[0], first_column, columns)
    down = _find_touched(squares.rows, squares.half[1], first_row, rows)
    x, y = squares.columns[across], squares.rows[down]
    along = integrate_along(np.ones((1, columns)), first_column, x - squares.half[0], x + squares.half[0])[0]
    above = integrate_along(np.ones((1, rows)), first_row, y - squares.half[1], y + squares.half[1])[0]
    sums[down, across] += above[:, None] * along[None, :]
