"""PLY files: numbers of vertices and faces as they stand in a file, and triangles written to one.

Blender's PLY importer makes zeros of numbers that are none (measured in 4.2, 5.0 and 5.2), single precision of
doubles, and reads texture coordinates only where they are called s and t; reconstructions have all of these.
Format: Turk, "The PLY Polygon File Format", 1994; texture coordinates of face corners (``texcoord``) as VCGlib writes
them.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..files import write_atomically
from ..physics.mesh.check import find_equal_rows

_TYPES = {"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
          "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
          "double": "f8", "float64": "f8"}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
#: What programs call the texture coordinates of a vertex.
_VERTEX_UV = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("tx", "ty"))


@dataclass(frozen=True)
class _Header:
    """``elements`` are name, count and the words of each property; the data begin at byte ``start``."""

    encoding: str
    elements: tuple[tuple[str, int, tuple[tuple[str, ...], ...]], ...]
    start: int
    comments: tuple[tuple[str, ...], ...]  # the words of each


def _read_header(path: Path) -> _Header | None:
    """The header, or None if it is not whole."""
    with path.open("rb") as stream:
        lines = (line.decode("latin-1").strip() for line in stream)
        header = [line.split() for line in itertools.takewhile(lambda line: line != "end_header", lines) if line]
        start = stream.tell()
    encoding = next((line[1] for line in header if line[0] == "format" and len(line) > 1), "")
    elements: list[tuple[str, int, list[tuple[str, ...]]]] = []
    for line in header:
        if line[0] == "element":
            if len(line) < 3:
                return None
            elements.append((line[1], int(line[2]), []))
        elif line[0] == "property" and elements:
            elements[-1][2].append(tuple(line[1:]))
    comments = tuple(tuple(line[1:]) for line in header if line[0] == "comment")
    return _Header(encoding, tuple((name, count, tuple(own)) for name, count, own in elements), start, comments)


def read_comment_number(path: Path, name: str) -> int | None:
    """The whole number of a comment ``name N``, or None if there is none."""
    header = _read_header(path)
    comments = header.comments if header else ()
    found = next((words[1] for words in comments if words[:1] == (name,) and len(words) == 2), "")
    return int(found) if found.isascii() and found.isdecimal() else None


def read_vertices(path: Path) -> np.ndarray | None:
    """Coordinates (n, 3) float64 of the vertices, or None where the file's layout is not the usual one."""
    return read_properties(path, "x", "y", "z")


def read_properties(path: Path, *wanted: str) -> np.ndarray | None:
    """These properties (n, len(wanted)) float64 of the vertices, or None where the file's layout is not the usual one.

    Usual is: vertices first, each of scalar properties with those ``wanted`` among them.
    """
    header = _read_header(path)
    if header is None or not header.elements or header.elements[0][0] != "vertex":
        return None
    _, count, declared = header.elements[0]
    names = [words[-1] for words in declared]
    if not set(wanted) <= set(names) or any(words[0] not in _TYPES for words in declared):
        return None
    if header.encoding == "ascii":
        rows = np.loadtxt(_read_rows(path, header.start, 0, count), ndmin=2)
        return rows[:, [names.index(name) for name in wanted]] if rows.shape == (count, len(names)) else None
    order = _ORDERS.get(header.encoding)
    kind = np.dtype([(words[-1], f"{order}{_TYPES[words[0]]}") for words in declared]) if order else None
    if kind is None or path.stat().st_size < header.start + count * kind.itemsize:
        return None
    table = np.memmap(path, kind, "r", header.start, (count,)) if count else np.empty(0, kind)
    return np.stack([table[name].astype(np.float64) for name in wanted], axis=1)


def read_texture_coordinates(path: Path, faces: np.ndarray) -> np.ndarray | None:
    """Texture coordinates (m, 3, 2) of the corners of triangles ``faces`` (m, 3), vertices of this file.

    Those of the file's faces, which keep seams, count before those of its vertices. None if it has none, or in
    another layout: with corners, vertices and then nothing but triangles, of which ``faces`` may be some.
    """
    found = _read_corner_coordinates(path, faces)
    if found is not None:
        return found
    for names in _VERTEX_UV:
        of_vertices = read_properties(path, *names)
        if of_vertices is not None:
            return of_vertices[faces]
    return None


def _read_rows(path: Path, start: int, skip: int, count: int) -> Iterator[str]:
    """Lines of an ASCII file's data."""
    with path.open("rb") as stream:
        stream.seek(start)
        for line in itertools.islice(stream, skip, skip + count):
            yield line.decode("latin-1")


def _read_corner_coordinates(path: Path, faces: np.ndarray) -> np.ndarray | None:
    header = _read_header(path)
    if header is None or [element[0] for element in header.elements[:2]] != ["vertex", "face"]:
        return None
    (_, vertices, of_vertex), (_, count, of_face) = header.elements[:2]
    names = [words[-1] for words in of_face]
    corners = next((name for name in names if name in ("vertex_indices", "vertex_index")), None)
    if not count or corners is None or "texcoord" not in names:
        return None
    if any(words[0] not in _TYPES for words in of_vertex):
        return None
    if header.encoding == "ascii":
        table = _read_ascii_table(path, header.start, vertices, count, of_face)
    else:
        order = _ORDERS.get(header.encoding)
        size = sum(np.dtype(_TYPES[words[0]]).itemsize for words in of_vertex)
        table = _read_binary_table(path, header.start + vertices * size, count, of_face, order) if order else None
    if table is None or table[corners].shape[1:] != (3,) or table["texcoord"].shape[1:] != (6,):
        return None
    uv = table["texcoord"].reshape(-1, 3, 2)
    if np.array_equal(table[corners], faces):
        return uv
    first, which = find_equal_rows(np.concatenate([table[corners].astype(np.int64), faces]))
    place = first[which[count:]]  # of each of ``faces`` in the file, whose first triangle like it counts
    return uv[place] if (place < count).all() else None


def _read_ascii_table(path: Path, start: int, skip: int, count: int,
                      declared: tuple[tuple[str, ...], ...]) -> dict[str, np.ndarray] | None:
    """Columns of each property of faces in ASCII, or None if their lists are not all of one length."""
    rows = np.loadtxt(_read_rows(path, start, skip, count), ndmin=2)
    table, at = {}, 0
    for words in declared:
        length = 1
        if words[0] == "list":
            length = int(rows[0, at])
            if (rows[:, at] != length).any():
                return None
            at += 1
        table[words[-1]] = rows[:, at:at + length]
        at += length
    return table if rows.shape == (count, at) else None


def _read_binary_table(path: Path, start: int, count: int, declared: tuple[tuple[str, ...], ...],
                       order: str) -> dict[str, np.ndarray] | None:
    """The same of faces in binary."""
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    lengths = {}
    with path.open("rb") as stream:  # the first face says how long the lists are
        stream.seek(start)
        for words in declared:
            name, types = words[-1], [order + _TYPES[word] for word in words[:-1] if word != "list"]
            length = 1
            if words[0] == "list":
                length = int(np.frombuffer(stream.read(np.dtype(types[0]).itemsize), types[0])[0])
                fields.append((f"length of {name}", types[0], ()))
                lengths[f"length of {name}"] = length
            fields.append((name, types[-1], (length,)))
            stream.seek(length * np.dtype(types[-1]).itemsize, 1)
    kind = np.dtype(fields)
    if path.stat().st_size < start + count * kind.itemsize:
        return None
    table = np.memmap(path, kind, "r", start, (count,))
    if any((table[name] != length).any() for name, length in lengths.items()):
        return None
    return {words[-1]: np.asarray(table[words[-1]]) for words in declared}


#: A triangle in a binary file of ours.
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def write_triangles(path: Path, vertices: np.ndarray, triangles: np.ndarray, normals: np.ndarray | None = None,
                    comments: tuple[str, ...] = ()) -> None:
    """Write positions (n, 3), indices (m, 3) and normals (n, 3) of a mesh as a binary PLY file in single precision."""
    names = ("x", "y", "z", *(("nx", "ny", "nz") if normals is not None else ()))
    data = encode_triangles(names, vertices if normals is None else np.hstack([vertices, normals]), triangles, comments)

    def write(part: Path) -> None:
        part.write_bytes(data)

    write_atomically(path, write)


def read_triangles(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) and triangles (m, 3) of a file that ``write_triangles`` wrote. Raises ValueError for another."""
    data = path.read_bytes()
    start = data.find(b"end_header\n") + len(b"end_header\n")
    lines = data[:start].decode("ascii", "replace").splitlines()
    counts = [int(line.split()[2]) for line in lines if line.startswith("element ")]
    width = sum(line.startswith("property float ") for line in lines)
    if len(counts) != 2 or len(data) - start != 4 * width * counts[0] + _FACE.itemsize * counts[1]:
        raise ValueError(f"{path} was not written by write_triangles")
    vertices = np.frombuffer(data, "<f4", width * counts[0], start).reshape(-1, width)
    faces = np.frombuffer(data, _FACE, counts[1], start + vertices.nbytes)
    return vertices[:, :3], faces["corners"].copy()


def encode_triangles(names: tuple[str, ...], vertices: np.ndarray, triangles: np.ndarray,
                     comments: tuple[str, ...] = ()) -> bytes:
    """A binary PLY file of vertices (n, k), whose k properties have these names, in single precision, and of indices
    (m, 3) of triangles."""
    faces = np.empty(len(triangles), _FACE)
    faces["count"], faces["corners"] = 3, triangles
    header = ["ply", "format binary_little_endian 1.0", *(f"comment {each}" for each in comments),
              f"element vertex {len(vertices)}", *(f"property float {name}" for name in names),
              f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    return "\n".join(header).encode("ascii") + np.ascontiguousarray(vertices, "<f4").tobytes() + faces.tobytes()
