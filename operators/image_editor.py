"""Show images in an Image Editor; without one, open a window with an Image Editor."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from .session import session
from .window_areas import list_areas, override_area
from .window_events import call_later, make_registration

#: A function that shows something in an area and finishes the work that depends on it.
Show = Callable[[bpy.types.Area], None]
#: Width and height of a new window, as a share of the main window's.
_SHARE_OF_WINDOW = 0.8


def find_editors_showing(image: bpy.types.Image) -> list[bpy.types.Area]:
    """Find the Image Editors that show an image."""
    return [area for _, area in list_areas("IMAGE_EDITOR") if area.spaces.active.image == image]


def find_empty_editors() -> list[bpy.types.Area]:
    """Find the Image Editors that show no image."""
    return [area for _, area in list_areas("IMAGE_EDITOR") if area.spaces.active.image is None]


def show_in_editor(open_window: bool, show: Show) -> bool:
    """Call ``show`` with an open Image Editor in View mode that is not pinned to its image and is not a UV Editor.

    With ``open_window``, this editor's window comes to the front; if there is no such editor, the next turn of the
    event loop opens a window with one. The user's other editors stay unchanged. Returns False if no editor shows or
    will show it.

    A new window becomes the window of the context. If a modal operator has opened the window, Blender (4.3 and 5.2)
    does not end this operator, and crashes later.
    """
    area = _find_editor()
    if area is not None:
        show(area)
        if open_window:
            raise_window(area)
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
    """Call the waiting functions. If there is no Image Editor, the first opens a window, and the others find it."""
    waiting = session.to_show[:]
    session.to_show.clear()
    for show in waiting:
        show(_find_editor() or _open_editor())


def _open_editor() -> bpy.types.Area:
    """Open a window, and return its Image Editor."""
    manager = bpy.context.window_manager
    before = list(manager.windows)
    if _is_render_shown():  # then the button of renders would change that editor
        with bpy.context.temp_override(window=_find_main_window()):
            bpy.ops.wm.window_new()
    else:
        _show_render_window()
    window = next(each for each in manager.windows if each not in before)
    window.screen.areas[0].ui_type = "IMAGE_EDITOR"
    return window.screen.areas[0]


def _is_render_shown() -> bool:
    """Return whether an Image Editor shows the user's render."""
    images = (area.spaces.active.image for _, area in list_areas("IMAGE_EDITOR"))
    return any(image is not None and image.type == "RENDER_RESULT" for image in images)


def _find_main_window() -> bpy.types.Window:
    """Find the first window that Blender does not close at Esc; else the first window."""
    windows = bpy.context.window_manager.windows
    return next((window for window in windows if not window.screen.is_temporary), windows[0])


def _show_render_window() -> None:
    """Open the window in which Blender shows a render, or bring it to the front. Esc closes it.

    Blender gives the window the size of the scene's render, in which a pair side by side would be small. So the render
    has another size while the window opens.
    """
    window = _find_main_window()
    view, preferences, render = bpy.context.preferences.view, bpy.context.preferences, window.scene.render
    before = view.render_display_type, preferences.is_dirty
    size = {name: getattr(render, name) for name in ("resolution_x", "resolution_y", "resolution_percentage")}
    view.render_display_type = "WINDOW"
    try:
        if window.scene.library is None:
            width, height = round(_SHARE_OF_WINDOW * window.width), round(_SHARE_OF_WINDOW * window.height)
            render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
        with bpy.context.temp_override(window=window):
            bpy.ops.render.view_show("INVOKE_DEFAULT")
    finally:
        view.render_display_type, preferences.is_dirty = before
        for name, value in size.items() if window.scene.library is None else ():
            setattr(render, name, value)


def raise_window(area: bpy.types.Area) -> None:
    """Bring the window of an Image Editor to the front in the next turn of the event loop. Blender can raise only a
    window that Esc closes, as it closes ours."""
    window = next((window for window, each in list_areas("IMAGE_EDITOR") if each == area), None)
    if window is not None and window.screen.is_temporary and not bpy.app.background:
        call_later(_raise_shown)


def _raise_shown() -> None:
    """Bring the window that Esc closes to the front, if it still exists."""
    if any(window.screen.is_temporary for window, _ in list_areas("IMAGE_EDITOR")):
        _show_render_window()


def zoom_to_fit(area: bpy.types.Area) -> None:
    """Zoom an Image Editor so that the whole image is visible."""
    window = next(window for window, each in list_areas("IMAGE_EDITOR") if each == area)
    with override_area(window, area):
        bpy.ops.image.view_all(fit_view=True)


register, unregister = make_registration(timers=(_open_windows, _raise_shown))
