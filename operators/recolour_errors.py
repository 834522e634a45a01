"""Colour the shown errors again when the range of the colours changes, in pieces that do not hold the window.

To colour a ground of 1.4 million vertices takes a thread half a second. While a slider moves, the colours follow at
this pace, and they end at its last value. Undo and redo restore the range but not the colours made after it, so the
colours are made again.
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial

import bpy

from ..nodes import measured_surface, painted_errors
from ..settings import change_announcements
from ..support.errors import IcyMoonError
from ..support.steps import Steps, finish
from . import live_preview
from .coloured_views import shows_errors
from .render import require_scene
from .session import session
from .window_events import call_later, make_registration
from .work_in_pieces import PIECES_INTERVAL_S, WorkInPieces


def follow_colour_range(scene: bpy.types.Scene, effects: frozenset[str]) -> None:
    """Colour the shown errors again when the range of the colours changes. Without a window this is done at once."""
    if scene is None or change_announcements.COLOURS not in effects or not shows_errors(scene):
        return
    if not live_preview.has_window():
        finish(_recolour(scene.session_uid))
        return
    _schedule(scene)


def _schedule(scene: bpy.types.Scene) -> None:
    session.to_recolour.add(scene.session_uid)
    call_later(_recolour_next)


def _recolour_next() -> float | None:
    """Run the next pieces. The timer calls this until no scene waits."""
    if session.recolouring is None:
        if not session.to_recolour:
            return None
        session.recolouring = WorkInPieces(_recolour(session.to_recolour.pop()), "the colours")
    session.recolouring.poll()
    if not session.recolouring.running:
        session.recolouring = None
    return PIECES_INTERVAL_S


def _recolour(scene_uid: int) -> Steps[None]:
    """Colour the errors of a scene for its present range, in steps."""
    find_scene = partial(require_scene, scene_uid)
    with suppress(IcyMoonError, ReferenceError):  # the scene or the errors were removed meanwhile
        full_m = find_scene().icymoon.error_range_m
        yield from measured_surface.recolour_points(find_scene, full_m)
        yield from painted_errors.recolour_errors(find_scene, full_m)


def _stop_recolouring() -> None:
    """Stop the recolouring before undo, which reads the meshes anew."""
    if session.recolouring is not None:
        session.recolouring.stop()
        session.recolouring = None


def _follow_undo() -> None:
    """Colour the errors of the windows' scenes again."""
    for scene in _list_shown_scenes() if live_preview.has_window() else ():
        if shows_errors(scene):
            _schedule(scene)


def _list_shown_scenes() -> set[bpy.types.Scene]:
    """Return the scenes that the windows show."""
    return {window.scene for window in bpy.context.window_manager.windows}


register, unregister = make_registration(
    follow_colour_range,
    timers=(_recolour_next,),
    end=_stop_recolouring,
    undo_pre=_stop_recolouring,
    redo_pre=_stop_recolouring,
    undo_post=_follow_undo,
    redo_post=_follow_undo,
    load_pre=_stop_recolouring,
    load_post=_follow_undo,
)
