"""Steps that read the scene while the user may change it: they begin anew after a change, so that what is read is the
scene at one time."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

from ..support.steps import Steps, finish
from .session import session

T = TypeVar("T")
#: Readings in pieces that a change may interrupt; the next reading is at once. An animation that plays changes the
#: scene in every turn.
_MAX_READINGS = 3


def settle(read: Callable[[], Steps[T]]) -> Steps[T]:
    """What ``read`` returns of a scene that does not change meanwhile. It must find the scene itself, since undo and
    the user may remove data-blocks during a pause."""
    for _ in range(_MAX_READINGS):
        changes = session.changes
        with suppress(ReferenceError):  # a data-block was removed
            found = yield from read()
            yield None
            if changes == session.changes:  # an edit in the last turn is an edit too
                return found
    return finish(read())
