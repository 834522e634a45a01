"""Returns of a laser scanner in files: all of them as npz, and as points in PLY."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np

from ..physics.lidar.returns import Returns
from ..physics.lidar.scan_patterns import ScanPattern
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.files import write_atomically
from ..support.foreign_bytes import parse_npz, read
from .ply import write_cloud

#: Arrays that place returns: where they were measured, and where the surface is.
_MEASURED, _TRUE = "point_m", "true_point_m"
_FIX = "scan the scene again by icymoon lidar"

#: Points of a PLY file: their properties, and how each is made.
_PLY_NAMES = ("x", "y", "z", "energy_j", "range_m", "range_error_m", "return_number", "label", "instance")


def write_returns(path: Path, returns: Returns, pattern: ScanPattern) -> None:
    """Write returns as npz: the fields of ``Returns``, and ``row``, ``column`` and ``time_s`` of each return's beam.
    Raises IcyMoonError if the disk refuses."""
    row, column, time_s = find_cells(returns.beam, pattern)
    arrays = {field.name: getattr(returns, field.name) for field in fields(Returns)}

    def write(part: Path) -> None:
        with part.open("wb") as stream:
            np.savez(stream, **arrays, row=row, column=column, time_s=time_s)

    write_atomically(path, write)


def read_points(path: Path) -> tuple[Array, Array]:
    """The measured and the true points (n, 3), m, in the axes of the site, of returns that ``write_returns`` wrote.
    Raises IcyMoonError, one sentence with a fix."""
    stored = read(path, lambda foreign: parse_npz(foreign, {_MEASURED, _TRUE}, "f"), "a scan", _FIX)
    for name in (_MEASURED, _TRUE):
        points = stored.get(name)
        if points is None or points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise IcyMoonError(f"{path}: {name} is not a list of points with three finite coordinates; {_FIX}.")
    if len(stored[_MEASURED]) != len(stored[_TRUE]):
        raise IcyMoonError(f"{path}: {_MEASURED} and {_TRUE} have different numbers of points; {_FIX}.")
    return stored[_MEASURED].astype(np.float64), stored[_TRUE].astype(np.float64)


def find_cells(beam: Array, pattern: ScanPattern) -> tuple[Array, Array, Array]:
    """Row, column and time in s (n,) of beams (n,)."""
    spinning = pattern.kind == "SPINNING"
    first, second = np.divmod(beam, pattern.rows if spinning else pattern.columns)
    row, column = (second, first) if spinning else (first, second)
    steps = {"SPINNING": column / pattern.columns, "RASTER": beam / pattern.count, "FLASH": np.zeros(len(beam))}
    return row, column, steps[pattern.kind] * pattern.period_s


def write_points(path: Path, returns: Returns) -> None:
    """Write the points of returns as binary PLY, in the axes of the site. Raises IcyMoonError if the disk refuses."""
    columns = np.column_stack(
        [
            returns.point_m,
            returns.energy_j,
            returns.range_m,
            returns.range_m - returns.true_range_m,
            returns.order,
            returns.label,
            returns.number,
        ]
    )
    write_cloud(path, _PLY_NAMES, columns, ("Icy Moon: range_error_m is measured minus true range",))
