"""The settings from which ids of pairs are made. No later version may change the id of a pair.

``pair_ids.json`` contains the settings of the first version under ``counted``. This list is closed, and an id is made
from these settings in this order. A newer setting is under ``later``, with the value that has the effect of versions
without it. It counts only if it differs from that value. Renamed settings are under ``renamed`` (old name, new name),
and removed ones under ``gone``, with the value that later versions imply. ``entries`` are the settings of each table of
a list. Imports no Blender.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ..typed_settings import Settings, typed
from .changes import relief_in_mesh
from .landform_releases import counted_landforms
from .table import Setting, all_settings
from .table_texts import MadeOnce

SCHEMA: dict[str, Any] = json.loads(
    Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))


def before(name: str, setting: Setting) -> Any:
    """The value of a setting that has the effect of versions without it; the default if the first version had it."""
    return SCHEMA["later"].get(name, setting.default)


def present_name(name: str) -> str:
    """The present name of a setting (``topic.key``)."""
    return str(SCHEMA["renamed"].get(name, name))


def counts(setting: Setting) -> bool:
    """Whether a setting can change a rendered pixel. The path of a file cannot."""
    return setting.effect not in ("response", "run") and setting.subtype != "FILE_PATH"


def counted(settings: Mapping[str, Mapping[str, Any]]) -> list[Any]:
    """The values of complete settings from which a pair's id is made.

    They are the list of the first version and, if there are any, the newer settings that differ from ``before``.
    """
    return [json.loads(text) for text in make_counter()(settings)]


def make_counter() -> Callable[[Mapping[str, Mapping[str, Any]]], list[str]]:
    """``counted`` for many descriptions, each of its lists as JSON.

    What a table gives is made once for all descriptions that share the table. It must not be changed meanwhile.
    """
    columns = [(name, *present_name(name).split(".", 1)) for name in SCHEMA["counted"]]
    special = {name for name, topic, key in columns if name in SCHEMA["gone"] or key == "relief"}
    runs = [(topic, MadeOnce(partial(_text_of, [(name, key) for name, _, key in run])) if topic else run[0][0])
            for topic, run in _split_columns(columns, special)]
    newer = {topic: MadeOnce(partial(_find_newer, *those)) for topic, those in _newer_settings().items()}

    def count(settings: Mapping[str, Mapping[str, Any]]) -> list[str]:
        first = ", ".join([json.dumps([made, _plain(made, value_in_id(made, settings))]) if isinstance(made, str)
                           else made.of(settings[topic]) for topic, made in runs])
        found = [each for topic, made in newer.items() for each in made.of(settings[topic])]
        found += counted_landforms(settings)
        return [f"[{first}]", json.dumps(sorted(found))] if found else [f"[{first}]"]

    return count


def _split_columns(columns: Sequence[tuple[str, str, str]], special: Collection[str],
                   ) -> list[tuple[str, list[tuple[str, str, str]]]]:
    """Neighbours of one topic, with that topic; those whose values depend on other topics one by one, without any."""
    runs = [(topic, list(run)) for topic, run in
            itertools.groupby(columns, lambda column: "" if column[0] in special else column[1])]
    return [(topic, part) for topic, run in runs for part in ([run] if topic else [[each] for each in run])]


def _text_of(columns: Sequence[tuple[str, str]], table: Mapping[str, Any]) -> str:
    return json.dumps([[name, _plain(name, table[key])] for name, key in columns])[1:-1]


def _newer_settings() -> dict[str, tuple[list[tuple[str, str, Any]], list[tuple[str, str, str, Any]]]]:
    """By topic (name, key, value before) of newer settings, and (key, part, name, value before) of newer parts of the
    tables of its lists."""
    found: dict[str, tuple[list[tuple[str, str, Any]], list[tuple[str, str, str, Any]]]] = {}
    for topic, s in all_settings():
        values, parts = found.setdefault(topic, ([], []))
        if (name := f"{topic}.{s.key}") in SCHEMA["later"] and counts(s):
            values.append((name, s.key, before(name, s)))
        parts += [(s.key, part.key, of, before(of, part)) for part in s.entries
                  if (of := f"{name}.{part.key}") in SCHEMA["later"]]
    return {topic: both for topic, both in found.items() if any(both)}


def _find_newer(values: Sequence[tuple[str, str, Any]], parts: Sequence[tuple[str, str, str, Any]],
                table: Mapping[str, Any]) -> list[Any]:
    """[name, value] of the newer settings of a table that differ from before."""
    found = [[name, _plain(name, table[key])] for name, key, old in values if table[key] != old]
    return found + [[f"{name} {k}", entry[part]] for key, part, name, old in parts
                    for k, entry in enumerate(table[key]) if entry[part] != old]


def value_in_id(name: str, settings: Mapping[str, Mapping[str, Any]]) -> Any:
    """The value of a setting (``topic.key``) from which a pair's id is made."""
    topic, _, key = present_name(name).partition(".")
    value = settings[topic].get(key, SCHEMA["gone"][name]) if name in SCHEMA["gone"] else settings[topic][key]
    if key == "relief" and value == "REAL" and (topic != "surface" or not relief_in_mesh(_as_typed(settings))):
        return "BUMP"  # real relief that is not in the mesh renders the same pixels, and was called so before
    return value


def _as_typed(settings: Mapping[str, Mapping[str, Any]]) -> Settings:
    return settings if isinstance(settings, Settings) else typed(settings)


def _plain(name: str, value: Any) -> Any:
    """A value without newer settings in the tables of a list."""
    keys = SCHEMA["entries"].get(name)
    return value if keys is None else [{key: entry[key] for key in keys} for entry in value]
