"""Work in steps: what a step is given, and what becomes of an error."""

from __future__ import annotations

import pytest
from icymoon.support.steps import Outcome, Steps, advance, call, finish


def add_up(seen: list[object]) -> Steps[int]:
    first = yield lambda: 2
    seen.append((yield None))
    try:
        yield lambda: 1 // 0
    except ZeroDivisionError:
        first += 40
    return first


def test_work_at_once_gets_the_values_of_its_functions_and_their_errors():
    seen: list[object] = []
    assert finish(add_up(seen)) == 42
    assert seen == [None]


def test_work_step_by_step_comes_to_the_same():
    steps, outcome, kinds = add_up([]), Outcome(), []
    for _ in range(3):
        work = advance(steps, outcome)
        kinds.append(work is None)
        outcome = call(work) if work else Outcome()
    assert kinds == [False, True, False]
    with pytest.raises(StopIteration) as end:
        advance(steps, outcome)
    assert end.value.value == 42


def test_an_error_that_the_work_does_not_expect_ends_it():
    def fail() -> None:
        raise KeyError("gone")

    def work() -> Steps[None]:
        yield fail

    with pytest.raises(KeyError, match="gone"):
        finish(work())
