"""The settings from which ids of pairs are made. No later version may change the id of a pair.

``pair_ids.json`` contains the settings of the first version under ``counted``. This list is closed, and an id is made
from these settings in this order. A newer setting is under ``later``, with the value that has the effect of versions
without it. It counts only if it differs from that value. Renamed settings are under ``renamed`` (old name, new name),
and removed ones under ``gone``, with the value that later versions imply. ``entries`` are the settings of each table of
a list. Imports no Blender.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ..typed_settings import typed
from .changes import relief_in_mesh
from .landform_releases import counted_landforms
from .table import Setting, all_settings

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
    return make_counter()(settings)


def make_counter() -> Callable[[Mapping[str, Mapping[str, Any]]], list[Any]]:
    """``counted`` for many descriptions: which settings count is looked up once for all of them."""
    columns = [(name, *present_name(name).split(".", 1)) for name in SCHEMA["counted"]]
    special = {name for name, topic, key in columns if name in SCHEMA["gone"] or key == "relief"}
    newer = [(f"{topic}.{s.key}", topic, s) for topic, s in all_settings() if f"{topic}.{s.key}" in SCHEMA["later"]]
    later = [(name, topic, s.key, before(name, s)) for name, topic, s in newer if counts(s)]
    lists = [(topic, s.key, part.key, name, before(name, part)) for topic, s in all_settings() for part in s.entries
             if (name := f"{topic}.{s.key}.{part.key}") in SCHEMA["later"]]

    def count(settings: Mapping[str, Mapping[str, Any]]) -> list[Any]:
        first = [[name, _plain(name, value_in_id(name, settings) if name in special else settings[topic][key])]
                 for name, topic, key in columns]
        found = [[name, _plain(name, settings[topic][key])] for name, topic, key, old in later
                 if settings[topic][key] != old]
        found += [[f"{name} {k}", entry[part]] for topic, key, part, name, old in lists
                  for k, entry in enumerate(settings[topic][key]) if entry[part] != old]
        found += counted_landforms(settings)
        return [first, sorted(found)] if found else [first]

    return count


def value_in_id(name: str, settings: Mapping[str, Mapping[str, Any]]) -> Any:
    """The value of a setting (``topic.key``) from which a pair's id is made."""
    topic, _, key = present_name(name).partition(".")
    value = settings[topic].get(key, SCHEMA["gone"][name]) if name in SCHEMA["gone"] else settings[topic][key]
    if key == "relief" and value == "REAL" and (topic != "surface" or not relief_in_mesh(typed(settings))):
        return "BUMP"  # real relief that is not in the mesh renders the same pixels, and was called so before
    return value


def _plain(name: str, value: Any) -> Any:
    """A value without newer settings in the tables of a list."""
    keys = SCHEMA["entries"].get(name)
    return value if keys is None else [{key: entry[key] for key in keys} for entry in value]
