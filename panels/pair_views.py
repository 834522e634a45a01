"""The views of the rendered pair, below the main buttons and in the header of the Image Editor that shows the pair."""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ..nodes.build_scene import find_collection
from ..operators import camera_image_notes, show_pair
from ..operators.session import ShownPair
from ..operators.sidebar_text import measure_line_length
from .exports import draw_export
from .fields import draw_lines

#: Buttons in a row, buttons in a row of a narrow sidebar, and characters of a line below which it is narrow.
_BUTTON_COLUMNS, _FEWER_BUTTON_COLUMNS, _NARROW_LINE = 3, 2, 30
#: A text as long as the lines on a pair without warnings.
_ROOM = "Exposure 1.23 ms; 0.123 % saturated; Depth 1.23 to 45.6 m, shown at 1/2 of its size"


def draw_pair(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Draw the buttons for the views of the last rendered pair, and lines on the shown pair.

    The buttons exist from the build on and are grey without a pair, so that nothing below moves when a render ends.
    """
    pairs = show_pair.find_pairs_to_show(scene)
    if not pairs and find_collection(scene) is None:
        return
    now = show_pair.find_shown_pair(scene)
    number = 1 + pairs.index(now.folder) if now is not None else 1
    layout = layout.column()
    column = layout.column(align=True)
    column.enabled = bool(pairs)
    columns = _BUTTON_COLUMNS if measure_line_length() >= _NARROW_LINE else _FEWER_BUTTON_COLUMNS
    for start in range(0, len(show_pair.VIEWS), columns):
        _draw_views(column.row(align=True), show_pair.VIEWS[start : start + columns], now, number)
    if len(pairs) > 1:
        _draw_choice(column.row(align=True), now.view if now is not None else "SIDE_BY_SIDE", number, len(pairs))
    draw_lines(layout, show_pair.list_lines(scene), "IMAGE_DATA", room_for=_ROOM)  # not grey, or they cannot be read
    export = layout.column()
    export.enabled = bool(pairs)
    draw_export(export, scene, "SCENE")


def _draw_views(
    row: bpy.types.UILayout, views: Sequence[tuple[str, str, str]], now: ShownPair | None, number: int
) -> None:
    for name, label, _ in views:
        button = row.operator("icymoon.show_pair", text=label, depress=now is not None and now.view == name)
        button.view, button.number = name, number


def _draw_choice(row: bpy.types.UILayout, view: str, number: int, count: int) -> None:
    """Draw buttons for the previous and the next pair."""
    before = row.operator("icymoon.show_pair", text="", icon="TRIA_LEFT")
    before.view, before.number = view, (number - 2) % count + 1
    row.label(text=f"Pair {number} of {count}")
    after = row.operator("icymoon.show_pair", text="", icon="TRIA_RIGHT")
    after.view, after.number = view, number % count + 1


def _draw_header(self: bpy.types.Header, context: bpy.types.Context) -> None:
    now, image = show_pair.find_shown_pair(context.scene), context.space_data.image
    if image is None:
        return
    if now is not None and image == show_pair.find_image():
        number = 1 + show_pair.find_pairs_to_show(context.scene).index(now.folder)
        _draw_views(self.layout.row(align=True), show_pair.VIEWS, now, number)
        self.layout.label(text=show_pair.describe_picture(context.scene))
    elif note := camera_image_notes.read_note(image):
        self.layout.label(text=note)


def register() -> None:
    """Add the views to the header of the Image Editor."""
    bpy.types.IMAGE_HT_header.append(_draw_header)


def unregister() -> None:
    """Remove the views from the header of the Image Editor."""
    bpy.types.IMAGE_HT_header.remove(_draw_header)
