"""Check, by a timer, jobs whose operators get no more events from Blender, so that no job runs for ever.

Blender drops a modal operator that raises an exception, without calling its ``cancel`` (seen in 4.3 and 5.2), so
``WatchingOperator`` lets no exception out. The events of the operator's timer continue through undo, redo, another
workspace and a closed area, and Blender cancels the operators of a closed window or file. The timer of this module is
for faults that are not known yet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from .jobs import Job
from .session import session
from .sidebar_text import format_for_window
from .window_areas import redraw_panels
from .window_events import call_later, make_registration

#: Seconds between two checks of all jobs.
INTERVAL_S = 0.5
#: Number of timer turns without an event after which a job is unseen. A slow window has few turns, so its jobs do not
#: count as unseen.
MAX_TURNS = 20


@dataclass
class Watch:
    """A running operator and its job. ``turns`` counts the timer's turns since the operator's last event."""

    operator: Any
    job: Job
    turns: int = 0
    ended: bool = False

    @property
    def is_seen(self) -> bool:
        """Whether the operator still gets events."""
        return self.turns < MAX_TURNS


_watches: list[Watch] = []


def watch(operator: Any, job: Job) -> Watch:
    """Watch the job of an operator that has begun to wait for events."""
    found = Watch(operator, job)
    _watches.append(found)
    call_later(_look_after_jobs, INTERVAL_S)
    return found


def close_job(job: Job) -> None:
    """Stop a job, so that other jobs can start."""
    for name in ("job", "reading", "developing", "building", "painting", "meshing"):
        if getattr(session, name) is job:
            setattr(session, name, None)
    redraw_panels()
    job.close()


def is_freed(operator: Any) -> bool:
    """Return whether Blender has freed an operator, so that none of its properties can be read."""
    try:
        operator.bl_idname  # noqa: B018
    except ReferenceError:
        return True
    except AttributeError:  # not an operator of Blender
        pass
    return False


def _look_after_jobs() -> float | None:
    """Check the jobs whose operators get no events. The timer stops when no job runs."""
    _watches[:] = [each for each in _watches if not each.ended]
    for each in _watches[:]:
        each.turns += 1
        if not each.is_seen:
            _look_instead(each)
    return INTERVAL_S if _watches else None


def _look_instead(found: Watch) -> None:
    """Check a job as its operator would. If the operator is gone, close the job and report it."""
    windows = bpy.context.window_manager.windows
    if is_freed(found.operator) or not windows:
        found.ended = True
        close_job(found.job)
        if windows:
            with bpy.context.temp_override(window=windows[0]):
                _show_sentence(f"{found.job.title} was stopped, because its window is gone; {found.job.if_stopped}.")
        return
    with bpy.context.temp_override(window=windows[0]):
        found.operator.look_or_end(bpy.context)


def _show_sentence(sentence: str) -> None:
    """Show a sentence in a window in which no operator can report."""

    def draw(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
        menu.layout.label(text=format_for_window(sentence))

    bpy.context.window_manager.popup_menu(draw, title="Icy Moon", icon="ERROR")


def _end_all() -> None:
    """End all watched jobs, before Icy Moon is disabled or after another file was opened."""
    for each in _watches:
        if not each.ended:
            each.ended = True
            close_job(each.job)
    _watches.clear()


register, unregister = make_registration(timers=(_look_after_jobs,), end=_end_all, load_post=_end_all)
