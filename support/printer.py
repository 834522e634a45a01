r"""Printing to a terminal, a pipe or a log: all output of this program goes through this module.

Texts contain foreign words: names of files, ids, errors of programs. They are printed as plain text, without markup,
and control characters are made visible, as in ``\x1b``. A stream that is absent, closed or knows few characters causes
no error. Imports no Blender, and rich only for tables and bars.
"""

from __future__ import annotations

import errno
import json
import math
import os
import re
import sys
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from typing import IO, TYPE_CHECKING, cast

from . import system

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

#: Characters that steer a terminal, end a line or change the direction of writing, and lone surrogates.
_CONTROL_CHARACTERS = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
_SHORT_ESCAPES = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}


def show_controls(text: str) -> str:
    """Return the text in one line, in which each control character is visible, as in ``\\x1b`` or ``\\u202e``."""
    return text if text.isprintable() else _CONTROL_CHARACTERS.sub(_escape_control_character, text)


def show_lines(text: str) -> str:
    """Return a text of several lines, each as by ``show_controls``."""
    return text if text.isprintable() else "\n".join(map(show_controls, text.split("\n")))


def _escape_control_character(found: re.Match[str]) -> str:
    number = ord(found[0])
    return _SHORT_ESCAPES.get(found[0]) or (f"\\x{number:02x}" if number < 0x100 else f"\\u{number:04x}")


def open_streams() -> None:
    """Open a standard stream for each absent one, and make all of them accept any character. Without this, the next
    opened file would get the number of the absent stream, and a library would print into the file."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            handle = os.open(os.devnull, os.O_RDWR)
            if handle != number:  # a stream with a lower number is absent too and cannot be made
                os.dup2(handle, number)
                os.close(handle)
            os.set_inheritable(number, True)
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w", encoding="utf-8"))  # noqa: SIM115
    system.set_utf8_output()
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def say(text: str = "", at_once: bool = False) -> None:
    """Print a line, or several, as a result on the standard output.

    Raises OSError if the system refuses the output, such as BrokenPipeError if its reader has ended.
    """
    _write(sys.stdout, f"{show_lines(text)}\n", at_once)


def warn(text: str, program: str = "icymoon") -> None:
    """Print a sentence on the standard error, after the name of the program. Never raises."""
    with suppress(OSError):
        _write(sys.stderr, f"{program}: {show_controls(' '.join(text.split()))}\n")


def rewrite_line(text: str) -> None:
    """Replace the last line of the standard error by a text, if standard error is a terminal. Never raises."""
    with suppress(OSError, ValueError, AttributeError):
        if sys.stderr.isatty():
            _write(sys.stderr, f"\r\033[K{show_controls(text)}")


def print_usage(text: str, to_error: bool) -> None:
    """Print a help or a usage that argparse has formatted. Never raises."""
    with suppress(OSError):
        _write(sys.stderr if to_error else sys.stdout, text)


def emit(kind: str, /, **facts: object) -> None:
    """Print one message to the process that started this process: a JSON line with its ``type``.

    Raises as ``say`` does.
    """
    emit_json({"type": kind, **facts})


def emit_json(data: object) -> None:
    """Print data as a line of JSON; a number that is not finite is null. Raises as ``say`` does."""
    try:
        text = json.dumps(data, allow_nan=False)
    except ValueError:
        text = json.dumps(_replace_nan(data), allow_nan=False)
    _write(sys.stdout, text.replace("\x7f", "\\u007f") + "\n")


def _replace_nan(data: object) -> object:
    if isinstance(data, dict):
        return {key: _replace_nan(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_replace_nan(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def flush() -> None:
    """Print the buffered text. Raises as ``say`` does."""
    _write(sys.stdout, "")
    with suppress(OSError):
        _write(sys.stderr, "")


def discard_output() -> None:
    """Discard all further output: the standard output has no reader, and Python would report this at its end."""
    with suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str | tuple[str, str]]],
    title: str = "",
    left: Collection[int] = (0,),
    narrowest: int = 0,
) -> None:
    """Print a table. A cell is a text, or a text and its style by rich's name.

    Columns in ``left`` are aligned to the left, others to the right. ``narrowest`` is the table's width, in characters,
    when the output is a pipe and so has no width. Raises as ``say`` does.
    """
    from rich.table import Table

    console = make_console()
    if not console.is_terminal:
        console.width = max(console.width, narrowest)
    table = Table(title=make_styled_text(title, "table.title") if title else None, title_justify="left")
    for place, name in enumerate(columns):
        table.add_column(make_styled_text(name), justify="left" if place in left else "right", overflow="fold")
    for row in rows:
        table.add_row(*(make_styled_text(*((cell,) if isinstance(cell, str) else cell)) for cell in row))
    console.print(table)


def print_line(console: Console, *parts: str | tuple[str, str]) -> None:
    """Print a line on a console, above the console's bar if there is one. Parts are like cells of ``print_table``."""
    from rich.text import Text

    console.print(Text.assemble(*(make_styled_text(*((part,) if isinstance(part, str) else part)) for part in parts)))


def make_styled_text(text: str, style: str = "") -> Text:
    """Make a text for rich, without markup."""
    from rich.text import Text

    return Text(show_controls(text), style)


def make_console(to_error: bool = False) -> Console:
    """Make a console of rich that prints like ``say`` or ``warn``, with the same safety; give it instances of its
    Text."""
    from rich.console import Console

    stream = cast(IO[str], _Stream("stderr" if to_error else "stdout"))
    return Console(file=stream, markup=False, highlight=False, emoji=False)


def _write(stream: IO[str] | None, text: str, at_once: bool = True) -> None:
    """Write to a stream, if it exists."""
    if stream is None:
        return
    try:
        try:
            stream.write(text)
        except UnicodeEncodeError:
            encoding = getattr(stream, "encoding", None) or "ascii"
            stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
        if at_once:
            stream.flush()
    except ValueError:  # the stream is closed
        return
    except OSError as error:
        if error.errno != errno.EBADF:  # the file of the stream is closed
            raise


class _Stream:
    """The current standard stream, for rich. It raises errors as ``say`` does, or never, as ``warn``."""

    def __init__(self, name: str) -> None:
        self._name = name

    @property
    def _stream(self) -> IO[str]:
        stream = getattr(sys, self._name)
        return getattr(stream, "rich_proxied_file", stream)  # while a bar is shown, this stream prints by rich

    @property
    def encoding(self) -> str:
        """Encoding by which rich chooses the characters of its lines."""
        return getattr(self._stream, "encoding", None) or "utf-8"

    def write(self, text: str) -> int:
        """Write a text, and flush."""
        try:
            _write(self._stream, text)
        except OSError:
            if self._name == "stdout":
                raise
        return len(text)

    def flush(self) -> None:
        """Do nothing, since no text is buffered."""

    def isatty(self) -> bool:
        """Return whether the stream is a terminal."""
        with suppress(ValueError, AttributeError):
            return bool(self._stream.isatty())
        return False

    def fileno(self) -> int:
        """Return the number of the stream. Raises OSError if it has no number."""
        stream = self._stream
        if stream is None:
            raise OSError(errno.EBADF, "absent")
        return int(stream.fileno())
