"""A panel for each topic of the settings, with sub-panels for settings that only some scenes need."""

from __future__ import annotations

import bpy

from ..operators import manual
from ..settings.table import TOPICS
from ..settings.topics.declaration import ADVANCED, LANDFORMS, Section, Topic
from ..settings.topics.ground import ABOVE_A_MAP
from .fields import draw_sentence, draw_settings, find_fields
from .sidebar import FIRST, LAST, Sidebar
from .topic_extras import AFTER, BEFORE, IN_SECTION

#: Kind of the presets that set a topic, for the menu in the header of the topic's panel.
_PRESETS = {
    "terrain": "terrains",
    "surface": "surfaces",
    "rocks": "rocks",
    "light": "lights",
    "rig": "rigs",
    "sensor": "sensors",
    "quality": "qualities",
}


class _TopicPanel(Sidebar):
    """A panel for a topic of the settings, drawn from the table of settings."""

    bl_options = {"DEFAULT_CLOSED"}
    topic: Topic

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the panel, or a panel inside it, has a field."""
        inside = (topic for topic in TOPICS.values() if topic.inside == cls.topic.key)
        return any(
            find_fields(context.scene.icymoon, topic.key, tuple(s.key for s in topic.settings))
            for topic in (cls.topic, *inside)
        )

    def draw(self, context: bpy.types.Context) -> None:
        layout, key = self.layout, self.topic.key
        if key in BEFORE:
            BEFORE[key](layout, context)
        draw_settings(layout, context.scene.icymoon, key, self.topic.main_keys)
        if key in AFTER:
            AFTER[key](layout, context)


class _SectionPanel(Sidebar):
    """A sub-panel for settings of a topic that only some scenes need."""

    bl_options = {"DEFAULT_CLOSED"}
    topic: Topic
    section: Section

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(find_fields(context.scene.icymoon, cls.topic.key, cls.topic.keys_in(cls.section)))

    def draw(self, context: bpy.types.Context) -> None:
        root = context.scene.icymoon
        if extra := IN_SECTION.get((self.topic.key, self.section.key)):
            extra(self.layout, context)
        draw_settings(self.layout, root, self.topic.key, self.topic.keys_in(self.section))


class ICYMOON_PT_landforms(Sidebar, bpy.types.Panel):
    """Landforms of icy ground. Each is off while its height, depth or coverage is 0"""

    bl_idname = "ICYMOON_PT_landforms"
    bl_label = LANDFORMS
    page = manual.find_page_of_topic("terrain")
    bl_options = {"DEFAULT_CLOSED"}
    bl_parent_id = "ICYMOON_PT_terrain"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return ABOVE_A_MAP(context.scene.icymoon, "terrain")

    def draw(self, context: bpy.types.Context) -> None:
        group = context.scene.icymoon
        shaping = [
            t.label
            for t in TOPICS.values()
            if t.parent == LANDFORMS and getattr(getattr(group, t.key), t.settings[0].key) > 0
        ]
        draw_sentence(
            self.layout, f"In use: {', '.join(shaping) or 'none'}. The first field of a landform turns it on; 0 is off."
        )


def _make_switch(topic: str, key: str) -> dict[str, object]:
    """Make the method that draws a tick in a panel's header."""

    def draw_header(self: Sidebar, context: bpy.types.Context) -> None:
        self.layout.prop(getattr(context.scene.icymoon, topic), key, text="")

    return {"draw_header": draw_header}


def _make_topic_panel(topic: Topic, order: int) -> type:
    own: dict[str, object] = {}
    if topic.parent == LANDFORMS:
        own["bl_parent_id"] = ICYMOON_PT_landforms.bl_idname
    elif topic.inside:
        own["bl_parent_id"] = f"ICYMOON_PT_{topic.inside}"
    if topic.key == "rock_surface":
        own |= _make_switch("rocks", "own_surface")
    return type(
        f"ICYMOON_PT_{topic.key}",
        (_TopicPanel, bpy.types.Panel),
        {
            "__doc__": topic.description,
            "bl_idname": f"ICYMOON_PT_{topic.key}",
            "bl_label": topic.label,
            "bl_order": order,
            "topic": topic,
            "page": manual.find_page_of_topic(topic.key),
            "preset_kind": _PRESETS.get(topic.key, ""),
            **own,
        },
    )


def _make_section_panel(topic: Topic, section: Section, order: int) -> type:
    own = _make_switch(topic.key, section.switch) if section.switch else {}
    name = f"ICYMOON_PT_{topic.key}_{section.key}"
    # Blender does not indent the content of a sub-panel, so the label names its topic.
    label = f"{section.label} {topic.brief or topic.label}" if section == ADVANCED else section.label
    return type(
        name,
        (_SectionPanel, bpy.types.Panel),
        {
            "__doc__": section.description,
            "bl_idname": name,
            "bl_label": label,
            "bl_order": LAST if section == ADVANCED else order,
            "bl_parent_id": f"ICYMOON_PT_{topic.key}",
            "topic": topic,
            "section": section,
            "page": manual.find_page_of_topic(topic.key),
            **own,
        },
    )


#: Blender registers a panel after its parent panel.
_PANEL_BY_TOPIC = {topic.key: _make_topic_panel(topic, FIRST + k) for k, topic in enumerate(TOPICS.values())}
_TOP_TOPICS = [key for key, topic in TOPICS.items() if not topic.parent and not topic.inside]
CLASSES = (
    *(_PANEL_BY_TOPIC[key] for key in _TOP_TOPICS),
    ICYMOON_PT_landforms,
    *(panel for key, panel in _PANEL_BY_TOPIC.items() if key not in _TOP_TOPICS),
    *(_make_section_panel(topic, section, k) for topic in TOPICS.values() for k, section in enumerate(topic.sections)),
)
