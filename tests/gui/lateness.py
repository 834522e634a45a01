"""Counts how long the extension holds the window; runs inside Blender.

The event loop calls a timer in each of its turns. Between two calls the processor time of Blender's own thread is
what the turn took, whatever else the machine does. It has two parts: that of the extension (its operators, timers,
listeners and panels), and the remainder, which is Blender's: drawing, evaluating the scene, steps of undo. Without a
graphics card drawing takes most of a turn.

With ICYMOON_LATE_PROFILE in the environment, late.json also names the functions that took longest in the longest turn
of each action. To watch all functions makes each turn longer.
"""

from __future__ import annotations

import cProfile
import functools
import json
import os
import pstats
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
from person import ADD_ON

#: A turn in which the extension works longer is late.
LATE_S = 0.1
_TICK_S = 0.002
#: Least time of a function that the profile of a turn names, ms.
_PROFILED_MS = 5.0
#: Methods of operators and panels that Blender calls.
_METHODS = ("invoke", "execute", "modal", "draw", "draw_header", "draw_header_preset", "cancel")
#: Functions that the extension gives to timers, by their modules.
_TIMERS = (
    ("operators.refine_ground", "_refine_next"),
    ("operators.live_preview", "show_waiting"),
    ("operators.live_exposure", "develop_waiting"),
)


class Lateness:
    """The turns of the event loop by action: how many were late, and the longest of each part, s."""

    def __init__(self) -> None:
        self.action = ""
        self.rows: dict[str, dict[str, Any]] = {}
        self._ours_s = 0.0
        self._depth = 0
        self._longest_call = ("", 0.0)
        self._since_s = time.thread_time()
        self._profile = cProfile.Profile(time.thread_time) if "ICYMOON_LATE_PROFILE" in os.environ else None

    def start(self) -> None:
        """Watch the extension, and count from now on."""
        for kind in _list_classes():
            for name in _METHODS:
                if name in vars(kind) or (kind.__module__.startswith(ADD_ON) and hasattr(kind, name)):
                    setattr(kind, name, _as_method(self._watch(getattr(kind, name), f"{kind.__name__}.{name}"), name))
        for module, name in _TIMERS:
            found = sys.modules[f"{ADD_ON}.{module}"]
            setattr(found, name, self._watch(getattr(found, name), name))
        self._listeners[:] = [self._watch(each, each.__name__) for each in self._listeners]
        bpy.app.timers.register(self._tick, first_interval=0.0)

    @property
    def _listeners(self) -> list[Callable[..., Any]]:
        """The functions of the extension that learn of changed settings."""
        found: list[Callable[..., Any]] = sys.modules[f"{ADD_ON}.settings.change_announcements"].listeners
        return found

    def leave_listeners(self) -> None:
        """Give the extension its own listeners back, which it removes when it ends."""
        self._listeners[:] = [getattr(each, "__wrapped__", each) for each in self._listeners]

    def count(self, action: str) -> None:
        """Count for another action from now on; for none if it is empty."""
        self._end_turn()
        self.action = action

    def _watch(self, function: Callable[..., Any], name: str) -> Callable[..., Any]:
        @functools.wraps(function)
        def timed(*words: Any, **options: Any) -> Any:
            if threading.current_thread() is not threading.main_thread() or self._depth:
                return function(*words, **options)
            self._depth, began = 1, time.thread_time()
            try:
                if self._profile is not None:
                    return self._profile.runcall(function, *words, **options)
                return function(*words, **options)
            finally:
                took = time.thread_time() - began
                self._depth, self._ours_s = 0, self._ours_s + took
                self._longest_call = max(self._longest_call, (name, took), key=lambda each: each[1])

        return timed

    def _tick(self) -> None:
        """End the turn. Registered anew, it runs after all other timers of a turn: between two of them it would count
        the second one of a turn and the first one of the next turn as one."""
        self._end_turn()
        bpy.app.timers.register(self._tick, first_interval=_TICK_S)

    def _end_turn(self) -> None:
        now = time.thread_time()
        whole_s, ours_s, call = now - self._since_s, self._ours_s, self._longest_call
        self._since_s, self._ours_s, self._longest_call = now, 0.0, ("", 0.0)
        functions = _list_functions(self._profile)
        if not self.action:
            return
        row = self.rows.setdefault(
            self.action,
            {"turns": 0, "late": 0, "longest_s": 0.0, "in": "", "ours_s": 0.0, "late_with_blender": 0, "whole_s": 0.0},
        )
        row["turns"] += 1
        row["late"] += ours_s > LATE_S
        row["late_with_blender"] += whole_s > LATE_S
        row["ours_s"] += ours_s
        row["whole_s"] = max(row["whole_s"], whole_s)
        if ours_s > row["longest_s"]:
            row["longest_s"], row["in"] = ours_s, call[0]
            row |= {"functions": functions} if functions else {}

    def write(self, path: Path) -> None:
        """Write the table as JSON."""
        path.write_text(json.dumps(self.rows, indent=1))

    def summarize(self) -> str:
        """The table as lines of text."""
        return "\n".join(
            f"{action:46s} {row['late']:2d} of {row['turns']:4d} turns late, longest {1e3 * row['longest_s']:5.0f} ms "
            f"({row['in']}), {row['ours_s']:.1f} s in all; with Blender {row['late_with_blender']:3d} late, "
            f"{1e3 * row['whole_s']:.0f} ms"
            for action, row in self.rows.items()
        )


def _list_functions(profile: cProfile.Profile | None) -> list[str]:
    """The functions of a turn that took longest with those that they called, ms; the profile begins anew."""
    if profile is None or not profile.getstats():
        return []
    found = pstats.Stats(profile).stats.items()  # type: ignore[attr-defined]
    profile.clear()
    took = sorted(
        ((1e3 * each[3], f"{Path(file).name}:{line} {name}") for (file, line, name), each in found), reverse=True
    )
    return [f"{ms:.0f} {name}" for ms, name in took if ms >= _PROFILED_MS]


def _as_method(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """A function with the parameters that Blender counts before it calls a method of this name."""
    if name in ("invoke", "modal"):
        return lambda self, context, event: function(self, context, event)
    return lambda self, context: function(self, context)


def _list_classes() -> Iterator[type]:
    """The operators, panels, menus and lists of the extension."""
    for name in dir(bpy.types):
        kind = getattr(bpy.types, name)
        if isinstance(kind, type) and kind.__module__.startswith(ADD_ON):
            yield kind
