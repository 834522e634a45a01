"""Show the colours of errors in 3D Views, and restore the views afterwards.

Undo does not change the window's layout. So a timer restores the views when undo removes the errors or the window shows
another scene, and shows the colours again when the errors or the scene return. A scene stores the earlier shading of
its view, so that the view can be restored after its file is opened again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import Any

import bpy

from ..nodes import lidar_in_view, measured_surface, painted_errors
from .session import session
from .window_areas import list_areas
from .window_events import call_later, make_registration

#: Custom property of a scene: the shading of its view before the colours.
KEPT = "icymoon_view_before_colours"
_SHADING_KEYS = ("color_type", "light", "type")


def _list_views() -> Iterator[tuple[bpy.types.Scene, Any]]:
    """Iterate over (scene, space) of all 3D Views."""
    return ((window.scene, area.spaces.active) for window, area in list_areas("VIEW_3D"))


def show_colours(context: bpy.types.Context, items: Iterable[bpy.types.Object], solid: bool = False) -> None:
    """Make the 3D View with the button show the colours of objects, in its local view too, and with ``solid`` in Solid
    shading.

    The colours of the ground itself are visible in Solid shading only. Solid shading gets no light, so that the colours
    match the legend.
    """
    space: bpy.types.Space = context.space_data
    if context.area is None or context.area.type != "VIEW_3D":
        return
    for item in items if space.local_view is not None else ():
        item.local_view_set(space, True)
    _colour_view(context.scene, space, solid)


def _colour_view(scene: bpy.types.Scene, space: bpy.types.Space, solid: bool) -> None:
    shading = space.shading
    kept = session.shading_before.setdefault(space.as_pointer(), {})
    session.colours_left.pop(space.as_pointer(), None)
    if solid:
        kept.setdefault("type", shading.type)
        shading.type = "SOLID"  # set first, because the other two properties belong to Solid shading
        kept.setdefault("light", shading.light)
        shading.light = "FLAT"
    kept.setdefault("color_type", shading.color_type)
    shading.color_type = "VERTEX"
    scene[KEPT] = kept


def hide_errors(scene: bpy.types.Scene) -> None:
    """Remove the measured surface and the painted errors of a scene, and restore its views."""
    measured_surface.clear_points(scene)
    painted_errors.clear_painted(scene)
    give_back_views(scene)


def hide_colours(scene: bpy.types.Scene) -> None:
    """Remove what a scene shows in colours, and restore its views."""
    lidar_in_view.clear_scan(scene)
    hide_errors(scene)


def give_back_views(scene: bpy.types.Scene) -> None:
    """Restore the views if a scene no longer shows colours."""
    if not is_shown(scene):
        scene.pop(KEPT, None)
        restore_views()


def is_shown(scene: bpy.types.Scene) -> bool:
    """Return whether a scene shows something in colours: errors, or the points or beams of a LiDAR."""
    return shows_errors(scene) or lidar_in_view.find_shown(scene) is not None


def shows_errors(scene: bpy.types.Scene) -> bool:
    """Return whether a measured surface or painted errors are shown in a scene."""
    return measured_surface.find_points(scene) is not None or painted_errors.find_painted(scene) is not None


def restore_views() -> None:
    """Restore the earlier shading of the views that showed colours and whose scene shows none."""
    for scene, space in _list_views():
        kept = session.shading_before.get(space.as_pointer(), {})
        if not kept or is_shown(scene):
            continue
        del session.shading_before[space.as_pointer()]
        session.colours_left[space.as_pointer()] = "type" in kept
        for key in _SHADING_KEYS:
            if key in kept:
                with suppress(TypeError):  # a file may contain any text
                    setattr(space.shading, key, kept[key])


def _follow_scenes() -> None:
    """Restore the views whose scene shows no colours, and show the colours again in views that return to them."""
    restore_views()
    for scene, space in list(_list_views()):
        if space.as_pointer() in session.colours_left and is_shown(scene):
            _colour_view(scene, space, session.colours_left[space.as_pointer()])


def _check_views() -> None:
    """Schedule ``_follow_scenes`` after undo, redo and changes of the scene that a window shows."""
    if any(
        space.as_pointer() in (session.colours_left if is_shown(scene) else session.shading_before)
        for scene, space in (_list_views() if session.shading_before or session.colours_left else ())
    ):
        call_later(_follow_scenes)  # views of a window may change in a timer only


def _read_earlier_shading() -> None:
    """Read the earlier shading of the views of an opened file that was saved with the colours shown."""
    for scene, space in _list_views():
        stored: Any = scene.get(KEPT)
        kept = (
            {key: str(stored[key]) for key in _SHADING_KEYS if key in stored}
            if hasattr(stored, "keys") and is_shown(scene)
            else {}
        )
        if kept and space.shading.color_type == "VERTEX" and ("type" not in kept or space.shading.type == "SOLID"):
            session.shading_before[space.as_pointer()] = kept


register, unregister = make_registration(
    timers=(_follow_scenes,),
    load_post=_read_earlier_shading,
    undo_post=_check_views,
    redo_post=_check_views,
    depsgraph_update_post=_check_views,  # Blender does not report that a window shows another scene
)
