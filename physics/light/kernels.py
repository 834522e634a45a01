"""Checks of SPICE kernels, and of the files that a meta-kernel names, before SPICE opens them.

Sources: NAIF's required readings "Kernel" (text kernels and meta-kernels) and "DAF" (binary kernels). Kernels are
foreign data: a meta-kernel may name files in its folder only, and the records of a binary kernel must not form a ring.
"""

from __future__ import annotations

import re
import struct
from functools import lru_cache
from pathlib import Path

from ...support.errors import IcyMoonError
from ...support.files import shorten
from ...support.foreign_bytes import ForeignBytes, RefusedError, describe_reason, note_on_backslashes, read

#: Largest text kernel in bytes.
_MAX_TEXT_BYTES = 2**25
#: Largest binary kernel in bytes.
_MAX_BINARY_BYTES = 2**36
#: Maximum number of files of a folder or a meta-kernel.
_MAX_FILES = 2000
_FIX = "get it again, or leave it out"
#: First bytes of binary kernels.
_BINARY_MARKS = (b"DAF/SPK", b"DAF/PCK", b"DAF/CK", b"NAIF/DAF")
#: Line of a text kernel at which data begins.
_BEGIN_DATA = b"\\begindata"
#: Line of a text kernel at which comments begin.
_BEGIN_TEXT = b"\\begintext"
#: Number of bytes of a record of a DAF.
_RECORD_BYTES = 1024
#: Number of bytes of a double in a DAF.
_DOUBLE_BYTES = 8
#: A token of the data of a text kernel. Each alternative consumes every character once.
_TOKEN = re.compile(rb"\s++|'((?:[^'\r\n]|'')*+)'|([()=,]|\+=)|([^\s()=,']++)")


def find_kernels(path: Path) -> list[Path]:
    """List the kernels that a file or folder stands for, in the order in which they are loaded.

    A folder stands for all kernels in it and in its direct subfolders, a meta-kernel for the kernels that it names.
    Raises IcyMoonError without a kernel, if one is damaged, or if a meta-kernel names a file outside of its folder.
    """
    found: list[Path] = []
    for file in list_kernel_files(path):
        named = _inspect_kernel(file)
        if named is None:
            continue
        found += [file] if not named else _resolve_named_kernels(file, named, path if path.is_dir() else None)
    if not found:
        raise IcyMoonError(f"{path} has no SPICE kernel; give a meta-kernel or a folder of kernels.")
    return list(dict.fromkeys(found))


def list_kernel_files(path: Path) -> list[Path]:
    """List the files that may be kernels: a file itself, or the files of a folder and of its direct subfolders. Raises
    IcyMoonError for a folder with too many files.
    """
    if not path.is_dir():
        return [path]
    there = sorted(path.iterdir())
    inner = [file for folder in there if folder.is_dir() for file in sorted(folder.iterdir()) if file.is_file()]
    found = [*(file for file in there if file.is_file()), *inner]
    if len(found) > _MAX_FILES:
        raise IcyMoonError(f"{path} has {len(found)} files, more than {_MAX_FILES}; give a folder of kernels.")
    return found


def _inspect_kernel(path: Path) -> tuple[str, ...] | None:
    """Return the result of ``_parse_kernel``, cached by size and time of change of the file."""
    try:
        state = path.stat()
    except OSError as error:
        raise IcyMoonError(f"{path} cannot be read ({describe_reason(error)}); {_FIX}.") from None
    return _read_kernel(path, state.st_size, state.st_mtime_ns)


@lru_cache(maxsize=4096)
def _read_kernel(path: Path, _size: int, _modified_ns: int) -> tuple[str, ...] | None:
    return read(path, _parse_kernel, "a SPICE kernel", _FIX, most=_MAX_BINARY_BYTES)


def _parse_kernel(foreign: ForeignBytes) -> tuple[str, ...] | None:
    """Parse the names that a meta-kernel lists; an empty tuple for another kernel, None for a file that is not a
    kernel.
    """
    head = foreign.part(0, min(foreign.size, _RECORD_BYTES))
    if head.startswith(_BINARY_MARKS):
        _check_binary(foreign, head)
        return ()
    if b"\0" in head or (foreign.size > _MAX_TEXT_BYTES and not head.startswith(b"KPL/")):
        return None
    if foreign.size > _MAX_TEXT_BYTES:
        raise RefusedError(
            f"is a text kernel of {foreign.size / 1e6:.0f} MB, more than {_MAX_TEXT_BYTES / 1e6:.0f}; {_FIX}."
        )
    data = _extract_data(foreign)
    return None if data is None else _list_kernels_to_load(data)


def _extract_data(foreign: ForeignBytes) -> bytes | None:
    """Extract the data lines of a text kernel; None if it has no data."""
    lines, is_data, any_data = [], False, False
    for _, line in foreign.lines():
        word = line.strip()
        if word == _BEGIN_DATA:
            is_data = any_data = True
        elif word == _BEGIN_TEXT:
            is_data = False
        elif is_data:
            lines.append(line)
    return b"\n".join(lines) if any_data else None


def _list_kernels_to_load(data: bytes) -> tuple[str, ...]:
    """List the files in KERNELS_TO_LOAD, with path symbols replaced."""
    if b"KERNELS_TO_LOAD" not in data:
        return ()
    values: dict[bytes, list[bytes]] = {}
    name, last, at = b"", b"", 0
    while at < len(data):
        found = _TOKEN.match(data, at)
        if found is None:
            raise ValueError("a text in quotes has no end in its line")
        at = found.end()
        text, sign, word = found.groups()
        if sign in (b"=", b"+="):
            name = last.removesuffix(b"+")
            if sign == b"=" and not last.endswith(b"+"):
                values[name] = []
        elif text is not None:
            values.setdefault(name, []).append(text.replace(b"''", b"'"))
        elif word is not None:
            last = word
    symbols = dict(zip(values.get(b"PATH_SYMBOLS", []), values.get(b"PATH_VALUES", []), strict=True))
    listed, before = [], b""
    for part in values.get(b"KERNELS_TO_LOAD", []):
        before += part.removesuffix(b"+")
        if part.endswith(b"+"):  # the name goes on in the next text
            continue
        for symbol, value in symbols.items():
            before = before.replace(b"$" + symbol, value)
        listed.append(before.decode("utf-8", "replace"))
        before = b""
        if len(listed) > _MAX_FILES:
            raise ValueError(f"it names more than {_MAX_FILES} kernels")
    if not listed:
        raise ValueError("it names no kernel in KERNELS_TO_LOAD")
    return tuple(listed)


def _resolve_named_kernels(meta: Path, named: tuple[str, ...], folder: Path | None) -> list[Path]:
    """Find the files that a meta-kernel names, in the folder that the user stated, or else in its folder. A meta-kernel
    in a folder ``mk`` may also name files beside that folder, as in NAIF's archives.
    """
    inside = (folder or (meta.parent.parent if meta.parent.name == "mk" else meta.parent)).resolve()
    found = []
    for name in named:
        try:
            file = (meta.parent / name).resolve()
            is_there = file.is_file()
        except (OSError, ValueError, RuntimeError):
            raise IcyMoonError(f"{meta} names {shorten(name)!r}, which is not a valid file name; correct it.") from None
        if not file.is_relative_to(inside):
            raise IcyMoonError(
                f"{meta} names {shorten(name)!r}, and only kernels in {inside} are loaded; copy it there."
            )
        if not is_there:
            raise IcyMoonError(
                f"{meta} names {shorten(name)!r}, which does not exist{note_on_backslashes(name)}; copy it there."
            )
        if _inspect_kernel(file) != ():
            raise IcyMoonError(f"{meta} names {shorten(name)!r}, which is not a kernel with data; leave it out.")
        found.append(file)
    return found


def _check_binary(foreign: ForeignBytes, head: bytes) -> None:
    """Raise ValueError if the summary records of a DAF form a ring, or if arrays lie outside the file."""
    if len(head) < _RECORD_BYTES:
        raise ValueError("it is cut off")
    order = ">" if head[88:96] == b"BIG-IEEE" or head[8:11] == b"\0\0\0" else "<"
    doubles, integers = struct.unpack_from(f"{order}2i", head, 8)
    record, _, free = struct.unpack_from(f"{order}3i", head, 76)
    size = doubles + (integers + 1) // 2
    if not (0 <= doubles <= 124 and 2 <= integers <= 250 and 1 <= size <= 125):
        raise ValueError(f"its summaries have {doubles} doubles and {integers} integers")
    if not 1 <= free <= foreign.size // _DOUBLE_BYTES + 1:
        raise ValueError("it is cut off")
    seen: set[int] = set()
    while record:
        if record in seen or not 1 < record <= foreign.size // _RECORD_BYTES:
            raise ValueError(f"its record {record} does not exist, or follows itself")
        seen.add(record)
        content = foreign.part((record - 1) * _RECORD_BYTES, _RECORD_BYTES)
        following, _, count = struct.unpack_from(f"{order}3d", content)
        if not (0 <= following <= foreign.size and following == int(following) and 0 <= count * size <= 125):
            raise ValueError(f"its record {record} has {count:g} summaries and is followed by {following:g}")
        for k in range(int(count)):
            place = (3 + k * size + doubles) * _DOUBLE_BYTES
            *_, begin, end = struct.unpack_from(f"{order}{integers}i", content, place)
            if not 1 <= begin <= end <= foreign.size // _DOUBLE_BYTES:
                raise ValueError(f"its record {record} has an array from {begin} to {end}")
        record = int(following)
