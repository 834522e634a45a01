"""Find Setting: show the settings and buttons that have the typed words, so that they can be used on the spot."""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ..operators.dialogs import SearchDialog
from ..operators.sidebar_text import describe_place, describe_value, measure_line_length, remember_answers
from ..settings.blender import scene_properties
from ..settings.find_settings import find_near_settings, find_settings
from ..settings.table import TOPICS, list_all_settings
from ..settings.topics.scene import Settings
from .fields import draw_field, draw_lines
from .sidebar_buttons import Button, draw_button, find_buttons

#: Property of the window manager for the typed words; it is not saved.
TYPED = "icymoon_sought"
#: Maximum numbers of drawn settings and buttons.
MAX_FOUND, MAX_BUTTONS = 12, 4
_POPUP_WIDTH_PX = 420
#: (name, text, tooltip) of all settings for Blender's search, which follows the typing. Blender keeps no copy of them.
_ITEMS = [
    (f"{topic}.{setting.key}", f"{setting.label}   {TOPICS[topic].brief or TOPICS[topic].label}", setting.description)
    for topic, setting in list_all_settings()
]


def explain_obstacle(topic: str, key: str, settings: Settings) -> str:
    """Explain why a setting has no effect with the present settings; empty if it has an effect."""
    deciding = TOPICS[topic].list_obstacles(key, settings)
    if deciding is None:
        return ""
    values = [describe_value(name, settings) for name in deciding]
    return f"Unused while {' and '.join(values)}" if values else f"Unused by {TOPICS[topic].label}"


@remember_answers
def sort_by_effect(typed: str, settings: Settings) -> list[tuple[str, str]]:
    """Sort the settings (topic, key) that have the typed words. Settings with an effect come first, then settings
    without, each in their order; settings with the words only in their description come last."""
    near = find_near_settings(typed)
    return sorted(
        find_settings(typed),
        key=lambda name: (name not in near, TOPICS[name[0]].list_obstacles(name[1], settings) is not None),
    )


def draw_search(layout: bpy.types.UILayout, context: bpy.types.Context) -> bool:
    """Draw the field for words to find, and return whether words are typed."""
    row = layout.row(align=True)
    row.prop(context.window_manager, TYPED, text="", icon="VIEWZOOM", placeholder="Find Setting or Button")
    return bool(getattr(context.window_manager, TYPED).strip())


def draw_found(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the settings and buttons that have the words of the search.

    Buttons with the words in their text or place are above the settings, and buttons with the words in the tooltip
    below. Settings without an effect are below settings that act.
    """
    root, typed = context.scene.icymoon, getattr(context.window_manager, TYPED)
    settings = scene_properties.read_for_display(root)
    found, buttons = sort_by_effect(typed, settings), find_buttons(typed)
    drawn = buttons[:MAX_BUTTONS]
    _draw_buttons(layout, [each.button for each in drawn if each.near])
    for topic, key in found[:MAX_FOUND]:
        layout.separator(factor=0.5)
        _draw_found(layout.column(align=True), root, topic, key, settings)
    _draw_buttons(layout, [each.button for each in drawn if not each.near])
    if not found and not buttons:
        draw_lines(layout, ("Nothing has these words",), "INFO")
    if more := max(0, len(found) - MAX_FOUND) + len(buttons) - len(drawn):
        draw_lines(layout, (f"{more} more; type another word",), "INFO")


def _draw_buttons(layout: bpy.types.UILayout, buttons: Sequence[Button]) -> None:
    for button in buttons:
        layout.separator(factor=0.5)
        draw_button(layout.column(align=True), button)


def _draw_found(
    layout: bpy.types.UILayout,
    root: bpy.types.PropertyGroup,
    topic: str,
    key: str,
    settings: Settings,
    typed_at_once: bool = False,
) -> None:
    """Draw a setting below the name of its panel, grey with the reason if it has no effect. In a popup,
    ``typed_at_once`` lets keys type into its field."""
    setting, reason = TOPICS[topic][key], explain_obstacle(topic, key, settings)
    place = describe_place(topic, setting).partition(" ▸ ")[0]
    whole = f"{place}   {topic}.{key}"
    layout.label(text=whole if len(whole) <= measure_line_length() else place)  # half a name would help nobody
    field = layout.row()
    field.enabled = not reason
    field.activate_init = typed_at_once
    if setting.kind == "list":
        field.label(text=f"{setting.label}: a list in its panel")
    else:
        draw_field(field, getattr(root, topic), setting)
    if reason:
        draw_lines(layout, (reason,), "INFO")


class ICYMOON_OT_find_setting(SearchDialog, bpy.types.Operator):
    """Find a setting by words of its label and its panel, and change it on the spot"""

    bl_idname = "icymoon.find_setting"
    bl_label = "Find Setting"
    bl_property = "setting"

    setting: bpy.props.EnumProperty(  # type: ignore[valid-type]
        items=_ITEMS, name="Setting", description="Setting to change", options={"SKIP_SAVE"}
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Search for a setting; if one is given, show its field."""
        if self.properties.is_property_set(self.bl_property):
            return set(context.window_manager.invoke_popup(self, width=_POPUP_WIDTH_PX))
        return SearchDialog.invoke(self, context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Show the field of the setting that was found."""
        if not bpy.app.background:
            bpy.ops.icymoon.find_setting("INVOKE_DEFAULT", setting=self.setting)
        return {"FINISHED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the field of the setting."""
        root, (topic, _, key) = context.scene.icymoon, self.setting.partition(".")
        settings = scene_properties.read_for_display(root)
        _draw_found(self.layout.column(align=True), root, topic, key, settings, typed_at_once=True)


CLASSES = (ICYMOON_OT_find_setting,)


def register() -> None:
    """Add the typed words to the window manager."""
    words = bpy.props.StringProperty(
        name="Find Setting",
        description="Words of the label, the name or the tooltip of a setting or a button",
        options={"SKIP_SAVE", "TEXTEDIT_UPDATE"},
    )
    setattr(bpy.types.WindowManager, TYPED, words)


def unregister() -> None:
    """Remove the typed words from the window manager."""
    delattr(bpy.types.WindowManager, TYPED)
