"""Long work in another process, watched by a modal operator that leaves the window free."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import bpy

from ..errors import IcyMoonError
from ..render.workers.detached import Detached
from ..render.workers.process import Message, Process

_INTERVAL_S = 0.1


def this_blender() -> str:
    """What starts another of this Blender; where it is a module of Python, that Python."""
    return str(bpy.app.binary_path or sys.executable)


@dataclass
class Job:
    """One running process and what it has reported so far; the panel shows it."""

    title: str
    process: Process | Detached
    handle: Callable[[Message], None]  # called with every message
    clean_up: Callable[[], None]  # called once at the end, however it ends
    started: float = field(default_factory=time.monotonic)
    fraction: float = 0.0
    text: str = ""
    error: str = ""
    warnings: list[str] = field(default_factory=list)
    done: bool = False

    @property
    def shown(self) -> tuple[str, int, str]:
        """What the panel shows of it: text, per cent, remaining time."""
        text = "Stopping" if self.process.cancelled else self.text or self.title
        return text, int(100 * self.fraction), remaining_text(self.remaining_s)

    @property
    def remaining_s(self) -> float | None:
        """Seconds that are left at the present rate, or None before there is one."""
        if self.fraction <= 0.02:
            return None
        return (time.monotonic() - self.started) * (1.0 - self.fraction) / self.fraction

    def advance(self) -> bool:
        """Take in what the process has reported; False when it has ended."""
        running = self.process.running
        for message in self.process.poll():
            self.hear(message)
            self.handle(message)
        return running

    def hear(self, message: Message) -> None:
        """Take in one thing that the process has reported."""
        kind = message["type"]
        if kind == "progress":
            self.fraction = float(message["fraction"])
            self.text = str(message["message"])
        elif kind == "warning":
            self.warnings.append(str(message["message"]))
        elif kind == "error":
            self.error = str(message["message"])
        elif kind in ("done", "result"):
            self.done = True

    @property
    def failure(self) -> str:
        """Why it did not do its work, or an empty text if it did."""
        if self.process.cancelled:
            return f"{self.title} was stopped; what was finished is kept."
        if self.error or self.done:
            return self.error
        return f"{self.title} ended without a result (status {self.process.returncode}): {self.process.last_line}"

    def run_to_end(self) -> None:
        """Wait until it has ended. Raises IcyMoonError if it failed."""
        try:
            while self.advance():
                time.sleep(_INTERVAL_S)
        finally:
            self.process.stop()
            self.clean_up()
        if self.failure:
            raise IcyMoonError(self.failure)


current: Job | None = None


def remaining_text(seconds: float | None) -> str:
    """'1:05 left', '2:03:20 left', or '' while it is not known."""
    if seconds is None:
        return ""
    minutes, rest = divmod(int(seconds), 60)
    return f"{minutes}:{rest:02d} left" if minutes < 60 else f"{minutes // 60}:{minutes % 60:02d}:{rest:02d} left"


def redraw() -> None:
    """Draw what shows the job again: sidebars, status bar, preferences; not the views, which may take seconds."""
    for window in bpy.context.window_manager.windows:
        window.workspace.status_text_set(None)  # which has the status bar drawn anew
        for area in window.screen.areas:
            for region in area.regions:
                if (area.type, region.type) in (("VIEW_3D", "UI"), ("PREFERENCES", "WINDOW")):
                    region.tag_redraw()


def push_undo(message: str) -> None:
    """Take an undo step of what was changed outside one that Blender takes, or undo would take it back along with the
    step before. Nothing without a window, where there is no undo."""
    windows = bpy.context.window_manager.windows
    if windows and not bpy.app.background:
        with bpy.context.temp_override(window=bpy.context.window or windows[0]):
            bpy.ops.ed.undo_push(message=message)


def finish(job: Job) -> None:
    """Release what a job holds."""
    global current
    job.clean_up()
    if current is job:
        current = None
    redraw()


def stop_current() -> None:
    """Stop the running job, if any: Blender is about to end or to open another file."""
    if current is not None:
        current.process.stop()
        finish(current)


class JobOperator:
    """Mix-in of an operator whose work runs in another process.

    ``start`` returns the job; ``report_success`` is called when it has done its work. From a script
    (``EXEC_DEFAULT``) the operator returns when the work is done.
    """

    #: Whether Esc stops it. Not what runs for hours while the user goes on working, in which Esc means other things.
    escapes = True
    _timer: Any = None
    _job: Job

    def start(self, context: bpy.types.Context) -> Job:
        raise NotImplementedError

    def run_blocking(self, context: bpy.types.Context) -> None:
        self.start(context).run_to_end()
        self.report_success(context)

    def report_success(self, context: bpy.types.Context) -> None:
        raise NotImplementedError

    def watch(self, context: bpy.types.Context) -> None:
        """Called again and again while it runs."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if current is not None:
            cls.poll_message_set(f"{current.title} is running")  # type: ignore[attr-defined]
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self.run_blocking(context)
        except IcyMoonError as error:
            return self.fail(error)
        return {"FINISHED"}

    def fail(self, error: Exception) -> set[str]:
        """Report an error to the user and cancel."""
        self.report({"ERROR"}, str(error))  # type: ignore[attr-defined]
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        global current
        if bpy.app.background:
            return self.execute(context)
        try:
            self._job = current = self.start(context)
        except IcyMoonError as error:
            return self.fail(error)
        manager = context.window_manager
        self._timer = manager.event_timer_add(_INTERVAL_S, window=context.window)
        manager.modal_handler_add(self)
        manager.progress_begin(0, 1000)
        redraw()
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.escapes and event.type == "ESC" and event.value == "PRESS":
            self._job.process.cancel()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        self.watch(context)
        before = self._job.shown
        running = self._job.advance()
        if self._job.shown != before:
            context.window_manager.progress_update(int(1000 * self._job.fraction))
            redraw()
        if running:
            return {"PASS_THROUGH"}
        return self._end(context)

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when the window closes or another file is opened, or a dialog before any work."""
        if self._timer is None:
            return
        self._job.process.stop()
        self._end(context)

    def _end(self, context: bpy.types.Context) -> set[str]:
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        job = self._job
        finish(job)
        for warning in job.warnings:
            self.report({"WARNING"}, warning)  # type: ignore[attr-defined]
        if job.process.left:
            return {"FINISHED"}
        if job.process.cancelled:
            self.report({"WARNING"}, job.failure)  # type: ignore[attr-defined]
            return {"CANCELLED"}
        if job.failure:
            return self.fail(IcyMoonError(job.failure))
        try:
            self.report_success(context)
        except IcyMoonError as error:
            return self.fail(error)
        return {"FINISHED"}


class ICYMOON_OT_cancel(bpy.types.Operator):
    """Stop the running work; what is finished is kept"""

    bl_idname = "icymoon.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if current is None:
            cls.poll_message_set("Nothing is running")
        return current is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        assert current is not None
        current.process.cancel()
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_cancel,)


@bpy.app.handlers.persistent
def _stop_before_load(*_: Any) -> None:
    stop_current()


def register() -> None:
    """Stop a running job before another file is opened."""
    bpy.app.handlers.load_pre.append(_stop_before_load)


def unregister() -> None:
    """Stop a running job and listen no longer."""
    bpy.app.handlers.load_pre.remove(_stop_before_load)
    stop_current()
