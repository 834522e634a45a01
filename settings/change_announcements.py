"""Announces changes of settings to listeners.

This module must not use Blender, because Blender as a module keeps the update functions of properties until the end. If
these functions referred to ``bpy`` in any way, ``bpy`` could not be freed, and Blender 4.2 would crash when Python
ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

#: The effect of a change of the colours by which errors are shown; no setting has it.
COLOURS = "colours"
#: The effect of a change in the display of a LiDAR's points; no setting has it.
LIDAR_POINTS = "lidar points"
#: A function that is called with a scene and the effects of the settings that changed in it.
listeners: list[Callable[[Any, frozenset[str]], None]] = []


@dataclass
class _State:
    count: int = 0  # number of the changes so far
    held: dict[Any, set[str]] | None = None  # effects that ``batch_changes`` holds back, by scene


_state = _State()


def count_changes() -> int:
    """Return the number of changes so far, including those that ``batch_changes`` holds back."""
    return _state.count


def announce(scene: object, effect: str) -> None:
    """Tell the listeners that a setting with this effect has changed."""
    _state.count += 1
    if _state.held is not None:
        _state.held.setdefault(scene, set()).add(effect)
        return
    for listener in listeners:
        listener(scene, frozenset({effect}))


@contextmanager
def batch_changes() -> Iterator[None]:
    """Hold changes back in this context, and announce them together at its end."""
    if _state.held is not None:
        yield
        return
    held = _state.held = dict[Any, set[str]]()
    try:
        yield
    finally:
        _state.held = None
        for scene, effects in held.items():
            for listener in listeners:
                listener(scene, frozenset(effects))


def make_update_callback(effect: str) -> Callable[[Any, Any], None]:
    """Make the ``update`` function of a Blender property of a scene; it announces the property's changes."""

    def update(group: Any, context: object) -> None:
        announce(group.id_data, effect)

    return update
