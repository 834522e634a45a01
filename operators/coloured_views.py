"""3D Views that show the colours of errors, and what they showed before."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy

from ..nodes import measured_surface, painted_errors

#: What 3D Views were like before they showed colours, by their addresses; the window's layout knows no undo.
_before: dict[int, dict[str, str]] = {}
_KEPT = ("color_type", "light", "type")


def show_colours(context: bpy.types.Context, items: Iterable[bpy.types.Object], solid: bool = False) -> None:
    """Make the 3D View with the button show the colours of objects, in its local view too; ``solid``: in Solid shading.

    The colours of the ground itself are visible in Solid shading only, without light, so that they are those of the
    legend.
    """
    space: Any = context.space_data
    if context.area is None or context.area.type != "VIEW_3D":
        return
    for item in items if space.local_view is not None else ():
        item.local_view_set(space, True)
    shading = space.shading
    kept = _before.setdefault(space.as_pointer(), {})
    if solid:
        kept.setdefault("type", shading.type)
        shading.type = "SOLID"  # first: the other two are those of Solid shading
        kept.setdefault("light", shading.light)
        shading.light = "FLAT"
    kept.setdefault("color_type", shading.color_type)
    shading.color_type = "VERTEX"


def hide_errors(scene: bpy.types.Scene) -> None:
    """Remove the measured surface and the painted errors of a scene, and give the views back what they showed."""
    measured_surface.clear_points(scene)
    painted_errors.clear(scene)
    restore_views()


def give_back_views(scene: bpy.types.Scene) -> None:
    """Give the views back what they showed before if no errors are shown in a scene any more."""
    if not is_shown(scene):
        restore_views()


def is_shown(scene: bpy.types.Scene) -> bool:
    """Whether a measured surface or painted errors are shown in a scene."""
    return measured_surface.find_points(scene) is not None or painted_errors.find(scene) is not None


def restore_views() -> None:
    """Give the views that showed colours back what they showed before."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            shading = area.spaces.active.shading if area.type == "VIEW_3D" else None
            kept = _before.get(area.spaces.active.as_pointer(), {})
            for key in _KEPT if shading is not None else ():
                if key in kept:
                    setattr(shading, key, kept[key])
    _before.clear()


@bpy.app.handlers.persistent
def _forget(*_: Any) -> None:
    _before.clear()


def register() -> None:
    """Forget the views of a file that is left."""
    bpy.app.handlers.load_pre.append(_forget)


def unregister() -> None:
    """Listen no longer."""
    bpy.app.handlers.load_pre.remove(_forget)
