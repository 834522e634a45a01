"""Reports while a driver compiles for a graphics card, because Cycles reports nothing then. Imports no Blender."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: Seconds between reports of ``report_while_compiling``, and seconds after which it stops: a driver took 443 s for the
#: kernels of an H200.
REPORT_INTERVAL_S, _MAX_COMPILING_S = 20.0, 1800.0


class FirstSample:
    """Whether Cycles has rendered anything in this process. A report that began before the first sample ends before the
    sample is noted."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self.has_come = False

    def note(self) -> None:
        """Record that a sample has come, after waiting for the end of a report in progress."""
        with self._changed:
            self.has_come = True
            self._changed.notify_all()

    def call_until_it_comes(self, tell: Callable[[], None], interval_s: float, most_s: float) -> None:
        """Call ``tell`` every ``interval_s`` seconds, for ``most_s`` seconds at most."""
        until = time.monotonic() + most_s
        with self._changed:
            while not self._changed.wait_for(lambda: self.has_come, interval_s) and time.monotonic() < until:
                tell()


@contextmanager
def report_while_compiling(first_sample: FirstSample, tell: Callable[[], None]) -> Iterator[None]:
    """Call ``tell`` every ``REPORT_INTERVAL_S`` seconds from another thread, until the context ends or the first
    sample comes.

    A driver compiles for a graphics card when Cycles first renders or bakes on it, and Cycles reports nothing
    meanwhile. After half an hour the reports stop, so that a hung worker can be noticed.
    """

    arguments = tell, REPORT_INTERVAL_S, _MAX_COMPILING_S
    thread = threading.Thread(target=first_sample.call_until_it_comes, args=arguments, daemon=True)
    thread.start()
    try:
        yield
    finally:
        first_sample.note()
        thread.join()
