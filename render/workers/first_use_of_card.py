"""Reports while a driver compiles for a graphics card, because Cycles reports nothing then. Imports no Blender."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: Seconds between reports of ``report_while_compiling``, and seconds after which it stops: a driver took 443 s for the
#: kernels of an H200.
REPORT_INTERVAL_S, _MOST_COMPILING_S = 20.0, 1800.0


@contextmanager
def report_while_compiling(sampled: threading.Event, tell: Callable[[], None]) -> Iterator[None]:
    """Call ``tell`` every ``REPORT_INTERVAL_S`` seconds from another thread, until the context ends or ``sampled`` is
    set.

    A driver compiles for a graphics card when Cycles first renders or bakes on it, and Cycles reports nothing
    meanwhile. After half an hour the reports stop, so that a hung worker can be noticed.
    """

    def watch() -> None:
        until = time.monotonic() + _MOST_COMPILING_S
        while not sampled.wait(REPORT_INTERVAL_S) and time.monotonic() < until:
            tell()

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        sampled.set()
        thread.join()
