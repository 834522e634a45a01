"""Required shapes of files that are read back: the keys, and the kind of each value.

A file may be of another version, cut off by a full disk or changed by hand. So its content is compared with a shape
before use. A shape is a kind of value, a table of shapes by key (``Maybe`` for an optional key), or ``Each`` for tables
and lists with any number of one shape. Imports no Blender.
"""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from .errors import IcyMoonError
from .files import quote, read_text
from .foreign_bytes import MAX_TEXT_BYTES, ForeignBytes, RefusedError, decode_text, describe_reason, parse_json, read
from .suggestions import suggest_nearest
from .system import find_name_fault


@dataclass(frozen=True)
class Kind:
    """A kind of value: its name in words, and a test for it."""

    name: str
    fits: Callable[[Any], bool]


@dataclass(frozen=True)
class Each:
    """A table whose keys have one kind and whose values have one shape, or a list (``keys`` is None) of such values.
    ``needed`` are the required keys."""

    shape: Shape
    keys: Kind | None = None
    needed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Maybe:
    """A shape of an optional value; ``null`` also allows null."""

    shape: Shape
    null: bool = False


Shape = Kind | Mapping[str, Any] | Each | Maybe


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a finite number, see ``NUMBER``."""
    return _is_whole(value) or (isinstance(value, float) and math.isfinite(value))


def _is_whole(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**63


def _is_matrix(value: object) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 4
        and all(isinstance(row, list) and len(row) == 4 and all(map(is_number, row)) for row in value)
    )


def _is_text(value: object) -> TypeGuard[str]:
    """Return whether a value is a text that can be written to files and terminals; JSON may contain lone surrogates."""
    return isinstance(value, str) and value == value.encode("utf-8", "replace").decode("utf-8")


def _is_file_name(value: object) -> bool:
    """Return whether a text names a file in a folder, on every system, and nothing outside the folder."""
    return _is_text(value) and value.strip(" .") == value != "" and not find_name_fault(value)


ANYTHING = Kind("anything", lambda value: True)
TEXT = Kind("a text", _is_text)
PATH = Kind("a path", lambda value: _is_text(value) and value.strip() != "" and "\0" not in value)
FLAG = Kind("true or false", lambda value: isinstance(value, bool))
NUMBER = Kind("a finite number", is_number)
POSITIVE = Kind("a number above 0", lambda value: is_number(value) and value > 0)
WHOLE = Kind("a whole number", _is_whole)
COUNT = Kind("a whole number of 0 or more", lambda value: _is_whole(value) and value >= 0)
PIXELS = Kind("a whole number from 1 to 100000", lambda value: _is_whole(value) and 1 <= value <= 100_000)
PROCESS = Kind("the number of a process", lambda value: _is_whole(value) and 1 < value < 2**31)
TABLE = Kind("a table", lambda value: isinstance(value, dict))
MATRIX = Kind("a 4 x 4 matrix", _is_matrix)
FILE_NAME = Kind("a file name without a folder", _is_file_name)
SHA256 = Kind(
    "64 digits of 0-9 and a-f", lambda value: isinstance(value, str) and re.fullmatch("[0-9a-f]{64}", value) is not None
)


def find_fault(data: object, shape: Shape, name: str = "it") -> str:
    """Find the first fault of ``data``, under the name ``name``; empty for a valid shape."""
    if isinstance(shape, Maybe):
        return "" if data is None and shape.null else find_fault(data, shape.shape, name)
    if isinstance(shape, Kind):
        return "" if shape.fits(data) else _describe_mismatch(data, name, shape.name)
    if isinstance(shape, Each) and shape.keys is None:
        if not isinstance(data, list):
            return _describe_mismatch(data, name, "a list")
        return _take_first_fault(find_fault(value, shape.shape, f"{name}[{k}]") for k, value in enumerate(data))
    if not isinstance(data, dict):
        return _describe_mismatch(data, name, "a table")
    needed = shape.needed if isinstance(shape, Each) else [k for k, v in shape.items() if not isinstance(v, Maybe)]
    for key in needed:
        if key not in data:
            return f"{_key_path(name, key)} is missing"
    if isinstance(shape, Each):
        keys = shape.keys or TEXT
        return _take_first_fault(
            _describe_mismatch(key, f"a name in {name}", keys.name)
            if not keys.fits(key)
            else find_fault(value, shape.shape, _key_path(name, key))
            for key, value in data.items()
        )
    return _take_first_fault(
        find_fault(data[key], inner, _key_path(name, key)) for key, inner in shape.items() if key in data
    )


def _key_path(name: str, key: str) -> str:
    return key if name == "it" else f"{name}.{key}"


def _describe_mismatch(value: object, name: str, wanted: str) -> str:
    return f"{name} is {quote(value)}, not {wanted}"


def _take_first_fault(faults: Iterable[str]) -> str:
    return next(filter(None, faults), "")


def check_record(data: object, shape: Shape, where: object, fix: str) -> Any:
    """Return ``data`` if it has this shape. Raises IcyMoonError with the file ``where``, the fault and the ``fix``."""
    wrong = find_fault(data, shape)
    if wrong:
        raise IcyMoonError(f"{where}: {wrong}; {fix}.")
    return data


def read_record(path: Path, shape: Shape, fix: str) -> Any:
    """Read the content of a JSON file of this shape. Raises IcyMoonError, or FileNotFoundError if the file is
    missing."""
    try:
        data = parse_json(read_text(path))
    except FileNotFoundError:
        raise
    except (OSError, ValueError) as error:
        raise IcyMoonError(f"{path} cannot be read ({describe_reason(error)}); {fix}.") from None
    return check_record(data, shape, path, fix)


#: Bytes of memory of a line of numbers.
_MEMORY_PER_LINE = 160
#: Bytes of memory of each number.
_MEMORY_PER_NUMBER = 32


def read_number_lines(
    path: Path, columns: Sequence[str], setting: str, most: int | None = None
) -> list[tuple[int, list[float] | None]]:
    """Read the numbers of some columns of a CSV file whose first line names its columns.

    Each line that is not empty gives its line number in the file and its numbers, or None if a column has no number.
    Raises IcyMoonError if the file that ``setting`` names cannot be read, lacks a column, or has more lines than
    ``most``; reading stops there.
    """
    return read(
        path,
        lambda foreign: _parse_number_lines(foreign, columns, most),
        "a table of numbers",
        f"check {setting}",
        most=MAX_TEXT_BYTES,
    )


def _parse_number_lines(
    foreign: ForeignBytes, columns: Sequence[str], most: int | None
) -> list[tuple[int, list[float] | None]]:
    found: list[tuple[int, list[float] | None]] = []
    lines = foreign.lines()
    first = _refuse_nul(*next(lines, (1, b""))).removeprefix(codecs.BOM_UTF8)
    heads = [head.strip() for head in decode_text(first).split(",")]
    for column in columns:
        if column not in heads:
            guess = suggest_nearest(column, heads, otherwise=f"but the first line {quote(decode_text(first))}.")
            raise RefusedError(
                f"has no column {column}, {guess} Its first line must name the columns {', '.join(columns)}."
            )
    places = [heads.index(column) for column in columns]
    for number, line in lines:
        if not line.strip():
            continue
        if len(found) == most:
            raise RefusedError(
                f"has more than {most} lines of numbers; leave out those that lie evenly between their neighbours."
            )
        foreign.budget.charge(_MEMORY_PER_LINE + _MEMORY_PER_NUMBER * len(places), "numbers")
        found.append((number, _read_numbers_at(_refuse_nul(number, line).split(b","), places)))
    return found


def _refuse_nul(number: int, line: bytes) -> bytes:
    if b"\0" in line:
        raise RefusedError(f"has a byte 0 in line {number}, which is not text; save it as UTF-8.")
    return line


def _read_numbers_at(cells: Sequence[bytes], places: Sequence[int]) -> list[float] | None:
    try:
        return [float(cells[place].replace(b"_", b"?")) for place in places]  # Python reads 1_0 as 10
    except (ValueError, IndexError):
        return None
