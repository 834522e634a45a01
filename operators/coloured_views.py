"""Shows the colours of errors in 3D Views, and restores the views afterwards.

The window's layout knows no undo, so a timer restores the views when undo removes the errors, and shows the colours
again when the errors return. A scene stores the earlier shading of its view, for when its file is opened again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import Any

import bpy

from ..nodes import measured_surface, painted_errors

#: Custom property of a scene: the shading of its view before the colours.
KEPT = "icymoon_view_before_colours"
#: Shading of 3D Views before they showed colours, by their addresses.
_before: dict[int, dict[str, str]] = {}
#: The views that no longer show colours, because undo or a button took the errors away; whether they were in Solid
#: shading.
_left: dict[int, bool] = {}
_KEYS = ("color_type", "light", "type")


def _views() -> Iterator[tuple[bpy.types.Scene, Any]]:
    """All 3D Views with their scenes."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield window.scene, area.spaces.active


def show_colours(context: bpy.types.Context, items: Iterable[bpy.types.Object], solid: bool = False) -> None:
    """Make the 3D View with the button show the colours of objects, in its local view too; ``solid``: in Solid shading.

    The colours of the ground itself are visible in Solid shading only. It has no light there, so that the colours match
    the legend.
    """
    space: Any = context.space_data
    if context.area is None or context.area.type != "VIEW_3D":
        return
    for item in items if space.local_view is not None else ():
        item.local_view_set(space, True)
    _colour(context.scene, space, solid)


def _colour(scene: bpy.types.Scene, space: Any, solid: bool) -> None:
    shading = space.shading
    kept = _before.setdefault(space.as_pointer(), {})
    _left.pop(space.as_pointer(), None)
    if solid:
        kept.setdefault("type", shading.type)
        shading.type = "SOLID"  # first: the other two properties belong to Solid shading
        kept.setdefault("light", shading.light)
        shading.light = "FLAT"
    kept.setdefault("color_type", shading.color_type)
    shading.color_type = "VERTEX"
    scene[KEPT] = kept


def hide_errors(scene: bpy.types.Scene) -> None:
    """Remove the measured surface and the painted errors of a scene, and restore the views."""
    measured_surface.clear_points(scene)
    painted_errors.clear(scene)
    scene.pop(KEPT, None)
    restore_views()


def give_back_views(scene: bpy.types.Scene) -> None:
    """Restore the views if a scene no longer shows errors."""
    if not is_shown(scene):
        scene.pop(KEPT, None)
        restore_views()


def is_shown(scene: bpy.types.Scene) -> bool:
    """Whether a measured surface or painted errors are shown in a scene."""
    return measured_surface.find_points(scene) is not None or painted_errors.find(scene) is not None


def restore_views() -> None:
    """Restore the earlier shading of the views that showed colours."""
    for _, space in _views():
        kept = _before.get(space.as_pointer(), {})
        if kept:
            _left[space.as_pointer()] = "type" in kept
        for key in _KEYS:
            if key in kept:
                with suppress(TypeError):  # a file may contain any text
                    setattr(space.shading, key, kept[key])
    _before.clear()


def _follow_undo() -> None:
    """Restore the views if undo has removed the errors, and show the colours again if redo has brought them back."""
    there = any(map(is_shown, bpy.data.scenes))
    if _before and not there:
        restore_views()
    elif _left and there:
        for scene, space in list(_views()):
            if space.as_pointer() in _left and is_shown(scene):
                _colour(scene, space, _left[space.as_pointer()])


@bpy.app.handlers.persistent
def _look_after_undo(*_: Any) -> None:
    if (_before or _left) and not bpy.app.timers.is_registered(_follow_undo):
        bpy.app.timers.register(_follow_undo, first_interval=0.0)  # views of a window may change in a timer only


@bpy.app.handlers.persistent
def _forget(*_: Any) -> None:
    _before.clear()
    _left.clear()


@bpy.app.handlers.persistent
def _remember(*_: Any) -> None:
    """Read the earlier shading of the views of an opened file that was saved with the colours shown."""
    for scene, space in _views():
        stored: Any = scene.get(KEPT)
        kept = (
            {key: str(stored[key]) for key in _KEYS if key in stored}
            if hasattr(stored, "keys") and is_shown(scene)
            else {}
        )
        if kept and space.shading.color_type == "VERTEX" and ("type" not in kept or space.shading.type == "SOLID"):
            _before[space.as_pointer()] = kept


_HANDLERS = (
    (bpy.app.handlers.load_pre, _forget),
    (bpy.app.handlers.load_post, _remember),
    (bpy.app.handlers.undo_post, _look_after_undo),
    (bpy.app.handlers.redo_post, _look_after_undo),
)


def register() -> None:
    """Follow undo and files that are opened."""
    for handlers, handler in _HANDLERS:
        handlers.append(handler)


def unregister() -> None:
    """Stop following them."""
    for handlers, handler in _HANDLERS:
        handlers.remove(handler)
    if bpy.app.timers.is_registered(_follow_undo):
        bpy.app.timers.unregister(_follow_undo)
