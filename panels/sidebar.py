"""The sidebar, top to bottom as the work goes: describe, build, render, evaluate. No logic here."""

from __future__ import annotations

from typing import Any

import bpy

from .. import settings as description
from ..nodes import scene as scenes
from ..operators import ground, jobs, layers, live, results
from ..physics import principled
from ..properties import LANDFORMS, TOPICS, Setting, Topic


class _Sidebar:
    """Where every panel of Icy Moon is."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Icy Moon"
    layout: Any


def _draw_job(layout: Any) -> None:
    job = jobs.current
    if job is None:
        return
    text, percent, left = job.shown
    column = layout.column(align=True)
    column.progress(factor=percent / 100, text=f"{text}  {percent} %")
    row = column.row(align=True)
    row.label(text=left or "Starting")
    row.operator("icymoon.cancel", icon="X")


class ICYMOON_PT_main(_Sidebar, bpy.types.Panel):
    """Preset, and the three steps from nothing to a measured stereo error"""

    bl_idname = "ICYMOON_PT_main"
    bl_label = "Icy Moon"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        group = context.scene.icymoon
        title = description.preset_header(group.preset)[0] if group.preset else "Choose a Preset"
        layout.menu("ICYMOON_MT_presets", text=title, icon="PRESET")
        column = layout.column(align=True)
        column.scale_y = 1.4
        column.operator("icymoon.build_scene", icon="RNDCURVE")
        column.operator("icymoon.render_pair", icon="RENDER_STILL")
        column.operator("icymoon.evaluate", icon="VIEWZOOM").scope = "SCENE"
        layout.prop(group, "live")
        notes = layout.column(align=True)
        for k, line in enumerate(live.lines(context.scene)):
            notes.label(text=line, icon="BLANK1" if k else "INFO")
        _draw_job(layout)


class ICYMOON_PT_results(_Sidebar, bpy.types.Panel):
    """Metrics of the last evaluation, mean over its pairs"""

    bl_idname = "ICYMOON_PT_results"
    bl_label = "Stereo Error"
    bl_parent_id = "ICYMOON_PT_main"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(results.summary())

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        rows = results.summary()
        grid = layout.grid_flow(row_major=True, columns=len(rows) + 1, even_columns=True, align=True)
        grid.label(text="")
        for row in rows:
            grid.label(text=row["method"])
        lines = (("L1", lambda r: f"{results.number(r['l1_m'], 3)} m"),
                 ("L1 > 10 cm", lambda r: results.percent(r["l1_rate_10"])),
                 ("si-RMSE", lambda r: results.number(r["si_rmse"], 4)),
                 ("DOD", lambda r: results.percent(r["dod"])),
                 ("Coverage", lambda r: results.percent(r["coverage"])))
        for label, text in lines:
            grid.label(text=label)
            for row in rows:
                grid.label(text=text(row))
        buttons = layout.row(align=True)
        buttons.operator("icymoon.open_report", icon="URL")
        buttons.operator("icymoon.show_error", text="Error Image", icon="IMAGE_DATA")
        surfaces = layout.row(align=True)
        for method in results.methods_with_points():
            surfaces.operator("icymoon.show_surface", text=f"Surface {method}", icon="MESH_GRID").method = method
        surfaces.operator("icymoon.hide_surface", text="" if results.methods_with_points() else "Remove Surface",
                          icon="X")


class _TopicPanel(_Sidebar):
    """One topic of the settings, drawn from the table of settings."""

    bl_options = {"DEFAULT_CLOSED"}
    topic: Topic

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        if self.topic.key == "source":
            layout.operator("icymoon.import_ground", text="Import Ground…", icon="IMPORT")
        if self.topic.key == "terrain":
            layout.prop(context.scene.icymoon.dataset, "seed")
        if self.topic.key == "rock_surface":
            layout.enabled = context.scene.icymoon.rocks.own_surface
        group = getattr(context.scene.icymoon, self.topic.key)
        source = context.scene.icymoon.source
        for setting in self.topic.settings:
            row = layout.row()
            row.enabled = _matters(self.topic.key, setting.key, group) and _source_asks(
                source, self.topic.key, setting.key)
            if setting.kind == "list":
                _draw_list(row.column(), group, setting)
            else:
                row.prop(group, setting.key)
        if self.topic.key in ("surface", "rock_surface"):
            told = principled.advice({s.key: getattr(group, s.key) for s in self.topic.settings})
            if told:
                layout.label(text=told, icon="INFO")
        if self.topic.key == "terrain" and scenes.measured_roughness(context.scene):
            layout.operator("icymoon.show_roughness", text=f"Measured: {scenes.measured_roughness(context.scene)}",
                            icon="DRIVER_DISTANCE")


class ICYMOON_UL_layers(bpy.types.UIList):
    """Layers of noise, a line each"""

    bl_idname = "ICYMOON_UL_layers"

    def draw_item(self, context: bpy.types.Context, layout: Any, data: Any, item: Any, icon: int,
                  active_data: Any, active_property: str) -> None:
        layout.label(text=layers.layer_title(item), icon="RNDCURVE")


def _draw_list(layout: Any, group: Any, setting: Setting) -> None:
    """A list of tables with its buttons, and the settings of the selected table."""
    layout.label(text=setting.label)
    row = layout.row()
    row.template_list("ICYMOON_UL_layers", "", group, setting.key, group, f"{setting.key}_active", rows=3)
    buttons = row.column(align=True)
    buttons.operator("icymoon.layer_add", text="", icon="ADD")
    buttons.operator("icymoon.layer_remove", text="", icon="REMOVE")
    buttons.operator("icymoon.layer_move", text="", icon="TRIA_UP").direction = "UP"
    buttons.operator("icymoon.layer_move", text="", icon="TRIA_DOWN").direction = "DOWN"
    entries, active = getattr(group, setting.key), getattr(group, f"{setting.key}_active")
    for each in setting.entries if active < len(entries) else ():
        layout.prop(entries[active], each.key)


def _source_asks(source: Any, topic: str, key: str) -> bool:
    """Whether the kind of ground leaves a setting an effect."""
    if topic == "terrain":
        return bool(source.kind == "PROCEDURAL" or source.detail
                    or (source.kind == "HEIGHT_MAP" and key in ("size_m", "resolution")))
    if topic == "source" and key != "kind":
        only = {"scale": "MESH", "up_axis": "MESH", "repair": "MESH", "metres_per_pixel": "HEIGHT_MAP",
                "height_scale_m": "HEIGHT_MAP"}
        return bool(source.kind == only[key] if key in only else source.kind != "PROCEDURAL")
    return True


#: Surface settings that have an effect only beside another that is above 0.
_SURFACE_NEEDS = {"albedo_patch_m": "albedo_variation", "subsurface_radius_m": "subsurface_weight",
                  "grain_size_m": "grain_amplitude_m", "relief": "grain_amplitude_m",
                  **{f"salt_{key}": "salt_share" for key in ("patch_m", "red", "green", "blue")}}


def _matters(topic: str, key: str, group: Any) -> bool:
    """Whether a setting has an effect beside the others; what has none is drawn greyed."""
    if TOPICS[topic].parent == LANDFORMS:
        # The first setting of a landform, its height, depth or coverage, turns it on.
        return key == TOPICS[topic].settings[0].key or getattr(group, TOPICS[topic].settings[0].key) > 0
    if topic == "rocks" and key != "coverage":
        return bool(group.coverage > 0 and (key != "power_index" or group.law == "POWER")
                    and (key not in ("cluster_blocks", "cluster_radius_m") or group.clustering > 0))
    if topic in ("surface", "rock_surface") and key in _SURFACE_NEEDS:
        return bool(getattr(group, _SURFACE_NEEDS[key]) > 0)
    if topic == "sensor" and key in ("auto_percentile", "auto_target"):
        return bool(group.auto_exposure)
    if topic == "sensor" and key == "saturation_radiance":
        return not group.auto_exposure
    return True


class ICYMOON_PT_landforms(_Sidebar, bpy.types.Panel):
    """Features of icy ground, each off until its height, depth or coverage is above 0"""

    bl_idname = "ICYMOON_PT_landforms"
    bl_label = LANDFORMS
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 10 + next(k for k, topic in enumerate(TOPICS.values()) if topic.parent == LANDFORMS)

    def draw(self, context: bpy.types.Context) -> None:
        group = context.scene.icymoon
        shaping = [t.label for t in TOPICS.values() if t.parent == LANDFORMS
                   and getattr(getattr(group, t.key), t.settings[0].key) > 0]
        self.layout.label(text=", ".join(shaping) or "None")


def _topic_panel(topic: Topic, order: int) -> type:
    parent = {"bl_parent_id": ICYMOON_PT_landforms.bl_idname} if topic.parent == LANDFORMS else {}
    return type(f"ICYMOON_PT_{topic.key}", (_TopicPanel, bpy.types.Panel), {
        "__doc__": topic.description, "bl_idname": f"ICYMOON_PT_{topic.key}", "bl_label": topic.label,
        "bl_order": order, "topic": topic, **parent})


TOPIC_PANELS = tuple(_topic_panel(topic, 10 + k) for k, topic in enumerate(TOPICS.values()))


class ICYMOON_PT_ground_report(_Sidebar, bpy.types.Panel):
    """What was found and mended in the file that the ground was built from"""

    bl_idname = "ICYMOON_PT_ground_report"
    bl_label = "Import Report"
    bl_parent_id = "ICYMOON_PT_source"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(ground.report(context.scene))

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column(align=True)
        for line in ground.report(context.scene):
            column.label(text=line)


CLASSES = (ICYMOON_UL_layers, ICYMOON_PT_main, ICYMOON_PT_results, ICYMOON_PT_landforms, *TOPIC_PANELS,
           ICYMOON_PT_ground_report)
