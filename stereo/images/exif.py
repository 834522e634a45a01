"""The orientation that an image states in its EXIF data, by which viewers turn it."""

from __future__ import annotations

import struct

from ...formats.tiff import read_directories
from ...support.foreign_bytes import Budget, ForeignBytes, OverBudgetError

#: The orientation of pixels as stored.
UPRIGHT = 1
#: The first bytes of EXIF data in JPEG, and in some WebP files; a TIFF file follows.
_EXIF_START = b"Exif\0\0"
#: Tag of the orientation in TIFF.
_ORIENTATION_TAG = 274
_MOST_BYTES = 2**16
_MOST_ORIENTATION = 8


def parse_orientation(body: bytes) -> int:
    """The orientation, 1 to 8, of EXIF data; 1 without an orientation and for damaged data, as in viewers."""
    data = body.removeprefix(_EXIF_START)[:_MOST_BYTES]
    try:
        stated = read_directories(ForeignBytes(data, len(data), Budget()))[0].number(_ORIENTATION_TAG, UPRIGHT)
    except (ValueError, KeyError, IndexError, struct.error, OverBudgetError):
        return UPRIGHT
    return stated if UPRIGHT <= stated <= _MOST_ORIENTATION else UPRIGHT
