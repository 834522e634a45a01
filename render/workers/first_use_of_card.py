"""Signs of life while a driver compiles for a graphics card, which Cycles does not report. Imports no Blender."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: How often and for how long ``tell_while_compiling`` tells, s: a driver took 443 s for the kernels of an H200.
TELL_S, _LONGEST_S = 20.0, 1800.0


@contextmanager
def tell_while_compiling(sampled: threading.Event, tell: Callable[[], None]) -> Iterator[None]:
    """Call ``tell`` every ``TELL_S`` from another thread, until the context ends or ``sampled`` is set.

    A driver compiles for a graphics card when Cycles first renders or bakes on it, and nothing is reported meanwhile.
    After half an hour this is silent too, so that who waits for a worker can tell that it hangs.
    """

    def watch() -> None:
        until = time.monotonic() + _LONGEST_S
        while not sampled.wait(TELL_S) and time.monotonic() < until:
            tell()

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        sampled.set()
        thread.join()
