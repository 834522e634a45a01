"""An operator that prepares its job in pieces goes on with the job; what fails or is stopped before begins nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import bpy
import pytest
from icymoon.operators import jobs, unseen_jobs, work_in_pieces
from icymoon.operators.decisions_in_view import ICYMOON_OT_paint_decisions
from icymoon.operators.job_operators import KeyStoppedOperator, PiecewiseOperator, PreparingOperator
from icymoon.operators.jobs import Job
from icymoon.operators.session import session
from icymoon.operators.window_events import cancel_call
from icymoon.render.workers.process import Message
from icymoon.support.errors import IcyMoonError
from icymoon.support.steps import Steps
from stand_ins import Process, stand_in

TIMER = stand_in(type="TIMER", value="NOTHING")
ESCAPE = stand_in(type="ESC", value="PRESS", is_repeat=False)
UNDO = stand_in(type="Z", value="PRESS", ctrl=True, oskey=False, shift=False)


class Prepared(PreparingOperator):
    """An operator whose job is prepared in three pieces."""

    bl_label = "Try"

    def __init__(self, error: str = "") -> None:
        self.said: list[str] = []
        self.succeeded, self._error = 0, error
        self._timer = object()

    def report(self, kind: set[str], message: str, /) -> None:
        self.said.append(message)

    def prepare(self, context: object) -> Steps[Job]:
        yield None
        if self._error:
            raise IcyMoonError(self._error)
        yield None
        process: Any = Process(3)
        return Job("Work", process)

    def report_success(self, context: object) -> None:
        self.succeeded += 1


@pytest.fixture
def context(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The context of a window. Each look runs one piece."""
    monkeypatch.setattr(work_in_pieces, "_BUDGET_S", -1.0)
    intervals: list[float] = []
    manager = stand_in(
        event_timer_add=lambda seconds, window: intervals.append(seconds) or object(),
        event_timer_remove=lambda timer: None,
        progress_end=lambda: None,
        progress_update=lambda value: None,
        intervals=intervals,
    )
    yield stand_in(window_manager=manager, window=None)
    unseen_jobs._end_all()
    session.job = None
    cancel_call(unseen_jobs._look_after_jobs)


def begin(operator: Any, context: Any) -> Any:
    """Begin as ``invoke`` does in a window."""
    operator._job = session.job = operator.begin(context)
    operator._watch = unseen_jobs.watch(operator, operator._job)
    return operator


def look_until_end(operator: Any, context: Any, at_look: Callable[[], object] = lambda: None) -> set[str]:
    while (result := operator.modal(context, TIMER)) == {"PASS_THROUGH"}:
        at_look()
    return result


def test_the_prepared_job_follows_without_a_gap_and_is_looked_at_less_often(context):
    operator, titles = begin(Prepared(), context), []
    assert look_until_end(operator, context, lambda: titles.append(session.job.title)) == {"FINISHED"}
    assert list(dict.fromkeys(titles)) == ["Try", "Work"]
    assert operator.succeeded == 1
    assert session.job is None
    assert session.ended == "Work: done"
    assert context.window_manager.intervals == [jobs.INTERVAL_S]


def test_an_error_before_the_job_is_a_sentence(context):
    operator = begin(Prepared("The folder is gone; choose another."), context)
    assert look_until_end(operator, context) == {"CANCELLED"}
    assert operator.said == ["The folder is gone; choose another."]
    assert (operator.succeeded, session.job) == (0, None)


def test_esc_twice_before_the_job_begins_nothing(context):
    operator = begin(Prepared(), context)
    operator.modal(context, TIMER)
    for _ in range(2):
        operator.modal(context, ESCAPE)
    assert look_until_end(operator, context) == {"CANCELLED"}
    assert operator.said == ["Try was stopped; nothing was begun."]
    assert session.job is None


def test_a_defect_while_the_job_is_handed_over_stops_the_prepared_job(context, capsys):
    """Its process went on without anything that looked at it."""
    operator, begun = begin(Prepared(), context), list[Job]()

    def fail(message: Message) -> None:
        begun.append(message["value"])
        raise KeyError("no key")

    operator._job.handle = fail
    assert look_until_end(operator, context) == {"CANCELLED"}
    assert "KeyError" in capsys.readouterr().err
    assert begun[0].process.cancelled
    assert session.job is None


def test_a_script_gets_the_job_itself(context):
    assert Prepared().start(context).title == "Work"


class Piecewise(PiecewiseOperator, KeyStoppedOperator):
    """An operator that works in pieces and in a thread."""

    bl_label = "Paint"

    def __init__(self) -> None:
        self.done: list[str] = []
        self._timer = object()

    def report(self, kind: set[str], message: str, /) -> None:
        self.done.append(message)

    def make_steps(self, context: object, report: Callable[[float, str], object]) -> Steps[None]:
        def compute() -> str:
            report(0.5, "half")
            return "painted"

        found = yield compute
        yield None
        self.done.append(found)


def test_the_thread_reports_its_progress(context):
    operator, shown = begin(Piecewise(), context), set[tuple[float, str]]()
    result = look_until_end(operator, context, lambda: shown.add((operator._job.fraction, operator._job.text)))
    assert result == {"FINISHED"}
    assert (0.5, "half") in shown
    assert operator.done == ["painted"]


@pytest.mark.parametrize("event", [ESCAPE, UNDO])
def test_keys_stop_the_pieces(context, event):
    operator = begin(Piecewise(), context)
    operator.modal(context, TIMER)
    assert operator.modal(context, event) == {"RUNNING_MODAL"}
    assert look_until_end(operator, context) == {"CANCELLED"}
    assert operator.done == []


def test_decisions_that_are_painted_anew_stop_the_earlier_ones(monkeypatch, scene):
    first, second = (Job("Show Decisions", Process(9)) for _ in range(2))  # type: ignore[arg-type]
    found = iter((first, second))
    monkeypatch.setattr(PiecewiseOperator, "start", lambda *_: next(found))
    for _ in range(2):
        ICYMOON_OT_paint_decisions.start(stand_in(), bpy.context)
    assert first.process.cancelled
    assert session.painting is second
    session.reset()
    assert second.process.cancelled
    assert session.painting is None
