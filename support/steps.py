"""Work in steps: a generator that yields between them and returns its result, so that a window can go on meanwhile."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

_T = TypeVar("_T")
#: Work in steps with a result.
Steps = Generator[None, None, _T]


def finish(steps: Steps[_T]) -> _T:
    """Do all steps at once, and return their result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: _T = end.value
            return result
