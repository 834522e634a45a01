"""PLY files: counts of vertices and faces in a file, and triangles written to one.

Blender's PLY importer reads malformed numbers as zeros (measured in 4.2, 5.0 and 5.2), doubles in single precision, and
texture coordinates only if they are called s and t; reconstructions have all of these.
Format: Turk, "The PLY Polygon File Format", 1994; texture coordinates of face corners (``texcoord``) as VCGlib writes
them.
"""

from __future__ import annotations

import functools
import struct
from array import array
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from ..physics.mesh.mesh_faults import find_equal_rows
from ..physics.triangle_files.line_patterns import LinePatterns, LineRows, UnusualTextError, reduce_digits
from ..support.arrays import Array
from ..support.files import shorten, write_atomically
from ..support.foreign_bytes import ForeignBytes, parse_whole_numbers, read

_NUMPY_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
#: Letters of ``struct`` for these types.
_STRUCT_CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
#: Names that programs give to the texture coordinates of a vertex.
_VERTEX_UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("tx", "ty"))


#: Largest header in bytes.
_MAX_HEADER_BYTES = 2**16
#: Largest number of rows of an element.
_MAX_ROWS = 2**40
#: Number of rows that are processed together.
_ROWS_AT_ONCE = 2**16
#: Bytes of rows with lists that are processed together.
_LIST_BYTES_AT_ONCE = 2**22
#: Longest row of a text in bytes.
_LONGEST_ROW_BYTES = 2**20
#: Largest mesh file in bytes; it is never in memory as a whole.
MAX_MESH_BYTES = 2**36
#: Names of the lists and numbers that are vertex indices.
_FACE_LIST_NAMES = ("vertex_indices", "vertex_index")
_VERTEX_INDEX_PROPERTIES = {*(("face", name) for name in _FACE_LIST_NAMES), ("edge", "vertex1"), ("edge", "vertex2")}
_FIX = "export the mesh again"


@dataclass(frozen=True)
class _Property:
    """A property: its name, the numpy type of its values, and the numpy type of their number if it is a list."""

    name: str
    kind: str
    count_kind: str | None = None


@dataclass(frozen=True)
class _Element:
    """An element of a file: ``count`` rows of properties."""

    name: str
    count: int
    properties: tuple[_Property, ...]

    @property
    def is_plain(self) -> bool:
        """Return whether no property is a list."""
        return all(each.count_kind is None for each in self.properties)

    @property
    def least_bytes(self) -> int:
        """Number of bytes of a row whose lists are empty."""
        return sum(np.dtype(each.count_kind or each.kind).itemsize for each in self.properties)

    def row_type(self, order: str) -> np.dtype[np.void]:
        """Return the numpy type of a row without lists."""
        return np.dtype([(each.name, order + each.kind) for each in self.properties])


@dataclass(frozen=True)
class _Header:
    """The header of a file. Data begin at byte ``start``, after ``lines`` lines; ``order`` is numpy's sign of the byte
    order, empty for ASCII."""

    order: str
    elements: tuple[_Element, ...]
    start: int
    lines: int
    comments: tuple[bytes, ...]


def _parse_header(foreign: ForeignBytes) -> _Header:
    """Parse the header. Raises ValueError, with the line, for an impossible header."""
    head = foreign.part(0, min(foreign.size, _MAX_HEADER_BYTES))
    elements: list[tuple[str, int, list[_Property]]] = []
    comments: list[bytes] = []
    encoding, start = "", 0
    for number, raw in enumerate(head.splitlines(keepends=True), 1):
        start += len(raw)
        words = raw.decode("latin-1").split()
        if words == ["end_header"]:
            break
        if not words or number == 1:
            continue
        if words[0] == "format" and len(words) > 1:
            encoding = words[1]
        elif words[0] == "comment":
            comments.append(raw.strip().removeprefix(b"comment").strip())
        elif words[0] == "element":
            if len(words) < 3 or not _is_count(words[2]):
                raise ValueError(f"line {number} of the header is not an element with the number of its rows")
            elements.append((words[1], int(words[2]), []))
        elif words[0] == "property" and elements:
            elements[-1][2].append(_parse_property(words, number))
    else:
        raise ValueError("its header has no end")
    if encoding not in ("ascii", *_BYTE_ORDERS):
        raise ValueError(f"its format is {shorten(encoding)!r}")
    for name, _, properties in elements:
        if len({each.name for each in properties}) < len(properties):
            raise ValueError(f"its element {shorten(name)!r} has two properties of one name")
    return _Header(
        _BYTE_ORDERS.get(encoding, ""),
        tuple(_Element(name, count, tuple(own)) for name, count, own in elements),
        start,
        number,
        tuple(comments),
    )


def _is_count(word: str) -> bool:
    return word.isascii() and word.isdecimal() and len(word) < 20 and int(word) <= _MAX_ROWS


def _parse_property(words: list[str], number: int) -> _Property:
    is_list = words[1:2] == ["list"]
    kinds = [_NUMPY_TYPES.get(word, "") for word in (words[2:-1] if is_list else words[1:-1])]
    if len(kinds) != 1 + is_list or not all(kinds) or (is_list and kinds[0][0] == "f"):
        raise ValueError(f"line {number} of the header is not a property with its type")
    return _Property(words[-1], kinds[-1], kinds[0] if is_list else None)


def count_triangles(path: Path) -> int | None:
    """Read the number of faces from the header of a file; None if it states none. Raises IcyMoonError for a damaged
    header."""
    header = read(path, _parse_header, "a PLY file", _FIX, most=MAX_MESH_BYTES)
    return next((element.count for element in header.elements if element.name == "face"), None)


def read_texture_files(path: Path) -> list[bytes]:
    """Read the names of images from comments of the header, as VCGlib writes them.

    Raises IcyMoonError for a damaged header.
    """
    header = read(path, _parse_header, "a PLY file", _FIX, most=MAX_MESH_BYTES)
    return [
        words[1] for text in header.comments if len(words := text.split(None, 1)) == 2 and words[0] == b"TextureFile"
    ]


def check_ply(foreign: ForeignBytes) -> None:
    """Compare the data with the header's statements, before a library allocates memory for them. Raises ValueError,
    with the line, for missing rows, malformed numbers, and indices of vertices that do not exist."""
    header = _parse_header(foreign)
    if bare := next((each for each in header.elements if each.count and not each.properties), None):
        raise ValueError(f"its element {shorten(bare.name)!r} has rows without a property")
    least = sum(
        element.count * (element.least_bytes if header.order else 2 * max(1, len(element.properties)))
        for element in header.elements
    )
    # The last number of a text needs no end of its line.
    if header.start + least > foreign.size + (0 if header.order else 1):
        raise ValueError(f"its header states rows of at least {least} bytes, but {foreign.size - header.start} follow")
    vertices = sum(element.count for element in header.elements if element.name == "vertex")
    if not header.order:
        _check_text(foreign, header, vertices)
        return
    at = header.start
    for element in header.elements:
        if element.is_plain:
            _check_index_ranges(foreign, at, element, header.order, vertices)
            at += element.count * element.least_bytes
        else:
            at = _check_lists(foreign, at, element, header.order, vertices)


def _check_range(name: str, values: Array, lowest: int, vertices: int, row: int) -> None:
    if values.size and not (values.min() >= lowest and values.max() < vertices):
        wrong = values[(values < lowest) | (values >= vertices)].ravel()[0]
        raise ValueError(
            f"row {row} of the element {name}, or one soon after, has vertex {wrong}, and the vertices "
            f"are 0 to {vertices - 1}"
        )


def _find_lowest(element: _Element, name: str) -> int | None:
    """Return the smallest vertex index that a property may have; None for a property with other numbers."""
    if (element.name, name) in _VERTEX_INDEX_PROPERTIES:
        return 0
    return -1 if element.name == "tristrips" and name in _FACE_LIST_NAMES else None  # -1 begins another strip


def _check_index_ranges(foreign: ForeignBytes, at: int, element: _Element, order: str, vertices: int) -> None:
    kind = element.row_type(order)
    names = [each.name for each in element.properties if _find_lowest(element, each.name) is not None]
    for row in range(0, element.count if names else 0, _ROWS_AT_ONCE):
        count = min(_ROWS_AT_ONCE, element.count - row)
        table = np.frombuffer(foreign.part(at + row * kind.itemsize, count * kind.itemsize), kind)
        for name in names:
            _check_range(element.name, table[name], 0, vertices, row)


def _check_lists(foreign: ForeignBytes, at: int, element: _Element, order: str, vertices: int) -> int:
    """Check the rows of an element with lists. Rows of equal lengths are checked together. Returns the byte after
    them."""
    row, kind = 0, _type_of_first_row(foreign, at, element, order)
    lengths = {name: kind[name].shape[0] for name in kind.names or () if f"length of {name}" in (kind.names or ())}
    while row < element.count:
        count = min(element.count - row, max(1, _LIST_BYTES_AT_ONCE // kind.itemsize))
        if at + count * kind.itemsize > foreign.size:
            break
        table = np.frombuffer(foreign.part(at, count * kind.itemsize), kind)
        if any((table[f"length of {name}"] != length).any() for name, length in lengths.items()):
            break
        for each in element.properties:
            if (lowest := _find_lowest(element, each.name)) is not None:
                _check_range(element.name, table[each.name], lowest, vertices, row)
        at += count * kind.itemsize
        row += count
    return at if row == element.count else _check_rows(foreign, at, element, order, vertices, row)


def _type_of_first_row(foreign: ForeignBytes, at: int, element: _Element, order: str) -> np.dtype[np.void]:
    """Return the numpy type of an element's rows if all lists are as long as in the row at byte ``at``."""
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    for each in element.properties:
        length = 1
        if each.count_kind is not None:
            size = np.dtype(each.count_kind).itemsize
            length = int(np.frombuffer(foreign.part(at, size), order + each.count_kind)[0]) if element.count else 0
            _check_length(length, at)
            fields.append((f"length of {each.name}", order + each.count_kind, ()))
            at += size
        fields.append((each.name, order + each.kind, (length,)))
        at += length * np.dtype(each.kind).itemsize
        if at > foreign.size:
            raise ValueError(f"it ends {at - foreign.size} bytes early")
    return np.dtype(fields)


def _check_length(length: int, at: int) -> None:
    if length < 0:
        raise ValueError(f"a list of {length} values at byte {at}")


def _check_rows(foreign: ForeignBytes, at: int, element: _Element, order: str, vertices: int, row: int) -> int:
    """Check rows from number ``row`` on one by one. Returns the byte after them."""
    data = foreign.part(at, foreign.size - at)
    plan = [(each, np.dtype(each.kind).itemsize, _find_lowest(element, each.name)) for each in element.properties]
    unpack = functools.lru_cache(maxsize=1000)(lambda layout: struct.Struct(layout).unpack_from)
    place = 0
    for number in range(row, element.count):
        for each, size, lowest in plan:
            length = 1
            if each.count_kind is not None:
                if place + int(each.count_kind[1]) > len(data):
                    raise ValueError("it ends early")
                (length,) = unpack(order + _STRUCT_CODES[each.count_kind])(data, place)
                _check_length(length, at + place)
                place += int(each.count_kind[1])
            if place + length * size > len(data):
                raise ValueError(f"it ends {place + length * size - len(data)} bytes early")
            if lowest is not None and length:
                values = unpack(f"{order}{length}{_STRUCT_CODES[each.kind]}")(data, place)
                if not (lowest <= min(values) and max(values) < vertices):
                    _check_range(element.name, np.array(values), lowest, vertices, number)
            place += length * size
    return at + place


def _check_text(foreign: ForeignBytes, header: _Header, vertices: int) -> None:
    with suppress(UnusualTextError, ValueError):  # the check line by line finds the fault
        _check_usual_text(foreign, header, vertices)
        return
    lines = foreign.lines(header.start, _LONGEST_ROW_BYTES)
    for element in header.elements:
        if element.is_plain and element.name != "edge":
            for _ in _number_rows(lines, header, element):
                pass
        else:
            _check_words(lines, header, element, vertices)


def _check_usual_text(foreign: ForeignBytes, header: _Header, vertices: int) -> None:
    """Check rows of vertices, followed by rows of faces with equal corner counts. Raises UnusualTextError or ValueError
    for other elements, and for a row that may be wrong."""
    elements = [each for each in header.elements if each.count]
    is_usual = [each.name for each in elements] in (["vertex"], ["vertex", "face"]) and elements[0].is_plain
    if not is_usual or any(
        len(each.properties) != 1
        or _find_lowest(each, each.properties[0].name) != 0
        or each.properties[0].kind[0] == "f"
        for each in elements[1:]
    ):
        raise UnusualTextError
    width, lengths, rows = len(elements[0].properties), set[int](), LineRows(foreign, header.start)

    def check_vertex(line: bytes) -> None:
        if len(list(map(float, line.split()))) < width or b"_" in line:
            raise UnusualTextError

    patterns_of_vertices, patterns_of_faces = (
        LinePatterns(check_vertex),
        LinePatterns(lambda line: lengths.add(len(line.split()))),
    )
    for text in rows.take(elements[0].count):
        patterns_of_vertices.check_lines(reduce_digits(text))
    for text in rows.take(elements[1].count if len(elements) > 1 else 0):
        patterns_of_faces.check_lines(reduce_digits(text))
        (length,) = lengths
        table = parse_whole_numbers(text).reshape(-1, length)
        if (table[:, 0] != length - 1).any() or table[:, 1:].max(initial=0) >= vertices:
            raise UnusualTextError


def _number_rows(lines: Iterator[tuple[int, bytes]], header: _Header, element: _Element) -> Iterator[list[float]]:
    """Yield the numbers of each row of an element without lists."""
    width = len(element.properties)
    for _ in range(element.count):
        number, line = next(lines, (0, b""))
        try:
            row = list(map(float, line.split()))
        except ValueError:
            row = []
        if len(row) < width or b"_" in line:
            raise _make_row_error(header, element, number, line)
        yield row


def _make_row_error(header: _Header, element: _Element, number: int, line: bytes, why: str = "") -> ValueError:
    return ValueError(
        f"line {header.lines + number} is not a row of the element {shorten(element.name)!r}{why}: "
        f"{shorten(line[:200].decode('utf-8', 'replace'))!r}"
        if number
        else "it ends early"
    )


def _check_words(lines: Iterator[tuple[int, bytes]], header: _Header, element: _Element, vertices: int) -> None:
    """Check the rows of an element that has lists, or numbers of vertices, in ASCII."""
    lowest = [_find_lowest(element, each.name) for each in element.properties]
    only = lowest[0] if len(lowest) == 1 and element.properties[0].kind[0] != "f" else None
    for _ in range(element.count):
        number, line = next(lines, (0, b""))
        try:
            if b"_" in line:
                raise ValueError
            if only is not None:  # by far the most files
                count, *values = map(int, line.split())
                if not 0 <= count <= len(values):
                    raise ValueError
                found = [(only, values[:count])]
            else:
                found = _split_lists(element, lowest, line.split())
        except (ValueError, IndexError):
            raise _make_row_error(header, element, number, line) from None
        for least, values in found:
            if values and not (least <= min(values) and max(values) < vertices):
                raise _make_row_error(header, element, number, line, f", whose vertices are {least} to {vertices - 1}")


def _split_lists(element: _Element, lowest: list[int | None], words: list[bytes]) -> list[tuple[int, list[int]]]:
    """Split the words of a row into its lists of vertex indices, each with the smallest allowed index."""
    found, at = [], 0
    for each, least in zip(element.properties, lowest, strict=True):
        length = 1
        if each.count_kind is not None:
            length, at = int(words[at]), at + 1
        values = words[at : at + length]
        if length < 0 or len(values) != length:
            raise ValueError
        if least is not None:
            found.append((least, [int(word) for word in values]))
        else:
            list(map(float, values))
        at += length
    return found


def read_comment_number(path: Path, name: str) -> int | None:
    """Read the whole number N of a comment ``name N``; None without one. Raises IcyMoonError if the file is not PLY."""
    header = read(path, _parse_header, "a PLY file", _FIX, most=MAX_MESH_BYTES)
    found = next(
        (words[1] for text in header.comments if len(words := text.split()) == 2 and words[0] == name.encode()), b""
    )
    return int(found) if _is_count(found.decode("latin-1")) else None


def read_vertices(path: Path) -> Array | None:
    """Read the coordinates (n, 3) float64 of the vertices; None for a file with an unusual layout."""
    return read_properties(path, "x", "y", "z")


def read_properties(path: Path, *wanted: str) -> Array | None:
    """Read the ``wanted`` properties (n, len(wanted)) float64 of the vertices; None if the file's layout is unusual.

    In the usual layout vertices come first and have scalar properties only, the ``wanted`` ones among them. Raises
    IcyMoonError if the file is not PLY, or a row is malformed or missing.
    """
    return read(path, lambda foreign: _read_properties(foreign, wanted), "a PLY file", _FIX, most=MAX_MESH_BYTES)


def _read_properties(foreign: ForeignBytes, wanted: tuple[str, ...]) -> Array | None:
    header = _parse_header(foreign)
    element = header.elements[0] if header.elements else None
    if element is None or element.name != "vertex" or not element.is_plain:
        return None
    names = [each.name for each in element.properties]
    if not set(wanted) <= set(names):
        return None
    rows = element.count * element.least_bytes
    if header.order and foreign.size < header.start + rows:
        raise ValueError(f"its vertices have {rows} bytes, but {foreign.size - header.start} follow; it is cut off")
    if not header.order:
        numbers, columns = array("d"), [names.index(name) for name in wanted]
        for row in _number_rows(foreign.lines(header.start, _LONGEST_ROW_BYTES), header, element):
            numbers.extend([row[column] for column in columns])
        return np.array(numbers).reshape(-1, len(wanted))
    kind = element.row_type(header.order)
    table = np.frombuffer(foreign.part(header.start, element.count * kind.itemsize), kind)
    return np.stack([table[name].astype(np.float64) for name in wanted], axis=1)


def read_texture_coordinates(path: Path, faces: Array) -> Array | None:
    """Read the texture coordinates (m, 3, 2) of the corners of triangles ``faces`` (m, 3), indices of this file's
    vertices.

    The coordinates of the file's faces keep seams, so they have precedence over the coordinates of its vertices. None
    if the file has neither, or an unsupported layout. If its faces have coordinates, vertices must come first and then
    triangles only; ``faces`` may be some of them.
    """
    found = _read_corner_coordinates(path, faces)
    if found is not None:
        return found
    for names in _VERTEX_UV_NAMES:
        of_vertices = read_properties(path, *names)
        if of_vertices is not None:
            return of_vertices[faces]
    return None


def _read_corner_coordinates(path: Path, faces: Array) -> Array | None:
    table = read(path, _read_face_table, "a PLY file", _FIX, most=MAX_MESH_BYTES)
    if table is None:
        return None
    corners, uv = table[0], table[1].reshape(-1, 3, 2)
    if np.array_equal(corners, faces):
        return uv
    first, which = find_equal_rows(np.concatenate([corners.astype(np.int64), faces]))
    place = first[which[len(corners) :]]  # of each of ``faces`` in the file, whose first triangle like it counts
    return uv[place] if (place < len(corners)).all() else None


def _read_face_table(foreign: ForeignBytes) -> tuple[Array, Array] | None:
    """Read the corners (m, 3) and their texture coordinates (m, 6) of triangles that follow the vertices; None for
    other faces."""
    header = _parse_header(foreign)
    if [element.name for element in header.elements[:2]] != ["vertex", "face"] or not header.elements[0].is_plain:
        return None
    vertex, face = header.elements[:2]
    names = [each.name for each in face.properties]
    corners = next((name for name in names if name in _FACE_LIST_NAMES), None)
    if not face.count or corners is None or "texcoord" not in names:
        return None
    if header.order:
        start = header.start + vertex.count * vertex.least_bytes
        kind = _type_of_first_row(foreign, start, face, header.order)
        if (
            kind[corners].shape != (3,)
            or kind["texcoord"].shape != (6,)
            or (foreign.size < start + face.count * kind.itemsize)
        ):
            return None
        table = np.frombuffer(foreign.part(start, face.count * kind.itemsize), kind)
        lengths = {name: kind[name].shape[0] for name in names if f"length of {name}" in (kind.names or ())}
        alike = all((table[f"length of {name}"] == length).all() for name, length in lengths.items())
        return (table[corners], table["texcoord"]) if alike else None
    return _read_text_faces(foreign, header, corners)


def _read_text_faces(foreign: ForeignBytes, header: _Header, corners: str) -> tuple[Array, Array] | None:
    vertex, face = header.elements[:2]
    found = {corners: array("d"), "texcoord": array("d")}
    wanted = {corners: 3, "texcoord": 6}
    for _, line in islice(foreign.lines(header.start, _LONGEST_ROW_BYTES), vertex.count, vertex.count + face.count):
        words, at = line.split(), 0
        for each in face.properties:
            length = 1
            if each.count_kind is not None:
                length, at = int(words[at]), at + 1
            if each.name in found:
                if length != wanted[each.name]:
                    return None
                found[each.name].extend(map(float, words[at : at + length]))
            at += length
    table = [np.array(found[name]) for name in wanted]
    if [len(each) for each in table] != [face.count * width for width in wanted.values()]:
        return None
    return table[0].reshape(-1, 3), table[1].reshape(-1, 6)


#: A triangle in a binary file of ours.
FACE_TYPE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def write_triangles(
    path: Path,
    vertices: Array,
    triangles: Array,
    normals: Array | None = None,
    comments: tuple[str, ...] = (),
) -> None:
    """Write positions (n, 3), indices (m, 3) and normals (n, 3) of a mesh as a binary PLY file in single precision."""
    names = ("x", "y", "z", *(("nx", "ny", "nz") if normals is not None else ()))
    data = encode_triangles(names, vertices if normals is None else np.hstack([vertices, normals]), triangles, comments)

    def write(part: Path) -> None:
        part.write_bytes(data)

    write_atomically(path, write)


def read_triangles(path: Path) -> tuple[Array, Array]:
    """Read the positions (n, 3) and triangles (m, 3) of a file from ``write_triangles``. Raises IcyMoonError for any
    other file."""
    return read(path, _parse_triangles, "a PLY file of ours", "make it again")


def _parse_triangles(foreign: ForeignBytes) -> tuple[Array, Array]:
    header = _parse_header(foreign)
    if [each.name for each in header.elements] != ["vertex", "face"] or header.order != "<":
        raise ValueError("it has other elements than vertices and faces")
    cursor = foreign.cursor(header.start)
    width = len(header.elements[0].properties)
    vertices = cursor.numbers("<f4", width * header.elements[0].count).reshape(-1, width)
    faces = cursor.numbers(FACE_TYPE, header.elements[1].count)
    if cursor.left or (faces["count"] != 3).any():
        raise ValueError("its faces are not triangles")
    return vertices[:, :3], faces["corners"].copy()


def encode_triangles(
    names: tuple[str, ...], vertices: Array, triangles: Array, comments: tuple[str, ...] = ()
) -> bytes:
    """Encode a binary PLY file in single precision: vertices (n, k), whose k properties have these ``names``, and
    vertex indices (m, 3) of triangles."""
    faces = np.empty(len(triangles), FACE_TYPE)
    faces["count"], faces["corners"] = 3, triangles
    return (
        make_header(names, len(vertices), len(faces), comments)
        + np.ascontiguousarray(vertices, "<f4").tobytes()
        + faces.tobytes()
    )


def write_cloud(path: Path, names: tuple[str, ...], columns: Array, comments: tuple[str, ...] = ()) -> None:
    """Write points, rows of ``columns`` (n, k) whose first three are x, y and z, as a binary PLY file of doubles."""
    write_cloud_parts(path, names, [columns], len(columns), comments)


def write_cloud_parts(
    path: Path, names: tuple[str, ...], parts: Iterable[Array], count: int, comments: tuple[str, ...] = ()
) -> None:
    """Write points as ``write_cloud`` does, from ``parts`` with ``count`` rows in all, so that memory holds one part at
    a time."""
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {each}" for each in comments),
        f"element vertex {count}",
        *(f"property double {name}" for name in names),
        "end_header",
        "",
    ]

    def write(part: Path) -> None:
        with part.open("wb") as stream:
            stream.write("\n".join(header).encode("ascii"))
            for columns in parts:
                stream.write(np.ascontiguousarray(columns, "<f8").tobytes())

    write_atomically(path, write)


def make_header(names: tuple[str, ...], vertices: int, triangles: int, comments: tuple[str, ...] = ()) -> bytes:
    """Make the header of a binary file. ``vertices`` and ``triangles`` are counts, ``names`` the vertices' properties
    in single precision."""
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {each}" for each in comments),
        f"element vertex {vertices}",
        *(f"property float {name}" for name in names),
        f"element face {triangles}",
        "property list uchar int vertex_indices",
        "end_header",
        "",
    ]
    return "\n".join(header).encode("ascii")
