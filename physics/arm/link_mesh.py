"""Triangles of a robot's link from STL (binary and ASCII) and Wavefront OBJ, which need no library.

The file comes from a stranger: sizes are bounded, indices are checked, and nothing else that it names is opened.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...errors import IcyMoonError
from ...files import shorten

#: Largest file in bytes, and most triangles of one file.
MOST_BYTES, MOST_TRIANGLES = 200_000_000, 1_000_000
_STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.MULTILINE)


def read_link_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) in the file's unit and triangles (m, 3).

    Raises IcyMoonError if the file is missing, of another format, too large, empty or broken.
    """
    try:
        size = path.stat().st_size if path.is_file() else -1
    except OSError:
        size = -1
    if size < 0:
        raise IcyMoonError(f"{path}: the mesh is missing; put it there or change the URDF.")
    if size > MOST_BYTES:
        raise IcyMoonError(f"{path}: has {size / 1e6:.0f} MB, more than {MOST_BYTES / 1e6:.0f} for a link's mesh; "
                           "make it coarser.")
    reader = {".stl": _read_stl, ".obj": _read_obj}.get(path.suffix.lower())
    if reader is None:
        raise IcyMoonError(f"{path}: meshes of a URDF are read from STL and OBJ; convert this one.")
    try:
        vertices, triangles = reader(path.read_bytes())
    except (OSError, ValueError, IndexError, OverflowError) as error:
        raise IcyMoonError(f"{path}: is no {path.suffix[1:].upper()} mesh ({error}); export it again.") from None
    if not len(triangles):
        raise IcyMoonError(f"{path}: has no triangle; export it again.")
    if len(triangles) > MOST_TRIANGLES:
        raise IcyMoonError(f"{path}: has {len(triangles)} triangles, more than {MOST_TRIANGLES} for a link; make it "
                           "coarser.")
    if not np.isfinite(vertices).all() or np.abs(vertices).max() > 1e9:
        raise IcyMoonError(f"{path}: has vertices that are no place; export it again.")
    return vertices, triangles


def _read_stl(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    # A binary file may begin with "solid" too; only its size tells.
    if len(data) == 84 + _STL.itemsize * count:
        corners = np.frombuffer(data, _STL, count, 84)["corners"].reshape(-1, 3).astype(np.float64)
    else:
        if not data.lstrip()[:5].lower() == b"solid":
            raise ValueError("it is cut off")
        corners = np.array([[float(value) for value in match] for match in _VERTEX.findall(data)]).reshape(-1, 3)
        if len(corners) % 3:
            raise ValueError("it is cut off")
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _read_obj(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    vertices: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    farthest, at = 0, 0  # the highest number of a vertex that a face has, and the line of that face
    for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), 1):
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append(_numbers(words[1:4], number))
        elif words[:1] == ["f"]:
            face = [_index(word, len(vertices), number) for word in words[1:]]
            if (highest := max(face, default=-1) + 1) > farthest:
                farthest, at = highest, number
            triangles += [(face[0], face[k], face[k + 1]) for k in range(1, len(face) - 1)]
    if farthest > len(vertices):  # only now: a face may come before its vertices
        raise ValueError(f"the face of line {at} has vertex {farthest}, but there are {len(vertices)}")
    return np.array(vertices, np.float64).reshape(-1, 3), np.array(triangles, np.int64).reshape(-1, 3)


def _numbers(words: list[str], number: int) -> list[float]:
    try:
        x, y, z = map(float, words)
    except ValueError:
        raise ValueError(f"the vertex of line {number} is not three numbers") from None
    return [x, y, z]


def _index(word: str, count: int, number: int) -> int:
    """The index of a corner such as 7/1/2 of a face, after ``count`` vertices: from 1, or back from -1, the last."""
    try:
        index = int(word.split("/")[0])
    except ValueError:
        raise ValueError(f"the face of line {number} has {shorten(word)!r}, not the number of a vertex") from None
    if index == 0 or index < -count:
        raise ValueError(f"the face of line {number} has vertex {shorten(str(index))}; they count from 1, or back "
                         "from -1")
    return index - 1 if index > 0 else count + index
