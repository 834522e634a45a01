"""The panel of active sensors: lamps, and a LiDAR whose scan is shown in the 3D View."""

from __future__ import annotations

import bpy

from ..nodes import lidar_in_view
from ..settings.blender.scene_properties import OWN_SCANNER
from .fields import draw_lines, draw_sentence, draw_start
from .sidebar import FIRST, Sidebar
from .topics import TOPICS

#: The panel follows the panel of the cameras' response.
_ORDER = FIRST + list(TOPICS).index("sensor")


class ICYMOON_PT_active_sensors(Sidebar, bpy.types.Panel):
    """Lamps and a LiDAR beside the cameras"""

    bl_idname = "ICYMOON_PT_active_sensors"
    bl_label = "Active Sensors"
    page = "howto/lidar"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = _ORDER

    def draw(self, context: bpy.types.Context) -> None:
        lamps = context.scene.icymoon.light.lamps
        power_w = sum(lamp.power_w for lamp in lamps)
        told = f"{len(lamps)} lamps of {power_w:g} W in all" if lamps else "No lamps"
        draw_sentence(self.layout, f"{told}; see Light ▸ Lamps", "LIGHT")
        self.layout.operator("icymoon.lamp_add", icon="ADD")


class ICYMOON_PT_lidar(Sidebar, bpy.types.Panel):
    """A laser scanner at the left eye, and the points of its scan"""

    bl_idname = "ICYMOON_PT_lidar"
    bl_label = "LiDAR"
    page = "howto/lidar#in-the-window"
    bl_parent_id = "ICYMOON_PT_active_sensors"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, group = self.layout, context.scene.icymoon.lidar
        column = layout.column()
        column.label(text="Scanner")
        column.prop(group, "scanner", text="")
        if group.scanner == OWN_SCANNER:
            column.prop(group, "file", text="")
        for key in ("rows", "columns"):
            column.prop(group, key)
        draw_lines(column, ("0: as many as the scanner has",))
        for key in ("detector", "ice"):
            column.prop(group, key)
        column = layout.column()
        column.active = group.detector  # only a detector receives a waveform
        column.label(text="Waveforms")
        column.prop(group, "waveforms", text="")
        column = layout.column(align=True)
        column.operator("icymoon.show_beams", icon="LIGHT_SPOT")
        draw_start(column, "icymoon.scan_lidar", "Scan with LiDAR", "OUTLINER_OB_POINTCLOUD")
        draw_start(column, "icymoon.show_scan", "Show LiDAR Points", "HIDE_OFF")
        if lidar_in_view.find_shown(context.scene) is None:
            return
        shows_points = lidar_in_view.find_points(context.scene) is not None
        layout.operator("icymoon.hide_scan", text=f"Remove LiDAR {'Points' if shows_points else 'Beams'}", icon="X")
        legend = lidar_in_view.make_legend(context.scene, group.colour)
        if shows_points and legend:
            column = layout.column()
            column.label(text="Colour")
            column.prop(group, "colour", text="")
            column.prop(group, "points", slider=True)
        column = layout.column(align=True)
        for text, icon in legend:
            draw_lines(column, (text,), icon)


CLASSES = (ICYMOON_PT_active_sensors, ICYMOON_PT_lidar)
