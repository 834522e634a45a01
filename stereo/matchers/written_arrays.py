"""The output of the user's programs: arrays of a known size, and their last words."""

from __future__ import annotations

import math
from pathlib import Path

from ...support.arrays import Array
from ...support.foreign_bytes import parse_npy, parse_part, read_end, read_regular
from ...support.printer import show_controls

#: Most bytes of a file beside its numbers, and of each number.
_MOST_EXTRA_BYTES, _MOST_BYTES_PER_NUMBER = 2**20, 16
#: Bytes of a text that are read from its end, and most characters that are shown.
_READ_BYTES, _MOST_SHOWN = 65536, 300


def read_array(path: Path, shape: tuple[int, ...]) -> Array:
    """The numbers of a file in numpy's format, for images of a shape; read-only, of any type.

    Raises OSError if there is no such file, ValueError if it is far too large, IcyMoonError if it is damaged.
    """
    data = read_regular(path, _MOST_BYTES_PER_NUMBER * math.prod(shape) + _MOST_EXTRA_BYTES)
    return parse_part(
        data,
        path.name,
        lambda foreign: parse_npy(foreign, "fiubcmMSUV"),
        "an array",
        "write it by numpy.save",
        memory=len(data),
    )


def read_last_line(path: Path) -> str:
    """The last line of a text that a program has written, such as its errors; empty for no text."""
    try:
        lines = read_end(path, _READ_BYTES).decode("utf-8", "replace").splitlines()
    except OSError:
        return ""
    return next((show_controls(line.strip()[:_MOST_SHOWN]) for line in reversed(lines) if line.strip()), "")
