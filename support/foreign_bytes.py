"""The one entrance for bytes that this process did not write.

A file may come from a stranger, be cut off by a full disk, or be changed by hand. ``read`` hands it to a parser as
``ForeignBytes``: a regular file of bounded size, whose parts are taken by a ``Cursor`` that only moves forward or by
``part``, which charges every byte. A parser charges each count that the file states to the ``Budget`` before it makes
room for it. Whatever a parser raises becomes one sentence. So a hostile file costs time in proportion to its size and
memory within the budget.

Parsers use no unanchored regular expression on foreign text; ``split_lines`` splits it. Imports no Blender.
"""

from __future__ import annotations

import codecs
import errno
import io
import json
import math
import struct
import tomllib
import xml.etree.ElementTree as ElementTree
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, TypeVar

from . import system
from .errors import IcyMoonError

if TYPE_CHECKING:
    from numpy.typing import DTypeLike

    from .arrays import Array

Parsed = TypeVar("Parsed")
#: Default limit of the bytes of a file.
MAX_BYTES = 2**30
#: Default limit of the memory in bytes of its content.
MAX_MEMORY = 2**28
#: Largest text file in bytes: a plan of 100,000 pairs has 40 MB.
MAX_TEXT_BYTES = 2**26
#: Longest line in bytes of a text that is read line by line.
LONGEST_LINE_BYTES = 2**16
#: Longest TOML text in characters; it takes at most 4 s and 500 MB.
MAX_TOML_CHARACTERS = 4_000_000
#: Maximum number of parts of a key.
_MAX_KEY_PARTS = 10
#: Maximum number of parts of all keys together; each may be a table.
_MAX_TOML_TABLES = 400_000
#: Maximum number of lists and tables of a JSON text; each takes about 100 bytes of memory.
_MAX_JSON_LISTS = 1_000_000
#: Maximum number of values of a JSON text; each takes about 40 bytes.
_MAX_JSON_VALUES = 5_000_000
#: Maximum number of readings of each byte of a file; formats whose tables lead to their data need two.
_MAX_READINGS = 4
#: Maximum number of digits of a whole number in a TOML file, so that a float can hold it.
_MAX_DIGITS = 308
#: Maximum number of bits of such a number.
_MAX_BITS = 1023
#: A line with a larger hexadecimal number is longer than this number of characters.
_HEX_LINE_CHARACTERS = 255
#: Least number of bytes that are split into lines at a time.
_LINES_STEP_BYTES = 2**16
#: Maximum number of members of an archive.
_MAX_MEMBERS = 1000
#: Largest header of an array in bytes.
_MAX_HEADER_BYTES = 10_000
#: Memory in bytes, rounded up, of an element, an attribute or a reference of an XML text.
_XML_PART_BYTES = 256
#: Largest list of an archive's members in bytes.
_MAX_DIRECTORY_BYTES = 2**20
#: Bytes of the smallest record at the end of an archive.
_ARCHIVE_END_BYTES = 22
#: Bytes that are unpacked at a time.
_UNPACKED_STEP_BYTES = 2**18
_TEXT_MARKS = {
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


class RefusedError(Exception):
    """A valid file cannot be used. The text is the end of a sentence about the file, with the fix and a full stop."""


class OverBudgetError(Exception):
    """A file needs more memory or time than its reader allows. The text is the end of a sentence about the file."""


class Budget:
    """The bytes of memory that a parser may still allocate."""

    def __init__(self, most: int = MAX_MEMORY) -> None:
        self.most = self.left = most

    def charge(self, count: int, what: str = "content") -> int:
        """Reserve ``count`` bytes before they are allocated, and return ``count``. Raises ValueError for a negative
        count, OverBudgetError if too few bytes are left."""
        if count < 0:
            raise ValueError(f"{what} of {count} bytes")
        if count > self.left:
            raise OverBudgetError(f"asks for more than {self.most / 1e6:.0f} MB of memory for its {what}")
        self.left -= count
        return count


class Cursor:
    """Bytes that are taken one after the other; nothing is ever taken twice.

    ``at`` counts from the beginning of the bytes, plus ``start``, for messages.
    """

    def __init__(self, data: bytes | memoryview, budget: Budget, start: int = 0) -> None:
        # Bytes are not converted, because taking parts of bytes takes half the time.
        self._data = data if isinstance(data, bytes) else memoryview(data).cast("B")
        self._at, self._start = 0, start
        self.budget = budget

    @property
    def at(self) -> int:
        """Offset of the next byte in the file."""
        return self._start + self._at

    @property
    def left(self) -> int:
        """Number of remaining bytes."""
        return len(self._data) - self._at

    def take(self, count: int) -> bytes:
        """Take the next ``count`` bytes. Raises ValueError for a negative count, and if fewer bytes are left."""
        at, end = self._at, self._at + count
        if not at <= end <= len(self._data):
            raise ValueError(
                f"a size of {count} at byte {self.at}" if count < 0 else f"it ends {count - self.left} bytes early"
            )
        self._at = end
        return bytes(self._data[at:end])

    def skip(self, count: int) -> None:
        """Skip the next bytes. Raises ValueError as ``take`` does."""
        if not 0 <= count <= self.left:
            raise ValueError(f"a size of {count} at byte {self.at}, with {self.left} bytes left")
        self._at += count

    def skip_to(self, place: int) -> None:
        """Go to an offset in the file. Raises ValueError for an offset behind the cursor or beyond the end."""
        self.skip(place - self.at)

    def unpack(self, layout: str) -> tuple[Any, ...]:
        """Take the next numbers, in a layout of ``struct``."""
        return struct.unpack(layout, self.take(struct.calcsize(layout)))

    def number(self, layout: str) -> int:
        """Take the next whole number, in a layout of ``struct`` such as ``<I``."""
        return int(self.unpack(layout)[0])

    def take_until(self, mark: bytes, most: int) -> bytes:
        """Take the bytes before ``mark``, and skip the mark. Raises ValueError if it does not follow within ``most``
        bytes."""
        at, data = self._at, self._data
        if not isinstance(data, bytes):
            data, at = bytes(data[at : at + most + len(mark)]), 0
        end = data.find(mark, at, at + most + len(mark))
        if end < 0:
            raise ValueError(f"no end of the text at byte {self.at}")
        self._at += end - at + len(mark)
        return data[at:end]

    def numbers(self, kind: DTypeLike, count: int, what: str = "numbers") -> Array:
        """Take the next ``count`` values of a numpy type, as a read-only array without a copy of the bytes. Raises
        ValueError if fewer are left."""
        import numpy as np  # only here, because modules that import this module report what a bare Python lacks

        dtype = np.dtype(kind)
        if dtype.hasobject:
            raise ValueError(f"{what} of type {dtype}")
        if count < 0 or count * dtype.itemsize > self.left:
            raise ValueError(f"{count} {what} at byte {self.at}, with {self.left} bytes left")
        self._at += count * dtype.itemsize
        return np.frombuffer(memoryview(self._data)[self._at - count * dtype.itemsize : self._at], dtype)


class ForeignBytes:
    """A file, or bytes from one, and the budget for reading it. ``name`` is the file's name, for commands on it."""

    def __init__(self, source: bytes | IO[bytes], size: int, budget: Budget, name: str = "in.tif") -> None:
        self._source, self.size, self.budget, self.name = source, size, budget, name
        self._readable = _MAX_READINGS * size + 2**16

    def part(self, start: int, count: int) -> bytes:
        """Read bytes at any offset. Raises ValueError for bytes outside the file, OverBudgetError if the same bytes are
        requested too often."""
        if start < 0 or count < 0 or start + count > self.size:
            raise ValueError(f"{count} bytes at byte {start}, but it has {self.size}")
        if count > self._readable:
            raise OverBudgetError("refers to the same bytes again and again")
        self._readable -= count
        if isinstance(self._source, bytes):
            return self._source[start : start + count]
        self._source.seek(start)
        data = self._source.read(count)
        if len(data) != count:
            raise ValueError(f"it ends {count - len(data)} bytes early")
        return data

    def cursor(self, start: int = 0, count: int | None = None) -> Cursor:
        """Make a cursor over ``count`` bytes from ``start`` on; without ``count``, over all remaining bytes."""
        return Cursor(self.part(start, self.size - start if count is None else count), self.budget, start)

    def content(self) -> bytes:
        """Read all bytes of the file."""
        return self.part(0, self.size)

    def text(self) -> str:
        """Read the content as text, see ``decode_text``."""
        return decode_text(self.content())

    def lines(self, start: int = 0, longest: int = LONGEST_LINE_BYTES) -> Iterator[tuple[int, bytes]]:
        """Yield the lines from byte ``start`` on, see the function ``split_lines``, without holding all in memory. The
        first lines show how lines end."""
        step = max(longest, _LINES_STEP_BYTES)
        first = self.part(start, min(step, self.size - start))
        rest = (self.part(at, min(step, self.size - at)) for at in range(start + len(first), self.size, step))
        return _split_parts(chain([first], rest), b"\r" if b"\n" not in first else b"\n", longest)


def read(
    path: Path,
    parse: Callable[[ForeignBytes], Parsed],
    kind: str,
    fix: str,
    most: int = MAX_BYTES,
    memory: int = MAX_MEMORY,
) -> Parsed:
    """Read a file and return the result of ``parse``.

    ``kind`` names the format with its article, as in "a PLY file"; ``fix`` is an imperative without a full stop.
    ``most`` limits the bytes of the file, ``memory`` the bytes that the parser charges. Raises IcyMoonError, one
    sentence, if the file is missing, no regular file, too large, or not as the parser needs it.
    """
    try:
        stream = system.retry(lambda: system.open_regular(path))
    except (OSError, ValueError) as error:
        if isinstance(error, OSError) and error.errno == errno.EINVAL:  # for example a pipe, whose content may be right
            fix = f"put a regular file in its place, or {fix}"
        raise IcyMoonError(f"{path} cannot be read ({describe_reason(error)}); {fix}.") from None
    with stream:
        size = stream.seek(0, io.SEEK_END)
        if size > most:
            raise IcyMoonError(
                f"{path} has {size / 1e6:.0f} MB, and {most / 1e6:g} MB are the most that can be read; make it smaller."
            )
        with explain_errors(path, kind, fix):
            return parse(ForeignBytes(stream, size, Budget(memory), path.name))


def parse_part(
    data: bytes, where: object, parse: Callable[[ForeignBytes], Parsed], kind: str, fix: str, memory: int = MAX_MEMORY
) -> Parsed:
    """Return the result of ``parse`` for bytes in memory. ``where`` names their file. Raises as ``read`` does."""
    with explain_errors(where, kind, fix):
        return parse(ForeignBytes(data, len(data), Budget(memory)))


@contextmanager
def explain_errors(where: object, kind: str, fix: str) -> Iterator[None]:
    """Convert any error of a parser into one sentence."""
    try:
        yield
    except IcyMoonError:
        raise
    except RefusedError as error:
        raise IcyMoonError(f"{where}: {error}") from None
    except OverBudgetError as error:
        raise IcyMoonError(f"{where}: {error}; {fix}.") from None
    except MemoryError:
        raise IcyMoonError(f"{where}: needs more memory than this machine has; {fix}.") from None
    except Exception as error:
        raise IcyMoonError(f"{where}: is not {kind} that can be read ({describe_reason(error)}); {fix}.") from None


def describe_reason(error: Exception) -> str:
    """Describe the reason of an error in a few words."""
    if isinstance(error, OSError):
        note = note_on_backslashes(error.filename) if isinstance(error, FileNotFoundError) else ""
        return (error.strerror or type(error).__name__) + note
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if isinstance(error, ValueError) and "int_max_str_digits" in str(error):  # a user does not know this name
        return f"it has a number of more than {_MAX_DIGITS} digits"
    if isinstance(error, KeyError):
        return f"{str(error)[:80]} is missing"
    if isinstance(error, IndexError):
        return "it refers to content that it lacks"
    if isinstance(error, TypeError | AttributeError):
        return "it has a value of another kind than it must have there"
    if isinstance(error, OverflowError):
        return "it has a number that is too large"
    if isinstance(error, struct.error):
        return "it is cut off"
    lines_of = str(error).strip().splitlines()
    return lines_of[0][:200].rstrip(".") if lines_of else type(error).__name__


def read_regular(path: Path, most: int) -> bytes:
    """Read the content of a regular file. Raises OSError if it is absent, ValueError if it has more than ``most``
    bytes."""

    def read_all() -> bytes:
        with system.open_regular(path) as stream:
            return stream.read(most + 1)

    data = system.retry(read_all)
    if len(data) > most:
        raise ValueError(f"it has more than {most / 1e6:g} MB")
    return data


def read_end(path: Path, most: int) -> bytes:
    """Read the last ``most`` bytes of a regular file, or all. Raises OSError if it is absent."""
    with system.open_regular(path) as stream:
        stream.seek(max(0, stream.seek(0, io.SEEK_END) - most))
        return stream.read(most)


def decode_text(data: bytes) -> str:
    r"""Decode a text in UTF-8, or in the encoding that its first bytes mark, as PowerShell and Notepad write it. Lines
    of the result end in \n. Raises ValueError for other content."""
    encoding = next((name for mark, name in _TEXT_MARKS.items() if data.startswith(mark)), "utf-8")
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        raise ValueError(f"byte {error.start} is not text; save it as UTF-8") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def split_lines(data: bytes, longest: int = LONGEST_LINE_BYTES) -> Iterator[tuple[int, bytes]]:
    """Yield the number, from 1, and the bytes of each line, without its end: \\n, \\r\\n or \\r.

    Raises ValueError for a line of more than ``longest`` bytes.
    """
    end = b"\r" if b"\n" not in data else b"\n"
    step = max(longest, _LINES_STEP_BYTES)
    return _split_parts((data[at : at + step] for at in range(0, len(data), step)), end, longest)


def _split_parts(parts: Iterable[bytes], end: bytes, longest: int) -> Iterator[tuple[int, bytes]]:
    """Yield the lines of a text from consecutive chunks. Each chunk except the last has ``longest`` bytes or more."""
    number, rest = 0, b""
    for part in parts:
        *whole, rest = (rest + part).split(end)
        for line in whole:
            number += 1
            if len(line) > longest:
                raise ValueError(f"line {number} has more than {longest} bytes")
            yield number, line.removesuffix(b"\r")
        if len(rest) > longest:
            raise ValueError(f"line {number + 1} has more than {longest} bytes")
    if rest:
        yield number + 1, rest.removesuffix(b"\r")


def parse_json(text: str | bytes) -> Any:
    """Parse a JSON text. Raises ValueError for other texts, for a number that is not finite, and for more than
    ``_MAX_JSON_VALUES`` values."""
    # Each bracket and comma adds at most one value. Brackets and commas within texts count too; files have few.
    if isinstance(text, bytes):
        lists, commas = text.count(b"[") + text.count(b"{"), text.count(b",")
    else:
        lists, commas = text.count("[") + text.count("{"), text.count(",")
    if lists > _MAX_JSON_LISTS or commas > _MAX_JSON_VALUES:
        raise ValueError(f"it has more than {_MAX_JSON_LISTS} lists and tables, or {_MAX_JSON_VALUES} values")
    try:
        return json.loads(text, parse_float=_parse_finite, parse_constant=_parse_finite)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    except json.JSONDecodeError:
        raise
    except ValueError as error:
        raise ValueError(describe_reason(error)) from None


def _parse_finite(text: str) -> float:
    number = float(text)
    if number - number:  # this is 0 for every number; a call takes as long as the rest of this function
        raise ValueError(f"{text[:40]} is not a number")
    return number


def note_on_backslashes(path: object) -> str:
    """Return a remark in parentheses on the path of a missing file: only Windows separates folders by a backslash,
    which is part of a name on other systems."""
    there = "\\" in str(path) and not system.is_windows()
    return " (a \\ is a part of a name here; write / between folders)" if there else ""


def make_path_hint(error: ValueError) -> str:
    """Return the end of a clause on the likely fault of a text that ``parse_toml`` refuses: in double quotes a
    backslash begins an escape, also in paths of Windows."""
    escape = "Unescaped" in str(error) or "hex value" in str(error)
    return "; write paths with / or in single quotes" if escape else ""


def parse_toml(text: str) -> dict[str, Any]:
    """Parse a TOML text. Raises tomllib.TOMLDecodeError, a ValueError with line and column, for other texts,
    for more than ``MAX_TOML_CHARACTERS`` characters, and for keys of more than ten parts."""
    if len(text) > MAX_TOML_CHARACTERS:
        raise tomllib.TOMLDecodeError(
            f"it has {len(text) / 1e6:.0f} million characters, more than {MAX_TOML_CHARACTERS / 1e6:g}"
        )
    tables, long_lines = 0, False
    for number, line in enumerate(text.split("\n"), 1):  # tomllib looks up each beginning of a key
        long_lines = long_lines or len(line) > _HEX_LINE_CHARACTERS
        if "." not in line:
            continue
        head = line.partition("=")[0] if "=" in line else line if line.lstrip().startswith("[") else ""
        parts = head.partition(",")[0].count(".")
        tables += parts
        if parts > _MAX_KEY_PARTS:
            raise tomllib.TOMLDecodeError(f"line {number} has a key of more than {_MAX_KEY_PARTS} parts")
        if tables > _MAX_TOML_TABLES:
            raise tomllib.TOMLDecodeError(f"up to line {number} it has more than {_MAX_TOML_TABLES} tables in its keys")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError:
        raise tomllib.TOMLDecodeError("it is nested too deeply") from None
    except ValueError as error:  # a number has too many digits
        raise tomllib.TOMLDecodeError(describe_reason(error)) from None
    if long_lines:
        _refuse_long_numbers(data)
    return data


def _refuse_long_numbers(data: dict[str, Any]) -> None:
    """Raise ValueError for whole numbers that are too large for a float, which numbers in hexadecimal digits may be."""
    left: list[Any] = [data]
    while left:
        value = left.pop()
        if isinstance(value, dict):
            left += value.values()
        elif isinstance(value, list):
            left += value
        elif isinstance(value, int) and value.bit_length() > _MAX_BITS:
            raise tomllib.TOMLDecodeError(f"it has a number of more than {_MAX_DIGITS} digits")


def parse_xml(text: str, budget: Budget | None = None) -> ElementTree.Element:
    """Parse an XML text without entities and return its root. Elements and attributes are charged to ``budget``, if
    any.

    Raises ValueError for a text that is not XML, and for a document type, because its entities may unfold without end
    or name other files.
    """
    if "<!DOCTYPE" in text.upper() or "<!ENTITY" in text.upper():
        raise ValueError("it has a document type, whose entities may grow without end")
    if budget is not None:
        budget.charge(_XML_PART_BYTES * sum(map(text.count, "<=&")), "elements and attributes")
    try:
        return ElementTree.fromstring(text.encode())
    except ElementTree.ParseError as error:
        raise ValueError(str(error)) from None


def parse_whole_numbers(text: bytes) -> Array:
    """Parse a text of digits and blanks as numbers (n,) int64; numbers beyond 2^63 - 1 become 2^63 - 1. Raises
    ValueError for any other text."""
    import numpy as np

    if text.translate(None, b"0123456789 \t\r\n"):
        raise ValueError("it has values other than whole numbers")
    return np.fromstring(text, np.int64, sep=" ") if text.strip() else np.empty(0, np.int64)


def inflate(data: bytes, size: int, budget: Budget | None = None) -> bytes:
    """Decompress the ``size`` bytes that zlib packed into ``data``. Raises ValueError if they are more or fewer."""
    if budget is not None:
        budget.charge(size, "packed data")
    unpacker = zlib.decompressobj()
    try:
        found = unpacker.decompress(data, size + 1)
    except zlib.error as error:
        raise ValueError(str(error)) from None
    if len(found) != size:
        raise ValueError(f"packed data of {'more' if len(found) > size else len(found)} bytes instead of {size}")
    return found


def parse_npy(foreign: ForeignBytes, kinds: str = "fiub") -> Array:
    """Parse the array of a file in numpy's format, read-only, with numbers of these ``kinds``. Raises ValueError for
    another type, and for a shape larger than the file."""
    return _read_array(foreign.cursor(), kinds)


def _read_array(cursor: Cursor, kinds: str) -> Array:
    import numpy as np

    if cursor.take(6) != b"\x93NUMPY":
        raise ValueError("it does not begin as an array")
    major, _ = cursor.unpack("<2B")
    if major not in (1, 2, 3):
        raise ValueError(f"version {major} of an array")
    length = cursor.number("<H" if major == 1 else "<I")
    if length > _MAX_HEADER_BYTES:
        raise ValueError(f"a header of {length} bytes")
    stated = io.BytesIO(struct.pack("<I", length) + cursor.take(length))
    try:
        shape, by_columns, dtype = np.lib.format.read_array_header_2_0(stated)
    except Exception:
        raise ValueError("its header does not describe an array") from None
    if dtype.kind not in kinds or dtype.hasobject:
        raise ValueError(f"values of type {str(dtype)[:40]}")
    if len(shape) > 8 or any(type(each) is not int or each < 0 for each in shape):
        raise ValueError("a shape that no array has")
    count = math.prod(shape)
    if count * dtype.itemsize != cursor.left:
        raise ValueError(f"values of {cursor.left} bytes, not as its header states")
    return cursor.numbers(dtype, count).reshape(shape, order="F" if by_columns else "C")


def parse_npz(foreign: ForeignBytes, wanted: Collection[str] | None = None, kinds: str = "fiub") -> dict[str, Array]:
    """Parse the arrays of an archive in numpy's format by name: all, or the ``wanted`` ones that it has.

    Raises ValueError if it is damaged or an array has another type, OverBudgetError if they are too large.
    """
    data = foreign.content()
    _check_directory(data)
    found = {}
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        for member in archive.infolist():
            name = member.filename.removesuffix(".npy")
            if wanted is not None and name not in wanted:
                continue
            if name in found or member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError(f"the member {name[:40]!r} is there twice, or packed in another way")
            size = foreign.budget.charge(member.file_size, "arrays")
            found[name] = _read_array(Cursor(_unpack(archive, member, size), foreign.budget), kinds)
    return found


def _check_directory(data: bytes) -> None:
    """Refuse an archive whose list of members is slow to read; the list is read as a whole before the members."""
    end = data.rfind(b"PK\x05\x06", max(0, len(data) - 2**16 - _ARCHIVE_END_BYTES))
    if end < 0 or end + _ARCHIVE_END_BYTES > len(data):
        raise ValueError("it has no list of members")
    count, size = struct.unpack_from("<HI", data, end + 10)
    if count > _MAX_MEMBERS or size > _MAX_DIRECTORY_BYTES or data.rfind(b"PK\x06\x07", max(0, end - 20), end) >= 0:
        raise ValueError(f"it has more than {_MAX_MEMBERS} members")
    if data.count(b"PK\x01\x02", max(0, end - size), end) > _MAX_MEMBERS:
        raise ValueError(f"it has more than {_MAX_MEMBERS} members")


def _unpack(archive: zipfile.ZipFile, member: zipfile.ZipInfo, size: int) -> memoryview:
    """Decompress a member of an archive, of ``size`` bytes at most, in steps that stay in the processor's cache."""
    content, at = bytearray(size), 0
    with archive.open(member) as stream:
        while at < size and (part := stream.read(min(_UNPACKED_STEP_BYTES, size - at))):
            content[at : at + len(part)] = part
            at += len(part)
    return memoryview(content)[:at].toreadonly()
