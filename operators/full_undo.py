"""Make undo read all data-blocks anew after a change that no undo step holds.

Blender's undo keeps the data-blocks that are the same in two neighbouring steps. The fine ground gives objects new data
without an undo step, see ``refine_ground``. Undo would keep such an object and free its new data, and Blender would
crash when it draws the object. With Blender's option *Undo Legacy*, undo keeps no data-blocks. This takes longer, so
the option is on during such an undo only.
"""

from __future__ import annotations

import bpy

from .session import session
from .window_events import make_registration


def require_full_undo() -> None:
    """Let the next undo or redo read all data-blocks anew."""
    session.changed_without_step = True


def _begin() -> None:
    """Switch *Undo Legacy* on, and Blender's options for developers, without which it has no effect."""
    if not session.changed_without_step or session.options_before_undo is not None:
        return
    preferences = bpy.context.preferences
    session.options_before_undo = (
        preferences.view.show_developer_ui,
        preferences.experimental.use_undo_legacy,
        preferences.is_dirty,
    )
    preferences.view.show_developer_ui = preferences.experimental.use_undo_legacy = True


def _end() -> None:
    """Restore the options. Outside Object Mode undo reads no data-blocks, as in sculpting, so the next undo must read
    them."""
    if session.options_before_undo is None:
        return
    preferences = bpy.context.preferences
    shown, legacy, dirty = session.options_before_undo
    preferences.view.show_developer_ui, preferences.experimental.use_undo_legacy = shown, legacy
    preferences.is_dirty, session.options_before_undo = dirty, None
    session.changed_without_step = bpy.context.mode != "OBJECT"


register, unregister = make_registration(undo_pre=_begin, redo_pre=_begin, undo_post=_end, redo_post=_end, end=_end)
