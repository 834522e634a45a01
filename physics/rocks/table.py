"""Rocks from a table: places and diameters of your own, such as those that were counted in an image."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import IcyMoonError
from ...suggestions import nearest

#: Columns that a table must have.
COLUMNS = ("x_m", "y_m", "diameter_m")
TABLE = "TABLE"


def read_table(path: Path) -> np.ndarray:
    """Places east and north and diameters (n, 3) in metres, largest first, from a CSV file whose first line names its
    columns; others than ``COLUMNS`` are not read.

    Raises IcyMoonError if the file is missing, or a column, or a number.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").split("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise IcyMoonError(f"{path}: cannot be read ({error}); check rocks.file.") from None
    heads = [head.strip() for head in lines[0].split(",")]
    for column in COLUMNS:
        if column not in heads:
            raise IcyMoonError(f"{path}: has no column {column}, {nearest(column, heads)} Its first line must name the "
                               f"columns {', '.join(COLUMNS)}.")
    at = [heads.index(column) for column in COLUMNS]
    rows = [(number, line.split(",")) for number, line in enumerate(lines[1:], 2) if line.strip()]
    values = np.empty((len(rows), len(COLUMNS)))
    for k, (number, cells) in enumerate(rows):
        try:
            values[k] = [float(cells[column]) for column in at]
        except (ValueError, IndexError):
            raise IcyMoonError(f"{path}: line {number} has no number for each of {', '.join(COLUMNS)}; "
                               "fix it.") from None
    wrong = ~np.isfinite(values).all(axis=1) | (values[:, 2] <= 0)
    if wrong.any():
        raise IcyMoonError(f"{path}: line {rows[int(np.argmax(wrong))][0]} is no rock; give finite places and a "
                           "diameter above 0.")
    return values[np.argsort(-values[:, 2], kind="stable")]


def covered_share(table: np.ndarray, size_m: float) -> float:
    """Share of a square patch under the rocks of a table (n, 3), counting overlaps twice."""
    return float(np.pi / 4 * (table[:, 2] ** 2).sum() / size_m**2)
