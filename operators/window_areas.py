"""Areas, redrawing and undo of the window, and pictures for buttons."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cached_property

import bpy
import bpy.utils.previews


def find_scene(uid: int) -> bpy.types.Scene | None:
    """Find the scene with a ``session_uid``; None if it no longer exists. Names and addresses do not hold: the user may
    rename or delete a scene, and undo moves it in memory."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == uid), None)


def list_areas(kind: str) -> Iterator[tuple[bpy.types.Window, bpy.types.Area]]:
    """Iterate over all areas of a kind, such as VIEW_3D, with their windows."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == kind:
                yield window, area


def override_area(window: bpy.types.Window, area: bpy.types.Area) -> bpy.types.ContextTempOverride:
    """Return a context in which operators run in an area."""
    region = next(region for region in area.regions if region.type == "WINDOW")
    return bpy.context.temp_override(window=window, area=area, region=region)


def redraw(kind: str) -> None:
    """Redraw all areas of a kind."""
    for _, area in list_areas(kind):
        area.tag_redraw()


def redraw_panels() -> None:
    """Redraw sidebars, status bar and preferences, which show the job. Views are left alone, because they may take
    seconds."""
    for window in bpy.context.window_manager.windows:
        window.workspace.status_text_set(None)  # redraws the status bar
    redraw_sidebars()


def redraw_sidebars() -> None:
    """Redraw sidebars and preferences."""
    for kind, shown in (("VIEW_3D", "UI"), ("PREFERENCES", "WINDOW")):
        for _, area in list_areas(kind):
            for region in area.regions:
                if region.type == shown:
                    region.tag_redraw()


@contextmanager
def pause_rendered_views() -> Iterator[None]:
    """Pause the rendering of all views within the ``with`` block.

    To evaluate any scene, Blender lets the renderer of each rendered view read that view's scene. In the middle of a
    build this scene is not evaluated: Cycles then reads freed meshes, and Blender crashes.

    The live preview needs no pause, because it evaluates nothing until its change is complete. A pause would restart
    the renderer at each step of a slider.
    """
    shadings = [area.spaces.active.shading for _, area in list_areas("VIEW_3D")]
    rendered = [shading for shading in shadings if shading.type == "RENDERED"]
    for shading in rendered:
        shading.type = "SOLID"
    try:
        yield
    finally:
        for shading in rendered:
            shading.type = "RENDERED"


def push_undo(message: str) -> None:
    """Push an undo step after a change outside Blender's own steps.

    Without this step, undoing the previous step would revert the change too. Without a window, undo does not exist, and
    nothing happens.
    """
    windows = bpy.context.window_manager.windows
    if windows and not bpy.app.background:
        with bpy.context.temp_override(window=bpy.context.window or windows[0]):
            bpy.ops.ed.undo_push(message=message)


def redo() -> None:
    """Redo the last undone step, if there is a window."""
    windows = bpy.context.window_manager.windows
    if windows and not bpy.app.background:
        with bpy.context.temp_override(window=bpy.context.window or windows[0]), suppress(RuntimeError):
            bpy.ops.ed.redo()  # raises RuntimeError if nothing was undone, because there was no earlier step


class ButtonPictures:
    """Pictures for buttons, in a Blender collection that is made at its first use."""

    @cached_property
    def collection(self) -> bpy.utils.previews.ImagePreviewCollection:
        """The collection of pictures by their names."""
        return bpy.utils.previews.new()

    def remove(self) -> None:
        """Free the pictures, before Icy Moon is disabled."""
        if (made := vars(self).pop("collection", None)) is not None:
            bpy.utils.previews.remove(made)
