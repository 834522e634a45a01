"""Reading the disparities that an evaluation stored. Needs only numpy, which Blender has."""

from __future__ import annotations

import math
from pathlib import Path

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import parse_npz, read

_NAME = "disparity"
#: Bytes of a value at most, and of the header of an array.
_VALUE, _HEADER = 8, 2**14


def read_disparity(path: Path, shape: tuple[int, ...]) -> Array | None:
    """The float32 disparity that ``image_files.write_disparity`` stored; None if it is damaged or of another shape."""
    try:
        stored = read(
            path,
            lambda foreign: parse_npz(foreign, {_NAME}),
            "a stored disparity",
            "evaluate again",
            memory=_VALUE * math.prod(shape) + _HEADER,
        )
    except IcyMoonError:
        return None
    disparity = stored.get(_NAME)
    return disparity if disparity is not None and disparity.shape == shape else None
