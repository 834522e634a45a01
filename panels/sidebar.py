"""The sidebar, top to bottom as the work goes: describe, build, render, evaluate. No logic here."""

from __future__ import annotations

from typing import Any

import bpy

from .. import settings as description
from ..operators import jobs, results
from ..properties import TOPICS, Topic


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
        buttons.operator("icymoon.show_error", icon="IMAGE_DATA")


class _TopicPanel(_Sidebar):
    """One topic of the settings, drawn from the table of settings."""

    bl_options = {"DEFAULT_CLOSED"}
    topic: Topic

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        if self.topic.key == "terrain":
            layout.prop(context.scene.icymoon.dataset, "seed")
        group = getattr(context.scene.icymoon, self.topic.key)
        for setting in self.topic.settings:
            row = layout.row()
            row.enabled = _matters(self.topic.key, setting.key, group)
            row.prop(group, setting.key)


def _matters(topic: str, key: str, group: Any) -> bool:
    """Whether a setting has an effect beside the others; what has none is drawn greyed."""
    if topic == "rocks" and key != "coverage":
        return bool(group.coverage > 0)
    if topic == "surface" and key == "albedo_patch_m":
        return bool(group.albedo_variation > 0)
    if topic == "surface" and key == "subsurface_radius_m":
        return bool(group.subsurface_weight > 0)
    if topic == "surface" and key == "grain_size_m":
        return bool(group.grain_amplitude_m > 0)
    if topic == "sensor" and key in ("auto_percentile", "auto_target"):
        return bool(group.auto_exposure)
    if topic == "sensor" and key == "saturation_radiance":
        return not group.auto_exposure
    return True


def _topic_panel(topic: Topic, order: int) -> type:
    return type(f"ICYMOON_PT_{topic.key}", (_TopicPanel, bpy.types.Panel), {
        "__doc__": topic.description, "bl_idname": f"ICYMOON_PT_{topic.key}", "bl_label": topic.label,
        "bl_order": order, "topic": topic})


TOPIC_PANELS = tuple(_topic_panel(topic, 10 + k) for k, topic in enumerate(TOPICS.values()))
CLASSES = (ICYMOON_PT_main, ICYMOON_PT_results, *TOPIC_PANELS)
