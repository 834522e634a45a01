"""Checks that the statements of a mesh file are true, before a library parses it.

Blender's importers allocate the memory that a header states, open the files that it names, and read zero for malformed
numbers. Formats: Stanford PLY, STL, Wavefront OBJ, glTF 2.0 (Khronos), USDZ (Pixar), binary FBX as described by
Blender's developers. The contents of USD files and of FBX in ASCII are left to their libraries.
"""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path

from ..physics.triangle_files import obj, stl
from ..support.errors import IcyMoonError
from ..support.files import is_file, shorten
from ..support.foreign_bytes import Cursor, ForeignBytes, read
from . import gltf, ply
from .mesh_file import add_article

_FIX = "export the mesh again"
#: Largest content in bytes that packed arrays of an FBX file may have.
_MAX_UNPACKED_BYTES = 2**31
#: Largest material library in bytes.
_MAX_LIBRARY_BYTES = 2**22
#: Deepest nesting of an FBX file.
_DEEPEST_FBX = 32
#: Maximum number of members of a USDZ archive.
_MAX_MEMBERS = 1000
_FBX_MARK = b"Kaydara FBX Binary  \0\x1a\0"
#: Bytes of a single FBX value by the letter of its type.
_FBX_VALUE_BYTES = {b"Y": 2, b"C": 1, b"B": 1, b"I": 4, b"F": 4, b"D": 8, b"L": 8}
#: Bytes of a value in an FBX array by the letter of its type.
_FBX_ARRAY_VALUE_BYTES = {b"f": 4, b"d": 8, b"l": 8, b"i": 4, b"b": 1, b"c": 1}


def check_mesh(path: Path, kind: str) -> None:
    """Check the content of a mesh file of a ``kind`` (see ``mesh_file.detect_kind``) against its statements. Raises
    IcyMoonError if stated data are missing, if a number is malformed, or if the file names another that a mesh must not
    name."""
    if kind == "glTF":
        for name in gltf.check_gltf(path):
            _check_named(path, path.parent / name)
        return
    parse = {
        "PLY": ply.check_ply,
        "STL": stl.check_statements,
        "OBJ": lambda foreign: _check_obj(path, foreign),
        "FBX": _check_fbx,
        "USD": lambda foreign: _check_usd(path, foreign),
    }[kind]
    read(path, parse, f"{add_article(kind)} file", _FIX, most=ply.MAX_MESH_BYTES, memory=_MAX_UNPACKED_BYTES)


def _check_obj(path: Path, foreign: ForeignBytes) -> None:
    for name in [*obj.check_statements(foreign), os.fsencode(path.with_suffix(".mtl").name)]:
        library = path.parent / os.fsdecode(name)
        _check_named(path, library)
        if is_file(library):
            read(
                library,
                lambda content: _check_library(path, content),
                "a material library",
                _FIX,
                most=_MAX_LIBRARY_BYTES,
            )


def _check_library(path: Path, foreign: ForeignBytes) -> None:
    """Check the files that a material library names. Any statement may name an image, with or without options."""
    for _, line in foreign.lines():
        _, _, rest = line.strip().partition(b" ")
        for name in {rest.strip(), rest.split(b" ")[-1]} - {b""}:
            _check_named(path, path.parent / os.fsdecode(name))


def _check_named(path: Path, file: Path) -> None:
    """Raise IcyMoonError for an existing pipe or device, which would block a program that opens it."""
    try:
        is_odd = file.exists() and not (file.is_file() or file.is_dir())
    except (OSError, ValueError):
        return  # the name cannot be a file's
    if is_odd:
        raise IcyMoonError(f"{path}: names {shorten(str(file))!r}, which is not a regular file; {_FIX}.")


def _check_usd(path: Path, foreign: ForeignBytes) -> None:
    if foreign.part(0, min(4, foreign.size)) == b"PK\3\4":
        _check_usdz(foreign)
    elif foreign.part(0, min(5, foreign.size)) == b"#usda":
        # Names of files stand between @. A file that is not regular, such as a pipe, would hold up the library.
        for _, line in foreign.lines(longest=2**26):
            for name in line.split(b"@")[1::2]:
                _check_named(path, path.parent / os.fsdecode(name))


def _check_usdz(foreign: ForeignBytes) -> None:
    """Check that the members of a USDZ are stored without compression, so that none is larger than the archive."""
    data = foreign.content()
    if data.count(b"PK\1\2") > _MAX_MEMBERS:
        raise ValueError(f"it has more than {_MAX_MEMBERS} members")
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = archive.infolist()
    if any(each.compress_type != zipfile.ZIP_STORED for each in members):
        raise ValueError("a member is packed, which the format does not allow")
    if sum(each.file_size for each in members) > foreign.size:
        raise ValueError("its members are larger than the file")


def _check_fbx(foreign: ForeignBytes) -> None:
    """Check that nodes lie within their parents, one after the other, and that arrays have the stated bytes."""
    if foreign.part(0, min(len(_FBX_MARK), foreign.size)) != _FBX_MARK:
        return  # in ASCII
    cursor = foreign.cursor()
    cursor.skip(len(_FBX_MARK))
    layout = "<3IB" if cursor.number("<I") < 7500 else "<3QB"
    ends: list[int] = []
    while True:
        end, properties, length, name = cursor.unpack(layout)
        if end == 0:  # the last one of its parent, or of the file
            if not ends:
                return
            cursor.skip_to(ends.pop())
            continue
        if end > (ends[-1] if ends else foreign.size) or len(ends) >= _DEEPEST_FBX:
            raise ValueError(f"the node at byte {cursor.at} does not lie within its parent")
        cursor.skip(name)
        after = cursor.at + length
        for _ in range(properties):
            _skip_fbx_value(cursor)
        cursor.skip_to(after)
        if cursor.at < end:
            ends.append(end)
        else:
            cursor.skip_to(end)
            while ends and cursor.at == ends[-1]:
                ends.pop()


def _skip_fbx_value(cursor: Cursor) -> None:
    kind = cursor.take(1)
    if kind in _FBX_VALUE_BYTES:
        cursor.skip(_FBX_VALUE_BYTES[kind])
    elif kind in _FBX_ARRAY_VALUE_BYTES:
        count, packed, length = cursor.unpack("<3I")
        size = cursor.budget.charge(count * _FBX_ARRAY_VALUE_BYTES[kind], "arrays")
        if (packed and size > 1100 * length) or (not packed and size != length):  # zlib packs up to 1032 times
            raise ValueError(f"the array before byte {cursor.at} does not have the {size} bytes that it states")
        cursor.skip(length)
    elif kind in (b"S", b"R"):
        cursor.skip(cursor.number("<I"))
    else:
        raise ValueError(f"a value of type {kind!r} at byte {cursor.at - 1}")
