"""A panel for each topic of the settings, with sub-panels for settings that only some scenes need."""

from __future__ import annotations

import bpy

from ..operators import manual
from ..settings.table import LANDFORMS, TOPICS, Topic
from .fields import draw_sentence, draw_settings, find_fields
from .relevance import uses_landforms
from .sections import ADVANCED, ELSEWHERE, INSIDE, SECTIONS, Section, main_settings
from .sidebar import FIRST, LAST, Sidebar
from .topic_extras import AFTER, BEFORE


class _TopicPanel(Sidebar):
    """One topic of the settings, drawn from the table of settings."""

    bl_options = {"DEFAULT_CLOSED"}
    topic: Topic

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _is_topic_shown(cls.topic.key, context.scene.icymoon)

    def draw(self, context: bpy.types.Context) -> None:
        layout, key = self.layout, self.topic.key
        layout.active = key != "rock_surface" or context.scene.icymoon.rocks.own_surface
        if key in BEFORE:
            BEFORE[key](layout, context)
        draw_settings(layout, context.scene.icymoon, key, main_settings(key))
        if key in AFTER:
            AFTER[key](layout, context)


def _is_topic_shown(topic: str, root: object) -> bool:
    """Whether the present choices use a topic."""
    if topic == "mesh":
        return bool(root.source.kind == "PROCEDURAL")  # type: ignore[attr-defined]
    if topic == "hapke":
        used = [root.surface, *([root.rock_surface] if root.rocks.own_surface else [])]  # type: ignore[attr-defined]
        return any(surface.model == "HAPKE" for surface in used)
    if topic not in ("hills", "arm") and TOPICS[topic].parent != LANDFORMS:
        return True
    return bool(find_fields(root, topic, tuple(setting.key for setting in TOPICS[topic].settings)))


class _SectionPanel(Sidebar):
    """Some settings of a topic that only some scenes need."""

    bl_options = {"DEFAULT_CLOSED"}
    section: Section

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(find_fields(context.scene.icymoon, cls.section.topic, cls.section.settings))

    def draw(self, context: bpy.types.Context) -> None:
        root = context.scene.icymoon
        self.layout.active = self.section.topic != "rock_surface" or root.rocks.own_surface
        draw_settings(self.layout, root, self.section.topic, self.section.settings)


class ICYMOON_PT_landforms(Sidebar, bpy.types.Panel):
    """Landforms of icy ground. Each is off while its height, depth or coverage is 0"""

    bl_idname = "ICYMOON_PT_landforms"
    bl_label = LANDFORMS
    page = manual.page_of_topic("terrain")
    bl_options = {"DEFAULT_CLOSED"}
    bl_parent_id = "ICYMOON_PT_terrain"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return uses_landforms(context.scene.icymoon)

    def draw(self, context: bpy.types.Context) -> None:
        group = context.scene.icymoon
        shaping = [t.label for t in TOPICS.values() if t.parent == LANDFORMS
                   and getattr(getattr(group, t.key), t.settings[0].key) > 0]
        draw_sentence(self.layout, f"In use: {', '.join(shaping) or 'none'}. The first field of a landform "
                                   "turns it on; 0 is off.")


def _switch(topic: str, key: str) -> dict[str, object]:
    """A tick in a panel's header."""
    def draw_header(self: Sidebar, context: bpy.types.Context) -> None:
        self.layout.prop(getattr(context.scene.icymoon, topic), key, text="")
    return {"draw_header": draw_header}


def _make_topic_panel(topic: Topic, order: int) -> type:
    own: dict[str, object] = {}
    if topic.parent == LANDFORMS:
        own["bl_parent_id"] = ICYMOON_PT_landforms.bl_idname
    elif topic.key in INSIDE:
        own["bl_parent_id"] = f"ICYMOON_PT_{INSIDE[topic.key]}"
    if topic.key == "rock_surface":
        own |= _switch("rocks", ELSEWHERE["rocks"][0])
    return type(f"ICYMOON_PT_{topic.key}", (_TopicPanel, bpy.types.Panel), {
        "__doc__": topic.description, "bl_idname": f"ICYMOON_PT_{topic.key}", "bl_label": topic.label,
        "bl_order": order, "topic": topic, "page": manual.page_of_topic(topic.key), **own})


def _make_section_panel(section: Section, order: int) -> type:
    own = _switch(section.topic, section.switch) if section.switch else {}
    name = f"ICYMOON_PT_{section.topic}_{section.key}"
    return type(name, (_SectionPanel, bpy.types.Panel), {
        "__doc__": section.description, "bl_idname": name, "bl_label": section.label,
        "bl_order": LAST if section.key == ADVANCED else order,
        "bl_parent_id": f"ICYMOON_PT_{section.topic}", "section": section,
        "page": manual.page_of_topic(section.topic), **own})


#: Blender registers a panel after the one that it is in.
_PANELS = {topic.key: _make_topic_panel(topic, FIRST + k) for k, topic in enumerate(TOPICS.values())}
_TOPS = [key for key, topic in TOPICS.items() if not topic.parent and key not in INSIDE]
CLASSES = (*(_PANELS[key] for key in _TOPS), ICYMOON_PT_landforms,
           *(panel for key, panel in _PANELS.items() if key not in _TOPS),
           *(_make_section_panel(section, k) for k, section in enumerate(SECTIONS)))
