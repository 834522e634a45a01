"""The output of the user's programs: arrays of a known size, and their last words."""

from __future__ import annotations

import math
from pathlib import Path

from ...support.arrays import Array
from ...support.foreign_bytes import parse_npy, parse_part, read_end, read_regular
from ...support.printer import show_controls

#: Bytes that a file may have beside its numbers, and that each number may take.
_BESIDE, _EACH = 2**20, 16
_LONGEST_WORDS, _SHOWN = 65536, 300


def read_array(path: Path, shape: tuple[int, ...]) -> Array:
    """The numbers of a file in numpy's format, for images of a shape; read-only, of any type.

    Raises OSError if there is no such file, ValueError if it is far too large, IcyMoonError if it is damaged.
    """
    data = read_regular(path, _EACH * math.prod(shape) + _BESIDE)
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
        lines = read_end(path, _LONGEST_WORDS).decode("utf-8", "replace").splitlines()
    except OSError:
        return ""
    return next((show_controls(line.strip()[:_SHOWN]) for line in reversed(lines) if line.strip()), "")
