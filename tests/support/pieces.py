"""Runs work in steps as the window does, with a look at each pause."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from icymoon.support.steps import Outcome, Steps, advance, call

T = TypeVar("T")


def walk(steps: Steps[T], at_pause: Callable[[], object]) -> T:
    """The result of the work, with a call at each pause."""
    outcome = Outcome()
    while True:
        try:
            work = advance(steps, outcome)
        except StopIteration as end:
            result: T = end.value
            return result
        if work is None:
            at_pause()
        outcome = call(work) if work else Outcome()


def count_pauses(steps: Steps[Any]) -> tuple[int, Any]:
    """Number of pauses of the work, and its result."""
    pauses: list[None] = []
    result = walk(steps, lambda: pauses.append(None))
    return len(pauses), result


def stop_after(steps: Steps[Any], pauses: int) -> None:
    """Stop the work after some pauses."""
    outcome = Outcome()
    while pauses:
        work = advance(steps, outcome)
        outcome = call(work) if work else Outcome()
        pauses -= work is None
    steps.close()
