"""The line of a TOML text in which a key is set. Imports no Blender."""

from __future__ import annotations

import functools
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..support.foreign_bytes import Budget, OverBudgetError, parse_toml

Key = tuple[str | int, ...]


def _has_key(data: Any, key: Key) -> bool:
    for step in key:
        try:
            data = data[step]
        except (KeyError, IndexError, TypeError):
            return False
    return True


#: Maximum number of characters that are parsed in search of a line.
_MAX_PARSED_CHARACTERS = 2**21


def _parse_beginning(beginning: str, budget: Budget) -> dict[str, Any] | None:
    """Parse the first lines of a TOML file, with open lists closed. None if they are not TOML."""
    for end in ("", "\n]"):
        budget.charge(len(beginning) + 100)
        try:
            return parse_toml(beginning + end)
        except tomllib.TOMLDecodeError:
            continue
    return None


def find_line(text: str, key: Key, budget: Budget | None = None) -> int | None:
    """Find the line, from 1, in which the value or table at ``key`` begins; None if the text lacks the key.

    ``("sweep", 2, "rig", "pitch_deg")`` is the setting in the third table of a list. ``tomllib`` gives no lines, but
    the first lines of a file are often valid TOML too: the first valid beginning that contains the key ends with it,
    and the last valid beginning before that ends just before the key. So every spelling that TOML allows is supported.
    If ``budget`` is used up, only lines of usual spellings are found.
    """
    budget, lines = budget or Budget(_MAX_PARSED_CHARACTERS), text.splitlines()
    # The first ``without`` lines are valid and lack the key. The first ``within`` lines contain the key, and no valid
    # beginning has ``least`` to ``within`` - 1 lines.
    without, within = 0, len(lines)
    try:
        if (whole := _parse_beginning("\n".join(lines), budget)) is None or not _has_key(whole, key):
            return None
        least = within
        while least > without + 1:
            middle = (without + least) // 2
            for end in range(middle, least):
                data = _parse_beginning("\n".join(lines[:end]), budget)
                if data is None:
                    continue  # in the middle of a value
                if _has_key(data, key):
                    within = least = end
                else:
                    without = end
                break
            else:
                least = middle
                continue
            if end > middle and within == least == end:
                least = middle  # none is whole between the two
    except OverBudgetError:
        return _find_plain_line(text, key)
    empty = (k for k in range(without, within) if lines[k].strip() and not lines[k].lstrip().startswith("#"))
    return next(empty, within - 1) + 1


@functools.lru_cache(maxsize=64)
def _find_plain_line(text: str, key: Key) -> int | None:
    """Find the line of a key in a text that is too long for ``find_line`` to parse. The text must have the usual
    spelling: headers and keys begin lines, and no text has several lines. A key within a list gets the line of the
    list."""
    header: Key = ()
    counts: dict[Key, int] = {}
    while len(key) > 2 and isinstance(key[-1], int):
        key = key[:-1]
    for number, line in enumerate(text.splitlines(), 1):
        stated = line.strip()
        if stated.startswith("["):
            header = _find_table(_split_key(stated.partition("]")[0].strip("[")), counts, stated.startswith("[["))
            found = header
        elif "=" in stated and not stated.startswith("#"):
            found = (*header, *_split_key(stated.partition("=")[0]))
        else:
            continue
        if found[: len(key)] == key:
            return number
    return None


def _split_key(name: str) -> tuple[str, ...]:
    return tuple(part.strip(" \t\"'") for part in name.split("."))


def _find_table(parts: tuple[str, ...], counts: dict[Key, int], begins_another: bool) -> Key:
    """Find the key of a header's table, with its index in each list; ``counts`` has the last index of each list."""
    found: Key = ()
    for k, part in enumerate(parts):
        found = (*found, part)
        if begins_another and k == len(parts) - 1:
            counts[found] = counts.get(found, -1) + 1
        if found in counts:
            found = (*found, counts[found])
    return found


@dataclass(frozen=True)
class Place:
    """A key of a TOML file, which an error names as ``FILE, line N``."""

    file: Path
    text: str
    key: Key = ()

    def at(self, *steps: str | int) -> Place:
        """Return the position of a key below this key."""
        return Place(self.file, self.text, (*self.key, *steps))

    def __str__(self) -> str:
        key, budget = self.key, Budget(_MAX_PARSED_CHARACTERS)
        while key and (line := find_line(self.text, key, budget)) is None:
            key = key[:-1]  # an absent key is reported at the table it belongs to
        return f"{self.file}, line {line}" if key else str(self.file)
