"""The progress of a render, parsed from the status lines of Cycles."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import bpy

_SAMPLE_STATUS = re.compile(r"Sample (\d+)/(\d+)")


class SampleCounter:
    """Completed fraction of a stereo render, from Cycles' status lines.

    Cycles renders the radiance of the ``eyes``, then ``truths`` times the truth of both, then the radiance of
    ``others``, cameras beside the pair; each run counts its samples from 0 to its own total. ``seconds`` is the time
    between these status lines.
    """

    def __init__(self, samples: int, truths: int = 1, others: int = 0, eyes: int = 2) -> None:
        self._expected = (eyes + others) * samples + 2 * truths  # the truth has one sample per eye
        self._finished, self._now = 0, 0
        self._since: float | None = None
        self.seconds = 0.0

    def add_time(self, status: str, now_s: float) -> None:
        """Add the time since the last status line to ``seconds`` if Cycles has been sampling."""
        if self._since is not None:
            self.seconds += now_s - self._since
        self._since = now_s if _SAMPLE_STATUS.search(status) else None

    def read(self, status: str) -> float | None:
        """Read a status line, and return the completed fraction in [0, 1] after it; None if it is unchanged."""
        found = _SAMPLE_STATUS.search(status)
        if not found:
            return None
        now = int(found[1])
        if now < self._now:
            self._finished += self._now
        if now == self._now:
            return None
        self._now = now
        return min(1.0, (self._finished + self._now) / self._expected)


@contextmanager
def watch_samples(
    samples: int, truths: int, report: Callable[[float], None], others: int = 0, eyes: int = 2
) -> Iterator[SampleCounter]:
    """Call ``report`` with the fraction done whenever Cycles has finished samples; see SampleCounter."""
    counter = SampleCounter(samples, truths, others, eyes)

    def read_arguments(*arguments: object) -> None:
        status = str(arguments[0]) if arguments else ""
        counter.add_time(status, time.perf_counter())
        fraction = counter.read(status)
        if fraction is not None:
            report(fraction)

    bpy.app.handlers.render_stats.append(read_arguments)
    try:
        yield counter
    finally:
        bpy.app.handlers.render_stats.remove(read_arguments)
