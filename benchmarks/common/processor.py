"""Processor time and memory of this process and of its child processes."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path


class Stopwatch:
    """Processor seconds of this process, from one call of ``lap`` to the next."""

    def __init__(self) -> None:
        self._since = time.process_time()

    def lap(self) -> float:
        """Processor seconds since the last call, or since the stopwatch was made."""
        before, self._since = self._since, time.process_time()
        return self._since - before


def seconds_of(work: Callable[[], object]) -> float:
    """Processor seconds of one run in this process."""
    watch = Stopwatch()
    work()
    return watch.lap()


def measure_least_seconds(work: Callable[[], object], runs: int = 3) -> float:
    """Processor seconds of the fastest of some runs in this process."""
    return min(seconds_of(work) for _ in range(runs))


def measure_all_seconds(work: Callable[[], object]) -> float:
    """Processor seconds of one run, in this process and its finished child processes."""
    before = _spent_s()
    work()
    return _spent_s() - before


def _spent_s() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def peak_mib() -> float:
    """The largest resident memory of this process so far, MiB. Linux and macOS only."""
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def resident_mib(what: str = "VmRSS", pid: int | None = None) -> float:
    """Resident memory of a process, without ``pid`` of this process, MiB, as Linux counts it: VmRSS now, VmHWM the
    largest since it was reset. StopIteration for an ended process."""
    lines = Path(f"/proc/{pid or 'self'}/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{what}:")) / 1024
