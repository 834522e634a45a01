"""STL, binary and ASCII: the triangles of a small file, and whether a large one is what it should be.

Format: 3D Systems, StereoLithography Interface Specification, 1989.
"""

from __future__ import annotations

from array import array

import numpy as np

from ...support.foreign_bytes import ForeignBytes, RefusedError
from .obj import parse_vertex

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: Bytes before the triangles of a binary file: 80 of a text, then their number.
_TEXT, _HEADER = 80, 84
#: Makes 0 of every digit; how many forms of lines are kept at most.
_DIGITS, _MOST_FORMS = bytes.maketrans(b"123456789", b"0" * 9), 10_000


def count_triangles(foreign: ForeignBytes) -> int | None:
    """The number of triangles of a binary file, None for another."""
    head = foreign.part(0, min(foreign.size, _HEADER))
    count = int.from_bytes(head[_TEXT:], "little") if len(head) == _HEADER else -1
    # A binary file may begin with "solid" too; only its size tells.
    return count if foreign.size == _HEADER + _TRIANGLE.itemsize * count else None


def parse_triangles(foreign: ForeignBytes, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners (3 n, 3) float64 and triangles (n, 3).

    Raises ValueError for what is no mesh, RefusedError for more than ``most`` triangles as soon as they are there.
    """
    count = count_triangles(foreign)
    if count is None:
        corners = _read_text(foreign, most)
    else:
        _check_count(count, most)
        table = foreign.cursor(_HEADER).numbers(_TRIANGLE, count, "triangles")
        corners = table["corners"].reshape(-1, 3).astype(np.float64)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _check_count(triangles: int, most: int) -> None:
    if triangles > most:
        raise RefusedError(f"has more than {most} triangles; make it coarser.")


def _read_text(foreign: ForeignBytes, most: int) -> np.ndarray:
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
    """Compare a file of any size with what Blender's importer takes, which makes zeros of what is no number.

    Raises ValueError, with the line, for what is no mesh.
    """
    if count_triangles(foreign) is not None:
        return
    count = 0
    known: set[bytes] = set()
    for number, line in foreign.lines():
        if b"v" in line and line.lstrip().startswith(b"vertex"):
            count += 1
            # Whether words are numbers does not depend on their digits, and most lines differ in nothing else.
            form = line.translate(_DIGITS)
            if form not in known:
                words = line.split(None, 4)
                parse_vertex(words, number)
                # With an exponent of three digits a number may be too large, whatever its form.
                if len(known) < _MOST_FORMS and all(len(word.lower().partition(b"e")[2]) < 4 for word in words[1:]):
                    known.add(form)
        elif not count and number == 1 and not line.lstrip().lower().startswith(b"solid"):
            raise ValueError("it is cut off")
    if count % 3:
        raise ValueError("it is cut off")
