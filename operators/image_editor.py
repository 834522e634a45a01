"""Finding an Image Editor to show an image in, or opening a window with one."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from .window import areas


def editors(context: bpy.types.Context) -> Iterator[tuple[bpy.types.Window, bpy.types.Area]]:
    """The Image Editors of all windows."""
    return areas("IMAGE_EDITOR")


def showing(context: bpy.types.Context, image: bpy.types.Image) -> list[bpy.types.Area]:
    """The Image Editors that show an image."""
    return [area for _, area in editors(context) if area.spaces.active.image == image]


def find_or_open(context: bpy.types.Context, open_window: bool) -> bpy.types.Area | None:
    """An open Image Editor in View mode that is not pinned to its image and is not a UV Editor.

    Without such an editor, ``open_window`` opens a window with one. The other editors of the user stay as they are.
    """
    for _, area in editors(context):
        space = area.spaces.active
        if area.ui_type == "IMAGE_EDITOR" and space.mode == "VIEW" and not space.use_image_pin:
            return area
    if not open_window or bpy.app.background:
        return None
    before = set(context.window_manager.windows)
    bpy.ops.wm.window_new()
    window = next(w for w in context.window_manager.windows if w not in before)
    window.screen.areas[0].ui_type = "IMAGE_EDITOR"
    return window.screen.areas[0]


def fit(context: bpy.types.Context, area: bpy.types.Area) -> None:
    """Zoom an editor so that the whole image is visible."""
    window = next(window for window, each in editors(context) if each == area)
    region = next(r for r in area.regions if r.type == "WINDOW")
    with context.temp_override(window=window, area=area, region=region):
        bpy.ops.image.view_all(fit_view=True)
