"""Triangles of a robot's link from STL (binary and ASCII) and Wavefront OBJ, which need no library.

The file comes from a stranger: sizes are bounded, indices are checked, and nothing else that it names is opened.
"""

from __future__ import annotations

from array import array
from pathlib import Path

import numpy as np

from ...errors import IcyMoonError
from ...formats import obj
from ...support.foreign_bytes import ForeignBytes, RefusedError, read

#: Largest file in bytes, and most triangles of one file.
MOST_BYTES, MOST_TRIANGLES = 200_000_000, 1_000_000
_STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: Bytes before the triangles of a binary STL: 80 of a text, then their number.
_STL_TEXT, _STL_HEADER = 80, 84


def read_link_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) in the file's unit and triangles (m, 3).

    Raises IcyMoonError if the file is missing, of another format, too large, empty or broken.
    """
    parse = {".stl": _parse_stl, ".obj": _parse_obj}.get(path.suffix.lower())
    if parse is None:
        raise IcyMoonError(f"{path}: meshes of a URDF are read from STL and OBJ; convert this one.")
    return read(path, lambda foreign: _checked(*parse(foreign)), f"an {path.suffix[1:].upper()} mesh",
                "export it again, or change the URDF", most=MOST_BYTES)


def _checked(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if not len(triangles):
        raise RefusedError("has no triangle; export it again.")
    if not np.isfinite(vertices).all() or np.abs(vertices).max() > 1e9:
        raise RefusedError("has vertices that are no place; export it again.")
    return vertices, triangles


def _parse_obj(foreign: ForeignBytes) -> tuple[np.ndarray, np.ndarray]:
    return obj.parse_triangles(foreign, MOST_TRIANGLES)


def _check_count(triangles: int) -> None:
    if triangles > MOST_TRIANGLES:
        raise RefusedError(f"has more than {MOST_TRIANGLES} triangles; make it coarser.")


def _parse_stl(foreign: ForeignBytes) -> tuple[np.ndarray, np.ndarray]:
    head = foreign.part(0, min(foreign.size, _STL_HEADER))
    count = int.from_bytes(head[_STL_TEXT:], "little") if len(head) == _STL_HEADER else -1
    # A binary file may begin with "solid" too; only its size tells.
    if foreign.size == _STL_HEADER + _STL.itemsize * count:
        _check_count(count)
        table = foreign.cursor(_STL_HEADER).numbers(_STL, count, "triangles")
        corners = table["corners"].reshape(-1, 3).astype(np.float64)
    else:
        corners = _read_stl_text(foreign)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _read_stl_text(foreign: ForeignBytes) -> np.ndarray:
    """Corners (3 n, 3) of triangles."""
    numbers, begun = array("d"), False
    for number, line in foreign.lines():
        words = line.split(None, 4)
        if not words:
            continue
        if not begun and not words[0].lower().startswith(b"solid"):
            break
        begun = True
        if words[0] == b"vertex":
            numbers.extend(obj.parse_vertex(words, number))
            _check_count(len(numbers) // 9)
    if not begun or len(numbers) % 9:
        raise ValueError("it is cut off")
    return np.array(numbers).reshape(-1, 3)
