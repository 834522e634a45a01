"""Find Setting: a field in which words are typed, and the settings that have them, to be changed on the spot."""

from __future__ import annotations

import bpy

from ..operators.sidebar_text import describe_place
from ..settings.blender import scene_properties
from ..settings.find_settings import find_settings
from ..settings.table import TOPICS
from ..settings.topics.scene import Settings
from .fields import draw_field, draw_lines

#: Property of the window manager, which is not saved: the typed words.
TYPED = "icymoon_sought"
#: Most settings that are drawn.
MOST_FOUND = 12
_POPUP_WIDTH_PX = 420


def explain_obstacle(topic: str, key: str, settings: Settings) -> str:
    """Why a setting has no effect with the present settings; empty if it has."""
    deciding = TOPICS[topic].list_obstacles(key, settings)
    if deciding is None:
        return ""
    values = []
    for name in deciding:
        of, _, other = name.partition(".")
        setting, value = TOPICS[of][other], settings[of][other]
        choices = {choice: label for choice, label, _ in setting.choices}
        text = choices.get(value, "off" if value is False else "on" if value is True else f"{value or 'empty'}")
        values.append(f"{describe_place(of, setting)} is {'0' if value == 0 and value is not False else text}")
    return f"Unused while {' and '.join(values)}" if values else "Unused with the present settings"


def draw_search(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the field for words, and the settings that have them."""
    row, typed = layout.row(align=True), getattr(context.window_manager, TYPED)
    row.prop(context.window_manager, TYPED, text="", icon="VIEWZOOM", placeholder="Find Setting")
    if not typed.strip():
        return
    found, root = find_settings(typed), context.scene.icymoon
    settings = scene_properties.read_for_display(root)
    for topic, key in found[:MOST_FOUND]:
        _draw_found(layout.box().column(align=True), root, topic, key, settings)
    if not found:
        draw_lines(layout, ("No setting has these words",), "INFO")
    if len(found) > MOST_FOUND:
        draw_lines(layout, (f"{len(found) - MOST_FOUND} more; type another word",), "INFO")


def _draw_found(
    layout: bpy.types.UILayout, root: bpy.types.PropertyGroup, topic: str, key: str, settings: Settings
) -> None:
    """Draw a setting below the name of its panel, grey with the reason where it has no effect."""
    setting, reason = TOPICS[topic][key], explain_obstacle(topic, key, settings)
    place = layout.row()
    place.active = False
    place.label(text=f"{describe_place(topic, setting).partition(' ▸ ')[0]}   {topic}.{key}")
    field = layout.row()
    field.enabled = not reason
    if setting.kind == "list":
        field.label(text=f"{setting.label}: a list in its panel")
    else:
        draw_field(field, getattr(root, topic), setting)
    if reason:
        draw_lines(layout, (reason,), "INFO")


class ICYMOON_OT_find_setting(bpy.types.Operator):
    """Find settings by words of their labels, names and tooltips, and change them on the spot"""

    bl_idname = "icymoon.find_setting"
    bl_label = "Find Setting"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return set(context.window_manager.invoke_popup(self, width=_POPUP_WIDTH_PX))

    def execute(self, context: bpy.types.Context) -> set[str]:
        return {"FINISHED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the field and what it finds."""
        draw_search(self.layout, context)


CLASSES = (ICYMOON_OT_find_setting,)


def register() -> None:
    """Add the typed words to the window manager."""
    words = bpy.props.StringProperty(
        name="Find Setting",
        description="Words of the label, the name or the tooltip of a setting",
        options={"SKIP_SAVE", "TEXTEDIT_UPDATE"},
    )
    setattr(bpy.types.WindowManager, TYPED, words)


def unregister() -> None:
    """Remove them."""
    delattr(bpy.types.WindowManager, TYPED)
