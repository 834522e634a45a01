"""Operators that start a job in another process and run until it ends, so that the window stays usable."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable

import bpy

from ..render.workers.process import Message
from ..support.errors import IcyMoonError
from ..support.steps import Steps, finish
from . import jobs, unseen_jobs
from .operator_type import ExplainedOperator
from .session import session
from .sidebar_text import format_for_window
from .window_areas import redraw_panels
from .work_in_pieces import PIECES_INTERVAL_S, WorkInPieces


def _notice_button(event: bpy.types.Event) -> None:
    """Remember whether the left mouse button is down. While a field is dragged or typed in, Blender sends operators
    nothing but timers, so the press is the last event until the field is left."""
    if event.type == "LEFTMOUSE":
        session.pressed_s = time.monotonic() if event.value == "PRESS" else None
    elif event.type == "MOUSEMOVE":
        session.pressed_s = None


class WatchingOperator(ExplainedOperator):
    """Mix-in: an operator whose work is a job.

    ``start`` returns the job, and ``report_success`` is called after it has succeeded. From a script
    (``EXEC_DEFAULT``) the operator returns when the job has ended. If Blender sends no more events, ``unseen_jobs``
    looks at the job instead.
    """

    #: Seconds between two looks at the job.
    interval_s = jobs.INTERVAL_S
    bl_label: str
    _timer: bpy.types.Timer | None = None
    _job: jobs.Job | None = None
    _watch: unseen_jobs.Watch | None = None

    def start(self, context: bpy.types.Context) -> jobs.Job:
        """Start the job. Raises IcyMoonError if it cannot start."""
        raise NotImplementedError

    def report_success(self, context: bpy.types.Context) -> None:
        """Use the results of the job. Raises IcyMoonError if that fails."""
        raise NotImplementedError

    def begin(self, context: bpy.types.Context) -> jobs.Job:
        """Start the job from the window; by default as ``start`` does."""
        return self.start(context)

    def run_blocking(self, context: bpy.types.Context) -> None:
        """Run the job to its end. Raises IcyMoonError if it fails."""
        self._job = self.start(context)
        self._job.run_to_end()
        self.report_success(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self.run_blocking(context)
        except IcyMoonError as error:
            return self.fail(error)
        return {"FINISHED"}

    def fail(self, error: Exception) -> set[str]:
        """Report an error to the user and cancel. The sidebar names what failed."""
        if self._job is not None:
            session.note_end(self._job, "failed")
        else:
            session.note_failure(self.bl_label, bpy.context.scene.session_uid)
        redraw_panels()
        self.report({"ERROR"}, format_for_window(error))
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event | None) -> set[str]:
        if bpy.app.background:
            return self.execute(context)
        try:
            self._job = self.begin(context)
        except IcyMoonError as error:
            return self.fail(error)
        manager = context.window_manager
        self._timer = manager.event_timer_add(self.interval_s, window=context.window)
        manager.modal_handler_add(self)
        self._watch = unseen_jobs.watch(self, self._job)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        assert self._watch is not None
        if self._watch.ended:  # by ``unseen_jobs``
            return {"FINISHED"}
        if event.type != "TIMER":
            _notice_button(event)
            return {"PASS_THROUGH"}
        self._watch.turns = 0
        return self.look_or_end(context) or {"PASS_THROUGH"}

    def look_or_end(self, context: bpy.types.Context) -> set[str]:
        """Look at the job, and end the operator if the job has ended. Returns the operator's result, empty while the
        job runs.

        A defect of ours ends the job too. Otherwise each look would meet it again, and no other job could start.
        """
        try:
            return set() if self.look(context) else self.end(context)
        except Exception as error:
            if unseen_jobs.is_freed(self):
                raise
            traceback.print_exc()
            return self.give_up(context, error)

    def give_up(self, context: bpy.types.Context, error: Exception) -> set[str]:
        """End the job because of a defect, with a sentence."""
        assert self._job is not None
        self._leave_events(context)
        unseen_jobs.close_job(self._job)
        return self.fail(
            IcyMoonError(
                f"{self._job.title} was ended by an error ({type(error).__name__}: {error}); start it again, and "
                "please "
                "report this."
            )
        )

    def look(self, context: bpy.types.Context) -> bool:
        """Check the job; this is called repeatedly. False when the job has ended."""
        assert self._job is not None
        return self._job.poll()

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when the window closes, another file is opened, or the user cancels the dialog."""
        if self._timer is not None:
            try:
                self.end(context)
            except Exception as error:
                traceback.print_exc()
                self.give_up(context, error)

    def _leave_events(self, context: bpy.types.Context) -> None:
        """Stop receiving events. A timer whose events have stopped may be freed already, so it is not removed."""
        if self._watch is not None:
            if self._watch.is_seen and self._timer is not None:
                context.window_manager.event_timer_remove(self._timer)
            self._watch.ended = True
        self._timer = None

    def end(self, context: bpy.types.Context) -> set[str]:
        """Stop the job if it has not ended, and report its success or failure."""
        assert self._job is not None
        self._leave_events(context)
        self._job.close()
        self.report_end(context)
        if self._job.process.left:
            return {"FINISHED"}
        if self._job.process.cancelled:
            return {"CANCELLED"}
        try:
            if self._job.failure:
                raise IcyMoonError(self._job.failure)
            self.report_success(context)
        except IcyMoonError as error:
            return self.fail(error)
        return {"FINISHED"}

    def report_end(self, context: bpy.types.Context) -> None:
        """Called when the job has ended, with or without success."""


class PiecewiseOperator(WatchingOperator):
    """Mix-in: an operator that works on the scene in pieces, so that the window stays usable."""

    interval_s = PIECES_INTERVAL_S
    bl_label: str

    def make_steps(self, context: bpy.types.Context, report: Callable[[float, str], object]) -> Steps[None]:
        """The work, in steps, of which the last alone changes the scene. Raises IcyMoonError if it fails.

        Any thread may ``report`` the finished share, 0 to 1, and the present work.
        """
        raise NotImplementedError

    def start(self, context: bpy.types.Context) -> jobs.Job:
        """Start to work in pieces."""
        reports = list[Message]()

        def report(fraction: float, text: str) -> None:
            reports.append({"type": "progress", "fraction": fraction, "message": text})

        work = WorkInPieces(self.make_steps(context, report), self.bl_label, reports)
        return jobs.Job(self.bl_label, work, if_stopped="the scene is as before")

    def run_blocking(self, context: bpy.types.Context) -> None:
        """Work to the end. Raises IcyMoonError if that fails."""
        finish(self.make_steps(context, lambda *_: None))

    def report_success(self, context: bpy.types.Context) -> None:
        """The steps have reported it."""


class KeyStoppedOperator(WatchingOperator):
    """Mix-in: an operator whose job Esc and Ctrl Z stop at once."""

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        is_undo = event.type == "Z" and (event.ctrl or event.oskey) and not event.shift
        assert self._job is not None
        if event.value != "PRESS" or not (event.type == "ESC" or is_undo) or not self._job.process.running:
            return super().modal(context, event)
        self._job.cancel()
        self.clean_up_after_stop()
        return {"RUNNING_MODAL"}  # the next look ends the operator

    def clean_up_after_stop(self) -> None:
        """Take back what the operator has changed before its job."""


def find_running_job() -> str:
    """A text that the job of the sidebar is running; empty without a job."""
    return f"{session.job.title} is running" if session.job is not None else ""


class JobOperator(WatchingOperator):
    """Mix-in: an operator whose job the sidebar shows. There is one such job at a time."""

    #: Whether Esc, pressed twice, stops the job. Esc never stops jobs of hours.
    stops_on_escape = True
    _job: jobs.Job
    _shown: tuple[str, ...] = ()

    def watch(self, context: bpy.types.Context) -> None:
        """Called repeatedly while the job runs."""

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return find_running_job()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event | None) -> set[str]:
        result = super().invoke(context, event)
        if result == {"RUNNING_MODAL"}:
            session.job = self._job
            context.window_manager.progress_begin(0, 1000)
            redraw_panels()
        return result

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # Blender sends a quick second press first as a double click, and then as a press if no one handles the double
        # click.
        if self.stops_on_escape and event.type == "ESC" and event.value == "PRESS" and not event.is_repeat:
            stops = self._job.escape()
            redraw_panels()
            return {"RUNNING_MODAL"} if stops else {"PASS_THROUGH"}
        return super().modal(context, event)

    def look(self, context: bpy.types.Context) -> bool:
        """Check the job, and show its progress."""
        self.watch(context)
        running = super().look(context)
        if (shown := self._job.shown) != self._shown:
            self._shown = shown
            context.window_manager.progress_update(int(1000 * self._job.fraction))
            redraw_panels()
        return running

    def report_end(self, context: bpy.types.Context) -> None:
        """Take the job from the sidebar, and report its warnings."""
        context.window_manager.progress_end()
        if session.job is self._job:
            session.job = None
        session.note_end(self._job)
        redraw_panels()
        for warning in self._job.warnings:
            self.report({"WARNING"}, format_for_window(warning))
        if self._job.process.cancelled and not self._job.process.left:
            self.report({"WARNING"}, format_for_window(self._job.failure))


class PreparingOperator(JobOperator):
    """Mix-in: an operator that prepares its job in pieces, so that the window stays usable."""

    interval_s = PIECES_INTERVAL_S
    bl_label: str
    _prepares = False

    def prepare(self, context: bpy.types.Context) -> Steps[jobs.Job]:
        """Start the job, in steps. Raises IcyMoonError if it cannot start."""
        raise NotImplementedError

    def start(self, context: bpy.types.Context) -> jobs.Job:
        return finish(self.prepare(context))

    def begin(self, context: bpy.types.Context) -> jobs.Job:
        """Start to prepare the job."""
        self._prepares = True
        work = WorkInPieces(self.prepare(context), self.bl_label)
        return jobs.Job(self.bl_label, work, if_stopped="nothing was begun")

    def look(self, context: bpy.types.Context) -> bool:
        """Check the job, and go on with the prepared one."""
        running = super().look(context)
        if running or not self._prepares or self._job.failure:
            return running
        self._prepares, job = False, self._job.result["value"]
        if session.job is self._job:
            session.job = job
        self._job = job
        if self._watch is not None:
            self._watch.job = job
        self._change_interval(context, jobs.INTERVAL_S)
        return True

    def give_up(self, context: bpy.types.Context, error: Exception) -> set[str]:
        """End the job because of a defect, also the prepared job of which this operator has not heard yet."""
        if self._prepares and self._job.result:
            self._job.result["value"].close()
        return super().give_up(context, error)

    def _change_interval(self, context: bpy.types.Context, seconds: float) -> None:
        """Look at the job after other times from now on. A timer whose events have stopped may be freed already."""
        if self._timer is not None and self._watch is not None and self._watch.is_seen:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = context.window_manager.event_timer_add(seconds, window=context.window)


class DialogJobOperator(JobOperator):
    """Mix-in: an operator that asks in a dialog of its properties before it starts its job."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event | None) -> set[str]:
        if bpy.app.background:
            return self.execute(context)
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Called after the dialog: starts the job."""
        if bpy.app.background:
            return super().execute(context)
        return super().invoke(context, None)


class ICYMOON_OT_cancel(ExplainedOperator, bpy.types.Operator):
    """Stop the running job. Finished pairs are kept"""

    bl_idname = "icymoon.cancel"
    bl_label = "Stop"

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if session.job is not None else "Nothing is running"

    def execute(self, context: bpy.types.Context) -> set[str]:
        assert session.job is not None
        session.job.cancel()
        return {"FINISHED"}


class ICYMOON_OT_wait(ExplainedOperator, bpy.types.Operator):
    """Another job is running; wait until it has ended, or cancel it"""

    bl_idname = "icymoon.wait"
    bl_label = "Wait for the Job"
    bl_options = {"INTERNAL"}

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return find_running_job() or "No job is running"

    def execute(self, context: bpy.types.Context) -> set[str]:
        return {"CANCELLED"}


CLASSES = (ICYMOON_OT_cancel, ICYMOON_OT_wait)
