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
    only timer events, so the press is the last event until the field is left."""
    if event.type == "LEFTMOUSE":
        session.pressed_s = time.monotonic() if event.value == "PRESS" else None
    elif event.type == "MOUSEMOVE":
        session.pressed_s = None


class WatchingOperator(ExplainedOperator):
    """Mix-in: an operator whose work is a job.

    ``start`` returns the job, and ``report_success`` is called after the job has succeeded. From a script
    (``EXEC_DEFAULT``) the operator returns when the job has ended. If Blender sends no more events, ``unseen_jobs``
    checks the job instead.
    """

    #: Seconds between two checks of the job.
    interval_s = jobs.INTERVAL_S
    bl_label: str
    _timer: bpy.types.Timer | None = None
    _job: jobs.Job | None = None
    _watch: unseen_jobs.Watch | None = None

    def start(self, context: bpy.types.Context) -> jobs.Job:
        """Start the job. Raises IcyMoonError if it cannot start."""
        raise NotImplementedError

    def report_success(self, context: bpy.types.Context) -> None:
        """Use the results of the job. Raises IcyMoonError if they cannot be used."""
        raise NotImplementedError

    def begin(self, context: bpy.types.Context) -> jobs.Job:
        """Start the job from the window; by default by ``start``."""
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
        """Report an error to the user, name the failed work in the sidebar, and cancel."""
        if self._job is not None:
            session.note_end(self._job, "failed")
        else:
            session.note(self.bl_label, "failed", bpy.context.scene.session_uid)
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
        """Check the job, and end the operator if the job has ended. Returns the operator's result; empty while the job
        runs.

        A defect of Icy Moon ends the job too. Otherwise each check would meet the defect again, and no other job could
        start.
        """
        try:
            return set() if self.look(context) else self.end(context)
        except Exception as error:
            if unseen_jobs.is_freed(self):
                raise
            traceback.print_exc()
            return self.give_up(context, error)

    def give_up(self, context: bpy.types.Context, error: Exception) -> set[str]:
        """End the job because of a defect, and report the defect."""
        assert self._job is not None
        self._leave_events(context)
        unseen_jobs.close_job(self._job)
        return self.fail(
            IcyMoonError(
                f"{self._job.title} was ended by an error ({type(error).__name__}: {error}); start it again, and "
                "please report this."
            )
        )

    def look(self, context: bpy.types.Context) -> bool:
        """Check the job; a timer calls this repeatedly. Return False when the job has ended."""
        assert self._job is not None
        return self._job.poll()

    def cancel(self, context: bpy.types.Context) -> None:
        """End the job. Blender calls this when the window closes, another file is opened, or the user cancels the
        dialog."""
        if self._timer is not None:
            try:
                self.end(context)
            except Exception as error:
                traceback.print_exc()
                self.give_up(context, error)

    def _leave_events(self, context: bpy.types.Context) -> None:
        """Stop receiving events. The timer is not removed if its events have stopped, because it may be freed
        already."""
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
        """Handle the end of the job, with or without success."""


class PiecewiseOperator(WatchingOperator):
    """Mix-in: an operator that works on the scene in pieces, so that the window stays usable."""

    interval_s = PIECES_INTERVAL_S
    bl_label: str

    def make_steps(self, context: bpy.types.Context, report: Callable[[float, str], object]) -> Steps[None]:
        """Make the steps of the work; only the last one changes the scene. Raises IcyMoonError if the work fails.

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
        """Do all the work at once. Raises IcyMoonError if the work fails."""
        finish(self.make_steps(context, lambda *_: None))

    def report_success(self, context: bpy.types.Context) -> None:
        """Report nothing, because the steps have reported their success."""


class KeyStoppedOperator(WatchingOperator):
    """Mix-in: an operator whose job Esc and Ctrl Z stop at once."""

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        is_undo = event.type == "Z" and (event.ctrl or event.oskey) and not event.shift
        assert self._job is not None
        if event.value != "PRESS" or not (event.type == "ESC" or is_undo) or not self._job.process.running:
            return super().modal(context, event)
        self._job.cancel()
        self.clean_up_after_stop()
        return {"RUNNING_MODAL"}  # the next check ends the operator

    def clean_up_after_stop(self) -> None:
        """Take back the changes that the operator made before its job."""


def find_running_job() -> str:
    """Return a text that names the running job of the sidebar; empty without a job."""
    return f"{session.job.title} is running" if session.job is not None else ""


class JobOperator(WatchingOperator):
    """Mix-in: an operator whose job the sidebar shows. Only one such job can run at a time."""

    #: Whether Esc, pressed twice, stops the job. It is False for jobs that take hours.
    stops_on_escape = True
    _job: jobs.Job
    _shown: tuple[str, ...] = ()

    def watch(self, context: bpy.types.Context) -> None:
        """Follow the running job; each check of the job calls this first."""

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
        """Remove the job from the sidebar, and report its warnings."""
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
        """Prepare and start the job in steps. Raises IcyMoonError if it cannot start."""
        raise NotImplementedError

    def start(self, context: bpy.types.Context) -> jobs.Job:
        return finish(self.prepare(context))

    def begin(self, context: bpy.types.Context) -> jobs.Job:
        """Start to prepare the job."""
        self._prepares = True
        work = WorkInPieces(self.prepare(context), self.bl_label)
        return jobs.Job(self.bl_label, work, if_stopped="nothing was begun")

    def look(self, context: bpy.types.Context) -> bool:
        """Check the job. When the preparation has ended, go on with the prepared job."""
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
        """End the job because of a defect, and also a prepared job that this operator has not taken over yet."""
        if self._prepares and self._job.result:
            self._job.result["value"].close()
        return super().give_up(context, error)

    def _change_interval(self, context: bpy.types.Context, seconds: float) -> None:
        """Change the seconds between two checks of the job. A timer whose events have stopped is left, because it may
        be freed already."""
        if self._timer is not None and self._watch is not None and self._watch.is_seen:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = context.window_manager.event_timer_add(seconds, window=context.window)


class DialogJobOperator(JobOperator):
    """Mix-in: an operator that shows a dialog of its properties before it starts its job."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event | None) -> set[str]:
        if bpy.app.background:
            return self.execute(context)
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the job, once the dialog is confirmed."""
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
