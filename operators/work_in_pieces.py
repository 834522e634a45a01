"""Work that the window does piece by piece, with the interface of a process."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

from ..render.workers.process import Message
from ..render.workers.watched_thread import Calculation
from ..support.errors import IcyMoonError
from ..support.steps import Outcome, Steps, advance, call

#: Seconds between two turns of such work.
PIECES_INTERVAL_S = 0.01
#: No further piece begins after these seconds of a turn of the event loop.
_BUDGET_S = 0.005


class WorkInPieces:
    """Work in steps. ``poll`` runs the next steps; functions that need no Blender run in a thread."""

    left, returncode, cause = False, 0, ""

    def __init__(self, steps: Steps[Any], subject: str, reports: list[Message] | None = None) -> None:
        """Start to work. ``subject`` names the work in errors of the thread; the thread adds messages to
        ``reports``."""
        self.cancelled = False
        self._reports = [] if reports is None else reports
        self._steps, self._subject, self._running = steps, subject, True
        self._outcome = Outcome()
        self._thread: Calculation | None = None

    @property
    def running(self) -> bool:
        """Whether more steps follow."""
        return self._running

    def poll(self) -> list[Message]:
        """Run the next steps, at least one, unless the thread is busy. Returns the reports and, at the end, a
        ``result`` with its ``value`` or an ``error``."""
        start, messages = time.perf_counter(), list[Message]()
        reported = [self._reports.pop(0) for _ in self._reports[:]]
        while self._running and not messages:
            if self._thread is not None:
                if self._thread.running:
                    break
                self._outcome, self._thread = self._thread.poll()[-1]["value"], None
            messages = self._step()
            if time.perf_counter() > start + _BUDGET_S:
                break
        return [*reported, *messages]

    def _step(self) -> list[Message]:
        """Run the next step. Returns the last message if the work has ended, else none."""
        try:
            work = advance(self._steps, self._outcome)
        except StopIteration as end:
            self._running = False
            return [{"type": "result", "value": end.value}]
        except IcyMoonError as error:
            self._running = False
            return [{"type": "error", "message": str(error)}]
        self._outcome = Outcome()
        if work is not None:
            self._thread = Calculation(partial(call, work), self._subject)
        return []

    def cancel(self) -> None:
        """Stop the work, and remove the objects that it made. A thread runs to its end, and its value is dropped."""
        if self._running:
            self.cancelled, self._running = True, False
            self._steps.close()

    def stop(self) -> None:
        """Stop as ``cancel`` does."""
        self.cancel()
