"""Caches of results that are made from tables of descriptions, once for each shared table. Imports no Blender.

The pairs of a plan differ in a few tables and share the others, so most results for a pair are known from another pair.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Generic, TypeVar

Made = TypeVar("Made")


class TableCache(Generic[Made]):
    """Caches the result of ``make`` for a table, by the identity of the table. Tables must not be changed."""

    def __init__(self, make: Callable[[Mapping[str, Any]], Made]) -> None:
        self._make = make
        # The stored table stays alive, so no other table gets its identity.
        self._known: dict[int, tuple[Mapping[str, Any], Made]] = {}

    def of(self, table: Mapping[str, Any]) -> Made:
        """Return the cached result for this table; it is made at the first call."""
        known = self._known.get(id(table))
        if known is None:
            known = self._known[id(table)] = (table, self._make(table))
        return known[1]


def _serialize_table(keys: Sequence[str], table: Mapping[str, Any]) -> str:
    return json.dumps([table[key] for key in keys])


class SettingsTexts:
    """Makes a key of a description: equal texts if these settings (topic, key) have equal values."""

    def __init__(self, names: Sequence[tuple[str, str]]) -> None:
        keys: dict[str, list[str]] = {}
        for topic, key in names:
            keys.setdefault(topic, []).append(key)
        self._made = {topic: TableCache(partial(_serialize_table, those)) for topic, those in keys.items()}

    def of(self, settings: Mapping[str, Mapping[str, Any]]) -> str:
        """Return the text of a description."""
        return " ".join([made.of(settings[topic]) for topic, made in self._made.items()])
