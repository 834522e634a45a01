"""What pairs are named by, for ever: a later version gives no pair another id, whatever settings it adds.

``pair_ids.json`` holds the list of settings that the first version had, which is not changed any more; an id is made of
those, in that order. A setting that came later stands under ``later`` with the value that does what was done before
there was it; it counts only where it differs from that. What is called otherwise today stands under ``renamed`` (old
name, new name), what there is no more under ``gone`` with the value that all versions since act by. ``entries`` are the
settings of each table of a list. Imports no Blender.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .table import Setting, all_settings

SCHEMA: dict[str, Any] = json.loads(
    Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))


def before(name: str, setting: Setting) -> Any:
    """The value of the setting of this name that means what was done before there was it; its default if it was there
    from the first version on."""
    return SCHEMA["later"].get(name, setting.default)


def present_name(name: str) -> str:
    """What a setting (``topic.key``) is called today."""
    return str(SCHEMA["renamed"].get(name, name))


def counts(setting: Setting) -> bool:
    """Whether a setting can change a rendered pixel; where a file lies cannot."""
    return setting.effect not in ("response", "run") and setting.subtype != "FILE_PATH"


def counted(settings: Mapping[str, Mapping[str, Any]]) -> list[Any]:
    """What a pair's id is made of, of complete settings: the first version's list, and what differs from what was done
    before there was a setting for it, if anything does."""
    first = [[name, _plain(name, _value(name, settings))] for name in SCHEMA["counted"]]
    later = sorted(_later(settings))
    return [first, later] if later else [first]


def _value(name: str, settings: Mapping[str, Mapping[str, Any]]) -> Any:
    topic, _, key = present_name(name).partition(".")
    return settings[topic].get(key, SCHEMA["gone"][name]) if name in SCHEMA["gone"] else settings[topic][key]


def _plain(name: str, value: Any) -> Any:
    """A value without what was added to the tables of a list."""
    keys = SCHEMA["entries"].get(name)
    return value if keys is None else [{key: entry[key] for key in keys} for entry in value]


def _later(settings: Mapping[str, Mapping[str, Any]]) -> list[list[Any]]:
    """[name, value] of what came later and is not as before; of tables of a list, name and number of the table."""
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
