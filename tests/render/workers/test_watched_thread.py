"""A calculation in a thread is watched like a process: one message, then it has ended."""

from __future__ import annotations

import threading
import time
from functools import partial

import pytest
from icymoon.render.workers.watched_thread import Calculation
from icymoon.support.errors import IcyMoonError


def messages(work: Calculation) -> list[dict]:
    """All messages, as a job takes them: it looks whether the work runs before it asks for messages."""
    found, end, running = [], time.monotonic() + 60.0, True
    while running and time.monotonic() < end:
        running = work.running
        found += work.poll()
    return found


def test_its_value_is_its_only_message_and_told_once():
    work = Calculation(lambda: 7, "seven")
    assert messages(work) == [{"type": "result", "value": 7}]
    assert work.poll() == []
    assert not work.cancelled


def test_no_message_is_lost_while_it_is_polled():
    """It is polled from another thread, at any moment of its end."""
    for k in range(300):
        assert messages(Calculation(partial(int, k), "k")) == [{"type": "result", "value": k}]


def test_it_reports_its_progress_in_order():
    def work(report) -> int:
        for k in range(3):
            report(k / 3, f"Part {k}")
        return 7

    told = messages(Calculation(work, "parts", reports=True))
    assert [(each["fraction"], each["message"]) for each in told[:3]] == [(k / 3, f"Part {k}") for k in range(3)]
    assert told[3:] == [{"type": "result", "value": 7}]


@pytest.mark.parametrize(
    ("error", "said"),
    [(IcyMoonError("a.exr is gone."), "a.exr is gone."), (MemoryError(), "the pair: there is not enough memory")],
)
def test_a_failure_is_one_sentence(error, said):
    def fail() -> None:
        raise error

    ((message),) = messages(Calculation(fail, "the pair"))
    assert message["type"] == "error"
    assert message["message"].startswith(said)


def test_stopping_cancels_what_runs_and_nothing_that_has_ended():
    free = threading.Event()
    work = Calculation(free.wait, "waiting")
    work.stop()
    assert work.cancelled
    assert work.running  # a thread cannot be stopped
    free.set()
    messages(work)
    done = Calculation(lambda: 1, "one")
    messages(done)
    done.stop()
    assert not done.cancelled
    done.cancel()
    assert done.cancelled
