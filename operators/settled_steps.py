"""Steps that read the scene while the user may change it. After a change they begin anew, so that all that they read is
the scene at one time."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

from ..support.steps import Steps, finish
from .session import session

T = TypeVar("T")
#: Maximum number of readings in pieces; after this number of interrupted readings, the scene is read at once. A playing
#: animation changes the scene in every turn.
_MAX_READINGS = 3


def settle(read: Callable[[], Steps[T]]) -> Steps[T]:
    """Return what ``read`` returns for a scene that does not change meanwhile.

    ``read`` must find the scene itself, since undo and the user may remove data-blocks during a pause.
    """
    for _ in range(_MAX_READINGS):
        changes = session.changes
        with suppress(ReferenceError):  # a data-block was removed
            found = yield from read()
            yield None
            if changes == session.changes:  # an edit in the last turn is an edit too
                return found
    return finish(read())
