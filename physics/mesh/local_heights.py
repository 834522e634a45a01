"""Heights of points above the mean height of their surroundings, by which hollows and tops of one width stand out."""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array

#: Number of cells along the width of the surroundings, and its maximum along a side of the map of means.
_CELLS_OF_WIDTH, _MAX_CELLS = 12, 2048


def measure_local_heights(x_m: Array, y_m: Array, z_m: Array, width_m: float) -> tuple[Array, Array]:
    """Measure the heights (n,) in metres of points (n,) above the mean of all heights within a square of ``width_m``
    around each, and whether (n,) they are known.

    The mean weights equal areas equally, even where points are dense, because it averages the means of cells. A cell is
    a twelfth of the width, or of the extent of the points if that is smaller. Points outside the map of 2048 x 2048
    cells around their middle are not known, and have 0.
    """
    middle = (float(np.median(x_m)), float(np.median(y_m)))
    extent = 2.0 * max(np.abs(x_m - middle[0]).max(), np.abs(y_m - middle[1]).max())
    span = min(width_m, extent) or width_m
    cell = span / _CELLS_OF_WIDTH
    half = min(extent, cell * _MAX_CELLS) / 2
    count = int(np.ceil(2.0 * half / cell)) + 1
    column, row = ((at - centre + half) / cell for at, centre in ((x_m, middle[0]), (y_m, middle[1])))
    known = (column >= 0.0) & (column <= count - 1) & (row >= 0.0) & (row <= count - 1)
    column, row = column[known], row[known]
    number = np.rint(row).astype(np.int64) * count + np.rint(column).astype(np.int64)
    points = np.bincount(number, minlength=count**2)
    total = np.bincount(number, z_m[known], count**2)
    filled = points > 0
    heights = np.where(filled, total / np.maximum(points, 1), 0.0).reshape(count, count)
    areas = filled.reshape(count, count).astype(np.float64)
    above = np.zeros(len(z_m))
    reach = _CELLS_OF_WIDTH / 2 * (width_m / span)  # exact where the width is the span
    above[known] = z_m[known] - _sum_squares(heights, column, row, reach) / _sum_squares(areas, column, row, reach)
    return above, known


def _sum_squares(values: Array, column: Array, row: Array, reach: float) -> Array:
    """Integrate a map (rows, columns) of square cells over squares of twice ``reach`` cells around places (n,). Places
    are in cells, with the centre of cell 0 at 0. Values outside the map are 0.
    """
    total = np.zeros((values.shape[0] + 1, values.shape[1] + 1))
    total[1:, 1:] = values.cumsum(axis=0).cumsum(axis=1)

    def integrate(down: Array, across: Array) -> Array:
        """Integrate from the corner of the map; the integral is bilinear within a cell."""
        at = [np.clip(each + 0.5, 0.0, limit) for each, limit in ((down, values.shape[0]), (across, values.shape[1]))]
        low = [
            np.minimum(np.floor(each).astype(np.int64), limit - 1) for each, limit in zip(at, values.shape, strict=True)
        ]
        v, u = (each - first for each, first in zip(at, low, strict=True))
        j, i = low
        return np.asarray(
            (1 - v) * ((1 - u) * total[j, i] + u * total[j, i + 1])
            + v * ((1 - u) * total[j + 1, i] + u * total[j + 1, i + 1])
        )

    return np.asarray(
        integrate(row + reach, column + reach)
        - integrate(row - reach, column + reach)
        - integrate(row + reach, column - reach)
        + integrate(row - reach, column - reach)
    )
