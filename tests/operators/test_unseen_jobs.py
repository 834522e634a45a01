"""A job ends whatever happens to its operator: Blender drops one that raises, and may send it no more events."""

from __future__ import annotations

from typing import Any, cast

import pytest
from icymoon.operators import jobs, unseen_jobs
from icymoon.operators.job_operators import JobOperator
from icymoon.operators.jobs import Job
from icymoon.operators.session import session
from icymoon.operators.window_events import cancel_call
from icymoon.support.errors import IcyMoonError
from stand_ins import Process, stand_in

ESCAPE = stand_in(type="ESC", value="PRESS", is_repeat=False)
HELD = stand_in(type="ESC", value="PRESS", is_repeat=True)
DOUBLE = stand_in(type="ESC", value="DOUBLE_CLICK", is_repeat=False)
TIMER = stand_in(type="TIMER", value="NOTHING")


class Operator(JobOperator):
    """An operator as Blender holds it while its job runs."""

    bl_idname = "icymoon.test"
    is_freed = False

    def __init__(self, looks: int = 10**6) -> None:
        self.said: list[str] = []
        self.cleaned: list[bool] = []
        self.succeeded = 0
        self.process = cast("Any", Process(looks, 1, "it was killed"))
        self._timer, self._job = object(), Job("Try", self.process, clean_up=lambda: self.cleaned.append(True))
        self._watch = unseen_jobs.watch(self, self._job)
        session.job = self._job

    def __getattribute__(self, name: str) -> object:
        if name == "bl_idname" and self.is_freed:
            raise ReferenceError("StructRNA of type Operator has been removed")
        return super().__getattribute__(name)

    def report(self, kind: set[str], message: str, /) -> None:
        self.said.append(message)

    def report_success(self, context: object) -> None:
        self.succeeded += 1


@pytest.fixture
def told(scene, monkeypatch):
    """What is shown where no operator can report."""
    sentences: list[str] = []
    monkeypatch.setattr(unseen_jobs, "_show_sentence", sentences.append)
    yield sentences
    unseen_jobs._end_all()
    cancel_call(unseen_jobs._look_after_jobs)


@pytest.fixture
def context():
    removed: list[object] = []
    manager = stand_in(
        event_timer_remove=removed.append,
        progress_end=lambda: None,
        progress_update=lambda value: None,
        removed=removed,
    )
    return stand_in(window_manager=manager)


def meet_fault(*_: object) -> None:
    raise KeyError("mesh")


def let_turn(count: int) -> float | None:
    return [unseen_jobs._look_after_jobs() for _ in range(count)][-1]


def test_a_job_without_events_is_looked_at_by_a_timer_and_ends(told):
    operator = Operator(looks=3)
    assert let_turn(unseen_jobs.MAX_TURNS - 1) == unseen_jobs.INTERVAL_S
    assert (operator.process.looks, session.job) == (3, operator._job)  # it may still be seen
    assert let_turn(5) is None
    assert (operator.succeeded, operator.cleaned, session.job, told) == (1, [True], None, [])
    assert operator.modal(stand_in(), TIMER) == {"FINISHED"}  # should an event come after all


@pytest.fixture
def clock(monkeypatch):
    """Seconds that the jobs see."""
    now = [100.0]
    monkeypatch.setattr(jobs, "time", stand_in(monotonic=lambda: now[0]))
    return now


@pytest.mark.parametrize(
    ("events", "after_s", "stops"),
    [
        ((ESCAPE,), 0.0, False),  # it is also the key that leaves a text field
        ((ESCAPE, ESCAPE), 1.9, True),
        ((ESCAPE, ESCAPE), 2.1, False),
        ((ESCAPE, HELD, HELD), 0.1, False),  # one press
        ((ESCAPE, DOUBLE), 0.1, False),  # Blender sends it again, as a press
        ((ESCAPE, DOUBLE, ESCAPE), 0.1, True),
        ((ESCAPE, ESCAPE, ESCAPE), 1.9, True),
    ],
)
def test_only_the_second_escape_stops_a_job(told, context, clock, events, after_s, stops):
    operator = Operator()
    for event in events:
        clock[0] += after_s
        result = operator.modal(context, event)
        if not operator.process.cancelled:
            assert result == {"PASS_THROUGH"}  # what the key is for is done
    assert operator.process.cancelled == stops


def test_the_hint_on_escape_is_seen_and_goes(told, context, clock):
    operator = Operator()
    operator.modal(context, ESCAPE)
    assert operator._job.shown[1] == "Press Esc again to stop"
    assert "Esc again" in operator._job.brief
    operator.look(context)
    clock[0] += jobs.ESCAPE_S
    assert "Esc" not in operator._job.brief + operator._job.shown[1]


def test_jobs_of_hours_know_no_escape(told, context, clock):
    operator = Operator()
    operator.stops_on_escape = False
    for _ in range(2):
        operator.modal(context, ESCAPE)
    assert not operator.process.cancelled


def test_the_sidebar_tells_how_a_job_has_ended(told, context, monkeypatch):
    def refuse(*_: object) -> None:
        raise IcyMoonError("full")

    for cancelled, outcome in ((False, "done"), (True, "stopped")):
        operator = Operator(looks=1)
        operator.process.cancelled = cancelled
        for _ in range(2):
            operator.modal(context, TIMER)
        assert session.ended == f"Try: {outcome}"
    monkeypatch.setattr(Operator, "report_success", refuse)
    operator = Operator(looks=1)
    for _ in range(2):
        operator.modal(context, TIMER)
    assert session.ended == "Try: failed"


def test_a_job_with_events_is_left_to_its_operator(told, context):
    operator = Operator()
    for _ in range(4):
        let_turn(unseen_jobs.MAX_TURNS - 1)
        assert operator.modal(context, TIMER) == {"PASS_THROUGH"}
    assert operator.process.looks == 10**6 - 4  # those of its events


def test_the_job_of_a_freed_operator_is_closed_with_a_sentence(told):
    operator = Operator()
    operator.is_freed = True
    assert let_turn(unseen_jobs.MAX_TURNS) == unseen_jobs.INTERVAL_S
    assert let_turn(1) is None
    assert told == ["Try was stopped, because its window is gone; what was finished is kept."]
    assert (operator.cleaned, operator.process.stops, session.job) == ([True], 1, None)


@pytest.mark.parametrize("where", ["watch", "report_success"])
def test_a_fault_ends_the_job_with_a_sentence(told, context, capsys, monkeypatch, where):
    """Blender drops an operator that lets an exception out, and its job would run for ever."""
    operator = Operator(looks=1)
    monkeypatch.setattr(Operator, where, meet_fault)
    operator.modal(context, TIMER)
    operator.modal(context, TIMER)
    assert operator.said == ["Try was ended by an error (KeyError: 'mesh'); start it again, and please report this."]
    assert (operator.cleaned, len(context.window_manager.removed), session.job) == ([True], 1, None)
    assert "KeyError" in capsys.readouterr().err  # a defect keeps its traceback
    assert operator.modal(context, TIMER) == {"FINISHED"}


def test_a_fault_when_another_file_is_opened_ends_the_job_too(told, context, monkeypatch):
    operator = Operator()
    monkeypatch.setattr(Operator, "report_end", meet_fault)
    operator.cancel(context)
    assert (operator.cleaned, operator.process.stops, session.job) == ([True], 2, None)


def test_an_error_for_the_user_is_no_fault(told, context, capsys, monkeypatch):
    def refuse(*_: object) -> None:
        raise IcyMoonError("There is no ground.")

    operator = Operator(looks=1)
    monkeypatch.setattr(Operator, "report_success", refuse)
    operator.modal(context, TIMER)
    assert operator.modal(context, TIMER) == {"CANCELLED"}
    assert (operator.said, capsys.readouterr().err) == (["There is no ground."], "")
