"""Measure the pairs of a data set while others are being rendered.

Rows are written as ``evaluate`` writes them, so ``evaluate`` measures only the rest later. No report is written and no
failure is shown: a pair that fails here fails again in ``evaluate``, which shows the failure.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..render.pairs.pair_folder import find_pair_folders, has_pairs
from ..support.errors import IcyMoonError
from ..support.system import lower_priority
from .evaluate import Evaluation
from .evaluated_pairs import Source, find_sources
from .evaluation_files import check_output_folder, remove_leftovers
from .matchers.methods import Method
from .matchers.resident_process import stop_residents
from .measure.confidence_metrics import OWN
from .measure_pair import MeasureRun, MeasureTask, measure_pair

#: Seconds between two searches for new pairs.
_POLL_S = 1.0


def measure_completed_pairs(
    dataset: Path,
    methods: Sequence[Method],
    out: Path,
    response: Mapping[str, Mapping[str, Any]],
    is_over: Callable[[], bool],
    points: bool = False,
    maps: float | None = None,
    confidence: Sequence[str] = (OWN,),
) -> None:
    """Measure pairs of a data set as they are completed, until ``is_over`` returns true; for the other parameters see
    ``evaluate``.

    A measurement in progress at the end is finished. Raises IcyMoonError if ``out`` cannot be written, or contains
    files that no evaluation wrote.
    """
    run = MeasureRun(methods, out, dict(response), points, maps, tuple(confidence))
    seen: set[str] = set()
    check_output_folder(out, ())
    remove_leftovers(out)
    try:
        while not is_over():
            sources = list(_find_new_pairs(dataset, seen))
            check_output_folder(out, [source.name for source in sources])
            if sources:
                evaluation = Evaluation(sources, run, lambda event: None)
                evaluation.log_results(_measure_until_over(evaluation, run, is_over))
            else:
                time.sleep(_POLL_S)
    finally:
        stop_residents()


def _find_new_pairs(dataset: Path, seen: set[str]) -> Iterator[Source]:
    """Yield the pairs that were completed since the last call."""
    for folder in find_pair_folders(dataset) if has_pairs(dataset) else ():
        if folder.name not in seen:
            seen.add(folder.name)
            with suppress(IcyMoonError):  # the pair cannot be used
                yield from find_sources([folder])


def _measure_until_over(
    evaluation: Evaluation, run: MeasureRun, is_over: Callable[[], bool]
) -> Iterator[tuple[MeasureTask, dict[str, Any]]]:
    for task in evaluation.tasks():
        if is_over():
            return
        for event in measure_pair(evaluation.sources[task.pair], run, task):
            yield task, event


def measure_until_input_ends(
    dataset: Path,
    methods: Sequence[Method],
    out: Path,
    response: Mapping[str, Mapping[str, Any]],
    points: bool,
    maps: float | None,
    confidence: Sequence[str],
) -> None:
    """Measure as ``measure_completed_pairs`` does, at a lower priority, until standard input ends. So this process ends
    with the renderer, also if the renderer crashes.
    """
    lower_priority()
    over = threading.Event()

    def wait() -> None:
        with suppress(OSError, ValueError):
            sys.stdin.buffer.read()
        over.set()

    threading.Thread(target=wait, daemon=True).start()
    measure_completed_pairs(dataset, methods, out, response, over.is_set, points, maps, confidence)
