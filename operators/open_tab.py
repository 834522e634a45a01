"""Open the tab Icy Moon of the sidebar once after the installation, so that users find it at once."""

from __future__ import annotations

import bpy

from .preferences import get_preferences
from .window_areas import list_areas
from .window_events import call_later, cancel_call

TAB = "Icy Moon"
#: Seconds between two tries, and maximum number of tries. Blender knows the tabs of a sidebar only after it has drawn
#: them.
_INTERVAL_S, _MAX_TRIES = 0.2, 50


class _RemainingTries:
    """The number of remaining tries to open the tab."""

    left = 0


def open_tab() -> float | None:
    """Open the sidebar of the largest 3D View at our tab. Returns the seconds until the next try, None after the
    last."""
    _RemainingTries.left -= 1
    areas = [area for _, area in list_areas("VIEW_3D")]
    if not areas:
        return _INTERVAL_S if _RemainingTries.left > 0 else None
    area = max(areas, key=lambda each: each.width * each.height)
    area.spaces.active.show_region_ui = True
    sidebar = next(region for region in area.regions if region.type == "UI")
    try:
        sidebar.active_panel_category = TAB
    except (TypeError, AttributeError):  # not drawn yet; in Blender 4.2 the user chooses the tab
        area.tag_redraw()
        return _INTERVAL_S if _RemainingTries.left > 0 else None
    sidebar.tag_redraw()
    return None


def _open_once() -> float | None:
    preferences = get_preferences()
    if preferences is None or preferences.tab_was_opened:
        return None
    again = open_tab()
    preferences.tab_was_opened = again is None
    return again


def register() -> None:
    """Schedule the opening of the tab if this is the first session with Icy Moon and has a window."""
    _RemainingTries.left = _MAX_TRIES
    if not bpy.app.background:
        call_later(_open_once, _INTERVAL_S)


def unregister() -> None:
    """Stop trying to open the tab."""
    cancel_call(_open_once)
