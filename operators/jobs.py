"""Jobs: long work in another process, which a modal operator watches so that the window stays usable."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import bpy

from ..render.graphics_cards import find_ticked_cards
from ..render.workers.cards import ENVIRONMENT, add_cards
from ..render.workers.detached import Detached
from ..render.workers.process import Message, Process
from ..support.errors import IcyMoonError
from .sidebar_text import in_window

_INTERVAL_S = 0.1
#: Share of a job, or seconds, from which on the remaining time is shown.
_SURE_FROM, _SURE_FROM_S = 0.1, 120.0


def environment_with_cards(device: str, environment: Mapping[str, str] | None = None) -> Mapping[str, str] | None:
    """The environment (None: ours) of a process that renders on ``device``: with the graphics cards that are ticked in
    the preferences of Blender, unless the environment names others."""
    if device != "GPU" or ENVIRONMENT in os.environ:
        return environment
    return add_cards(environment, find_ticked_cards())


def this_blender() -> str:
    """The program that starts another Blender like this one: Blender, or Python if Blender is a module of it."""
    return str(bpy.app.binary_path or sys.executable)


@dataclass
class Job:
    """One running process and its reports so far, which the panel shows."""

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
    if_stopped: str = "what was finished is kept"

    @property
    def shown(self) -> tuple[str, int, str]:
        """Text, per cent and remaining time, as the panel shows them."""
        text = "Stopping" if self.process.cancelled else self.text or self.title
        return text, int(100 * self.fraction), remaining_text(self.remaining_s)

    @property
    def remaining_s(self) -> float | None:
        """Estimate of the remaining seconds; None at first, when the start of the process would distort it."""
        past_s = time.monotonic() - self.started
        if self.fraction <= 0.02 or (self.fraction < _SURE_FROM and past_s < _SURE_FROM_S):
            return None
        return past_s * (1.0 - self.fraction) / self.fraction

    def advance(self) -> bool:
        """Handle the new messages of the process; False when it has ended."""
        running = self.process.running
        for message in self.process.poll():
            self.hear(message)
            self.handle(message)
        return running

    def hear(self, message: Message) -> None:
        """Handle one message of the process."""
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
        """Why the job failed, or an empty text if it succeeded."""
        if self.process.cancelled:
            return f"{self.title} was stopped; {self.if_stopped}."
        if self.error or self.done:
            return self.error
        return f"{self.title} ended without a result (status {self.process.returncode}): {self.process.cause}"

    def run_to_end(self) -> None:
        """Wait until the process has ended. Raises IcyMoonError if the job failed."""
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
    """'1:05 left', '2:03:20 left', or '' for None."""
    if seconds is None:
        return ""
    minutes, rest = divmod(int(seconds), 60)
    return f"{minutes}:{rest:02d} left" if minutes < 60 else f"{minutes // 60}:{minutes % 60:02d}:{rest:02d} left"


def redraw() -> None:
    """Redraw sidebars, status bar and preferences, which show the job. Views are left alone: they may take seconds."""
    for window in bpy.context.window_manager.windows:
        window.workspace.status_text_set(None)  # redraws the status bar
        for area in window.screen.areas:
            for region in area.regions:
                if (area.type, region.type) in (("VIEW_3D", "UI"), ("PREFERENCES", "WINDOW")):
                    region.tag_redraw()


def push_undo(message: str) -> None:
    """Push an undo step after a change outside Blender's own steps.

    Without it, undoing the previous step would revert this change too. Does nothing without a window, where there is
    no undo.
    """
    windows = bpy.context.window_manager.windows
    if windows and not bpy.app.background:
        with bpy.context.temp_override(window=bpy.context.window or windows[0]):
            bpy.ops.ed.undo_push(message=message)


def finish(job: Job) -> None:
    """Clean up after a job, which is then no longer the current one."""
    global current
    job.clean_up()
    if current is job:
        current = None
    redraw()


def stop_current() -> None:
    """Stop the running job, if any, before Blender ends or opens another file."""
    if current is not None:
        current.process.stop()
        finish(current)


class JobOperator:
    """Mix-in: an operator whose work runs in another process.

    ``start`` returns the job, and ``report_success`` is called after it has succeeded. From a script
    (``EXEC_DEFAULT``) the operator returns when the job has ended.
    """

    #: Whether Esc stops the job. It does not stop jobs of hours, during which the user presses Esc for other reasons.
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
        """Called repeatedly while the job runs."""

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
        self.report({"ERROR"}, in_window(error))  # type: ignore[attr-defined]
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
        """Called by Blender when the window closes, another file is opened, or the user cancels the dialog."""
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
            self.report({"WARNING"}, in_window(warning))  # type: ignore[attr-defined]
        if job.process.left:
            return {"FINISHED"}
        if job.process.cancelled:
            self.report({"WARNING"}, in_window(job.failure))  # type: ignore[attr-defined]
            return {"CANCELLED"}
        if job.failure:
            return self.fail(IcyMoonError(job.failure))
        try:
            self.report_success(context)
        except IcyMoonError as error:
            return self.fail(error)
        return {"FINISHED"}


class ICYMOON_OT_cancel(bpy.types.Operator):
    """Stop the running job. Finished pairs are kept"""

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


class ICYMOON_OT_wait(bpy.types.Operator):
    """Another job is running; wait until it has ended, or cancel it"""

    bl_idname = "icymoon.wait"
    bl_label = "Wait for the Job"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if current is not None:
            cls.poll_message_set(f"{current.title} is running")
        return False

    def execute(self, context: bpy.types.Context) -> set[str]:
        return {"CANCELLED"}


CLASSES = (ICYMOON_OT_cancel, ICYMOON_OT_wait)


@bpy.app.handlers.persistent
def _stop_before_load(*_: Any) -> None:
    stop_current()


def register() -> None:
    """Make Blender stop a running job before it opens another file."""
    bpy.app.handlers.load_pre.append(_stop_before_load)


def unregister() -> None:
    """Stop a running job and remove the handler."""
    bpy.app.handlers.load_pre.remove(_stop_before_load)
    stop_current()
