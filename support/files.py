"""Atomic writing of files: a crash leaves the old or the new file, never a part of a file."""

from __future__ import annotations

import datetime
import errno
import functools
import glob
import hashlib
import itertools
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from . import system
from .errors import DiskError, IcyMoonError
from .foreign_bytes import MAX_TEXT_BYTES, decode_text, read_regular
from .printer import show_controls

PART_SUFFIX = ".part"
#: Bytes of a file that are read at a time for its checksum.
_CHECKSUM_STEP_BYTES = 2**18
#: Whole numbers above this are quoted as a number of digits.
_LARGEST_QUOTED_NUMBER = 10**20
#: Maximum number of values of a list that are quoted.
_MAX_QUOTED_VALUES = 8
#: Longest name in bytes of usual file systems.
_LONGEST_NAME_BYTES = 255
#: Longest path in characters.
_LONGEST_PATH_CHARACTERS = 4095
_FIX_BY_ERROR = {
    errno.ENOSPC: "the disk is full; free some space or choose another folder",
    errno.EDQUOT: "your disk quota is used up; free some space or choose another folder",
    errno.EROFS: "the disk is read-only; choose another folder",
    errno.EACCES: "this folder may not be written to; choose another one",
    errno.EPERM: "this folder may not be written to; choose another one",
    errno.ENOTDIR: "a part of this path is a file, not a folder; choose another folder",
    errno.EEXIST: "a file of this name is in the way; move it or choose another folder",
}
_FIX_OF_OPEN_FILE = "another program has it open, or it may not be written to; close it there or choose another folder"
#: Names of files that file managers make: macOS' file attributes and folder views, and Windows' pictures and folder
#: views.
_FILE_MANAGER_NAMES = re.compile(r"\._.+|\.DS_Store|Thumbs\.db|desktop\.ini")
_part_numbers = itertools.count(1)


def make_part_path(path: Path) -> Path:
    """Make the path of the half-written file that will be renamed to ``path``.

    Its name ends in ``PART_SUFFIX``, and no other process on any machine uses it.
    """
    return path.with_name(f"{path.name}.{system.find_computer_name()}-{os.getpid()}-{next(_part_numbers)}{PART_SUFFIX}")


@contextmanager
def explain_disk_errors(what: str, where: Path) -> Iterator[None]:
    """Turn an OSError inside the ``with`` statement into a sentence that tells the user what to do."""
    system.check_path(where)
    try:
        yield
    except OSError as error:
        fix = (
            _FIX_OF_OPEN_FILE
            if system.may_be_open_elsewhere(error)
            else _FIX_BY_ERROR.get(error.errno or 0, f"{error.strerror or error}")
        )
        raise DiskError(f"Cannot {what} {where}: {fix}.") from error


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a file beside ``path``, see ``make_part_path``, then flush it and rename it to ``path``. Makes
    the parent folders. Raises IcyMoonError if the disk refuses; the part is then removed."""
    part = make_part_path(path)
    system.check_path(path, part)
    with explain_disk_errors("write", path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            write(part)
            system.flush(part)
            system.replace(part, path)
            system.flush(path.parent)
        finally:
            system.remove(part)


def read_text(path: Path) -> str:
    """Read a text file that Icy Moon wrote, see ``foreign_bytes.decode_text``. Raises OSError if the file cannot be
    read, and ValueError for content other than text or for more than ``MAX_TEXT`` bytes."""
    return decode_text(read_regular(path, MAX_TEXT_BYTES))


def is_of_file_manager(name: str) -> bool:
    """Return whether file managers leave files of this name in folders."""
    return bool(_FILE_MANAGER_NAMES.fullmatch(name))


def list_user_files(folder: Path, pattern: str = "*") -> list[Path]:
    """List the paths in a folder that match a pattern, sorted. Files of file managers are left out, in any folder of
    the path."""
    return [
        path
        for path in sorted(folder.glob(pattern))
        if not any(map(is_of_file_manager, path.relative_to(folder).parts))
    ]


def find_leftover_parts(folder: Path, pattern: str = "*") -> Iterator[Path]:
    """Yield the half-written files in a folder whose processes, on this computer, have certainly ended. ``pattern`` is
    the name of the whole file."""
    scope = system.find_process_scope()
    for part in folder.glob(f"{pattern}.{glob.escape(system.find_computer_name())}-*-*{PART_SUFFIX}"):
        writer = part.name.removesuffix(PART_SUFFIX).rsplit("-", 2)[1]
        if writer.isdecimal() and system.has_ended(int(writer), scope) and part.is_file() and not part.is_symlink():
            yield part


def remove_leftover_parts(folder: Path) -> None:
    """Remove the half-written files in a folder that ``find_leftover_parts`` finds."""
    for part in find_leftover_parts(folder):
        with suppress(OSError):  # another process may remove it too, or the disk refuses
            system.remove(part)


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file atomically."""
    write_atomically(path, lambda part: part.write_text(text, encoding="utf-8", newline="\n"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically, see ``write_atomically``."""
    write_atomically(path, lambda part: part.write_bytes(content))


def to_json_text(data: object) -> str:
    """Write data as the content of a JSON file. Raises ValueError for NaN, which JSON lacks."""
    return json.dumps(data, indent=1, allow_nan=False) + "\n"


def make_json_digest(data: object) -> str:
    """Make a digest of JSON values, sixteen digits."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def escape_cell(text: str) -> str:
    """Escape a text for a cell of a table: control characters are made visible, and an apostrophe precedes a text that
    a spreadsheet would take for a formula."""
    return show_controls(f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text)


def write_json(path: Path, data: object) -> None:
    """Write a JSON file atomically. Raises ValueError for NaN."""
    write_text(path, to_json_text(data))


def replace_if_unchanged(path: Path, before: str, text: str) -> bool:
    """Replace a text file whose content is ``before`` by ``text``, atomically. Returns False if its content differs.
    This is safe even if another process moves the folder away, because the half-written file is then in the moved
    folder."""

    def write(part: Path) -> None:
        part.write_text(text, encoding="utf-8", newline="\n")
        if read_text(path) != before:
            raise _ChangedError

    try:
        write_atomically(path, write)
    except (_ChangedError, DiskError) as error:
        if isinstance(error, DiskError) and not isinstance(error.__cause__, FileNotFoundError):
            raise
        return False
    return True


class _ChangedError(Exception):
    """The content of a file has changed."""


def hash_file(path: Path) -> str:
    """Compute the checksum of a regular file's content. Raises OSError for any other, such as a pipe that never
    ends."""
    found = hashlib.sha256()
    with system.open_regular(path) as stream:
        while part := stream.read(_CHECKSUM_STEP_BYTES):
            found.update(part)
    return found.hexdigest()


def hash_file_once(path: Path) -> str:
    """Return the checksum of a regular file's content. The file is read again only if its size or time of change
    differs. Raises OSError."""
    state = path.stat()
    return _hash_state(path, state.st_size, state.st_mtime_ns)


@functools.lru_cache(maxsize=256)
def _hash_state(path: Path, size: int, modified_ns: int) -> str:
    return hash_file(path)


def read_checksum(path: Path, most: float = math.inf) -> str:
    """Read the checksum of a file; empty if the file cannot be read or has more than ``most`` bytes. The user of the
    file reports this fault."""
    try:
        return hash_file(path) if path.stat().st_size <= most else ""
    except OSError:
        return ""


def absolute_path(text: str, name: str, blend_folder: str | None = None) -> Path:
    """Return the absolute path in the setting ``name``: ``~`` is the home folder, ``//`` the .blend's folder.
    ``blend_folder`` is empty or None without a saved .blend. Raises IcyMoonError for an empty or impossible path, and
    for // without a saved .blend."""
    if text.startswith("//"):
        if not blend_folder:
            raise IcyMoonError(
                f"{name} is {shorten(text)!r}, beside a .blend file that is not saved; "
                "save it or choose a path that does not begin with //."
            )
        return Path(os.path.normpath(os.path.join(blend_folder, parse_path(text[2:], name))))
    return Path(os.path.abspath(parse_path(text, name)))


def parse_path(text: str, name: str) -> Path:
    """Parse the path that the user wrote for ``name``; ``~`` at its start is a home folder. Raises IcyMoonError for an
    empty or impossible path."""
    if not text.strip():
        raise IcyMoonError(f"{name} is empty; choose a path.")
    path = os.path.expanduser(text)
    if text.startswith("~") and path == text:
        raise IcyMoonError(
            f"{name} is {shorten(text)!r}, but there is no such home folder; write the whole path, or "
            "./~ for a name that begins so."
        )
    try:
        longest = max(map(len, os.fsencode(path).split(os.sep.encode())))
    except ValueError:
        longest = 0
    if longest == 0 or "\0" in path:
        raise IcyMoonError(f"{name} is {shorten(text)!r}, with characters that a path cannot have; write another path.")
    if longest > _LONGEST_NAME_BYTES or len(path) > _LONGEST_PATH_CHARACTERS:
        raise IcyMoonError(
            f"{name} is {shorten(text)!r}, longer than file systems allow ({_LONGEST_NAME_BYTES} bytes for a "
            f"name, {_LONGEST_PATH_CHARACTERS} for a path); choose a shorter one."
        )
    return Path(path)


def shorten(text: str) -> str:
    """Shorten a text for a quotation in a sentence: only its beginning if it is long."""
    return text if len(text) <= 80 else text[:60] + "…"


def quote(value: object) -> str:
    """Quote a value of a file in a sentence, plainly and never long: texts in quotes, ``true``, dates as written in
    TOML, ``a table``, ``a whole number of 5000 digits``."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "null"
    if isinstance(value, int) and abs(value) >= _LARGEST_QUOTED_NUMBER:
        return f"a whole number of {int(math.log10(abs(value))) + 1} digits"
    if isinstance(value, datetime.date | datetime.time):  # a datetime is also a date
        return value.isoformat()
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, list | tuple):
        plain = len(value) <= _MAX_QUOTED_VALUES and not any(isinstance(each, Mapping | list | tuple) for each in value)
        return shorten(f"[{', '.join(map(quote, value))}]") if plain else f"a list of {len(value)}"
    return shorten(repr(value))


def refuse_file_as_folder(path: Path, option: str) -> None:
    """Raise IcyMoonError if ``path``, the value of ``option``, or a folder above it is a file.

    Called before long work whose results go into that folder.
    """
    for part in (path, *path.absolute().parents):
        if os.path.exists(part) and not os.path.isdir(part):  # unlike Path's, these never raise
            raise IcyMoonError(f"{option}: {part} is a file, not a folder; give another folder.")


def is_file(path: Path) -> bool:
    """Return whether a file exists; False also for a path that is invalid on this system."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
