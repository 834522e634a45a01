"""The orientation that an image states in its EXIF data, by which viewers turn it."""

from __future__ import annotations

import struct

from ...formats.tiff import read_directories
from ...support.foreign_bytes import Budget, ForeignBytes, OverBudgetError

#: As the pixels are stored.
UPRIGHT = 1
#: The first bytes of EXIF data in JPEG, and in some WebP files; a TIFF file follows.
_MARK = b"Exif\0\0"
_ORIENTATION, _MOST_BYTES, _MOST_ORIENTATION = 274, 2**16, 8


def parse_orientation(body: bytes) -> int:
    """The orientation, 1 to 8, that EXIF data state; 1 if they state none or cannot be read, as viewers take it."""
    data = body.removeprefix(_MARK)[:_MOST_BYTES]
    try:
        stated = read_directories(ForeignBytes(data, len(data), Budget()))[0].number(_ORIENTATION, UPRIGHT)
    except (ValueError, KeyError, IndexError, struct.error, OverBudgetError):
        return UPRIGHT
    return stated if UPRIGHT <= stated <= _MOST_ORIENTATION else UPRIGHT
