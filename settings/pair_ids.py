"""The id of a pair, a hash of its settings; no later version may change it.

An id is made from the settings of the first release, in the order of their declaration; this list is closed. A newer
setting, whose declaration states ``since``, counts only if it differs from the value with the effect of releases
without it (``Setting.old_value``). Imports no Blender.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import Any

from .landform_releases import list_counted_landforms
from .rebuilt_parts import describe_mesh_relief
from .table import TOPICS, list_all_settings
from .table_cache import TableCache
from .topics.declaration import Setting, Value
from .topics.scene import Settings, typed

#: A function that returns the values of settings that count in an id, as JSON, see ``make_counter``.
Counter = Callable[[Mapping[str, Mapping[str, Any]]], list[str]]
#: Present names of settings that were renamed, by their old names (``topic.key``), as ids contain the old ones.
RENAMED_SETTINGS: dict[str, str] = {}


def make_pair_id(settings: Mapping[str, Mapping[str, Value]], extra: str = "", counter: Counter | None = None) -> str:
    """Make the id of the pair with these complete settings: twelve hexadecimal digits.

    Settings that cannot change a rendered pixel (camera response, paths, threads) do not count. Newer settings count
    only if they differ from their ``old_value``. ``extra`` identifies content that the settings do not describe: files
    of the ground, and edited or added geometry. For many pairs, give one ``counter`` from ``make_counter`` to all.
    """
    first, *later = (counter or make_counter())(settings)
    return hashlib.sha256(f"[{', '.join((first, json.dumps(extra), *later))}]".encode()).hexdigest()[:12]


def find_present_name(name: str) -> str:
    """Return the present name of a setting (``topic.key``)."""
    return RENAMED_SETTINGS.get(name, name)


def affects_pixels(setting: Setting) -> bool:
    """Return whether a setting can change a rendered pixel. The path of a file cannot."""
    return setting.effect not in ("response", "run") and setting.subtype != "FILE_PATH"


def list_first_settings() -> list[str]:
    """List the settings of the first release that count in an id, by their names in that release, in the order of the
    id."""
    old = {new: name for name, new in RENAMED_SETTINGS.items()}
    return [
        old.get(name, name)
        for name in (
            f"{topic.key}.{s.key}"
            for topic in TOPICS.values()
            if not topic.plugin
            for s in topic.settings
            if not s.since and affects_pixels(s)
        )
    ]


def list_counted_values(settings: Mapping[str, Mapping[str, Any]]) -> list[Any]:
    """List the values of complete settings from which a pair's id is made: the list of the first release and, if there
    are any, the newer settings that differ from their ``old_value``."""
    return [json.loads(text) for text in make_counter()(settings)]


def make_counter() -> Counter:
    """Make a function that lists the counted values of many descriptions, as ``list_counted_values`` does, each as
    JSON.

    The result for a table is kept for all descriptions that share the table, so do not change a table between calls.
    """
    columns = [
        (name, topic, key)
        for name in list_first_settings()
        for topic, _, key in [find_present_name(name).partition(".")]
    ]
    special = {name for name, topic, key in columns if key == "relief"}
    runs = [
        (topic, TableCache(partial(_make_text, [(name, key) for name, _, key in run])) if topic else run[0][0])
        for topic, run in _group_names_by_topic(columns, special)
    ]
    newer = {topic: TableCache(partial(_find_newer, *those)) for topic, those in _list_newer_settings().items()}

    def count(settings: Mapping[str, Mapping[str, Any]]) -> list[str]:
        first = ", ".join(
            [
                json.dumps([made, _drop_newer_parts(made, find_value_in_id(made, settings))])
                if isinstance(made, str)
                else made.of(settings[topic])
                for topic, made in runs
            ]
        )
        found = [each for topic, made in newer.items() for each in made.of(settings[topic])]
        found += list_counted_landforms(settings)
        return [f"[{first}]", json.dumps(sorted(found))] if found else [f"[{first}]"]

    return count


def _group_names_by_topic(
    columns: Sequence[tuple[str, str, str]],
    special: Collection[str],
) -> list[tuple[str, list[tuple[str, str, str]]]]:
    """Group neighbouring columns by topic. A column whose value depends on other topics stays alone, with an empty
    topic.
    """
    runs = [
        (topic, list(run))
        for topic, run in itertools.groupby(columns, lambda column: "" if column[0] in special else column[1])
    ]
    return [(topic, part) for topic, run in runs for part in ([run] if topic else [[each] for each in run])]


def _make_text(columns: Sequence[tuple[str, str]], table: Mapping[str, Any]) -> str:
    return json.dumps([[name, _drop_newer_parts(name, table[key])] for name, key in columns])[1:-1]


def _list_newer_settings() -> dict[str, tuple[list[tuple[str, str, Any]], list[tuple[str, str, str, Any]]]]:
    """List the newer settings by topic as (name, key, value before), and the newer parts of the tables of its lists as
    (key, part, name, value before)."""
    found: dict[str, tuple[list[tuple[str, str, Any]], list[tuple[str, str, str, Any]]]] = {}
    for topic, s in list_all_settings():
        values, parts = found.setdefault(topic, ([], []))
        name = f"{topic}.{s.key}"
        if s.since and affects_pixels(s):
            values.append((name, s.key, s.old_value))
        parts += [(s.key, part.key, f"{name}.{part.key}", part.old_value) for part in s.entries if part.since]
    return {topic: both for topic, both in found.items() if any(both)}


def _find_newer(
    values: Sequence[tuple[str, str, Any]], parts: Sequence[tuple[str, str, str, Any]], table: Mapping[str, Any]
) -> list[Any]:
    """Find [name, value] of each newer setting of a topic's ``table`` whose value differs from its ``old_value``.
    ``values`` and ``parts`` are from ``_list_newer_settings``."""
    found = [[name, _drop_newer_parts(name, table[key])] for name, key, old in values if table[key] != old]
    return found + [
        [f"{name} {k}", entry[part]]
        for key, part, name, old in parts
        for k, entry in enumerate(table[key])
        if entry[part] != old
    ]


def find_value_in_id(name: str, settings: Mapping[str, Mapping[str, Any]]) -> Value:
    """Find the value of a setting (``topic.key``) that is hashed in a pair's id."""
    topic, _, key = find_present_name(name).partition(".")
    value = settings[topic][key]
    if (
        key == "relief"
        and value == "REAL"
        and (topic != "surface" or not describe_mesh_relief(_make_typed_settings(settings)))
    ):
        return "BUMP"  # real relief that is not in the mesh renders the same pixels, and had this name before
    return value


def _make_typed_settings(settings: Mapping[str, Mapping[str, Any]]) -> Settings:
    return settings if isinstance(settings, Settings) else typed(settings)


def _drop_newer_parts(name: str, value: Value) -> Value:
    """Return a value without the newer settings in the tables of a list."""
    topic, _, key = find_present_name(name).partition(".")
    keys = [setting.key for setting in TOPICS[topic][key].entries if not setting.since]
    return [{key: table[key] for key in keys} for table in value] if keys and isinstance(value, list) else value
