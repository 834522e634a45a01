"""Shows images in an Image Editor, and opens a window with an Image Editor if there is none."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from .session import session
from .window_areas import list_areas, override_area
from .window_events import call_later, make_registration

#: A function that shows something in an area and finishes the work that depends on it.
Show = Callable[[bpy.types.Area], None]


def find_editors_showing(image: bpy.types.Image) -> list[bpy.types.Area]:
    """The Image Editors that show an image."""
    return [area for _, area in list_areas("IMAGE_EDITOR") if area.spaces.active.image == image]


def show_in_editor(open_window: bool, show: Show) -> bool:
    """Call ``show`` with an open Image Editor in View mode that is not pinned to its image and is not a UV Editor.

    Without such an editor, ``open_window`` lets the next turn of the event loop open a window with one. The other
    editors of the user stay as they are. Returns False if nothing is or will be shown.

    A new window becomes the window of the context. If a modal operator has opened the window, Blender (4.3 and 5.2)
    does not end this operator, and crashes later.
    """
    area = _find_editor()
    if area is not None:
        show(area)
        return True
    if not open_window or bpy.app.background:
        return False
    session.to_show.append(show)
    call_later(_open_windows)
    return True


def _find_editor() -> bpy.types.Area | None:
    for _, area in list_areas("IMAGE_EDITOR"):
        space = area.spaces.active
        if area.ui_type == "IMAGE_EDITOR" and space.mode == "VIEW" and not space.use_image_pin:
            return area
    return None


def _open_windows() -> None:
    """Call the waiting functions. The first opens a window if there is no Image Editor, and the others find that
    window."""
    waiting = session.to_show[:]
    session.to_show.clear()
    for show in waiting:
        show(_find_editor() or _open_editor())


def _open_editor() -> bpy.types.Area:
    """The Image Editor of a new window."""
    manager = bpy.context.window_manager
    before = list(manager.windows)
    with bpy.context.temp_override(window=before[0]):
        bpy.ops.wm.window_new()
    window = next(each for each in manager.windows if each not in before)
    window.screen.areas[0].ui_type = "IMAGE_EDITOR"
    return window.screen.areas[0]


def zoom_to_fit(area: bpy.types.Area) -> None:
    """Zoom an editor so that the whole image is visible."""
    window = next(window for window, each in list_areas("IMAGE_EDITOR") if each == area)
    with override_area(window, area):
        bpy.ops.image.view_all(fit_view=True)


register, unregister = make_registration(timers=(_open_windows,))
