"""IES files (ANSI/IES LM-63): the measured intensity of a luminaire by direction.

Source: ANSI/IES LM-63-19. Lines of keywords end with a line ``TILT=``; then numbers follow in a fixed order, with any
spaces and line breaks. Photometry of type C is supported, without TILT. Lumens, watts and the multiplier are not used,
since a lamp's own power scales the table.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ..physics.light.intensity_table import IntensityTable
from ..support.arrays import Array
from ..support.foreign_bytes import ForeignBytes, RefusedError, read

#: Largest file in bytes; intensities every 0.5° all around take 2 MB.
_MAX_BYTES = 2**23
#: Largest number of angles in either direction.
_MAX_ANGLES = 1500
_FIX = "export it as LM-63 with photometry of type C and TILT=NONE"
_TYPE_NAMES = {2: "B", 3: "A"}
#: Angle in degrees between the rows of a table for Cycles, which interpolates by curves.
_VERTICAL_STEP_DEG, _HORIZONTAL_STEP_DEG = 0.5, 1.0
#: Width in degrees of the edge of a table that ends at 90°.
_EDGE_DEG = 1e-6
#: Cycles multiplies the intensities of a table by this number, to get the strength of a lamp.
_STRENGTH_PER_CANDELA = 0.0706650768394


def read_ies(path: Path) -> IntensityTable:
    """Read the intensity by direction from a file. Raises IcyMoonError, one sentence with a fix."""
    return read(path, parse_ies, "an IES file", _FIX, _MAX_BYTES)


def parse_ies(foreign: ForeignBytes) -> IntensityTable:
    """Parse the intensity by direction from the bytes of a file. Raises ValueError and RefusedError with the reason."""
    head, mark, rest = foreign.text().partition("TILT=")
    if not mark or not (not head or head.endswith("\n") or head.endswith("\r")):
        raise ValueError("no line that begins with TILT=")
    tilt, _, body = rest.partition("\n")
    if tilt.strip().upper() != "NONE":
        raise RefusedError(f"depends on the tilt of its lamp (TILT={tilt.strip()[:20]}); {_FIX}.")
    numbers = body.replace(",", " ").split()
    counts = [_parse_number(text) for text in numbers[:13]]
    if len(counts) < 13:
        raise ValueError("it ends before its angles")
    if counts[5] != 1:
        name = _TYPE_NAMES.get(int(counts[5]), f"{counts[5]:g}")
        raise RefusedError(f"has photometry of type {name}; {_FIX}.")
    columns, rows = _parse_count(counts[3]), _parse_count(counts[4])
    foreign.budget.charge(8 * (columns + rows + columns * rows), "table")
    wanted = 13 + columns + rows + columns * rows
    if len(numbers) < wanted:
        raise ValueError(f"it has {len(numbers)} numbers, but its table needs {wanted}")
    values = np.array([_parse_number(text) for text in numbers[13:wanted]])
    return make_table(
        values[:columns], values[columns : columns + rows], values[columns + rows :].reshape(rows, columns)
    )


def make_table(vertical_deg: Array, horizontal_deg: Array, values: Array) -> IntensityTable:
    """Complete a file's angles and intensities to all directions. A file may omit planes that follow by symmetry, and
    the dark half. Raises ValueError for angles or intensities that type C does not allow."""
    for name, angles in (("vertical", vertical_deg), ("horizontal", horizontal_deg)):
        if (np.diff(angles) <= 0).any():
            raise ValueError(f"its {name} angles do not increase")
    if len(vertical_deg) < 2 or vertical_deg[0] not in (0.0, 90.0) or vertical_deg[-1] not in (90.0, 180.0):
        raise ValueError("its vertical angles do not go from 0° or 90° to 90° or 180°")
    if (values < 0).any() or not values.any():
        raise ValueError("its intensities are not positive")
    horizontal_deg, values = _complete_planes(horizontal_deg, values)
    return IntensityTable(*_complete_halves(vertical_deg, horizontal_deg, values))


def _complete_planes(angles: Array, values: Array) -> tuple[Array, Array]:
    """Complete the planes from 0 to 360 degrees, by the symmetry that the first and last angle indicate."""
    if len(angles) == 1 and angles[0] == 0:
        return angles, values
    first, last = float(angles[0]), float(angles[-1])
    if (first, last) == (90.0, 270.0):
        angles, values = np.concatenate([angles, 540.0 - angles[-2::-1]]), np.concatenate([values, values[-2::-1]])
        wanted = np.unique(np.concatenate([[0.0, 360.0], angles % 360.0]))
        at = np.where(wanted < 90.0, wanted + 360.0, wanted)
        return wanted, np.stack([np.interp(at, angles, column) for column in values.T], axis=1)
    if first != 0 or last not in (90.0, 180.0, 360.0):
        raise ValueError("its horizontal angles do not go from 0° to 0°, 90°, 180° or 360°")
    while angles[-1] < 360.0:
        end = float(angles[-1])
        angles, values = np.concatenate([angles, 2 * end - angles[-2::-1]]), np.concatenate([values, values[-2::-1]])
    return angles, values


def _complete_halves(vertical: Array, horizontal: Array, values: Array) -> tuple[Array, Array, Array]:
    """Complete the vertical angles from 0 to 180 degrees. A half that the table leaves out gets no light."""
    dark = np.zeros((len(values), 2))
    if vertical[0] == 90.0:
        vertical = np.concatenate([[0.0, 90.0 - _EDGE_DEG], vertical])
        values = np.concatenate([dark, values], axis=1)
    if vertical[-1] == 90.0:
        vertical = np.concatenate([vertical, [90.0 + _EDGE_DEG, 180.0]])
        values = np.concatenate([values, dark], axis=1)
    return vertical, horizontal, values


def _parse_number(text: str) -> float:
    number = float(text)
    if "_" in text or not math.isfinite(number):
        raise ValueError(f"{text[:20]!r} is not a number")
    return number


def _parse_count(number: float) -> int:
    if number != int(number) or not 1 <= number <= _MAX_ANGLES:
        raise ValueError(f"{number:g} angles, but 1 to {_MAX_ANGLES} are supported")
    return int(number)


def write_for_cycles(table: IntensityTable) -> str:
    """Write an IES file with which a point lamp in Cycles sends out its own power: the strength is 4π times the table's
    intensity divided by its flux.

    Cycles interpolates by curves, so the angles are close together. Cycles counts horizontal angles clockwise from the
    luminaire's lower side; the table counts them from its right side.
    """
    vertical = np.linspace(0.0, 180.0, round(180 / _VERTICAL_STEP_DEG) + 1)
    around = 1 if len(table.horizontal_deg) == 1 else round(360 / _HORIZONTAL_STEP_DEG) + 1
    horizontal = np.linspace(0.0, 360.0, around) if around > 1 else np.zeros(1)
    found = table.find_intensity(vertical[None], 270.0 - horizontal[:, None])
    candela = found * (4 * np.pi / IntensityTable(vertical, horizontal, found).flux / _STRENGTH_PER_CANDELA)
    lines = ["IESNA:LM-63-2002", "TILT=NONE", f"1 -1 1 {len(vertical)} {len(horizontal)} 1 2 0 0 0", "1 1 0"]
    lines += [" ".join(f"{each:.7g}" for each in row) for row in (vertical, horizontal, *candela)]
    return "\n".join(lines) + "\n"
