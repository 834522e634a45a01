"""Writing files so that a crash leaves the old one, the new one, or none, never half of one."""

from __future__ import annotations

import errno
import hashlib
import itertools
import json
import os
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from .errors import DiskError, IcyMoonError

PART = ".part"
#: Errors that pass by themselves: of a network share, or of a call that a signal has interrupted.
_PASSING = {errno.EIO, errno.ESTALE, errno.EAGAIN, errno.ETIMEDOUT, errno.EINTR}
#: Waits before another attempt, 13 s in all: a share that is away for longer is a failure.
_WAITS_S = (0.1, 0.3, 1.0, 3.0, 8.6)
Answer = TypeVar("Answer")
_numbers = itertools.count(1)


def part_of(path: Path) -> Path:
    """Where to write what is to become ``path``: a name that no other process uses, on any machine, and that ends
    in ``PART``."""
    return path.with_name(f"{path.name}.{socket.gethostname()}-{os.getpid()}-{next(_numbers)}{PART}")


def patiently(act: Callable[[], Answer]) -> Answer:
    """What ``act`` returns, tried again for some seconds if an error meets it that passes by itself."""
    for wait_s in _WAITS_S:
        try:
            return act()
        except OSError as error:
            if not _passes(error):
                raise
        time.sleep(wait_s)
    return act()


def _passes(error: OSError) -> bool:
    # On Windows a file cannot be renamed or removed while a virus scanner or an indexer has it open.
    return error.errno in _PASSING or (sys.platform == "win32" and isinstance(error, PermissionError))


@contextmanager
def disk_errors(what: str, where: Path) -> Iterator[None]:
    """Turn an OSError inside the block into a sentence a person can act on."""
    try:
        yield
    except OSError as error:
        mend = {errno.ENOSPC: "the disk is full; free some space or choose another folder",
                errno.EDQUOT: "your disk quota is used up; free some space or choose another folder",
                errno.EROFS: "the disk is read-only; choose another folder",
                errno.EACCES: "this folder may not be written to; choose another one",
                errno.EPERM: "this folder may not be written to; choose another one",
                errno.ENOTDIR: "a part of this path is a file, not a folder; choose another folder",
                errno.EEXIST: "a file of this name is in the way; move it or choose another folder",
                }.get(error.errno or 0, f"{error.strerror or error}")
        raise DiskError(f"Cannot {what} {where}: {mend}.") from error


def sync(path: Path) -> None:
    """Flush a file, or the entries of a folder, to the disk."""
    if path.is_dir() and os.name == "nt":
        return  # Windows has no handle on a folder to flush
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_atomically(path: Path, write: Callable[[Path], None]) -> None:
    """Let ``write`` fill a file beside ``path``, see ``part_of``, then flush and rename it to ``path``.

    Makes the parent folders. Raises IcyMoonError when the disk refuses; the part is removed.
    """
    part = part_of(path)
    with disk_errors("write", path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            write(part)
            sync(part)
            os.replace(part, path)
            sync(path.parent)
        finally:
            part.unlink(missing_ok=True)


def read_text(path: Path) -> str:
    """The content of a UTF-8 text file. Raises OSError as opening it does, ValueError where it is no such text."""
    return patiently(lambda: path.read_text(encoding="utf-8"))


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file atomically."""
    write_atomically(path, lambda part: _write_text(part, text))


def _write_text(part: Path, text: str) -> None:
    part.write_text(text, encoding="utf-8", newline="\n")


def json_text(data: Any) -> str:
    """The content of a JSON file; NaN is refused, since JSON has none."""
    return json.dumps(data, indent=1, allow_nan=False) + "\n"


def write_json(path: Path, data: Any) -> None:
    """Write a JSON file atomically; NaN is refused."""
    write_text(path, json_text(data))


def replaced(path: Path, before: str, text: str) -> bool:
    """Put ``text`` atomically in the place of a text file that has the content ``before``; False if it has another.

    That holds also where another process renames the file's folder at any moment, and puts another in its place: the
    part then lies in the folder that went.
    """
    def write(part: Path) -> None:
        _write_text(part, text)
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
    """A file is no longer what it was."""


def sha256(path: Path) -> str:
    """Checksum of a file's content."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def absolute_path(text: str, name: str, blend_folder: str | None = None) -> Path:
    """The file or folder that the setting ``name`` states: ``~`` is the home folder, ``//`` the .blend's folder.

    ``blend_folder`` is empty or None where there is no saved .blend. Raises IcyMoonError if the
    path is empty or begins with // without one.
    """
    if text.startswith("//"):
        if not blend_folder:
            raise IcyMoonError(f"{name} is {text!r}, beside a .blend file that is not saved; "
                               "save it or choose a path that does not begin with //.")
        return Path(os.path.normpath(os.path.join(blend_folder, text[2:])))
    if not text.strip():
        raise IcyMoonError(f"{name} is empty; choose a path.")
    return Path(os.path.abspath(os.path.expanduser(text)))
