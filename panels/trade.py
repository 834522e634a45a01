"""The panel Speed and Accuracy below Quality and Speed: measured costs and errors of this scene."""

from __future__ import annotations

import bpy

from ..operators import manual, trade
from .fields import draw_sentence, draw_start
from .sidebar import Sidebar


class ICYMOON_PT_trade(Sidebar, bpy.types.Panel):
    """Measure which quality this scene needs"""

    bl_idname = "ICYMOON_PT_trade"
    bl_label = "Speed and Accuracy"
    page = manual.find_page_of_topic("quality")
    bl_parent_id = "ICYMOON_PT_quality"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout: bpy.types.UILayout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        draw_start(layout, "icymoon.measure_machine", "Measure This Machine")
        draw_start(layout, "icymoon.trade", "Compare Qualities…")
        layout.operator("icymoon.show_trade", icon="IMAGE_DATA")
        for sentence in trade.last_results.get(context.scene.name, ()):
            draw_sentence(layout, sentence, hang="    ")


CLASSES = (ICYMOON_PT_trade,)
