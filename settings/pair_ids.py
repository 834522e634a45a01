"""The settings from which ids of pairs are made. No later version may change the id of a pair.

``pair_ids.json`` contains the settings of the first version under ``counted``. This list is closed, and an id is made
from these settings in this order. A newer setting is under ``later``, with the value that has the effect of versions
without it. It counts only if it differs from that value. Renamed settings are under ``renamed`` (old name, new name),
and removed ones under ``gone``, with the value that later versions imply. ``entries`` are the settings of each table of
a list. Imports no Blender.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..typed_settings import typed
from .changes import relief_in_mesh
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
    first = [[name, _plain(name, value_in_id(name, settings))] for name in SCHEMA["counted"]]
    later = sorted(_later(settings))
    return [first, later] if later else [first]


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


def _later(settings: Mapping[str, Mapping[str, Any]]) -> list[list[Any]]:
    """[name, value] of each newer setting that differs from ``before``; names in lists include the table's number."""
    found = []
    for topic, setting in all_settings():
        name, value = f"{topic}.{setting.key}", settings[topic][setting.key]
        if name in SCHEMA["later"] and counts(setting) and value != before(name, setting):
            found.append([name, _plain(name, value)])
        for part in setting.entries:
            key = f"{name}.{part.key}"
            found += [[f"{key} {k}", entry[part.key]] for k, entry in enumerate(value)
                      if key in SCHEMA["later"] and entry[part.key] != before(key, part)]
    return found
