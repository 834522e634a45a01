"""Operators that start a job in another process and run until it ends, so that the window stays usable."""

from __future__ import annotations

import traceback

import bpy

from ..support.errors import IcyMoonError
from . import jobs, unseen_jobs
from .operator_type import ExplainedOperator
from .session import session
from .sidebar_text import format_for_window
from .window_areas import redraw_panels


class WatchingOperator(ExplainedOperator):
    """Mix-in: an operator whose work is a job.

    ``start`` returns the job, and ``report_success`` is called after it has succeeded. From a script
    (``EXEC_DEFAULT``) the operator returns when the job has ended. If Blender sends no more events, ``unseen_jobs``
    looks at the job instead.
    """

    #: Seconds between two looks at the job.
    interval_s = jobs.INTERVAL_S
    _timer: bpy.types.Timer | None = None
    _job: jobs.Job | None = None
    _watch: unseen_jobs.Watch | None = None

    def start(self, context: bpy.types.Context) -> jobs.Job | None:
        """Start the job; None if there is nothing to wait for. Raises IcyMoonError if it cannot start."""
        raise NotImplementedError

    def report_success(self, context: bpy.types.Context) -> None:
        """Use the results of the job. Raises IcyMoonError if that fails."""
        raise NotImplementedError

    def run_blocking(self, context: bpy.types.Context) -> None:
        """Run the job to its end. Raises IcyMoonError if it fails."""
        self._job = self.start(context)
        if self._job is not None:
            self._job.run_to_end()
        self.report_success(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self.run_blocking(context)
        except IcyMoonError as error:
            return self.fail(error)
        return {"FINISHED"}

    def fail(self, error: Exception) -> set[str]:
        """Report an error to the user and cancel."""
        self.report({"ERROR"}, format_for_window(error))
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event | None) -> set[str]:
        if bpy.app.background:
            return self.execute(context)
        try:
            self._job = self.start(context)
            if self._job is None:
                self.report_success(context)
                return {"FINISHED"}
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

    def fail(self, error: Exception) -> set[str]:
        """Report an error; the sidebar names the job that failed."""
        if self._job is not None:
            session.ended = f"{self._job.title}: failed"
            redraw_panels()
        return super().fail(error)

    def report_end(self, context: bpy.types.Context) -> None:
        """Take the job from the sidebar, and report its warnings."""
        context.window_manager.progress_end()
        if session.job is self._job:
            session.job = None
        session.ended = f"{self._job.title}: {self._job.outcome}"
        redraw_panels()
        for warning in self._job.warnings:
            self.report({"WARNING"}, format_for_window(warning))
        if self._job.process.cancelled and not self._job.process.left:
            self.report({"WARNING"}, format_for_window(self._job.failure))


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
