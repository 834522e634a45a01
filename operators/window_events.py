"""Follow the events of the window: changes of settings, Blender's handlers and timers; and cache values until such an
event."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import bpy

from ..settings import change_announcements

_T = TypeVar("_T")
Function = Callable[[], Any]
_known: dict[Hashable, Any] = {}


def make_registration(
    changes: Callable[[Any, frozenset[str]], None] | None = None,
    timers: tuple[Function, ...] = (),
    end: Function | None = None,
    **handlers: Function,
) -> tuple[Callable[[], None], Callable[[], None]]:
    """Make the functions ``register`` and ``unregister`` of a module that follows events.

    ``changes`` is a listener of changed settings. ``handlers`` are called at Blender's events of their names, such as
    ``load_pre``. ``unregister`` cancels the ``timers`` and then calls ``end``.
    """
    added = {name: _persistent(function) for name, function in handlers.items()}

    def register() -> None:
        if changes is not None:
            change_announcements.listeners.append(changes)
        for name, function in added.items():
            getattr(bpy.app.handlers, name).append(function)

    def unregister() -> None:
        for name, function in added.items():
            getattr(bpy.app.handlers, name).remove(function)
        if changes is not None:
            change_announcements.listeners.remove(changes)
        for timer in timers:
            cancel_call(timer)
        if end is not None:
            end()

    return register, unregister


def _persistent(function: Function) -> Callable[..., None]:
    @bpy.app.handlers.persistent
    def handle(*_: object) -> None:
        function()

    return handle


def call_later(function: Function, seconds: float = 0.0) -> None:
    """Let Blender call a function after some seconds, and again after the seconds that it returns. Does nothing if a
    call is scheduled already."""
    if not bpy.app.timers.is_registered(function):
        bpy.app.timers.register(function, first_interval=seconds)


def cancel_call(function: Function) -> None:
    """Cancel the scheduled calls of a function by ``call_later``."""
    if bpy.app.timers.is_registered(function):
        bpy.app.timers.unregister(function)


def keep_until_change(key: Hashable, make: Callable[[], _T]) -> _T:
    """Return the value of ``make``, called once for each ``key``. The value is cached until a setting changes, undo or
    redo runs, or another file is opened."""
    if key not in _known:
        _known[key] = make()
    found: _T = _known[key]
    return found


register, unregister = make_registration(
    changes=lambda *_: _known.clear(),
    end=_known.clear,
    undo_post=_known.clear,
    redo_post=_known.clear,
    load_post=_known.clear,
)
