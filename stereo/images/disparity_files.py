"""Reading the disparities that an evaluation stored. Needs only numpy, which Blender has."""

from __future__ import annotations

import math
from pathlib import Path

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import parse_npz, read

#: Names of the arrays of a disparity file.
_DISPARITY, _FOCAL_BASELINE = "disparity", "focal_baseline_px_m"
#: Most bytes of a value, and of the header of an array.
_VALUE_BYTES, _HEADER_BYTES = 8, 2**14


def read_disparity(path: Path, shape: tuple[int, ...]) -> Array | None:
    """The float32 disparity that ``image_files.write_disparity`` stored; None if it is damaged or of another shape."""
    disparity = _read_array(path, _DISPARITY, _VALUE_BYTES * math.prod(shape) + _HEADER_BYTES)
    return disparity if disparity is not None and disparity.shape == shape else None


def read_focal_baseline(path: Path) -> float | None:
    """f·B in px·m, which turns the stored disparities into depths; None if the file states none."""
    stored = _read_array(path, _FOCAL_BASELINE, _VALUE_BYTES + _HEADER_BYTES)
    if stored is None or stored.shape or stored.dtype.kind != "f":
        return None
    return float(stored)


def _read_array(path: Path, name: str, memory: int) -> Array | None:
    try:
        stored = read(
            path, lambda foreign: parse_npz(foreign, {name}), "a stored disparity", "evaluate again", memory=memory
        )
    except IcyMoonError:
        return None
    return stored.get(name)
