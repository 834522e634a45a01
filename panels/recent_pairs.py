"""The panel Recent Pairs: pictures of the pairs of the data set folder that were rendered last. A click shows a
pair."""

from __future__ import annotations

import bpy

from ..nodes.build_scene import find_collection
from ..operators import manual, recent_pairs
from ..operators.session import session
from .fields import draw_lines
from .sidebar import Sidebar

#: Height of a picture, in heights of a button.
_PICTURE_SCALE = 3.0
#: Share of a line that the picture takes.
_PICTURE_SHARE = 0.35


class ICYMOON_PT_recent(Sidebar, bpy.types.Panel):
    """The pairs of the data set folder that were rendered last. Click on one to show it"""

    bl_idname = "ICYMOON_PT_recent"
    bl_label = "Recent Pairs"
    page = manual.find_page_of_topic("dataset")
    bl_parent_id = "ICYMOON_PT_main"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 1

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the scene is built or has pairs. If the header appeared only after a render, it would move the
        panels below."""
        return find_collection(context.scene) is not None or bool(recent_pairs.list_recent(context.scene))

    def draw(self, context: bpy.types.Context) -> None:
        shown = session.shown.folder if session.shown is not None else None
        column = self.layout.column(align=True)
        pairs = recent_pairs.list_recent(context.scene)
        if not pairs:
            draw_lines(column, ("No pair in Data Set ▸ Folder",))
        for pair in pairs:
            row = column.split(factor=_PICTURE_SHARE)
            icon = recent_pairs.find_icon(pair)
            if icon is not None:
                row.template_icon(icon_value=icon, scale=_PICTURE_SCALE)
            else:
                row.label(text="", icon="IMAGE_DATA")
            beside = row.column(align=True)
            button = beside.column()
            button.scale_y = _PICTURE_SCALE - 1.0 if icon is not None else 1.0
            button.operator("icymoon.show_pair", text=pair.title, depress=pair.folder == shown).id = pair.id
            if icon is not None:
                beside.label(text=recent_pairs.find_description(pair))


CLASSES = (ICYMOON_PT_recent,)
