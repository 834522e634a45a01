"""In which line of a TOML text a key is set. Imports no Blender."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Key = tuple[str | int, ...]


def _has(data: Any, key: Key) -> bool:
    for step in key:
        try:
            data = data[step]
        except (KeyError, IndexError, TypeError):
            return False
    return True


def _parse_beginning(beginning: str) -> dict[str, Any] | None:
    """The content of a beginning of a file, an array closed where it ends in one; None if it ends elsewhere."""
    for end in ("", "\n]"):
        try:
            return tomllib.loads(beginning + end)
        except tomllib.TOMLDecodeError:
            continue
    return None


def find_line(text: str, key: Key) -> int | None:
    """The line, from 1, in which the value or table at ``key`` begins; None if there is none.

    ``("sweep", 2, "rig", "pitch_deg")`` is the setting in the third table of a list. ``tomllib`` tells no lines, but
    the beginning of a file up to a line is a TOML file too: the first beginning that holds the key ends with it, and
    the last whole beginning before it ends just before it. So every spelling that TOML allows is understood.
    """
    lines = text.splitlines()
    whole = 0
    for end in range(1, len(lines) + 1):
        data = _parse_beginning("\n".join(lines[:end]))
        if data is None:
            continue  # in the middle of a value
        if _has(data, key):
            empty = (k for k in range(whole, end) if lines[k].strip() and not lines[k].lstrip().startswith("#"))
            return next(empty, end - 1) + 1
        whole = end
    return None


@dataclass(frozen=True)
class Place:
    """A key of a TOML file, which an error names as ``FILE, line N``."""

    file: Path
    text: str
    key: Key = ()

    def at(self, *steps: str | int) -> Place:
        """A place further down."""
        return Place(self.file, self.text, (*self.key, *steps))

    def __str__(self) -> str:
        key = self.key
        while key and (line := find_line(self.text, key)) is None:
            key = key[:-1]  # what is absent is told at the table it belongs to
        return f"{self.file}, line {line}" if key else str(self.file)
