"""Work in steps, between which the window stays usable.

The work is a generator. It yields None for a pause, or a function that needs no Blender and that any thread may call;
the generator receives the value of that function or its error.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")
Steps = Generator[Callable[[], Any] | None, Any, T]


@dataclass(frozen=True)
class Outcome:
    """The value that a function returned, or the error that it raised."""

    value: Any = None
    error: Exception | None = None


def call(work: Callable[[], Any]) -> Outcome:
    """Call a function and return its outcome."""
    try:
        return Outcome(work())
    except Exception as error:
        return Outcome(error=error)


def advance(steps: Steps[Any], outcome: Outcome) -> Callable[[], Any] | None:
    """Run work to its next yield, and return the value that it yields. ``outcome`` belongs to the function that it
    yielded last. Raises StopIteration with the result of the work at its end."""
    return steps.send(outcome.value) if outcome.error is None else steps.throw(outcome.error)


def finish(steps: Steps[T]) -> T:
    """Run work to its end without pauses, and return its result."""
    outcome = Outcome()
    while True:
        try:
            work = advance(steps, outcome)
        except StopIteration as end:
            result: T = end.value
            return result
        outcome = Outcome() if work is None else call(work)
