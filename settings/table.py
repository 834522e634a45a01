"""The table of settings: all topics, ours and the topics of plug-ins.

Blender's property groups (``Scene.icymoon``), the keys of presets and TOML files, ``--set topic.key=value``, the
sidebar, the documentation and the provenance in ``pair.json`` are all made from ``TOPICS``. ``topics/`` declares ours.
"""

from __future__ import annotations

from typing import Any

from ..plugins.landforms import RELEASE, PluginLandform, load_landform_plugins
from .topics.declaration import LANDFORMS, Setting, Topic
from .topics.ground import ABOVE_A_MAP
from .topics.scene import OUR_TOPICS, Settings


def _make_topic(landform: PluginLandform) -> Topic:
    """Make the topic of a plug-in's landform: its numbers, and the release that made it."""
    settings = []
    for n in landform.settings:
        label = f"{n.label} (°)" if n.unit == "deg" else n.label
        kind: dict[str, Any] = (
            {"subtype": "DISTANCE", "precision": 4} if n.unit == "m" else {"precision": 2} if n.unit == "deg" else {}
        )
        settings.append(
            Setting(
                key=n.key,
                label=label,
                default=n.default,
                description=n.doc,
                effect="geometry",
                unit=n.unit,
                minimum=n.minimum,
                maximum=n.maximum,
                **kind,
            )
        )
    settings.append(
        Setting(
            key=RELEASE,
            label="Made By",
            default="",
            effect="geometry",
            trust="name",
            description="Package and version that make the landform. Empty for the installed one",
        )
    )
    return Topic(
        landform.topic,
        landform.label,
        landform.doc,
        tuple(settings),
        LANDFORMS,
        shown=ABOVE_A_MAP,
        turned_on_by=landform.settings[0].key,
        plugin=landform.plugin.release,
    )


TOPICS: dict[str, Topic] = OUR_TOPICS | {
    landform.topic: _make_topic(landform) for landform in load_landform_plugins()[0].values()
}


def list_all_settings() -> list[tuple[str, Setting]]:
    """List (topic key, setting) of all settings in the order of the sidebar."""
    return [(topic.key, setting) for topic in TOPICS.values() for setting in topic.settings]


def list_differing_settings(one: Settings, other: Settings) -> list[tuple[str, Setting]]:
    """List (topic, setting) of the settings that differ, without those that ``one`` lacks; ``other`` is complete."""
    return [
        (topic, s)
        for topic, s in list_all_settings()
        if s.key in one.get(topic, {}) and one[topic][s.key] != other[topic][s.key]
    ]


def list_ground_settings() -> dict[str, tuple[str, str]]:
    """List the settings (topic, key) of a patch of ground by a keyword: the seed, each number of the terrain, and all
    of its landforms.

    The radius of the body is left out, because a patch is flat.
    """
    ground = {
        s.key: ("terrain", s.key)
        for s in TOPICS["terrain"].settings
        if s.kind in ("int", "float") and s.key != "body_radius_m"
    }
    return {
        **ground,
        "seed": ("dataset", "seed"),
        **{
            f"{topic.key}_{s.key}": (topic.key, s.key)
            for topic in TOPICS.values()
            if topic.parent == LANDFORMS
            for s in topic.settings
            if s.kind != "text"
        },
    }
