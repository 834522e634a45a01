"""What is made of the tables of many descriptions, once for all that share a table. Imports no Blender.

The pairs of a plan differ in a few tables and share the others, so most of what is needed of a pair is known from
another.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Generic, TypeVar

Made = TypeVar("Made")


class MadeOnce(Generic[Made]):
    """What ``make`` makes of a table, remembered for that very table. Tables must not be changed meanwhile."""

    def __init__(self, make: Callable[[Mapping[str, Any]], Made]) -> None:
        self._make = make
        # With the table itself: as long as it is there, no other has its identity.
        self._known: dict[int, tuple[Mapping[str, Any], Made]] = {}

    def of(self, table: Mapping[str, Any]) -> Made:
        """What was made of this table, or is made now."""
        known = self._known.get(id(table))
        if known is None:
            known = self._known[id(table)] = (table, self._make(table))
        return known[1]


def _text_of(keys: Sequence[str], table: Mapping[str, Any]) -> str:
    return json.dumps([table[key] for key in keys])


class Texts:
    """Texts that are equal for descriptions in which these settings (topic, key) are."""

    def __init__(self, names: Sequence[tuple[str, str]]) -> None:
        keys: dict[str, list[str]] = {}
        for topic, key in names:
            keys.setdefault(topic, []).append(key)
        self._made = {topic: MadeOnce(partial(_text_of, those)) for topic, those in keys.items()}

    def of(self, settings: Mapping[str, Mapping[str, Any]]) -> str:
        """The text of a description."""
        return " ".join([made.of(settings[topic]) for topic, made in self._made.items()])
