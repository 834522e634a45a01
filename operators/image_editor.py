"""Finding an Image Editor to show an image in, or opening a window with one."""

from __future__ import annotations

import bpy

from .window_areas import list_areas, override_area


def find_editors_showing(image: bpy.types.Image) -> list[bpy.types.Area]:
    """The Image Editors that show an image."""
    return [area for _, area in list_areas("IMAGE_EDITOR") if area.spaces.active.image == image]


def find_or_open(context: bpy.types.Context, open_window: bool) -> bpy.types.Area | None:
    """An open Image Editor in View mode that is not pinned to its image and is not a UV Editor.

    Without such an editor, ``open_window`` opens a window with one. The other editors of the user stay as they are.
    """
    for _, area in list_areas("IMAGE_EDITOR"):
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


def zoom_to_fit(area: bpy.types.Area) -> None:
    """Zoom an editor so that the whole image is visible."""
    window = next(window for window, each in list_areas("IMAGE_EDITOR") if each == area)
    with override_area(window, area):
        bpy.ops.image.view_all(fit_view=True)
