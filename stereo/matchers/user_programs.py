"""The user's programs: their command lines, the arrays that they write, and their last lines of output."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import parse_npy, parse_part, read_end, read_regular
from ...support.printer import show_controls
from ...support.system import split_command

#: Most bytes of a file beside its numbers, and of each number.
_MAX_EXTRA_BYTES, _MAX_BYTES_PER_NUMBER = 2**20, 16
#: Bytes of a text that are read from its end, and most characters that are shown.
_READ_BYTES, _MAX_SHOWN = 65536, 300


def read_array(path: Path, shape: tuple[int, ...]) -> Array:
    """Read the numbers of a file in numpy's format, for images of a shape. The array is read-only and of any type.

    Raises OSError if there is no such file, ValueError if it is far too large, IcyMoonError if it is damaged.
    """
    data = read_regular(path, _MAX_BYTES_PER_NUMBER * math.prod(shape) + _MAX_EXTRA_BYTES)
    return parse_part(
        data,
        path.name,
        lambda foreign: parse_npy(foreign, "fiubcmMSUV"),
        "an array",
        "write it by numpy.save",
        memory=len(data),
    )


def read_written_array(program: str, what: str, path: Path, shape: tuple[int, ...]) -> Array:
    """Read the numbers that a ``program`` has written, see ``read_array``. Raises IcyMoonError, which names the program
    and ``what`` it should write, if they are missing or damaged.
    """
    try:
        return read_array(path, shape)
    except FileNotFoundError:
        raise IcyMoonError(f"{program} wrote no {what}; write it by numpy.save to the path that it got.") from None
    except (OSError, ValueError, IcyMoonError) as error:
        raise IcyMoonError(
            f"{program} wrote a {what} that cannot be read ({' '.join(str(error).split())[:300].rstrip('.')}); write "
            "it by numpy.save."
        ) from None


def read_last_line(path: Path) -> str:
    """Read the last line of a text that a program has written, such as its errors; "" if there is no text."""
    try:
        lines = read_end(path, _READ_BYTES).decode("utf-8", "replace").splitlines()
    except OSError:
        return ""
    return next((show_controls(line.strip()[:_MAX_SHOWN]) for line in reversed(lines) if line.strip()), "")


def split_arguments(option: str, command: str, example: str) -> list[str]:
    """Split a command into its arguments. Raises IcyMoonError, naming the ``option``, if it has none."""
    try:
        arguments = split_command(command)
    except ValueError as error:
        raise IcyMoonError(f"{option} cannot be split into arguments ({error}); close its quotes.") from None
    if not arguments:
        raise IcyMoonError(f"{option} is empty; write it as {example}.")
    return arguments


def require_program(option: str, name: str) -> None:
    """Raise IcyMoonError unless a program with this name or path exists on this machine."""
    if shutil.which(name) is None:
        raise IcyMoonError(f"{option} starts with {name}, which is not a program on this machine; give its whole path.")
