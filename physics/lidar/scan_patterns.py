"""The directions into which a laser scanner sends its pulses, and their times.

The axes of a sensor follow ROS (REP 103): x forward, y left, z up. Azimuth grows from x to y, elevation from the
horizon upward. A pattern divides its field into equal cells, rows from the top down, and sends a beam through the
centre of each cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError

#: Number of beams of the largest pattern.
MAX_BEAMS = 10**9
#: Widest field of a flash, which is a pinhole camera.
WIDEST_FLASH_DEG = 170.0

PatternKind = Literal["SPINNING", "RASTER", "FLASH"]


@dataclass(frozen=True)
class Beams:
    """Consecutive beams of a pattern: unit vectors ``direction`` (n, 3) in the sensor's axes, ``row`` and ``column``
    (n,) int32, and ``time_s`` (n,), seconds after the scan began.
    """

    direction: Array
    row: Array
    column: Array
    time_s: Array


@dataclass(frozen=True)
class ScanPattern:
    """A pattern of ``rows`` times ``columns`` beams in a field of ``width_deg`` by ``height_deg``, whose middle is
    ``elevation_deg`` above the sensor's horizon.

    SPINNING: all rows of a column at once, one column after the other, counterclockwise. RASTER: row by row, each from
    left to right, in equal steps of both angles. FLASH: all beams at once, through the pixels of a pinhole camera.
    A scan takes ``period_s``. Raises IcyMoonError for a pattern without beams and for fields that are not possible.
    """

    kind: PatternKind
    rows: int
    columns: int
    width_deg: float
    height_deg: float
    elevation_deg: float = 0.0
    period_s: float = 0.1

    def __post_init__(self) -> None:
        if self.rows < 1 or self.columns < 1:
            raise IcyMoonError(
                f"The LiDAR's pattern has {self.rows} rows and {self.columns} columns, so it has no beams; give at "
                "least one of each."
            )
        if self.count > MAX_BEAMS:
            raise IcyMoonError(
                f"The LiDAR's pattern has {self.count:.3g} beams; reduce lidar.rows or lidar.columns to {MAX_BEAMS:g} "
                "or fewer beams."
            )
        widest = WIDEST_FLASH_DEG if self.kind == "FLASH" else 360.0
        highest = WIDEST_FLASH_DEG if self.kind == "FLASH" else 180.0
        if not (0 <= self.width_deg <= widest and 0 <= self.height_deg <= highest):
            raise IcyMoonError(
                f"The LiDAR's field is {self.width_deg:g}° wide and {self.height_deg:g}° high; a {self.kind} pattern "
                f"has at most {widest:g}° and {highest:g}°."
            )
        if not 0 <= self.period_s < np.inf:
            raise IcyMoonError(f"A scan of the LiDAR takes {self.period_s:g} s; give 0 or a positive number.")

    @property
    def count(self) -> int:
        """Number of beams of a scan."""
        return self.rows * self.columns

    def make_beams(self, first: int = 0, end: int | None = None) -> Beams:
        """Make the beams from number ``first`` to before ``end``, in the order of their firing; all by default."""
        return self.make_chosen(np.arange(first, min(self.count, self.count if end is None else end)))

    def make_chosen(self, number: Array) -> Beams:
        """Make the beams with these numbers (n,), each from 0 to before ``count``."""
        if self.kind == "SPINNING":
            column, row = np.divmod(number, self.rows)
            time_s = column * (self.period_s / self.columns)
        else:
            row, column = np.divmod(number, self.columns)
            time_s = number * (self.period_s / self.count) if self.kind == "RASTER" else np.zeros(len(number))
        across, upward = (column + 0.5) / self.columns - 0.5, 0.5 - (row + 0.5) / self.rows
        make = self._point_pixels if self.kind == "FLASH" else self._point_angles
        return Beams(make(across, upward), row.astype(np.int32), column.astype(np.int32), time_s)

    def choose_spread(self, most_rows: int, most_columns: int) -> Array:
        """Choose the numbers of at most ``most_rows`` times ``most_columns`` beams that spread over the field. The
        outermost rows and columns are among them if at least two of each are chosen.
        """
        row, column = (
            np.unique(np.rint(np.linspace(0, count - 1, min(count, most))).astype(np.int64))
            for count, most in ((self.rows, most_rows), (self.columns, most_columns))
        )
        number = column[:, None] * self.rows + row if self.kind == "SPINNING" else row[:, None] * self.columns + column
        return np.asarray(number.ravel())

    def _point_angles(self, across: Array, upward: Array) -> Array:
        """Compute the directions (n, 3) at equal steps of angle; ``across`` and ``upward`` (n,) are shares of the
        field.
        """
        turn = 1.0 if self.kind == "SPINNING" else -1.0
        azimuth = np.radians(turn * across * self.width_deg)
        elevation = np.radians(self.elevation_deg + upward * self.height_deg)
        level = np.cos(elevation)
        return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)

    def _point_pixels(self, across: Array, upward: Array) -> Array:
        """Compute the directions (n, 3) through pixels of a pinhole camera; ``across`` and ``upward`` (n,) are shares
        of the field.
        """
        left = -2 * across * np.tan(np.radians(self.width_deg / 2))
        up = 2 * upward * np.tan(np.radians(self.height_deg / 2))
        length = np.sqrt(1 + left**2 + up**2)
        sine, cosine = np.sin(np.radians(self.elevation_deg)), np.cos(np.radians(self.elevation_deg))
        return np.stack([cosine - sine * up, left, sine + cosine * up], axis=1) / length[:, None]
