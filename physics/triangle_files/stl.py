"""STL, binary and ASCII: the triangles of a small file, and a check of a large one.

Format: 3D Systems, StereoLithography Interface Specification, 1989.
"""

from __future__ import annotations

from array import array

import numpy as np

from ...support.arrays import Array
from ...support.foreign_bytes import ForeignBytes, RefusedError
from .line_patterns import LinePatterns, UnusualTextError, read_whole_lines, reduce_digits
from .obj import parse_vertex

_TRIANGLE_TYPE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: Number of bytes of text at the start of a binary file.
_TEXT_BYTES = 80
#: Number of bytes before the triangles of a binary file: the text and the number of triangles.
_HEADER_BYTES = 84


def count_triangles(foreign: ForeignBytes) -> int | None:
    """Return the number of triangles of a binary file; None for any other file."""
    head = foreign.part(0, min(foreign.size, _HEADER_BYTES))
    count = int.from_bytes(head[_TEXT_BYTES:], "little") if len(head) == _HEADER_BYTES else -1
    # A binary file may begin with "solid" too; only its size tells.
    return count if foreign.size == _HEADER_BYTES + _TRIANGLE_TYPE.itemsize * count else None


def parse_triangles(foreign: ForeignBytes, most: int) -> tuple[Array, Array]:
    """Parse the corners (3 n, 3) float64 and the triangles (n, 3).

    Raises ValueError if the file is malformed, and RefusedError for more than ``most`` triangles as soon as they are
    read.
    """
    count = count_triangles(foreign)
    if count is None:
        corners = _read_ascii(foreign, most)
    else:
        _check_count(count, most)
        table = foreign.cursor(_HEADER_BYTES).numbers(_TRIANGLE_TYPE, count, "triangles")
        corners = table["corners"].reshape(-1, 3).astype(np.float64)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _check_count(triangles: int, most: int) -> None:
    if triangles > most:
        raise RefusedError(f"has more than {most} triangles; make it coarser.")


def _read_ascii(foreign: ForeignBytes, most: int) -> Array:
    numbers, begun = array("d"), False
    for number, line in foreign.lines():
        words = line.split(None, 4)
        if not words:
            continue
        if not begun and not words[0].lower().startswith(b"solid"):
            break
        begun = True
        if words[0] == b"vertex":
            numbers.extend(parse_vertex(words, number))
            _check_count(len(numbers) // 9, most)
    if not begun or len(numbers) % 9:
        raise ValueError("it is cut off")
    return np.array(numbers).reshape(-1, 3)


def check_statements(foreign: ForeignBytes) -> None:
    """Check that Blender's importer, which turns malformed numbers into zeros, reads a file of any size correctly.

    Raises ValueError, with the line, if the file is malformed.
    """
    if count_triangles(foreign) is not None:
        return
    try:
        count = _count_vertices(foreign)
    except UnusualTextError:
        count = 0
        for number, line in foreign.lines():
            if _is_vertex(line):
                count += 1
                parse_vertex(line.split(None, 4), number)
            elif number == 1 and not line.lstrip().lower().startswith(b"solid"):
                raise ValueError("it is cut off") from None
    if count % 3:
        raise ValueError("it is cut off")


def _is_vertex(line: bytes) -> bool:
    return b"v" in line and line.lstrip().startswith(b"vertex")


def _count_vertices(foreign: ForeignBytes) -> int:
    """Count the vertices of a text with valid lines in the usual form. Raises UnusualTextError for any other text."""
    if not foreign.part(0, min(foreign.size, _TEXT_BYTES)).lstrip(b" \t").lower().startswith(b"solid"):
        raise UnusualTextError
    patterns, count = LinePatterns(_check_line), 0
    for text in read_whole_lines(foreign):
        lines = reduce_digits(text)
        patterns.check_lines(lines)
        count += lines.count(b"vertex")
    return count


def _check_line(line: bytes) -> None:
    if _is_vertex(line):
        parse_vertex(line.split(None, 4), 0)
    if line.count(b"vertex") != _is_vertex(line):  # such as in the name of a solid
        raise UnusualTextError
