"""The list of settings of Vary This Scene: its operators, and the texts of its lines and values."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import bpy

from ..render.plans.vary_scene import (
    VariedSetting,
    check_varied,
    find_label,
    list_values,
    list_variable_settings,
    make_default_variation,
    why_fixed,
)
from ..settings.blender import scene_properties
from ..settings.table import TOPICS
from ..settings.topics.declaration import Setting
from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from .list_editing import EditedList, MoveEntry, RemoveEntry
from .operator_type import ExplainedOperator
from .sidebar_text import format_for_window

#: Maximum number of values of a setting that the panel shows.
_MAX_SHOWN_VALUES = 12
#: Maximum number of characters of a line of the list.
_LIST_LINE = 29
_UNIT_TEXTS = {"deg": "°", "1": ""}


def _find_setting(name: str) -> Setting:
    topic, _, key = name.partition(".")
    return TOPICS[topic][key]


def find_unit(name: str) -> str:
    """Return the unit of a setting as the sidebar shows it."""
    unit = _find_setting(name).unit
    return _UNIT_TEXTS.get(unit, unit)


#: (name, label, description) of the settings that can vary.
_SETTING_ITEMS = [
    (name, f"{TOPICS[name.partition('.')[0]].label} ▸ {find_label(name)}", _find_setting(name).description)
    for name in list_variable_settings()
]


def find_setting_of_button(context: bpy.types.Context) -> str:
    """Return the setting under the mouse when a context menu was opened; empty if it is not a setting of Icy Moon."""
    prop, group = getattr(context, "button_prop", None), getattr(context, "button_pointer", None)
    topic = type(group).__name__.removeprefix("ICYMOON_PG_")
    if prop is None or topic not in TOPICS or prop.identifier not in {s.key for s in TOPICS[topic].settings}:
        return ""
    return f"{topic}.{prop.identifier}"


def _list_choice_items(operator: bpy.types.Operator, _context: bpy.types.Context) -> list[tuple[str, str, str]]:
    """List the values of the choice that the dialog varies."""
    return list(_find_setting(operator.setting).choices) if operator.setting else []


#: The values of a number, as properties of a dialog.
_ValueFields: Any = type(
    "_ValueFields", (), {"__annotations__": scene_properties.make_varied_fields(options={"SKIP_SAVE"})}
)


class ICYMOON_OT_vary(_ValueFields, ExplainedOperator, bpy.types.Operator):
    """Vary a setting of this scene: render a pair for each value and see how the error depends on it"""

    bl_idname = "icymoon.vary"
    bl_label = "Vary"
    bl_options = {"REGISTER", "UNDO"}
    bl_property = "setting"

    setting: bpy.props.EnumProperty(
        items=_SETTING_ITEMS,
        name="Setting",
        options={"SKIP_SAVE"},
        description="Setting that varies",
    )
    values: bpy.props.EnumProperty(
        items=_list_choice_items,
        name="Values",
        options={"ENUM_FLAG", "SKIP_SAVE"},
        description="The values of a choice",
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Return the tooltip, with the description of the setting if one is given."""
        if not properties.is_property_set("setting"):
            return str(cls.__doc__)
        return (
            f"Vary {find_label(properties.setting)}: render a pair for each value and see how the error depends on "
            f"it. {_find_setting(properties.setting).description}"
        )

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        name = find_setting_of_button(context)
        why = why_fixed(*name.split(".")) if name else ""
        return format_for_window(f"{name} {why}.") if why else ""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.properties.is_property_set("setting"):
            context.window_manager.invoke_search_popup(self)
            return {"INTERFACE"}  # as Blender's own searches; a running operator would never be freed
        self._complete(context.scene.icymoon)
        return set(context.window_manager.invoke_props_dialog(self, title=f"Vary {find_label(self.setting)}"))

    def execute(self, context: bpy.types.Context) -> set[str]:
        root = context.scene.icymoon
        self._complete(root)
        varied = scene_properties.read_varied(
            self,
            self.setting,
            tuple(choice[0] for choice in _find_setting(self.setting).choices if choice[0] in self.values),
        )
        try:
            check_varied(varied)
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        scene_properties.write_varied(root, varied)
        self.report(
            {"INFO"}, f"{find_label(self.setting)} varies; Data Set ▸ Vary This Scene ▸ Render These Variations is next"
        )
        return {"FINISHED"}

    def draw(self, context: bpy.types.Context) -> None:
        draw_values(self.layout, self, self.setting)
        if _find_setting(self.setting).choices:
            self.layout.column().prop(self, "values")

    def _complete(self, root: bpy.types.PropertyGroup) -> None:
        """Fill in the fields that the caller did not set: from the list, else with values around the present value."""
        there = next(
            (each for each in scene_properties.read_variations(root).varied if each.name == self.setting), None
        )
        topic, _, key = self.setting.partition(".")
        value = scene_properties.read_unchecked(root)[topic][key]
        wanted = there or make_default_variation(self.setting, value)
        whole = "_whole" if _find_setting(self.setting).kind == "int" else ""
        stated = {
            f"first{whole}": wanted.first,
            f"last{whole}": wanted.last,
            "count": wanted.count,
            "spacing": wanted.spacing,
            "values": set(wanted.values),
        }
        for name, each in stated.items():
            if not self.properties.is_property_set(name) and (name != "values" or each):
                setattr(self, name, each)


def draw_values(layout: bpy.types.UILayout, fields: bpy.types.bpy_struct, name: str) -> None:
    """Draw the ends, the number and the spacing of a varied number; for a tick, a sentence."""
    setting, unit = _find_setting(name), find_unit(name)
    if setting.kind == "bool":
        layout.label(text="Off and on", icon="CHECKBOX_HLT")
    if setting.kind not in ("int", "float"):
        return
    column = layout.column(align=True)
    for end, label in (("first", "From"), ("last", "To")):
        shown = (
            f"{end}_whole" if setting.kind == "int" else scene_properties.shown_property_name(end, setting.precision)
        )
        column.prop(fields, shown, text=f"{label} ({unit})" if unit else label)
    column.prop(fields, "count")
    layout.prop(fields, "spacing", text="")


@lru_cache(maxsize=256)
def describe_varied(varied: VariedSetting) -> str:
    """Describe a varied setting and its values in a line of the list."""
    try:
        setting = check_varied(varied)
    except IcyMoonError:
        return find_label(varied.name)[:40]
    if setting.kind in ("bool", "choice"):
        labels = setting.choice_labels
        title = f"{find_label(varied.name)}: {', '.join(labels[v] for v in varied.values) if labels else 'off, on'}"
        short = f"{find_label(varied.name)}: {format_count(len(varied.values), 'value')}"
        return title if len(title) <= _LIST_LINE else short
    count = len(list_values(varied)) if varied.spacing != "RANDOM" else varied.count
    unit = find_unit(varied.name)
    return (
        f"{find_label(varied.name)}: {varied.first:.4g} to {varied.last:.4g}"
        f"{unit if unit == '°' else f' {unit}' if unit else ''}, {count} {'random' * (varied.spacing == 'RANDOM')}"
    ).rstrip()


@lru_cache(maxsize=256)
def describe_values(varied: VariedSetting) -> str:
    """List the values of a number that does not vary at random, up to the number of values that the panel shows; else
    empty."""
    try:
        if check_varied(varied).kind not in ("int", "float") or varied.spacing == "RANDOM":
            return ""
    except IcyMoonError:
        return ""
    values = [f"{value:.5g}" for value in list_values(varied)]
    return ", ".join(
        values if len(values) <= _MAX_SHOWN_VALUES else [*values[: _MAX_SHOWN_VALUES - 1], "…", values[-1]]
    )


class _VariationOperator:
    """Mix-in: an operator on the list of settings that vary."""

    empty = "Nothing varies yet; press Add Setting"

    @staticmethod
    def find(scene: bpy.types.Scene) -> EditedList:
        return EditedList(scene.icymoon.variations, "varied", "active", "run")


class ICYMOON_OT_variation_remove(_VariationOperator, RemoveEntry, bpy.types.Operator):
    """Remove the selected setting from the list; the setting itself stays as it is"""

    bl_idname = "icymoon.variation_remove"
    bl_label = "Remove Varied Setting"


class ICYMOON_OT_variation_move(_VariationOperator, MoveEntry, bpy.types.Operator):
    """Move the selected setting in the list; the last setting changes fastest from pair to pair"""

    bl_idname = "icymoon.variation_move"
    bl_label = "Move Varied Setting"

    direction: bpy.props.EnumProperty(
        name="Direction",
        description="Direction of the move",
        items=(("UP", "Up", "Toward the first"), ("DOWN", "Down", "Toward the last")),
    )


CLASSES = (ICYMOON_OT_vary, ICYMOON_OT_variation_remove, ICYMOON_OT_variation_move)
