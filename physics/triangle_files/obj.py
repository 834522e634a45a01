"""Wavefront OBJ: vertices and triangles of a small file, and a check of a large one.

Format: the appendix "Object Files (.obj)" of Wavefront's Advanced Visualizer. No file that it names is opened.
"""

from __future__ import annotations

import math
from array import array

import numpy as np

from ...support.arrays import Array
from ...support.files import shorten
from ...support.foreign_bytes import LONGEST_LINE_BYTES, ForeignBytes, RefusedError
from .line_patterns import LinePatterns, UnusualTextError, read_whole_lines, reduce_digits

#: Bytes that may occur in a face after its first word.
_FACE_BYTES = b"0123456789/- \t"
_MAX_LIBRARIES = 100


def parse_triangles(foreign: ForeignBytes, most: int) -> tuple[Array, Array]:
    """Parse the vertices (n, 3) in the file's unit, and the triangles (m, 3); a polygon becomes a fan. Raises
    ValueError, with the line, for a malformed file. Raises RefusedError for more than ``most`` triangles or three times
    as many vertices, as soon as they are read.
    """
    numbers, corners = array("d"), array("q")
    most_vertices = 3 * most
    farthest, at = 0, 0  # the highest vertex number in a face, and the line of this face
    for number, line in foreign.lines():
        words = line.split()
        if not words:
            continue
        if words[0] == b"v":
            numbers.extend(parse_vertex(words, number))
            if len(numbers) > 3 * most_vertices:
                raise RefusedError(f"has more than {most_vertices} vertices; make it coarser.")
        elif words[0] == b"f":
            count = len(numbers) // 3
            face = [_parse_index(word, count, number) for word in words[1:]]
            if (highest := max(face, default=-1) + 1) > farthest:
                farthest, at = highest, number
            if highest > most_vertices:
                break  # no vertex can have this number
            for k in range(1, len(face) - 1):
                corners.extend((face[0], face[k], face[k + 1]))
            if len(corners) > 3 * most:
                raise RefusedError(f"has more than {most} triangles; make it coarser.")
    vertices = np.frombuffer(numbers, np.float64).reshape(-1, 3) if numbers else np.empty((0, 3))
    if farthest > len(vertices):  # only now: a face may come before its vertices
        raise ValueError(f"the face of line {at} has vertex {shorten(str(farthest))}, but there are {len(vertices)}")
    return vertices, np.frombuffer(corners, np.int64).reshape(-1, 3) if corners else np.empty((0, 3), np.int64)


def parse_vertex(words: list[bytes], number: int) -> tuple[float, float, float]:
    """Parse the coordinates of a line ``v x y z`` with this ``number``. Raises ValueError if they are not numbers."""
    try:
        x, y, z = map(float, words[1:4])
        if math.inf in (abs(x), abs(y), abs(z)):
            raise ValueError
    except ValueError:
        raise ValueError(f"the vertex of line {number} is not three numbers: {_quote(words[1:4])}") from None
    return x, y, z


def check_statements(foreign: ForeignBytes) -> list[bytes]:
    """Check that Blender's importer, which turns malformed coordinates into zeros and omits faces, reads a file of any
    size correctly. Return the names of the file's material libraries.

    Raises ValueError, with the line, if the file is malformed.
    """
    libraries = list[bytes]()
    try:
        patterns = LinePatterns(_check_pattern)
        for text in read_whole_lines(foreign):
            lines = reduce_digits(text)
            patterns.check_lines(lines)
            if b"mtllib" in lines:
                for line in text.split(b"\n"):
                    _add_library(libraries, line)
    except UnusualTextError:
        return _check_lines(foreign)
    return libraries


def _check_pattern(line: bytes) -> None:
    if line.endswith(b"\\"):
        raise UnusualTextError
    _check_line(line, 0)


def _check_lines(foreign: ForeignBytes) -> list[bytes]:
    before, libraries = b"", list[bytes]()
    for number, line in foreign.lines():
        if before or line.endswith(b"\\"):  # a statement that goes on in the next line
            before += line.removesuffix(b"\\") + b" "
            if len(before) > LONGEST_LINE_BYTES:
                raise ValueError(
                    f"the statement that goes on in line {number} has more than {LONGEST_LINE_BYTES} bytes"
                )
            if line.endswith(b"\\"):
                continue
            line, before = before, b""
        _check_line(line, number)
        _add_library(libraries, line)
    return libraries


def _check_line(line: bytes, number: int) -> None:
    start = line[:2]
    if start in (b"v ", b"v\t"):
        parse_vertex(line.partition(b"#")[0].split(None, 4), number)
    elif start in (b"f ", b"f\t") and line.partition(b"#")[0].translate(None, _FACE_BYTES) != b"f":
        raise ValueError(f"the face of line {number} is not of numbers of vertices: {_quote(line.split()[1:])}")


def _add_library(libraries: list[bytes], line: bytes) -> None:
    if line.startswith(b"mtllib"):
        libraries.append(line.removeprefix(b"mtllib").strip())
        if len(libraries) > _MAX_LIBRARIES:
            raise ValueError(f"it names more than {_MAX_LIBRARIES} material libraries")


def _parse_index(word: bytes, count: int, number: int) -> int:
    """Parse the 0-based vertex index of a corner such as 7/1/2 of a face, after ``count`` vertices. The file counts
    from 1, or back from -1, the last vertex. Raises ValueError, with the line, for another index.
    """
    try:
        index = int(word.partition(b"/")[0])
    except ValueError:
        raise ValueError(f"the face of line {number} has {_quote([word])}, not the number of a vertex") from None
    if index == 0 or index < -count:
        raise ValueError(
            f"the face of line {number} has vertex {shorten(str(index))}; they count from 1, or back from -1"
        )
    return index - 1 if index > 0 else count + index


def _quote(words: list[bytes]) -> str:
    return repr(shorten(b" ".join(words)[:200].decode("utf-8", "replace")))
