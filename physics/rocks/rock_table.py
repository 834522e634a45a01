"""Rocks from a table: positions and diameters, such as those counted in an image."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import read_number_lines

#: Columns that a table must have.
ROCK_COLUMNS = ("x_m", "y_m", "diameter_m")
TABLE = "TABLE"


def read_rock_table(path: Path) -> Array:
    """Read places east and north and diameters (n, 3) in metres, largest first, from a CSV file. Its first line names
    the columns; only ``ROCK_COLUMNS`` are read. Raises IcyMoonError for a missing file, column or number.
    """
    rows = read_number_lines(path, ROCK_COLUMNS, "rocks.file")
    values = np.empty((len(rows), len(ROCK_COLUMNS)))
    for k, (number, numbers) in enumerate(rows):
        if numbers is None:
            raise IcyMoonError(f"{path}: line {number} has no number for each of {', '.join(ROCK_COLUMNS)}; fix it.")
        values[k] = numbers
    wrong = ~np.isfinite(values).all(axis=1) | (values[:, 2] <= 0)
    if wrong.any():
        raise IcyMoonError(
            f"{path}: line {rows[int(np.argmax(wrong))][0]} is not a rock; give finite places and a diameter above 0."
        )
    return values[np.argsort(-values[:, 2], kind="stable")]


def covered_share(table: Array, size_m: float) -> float:
    """Compute the share of a square patch under the rocks of a table (n, 3), counting overlaps twice."""
    return float(np.pi / 4 * (table[:, 2] ** 2).sum() / size_m**2)
