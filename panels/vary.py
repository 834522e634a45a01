"""Vary This Scene: the list of varied settings, the pairs that they make, and their time."""

from __future__ import annotations

import bpy

from ..operators import (
    dataset,
    export_pairs,
    last_variations,
    render_variations,
    show_pair,
    variation_curves,
    variation_pictures,
    variation_plan,
    varied_settings,
)
from ..render.plans.vary_scene import find_label, list_variable_settings
from ..settings.blender import scene_properties
from ..settings.table import TOPICS
from .fields import RowsOfText, draw_list, draw_sentence, draw_settings, draw_start
from .sidebar import Sidebar

_VARIABLE_SETTINGS = frozenset(list_variable_settings())
#: Maximum number of curves with a button; the report shows all curves.
_MAX_CURVES = 6


class ICYMOON_UL_variations(RowsOfText, bpy.types.UIList):
    """The settings that vary, one per line"""

    bl_idname = "ICYMOON_UL_variations"

    symbol = "DRIVER_DISTANCE"

    @staticmethod
    def describe(item: bpy.types.PropertyGroup) -> str:
        return varied_settings.describe_varied(scene_properties.read_item(item))


class ICYMOON_PT_vary(Sidebar, bpy.types.Panel):
    """Vary settings of this scene: render a pair for each value and see how the error depends on it"""

    bl_idname = "ICYMOON_PT_vary"
    bl_label = "Vary This Scene"
    page = "datasets#vary-this-scene"
    bl_parent_id = "ICYMOON_PT_dataset"
    bl_order = 0

    def draw(self, context: bpy.types.Context) -> None:
        layout, root = self.layout, context.scene.icymoon
        group = root.variations
        add, verb = "icymoon.vary", "icymoon.variation"
        draw_list(layout, "ICYMOON_UL_variations", group, "varied", "active", add=add, verb=verb)
        if group.active < len(group.varied):
            _draw_varied(layout, root, group.varied[group.active])
        elif not group.varied:
            draw_sentence(
                layout,
                "Right-click a setting and choose Vary, or press +. For 100 grounds of this kind, "
                "set Variations by Seed to 100.",
                "INFO",
            )
        if len(group.varied) > 1 or group.combine != "GRID":
            layout.prop(group, "combine", text="")
        if group.combine == "SOBOL":
            layout.prop(group, "draws")
        layout.prop(group, "seeds")
        _draw_render(layout, context)
        _draw_pictures(layout, context.scene)
        _draw_curves(layout, context.scene)


def _draw_render(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the number of pairs, time and size of the variations, and the buttons that render them and save their
    plan."""
    root = context.scene.icymoon
    total, *cost = render_variations.list_lines(context.scene)
    draw_sentence(layout, total, "RENDER_RESULT" if cost else "ERROR")
    for line in cost:
        draw_sentence(layout, line, "TIME")
    if why := variation_plan.why_not_a_plan(context.scene):
        draw_sentence(layout, why, "ERROR")
    if cost and not variation_pictures.draw_icons(layout, context.scene):
        draw_start(layout, "icymoon.show_ends", "Show First and Last", "IMAGE_REFERENCE")
    draw_settings(layout, root, "dataset", ("evaluate",))
    column = layout.column(align=True)
    column.operator_context = "INVOKE_DEFAULT"
    large = column.row()
    large.scale_y = 1.4
    draw_start(large, "icymoon.render_variations", "Render These Variations", "RENDER_ANIMATION", folder="")
    column.operator("icymoon.save_plan", text="Save Plan…", icon="FILE_TICK")
    for line in dataset.readout["set_aside"][-3:]:
        draw_sentence(layout, f"Set aside: {line}")


def _draw_pictures(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Draw buttons that show the first and the last pair of the variations rendered last, and evaluate all of them."""
    pairs, listed = last_variations.find_pairs(scene), show_pair.find_pairs_to_show(scene)
    row = layout.row(align=True) if pairs else layout
    for text, pair in zip(("First Pair", "Last Pair"), (*pairs[:1], *pairs[1:][-1:]), strict=False):
        row.operator("icymoon.show_pair", text=text, icon="IMAGE_DATA").number = 1 + listed.index(pair)
    if last_variations.SCOPE in export_pairs.find_sources(scene):
        scope = last_variations.SCOPE
        draw_start(layout, "icymoon.evaluate", "Evaluate These Variations", "VIEWZOOM", scope=scope)


def _draw_varied(layout: bpy.types.UILayout, root: bpy.types.PropertyGroup, item: bpy.types.PropertyGroup) -> None:
    """Draw the values of the selected setting, and a warning if it has no effect."""
    if item.setting not in _VARIABLE_SETTINGS:
        draw_sentence(layout, "This setting cannot vary; remove it.", "ERROR")
        return
    topic, _, key = item.setting.partition(".")
    draw_sentence(layout, f"{TOPICS[topic].label} ▸ {find_label(item.setting)}")
    varied_settings.draw_values(layout, item, item.setting)
    if root.variations.combine != "SOBOL" and (
        values := varied_settings.describe_values(scene_properties.read_item(item))
    ):
        draw_sentence(layout, values)
    labels = TOPICS[topic][key].choice_labels
    column = layout.column(align=True)
    for tick in item.ticks:
        column.prop(tick, "on", text=labels.get(tick.name, tick.name), toggle=True)
    if not (TOPICS[topic].is_shown(key, root) and TOPICS[topic].has_effect(key, root)):
        draw_sentence(layout, "It has no effect with the present settings.", "ERROR")


def _draw_curves(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Draw a button for each picture of the error against a setting."""
    found = list(variation_curves.sort_curves(scene))
    if not found:
        return
    column = layout.column(align=True)
    for name in found[:_MAX_CURVES]:
        column.operator("icymoon.show_curve", text=variation_curves.describe_curve(name), icon="FCURVE").setting = name
    column.operator("icymoon.open_report", icon="URL")


def _draw_context_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Draw Vary… in the context menu of a setting."""
    name = varied_settings.find_setting_of_button(context)
    if not name:
        return
    self.layout.separator()
    self.layout.operator_context = "INVOKE_DEFAULT"
    button = self.layout.operator("icymoon.vary", text="Vary…", icon="DRIVER_DISTANCE")
    if name in _VARIABLE_SETTINGS:
        button.setting = name


CLASSES = (ICYMOON_UL_variations, ICYMOON_PT_vary)


def register() -> None:
    """Add Vary… to the context menu of settings."""
    bpy.types.UI_MT_button_context_menu.append(_draw_context_menu)


def unregister() -> None:
    """Remove Vary… from the context menu of settings."""
    bpy.types.UI_MT_button_context_menu.remove(_draw_context_menu)
