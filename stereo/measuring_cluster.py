"""Measure pairs with the workers of a Dask cluster.

A task is a pair, as for ``measuring_processes``: a worker writes the pictures and facts of its pair, and returns the
events of ``measure_pair``. Only the process that submitted the task writes rows. A pair whose worker is lost is
measured again.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

from ..render.workers.dask_cluster import connect_cluster
from ..render.workers.runner import MAX_CRASHES
from ..support.errors import DiskError
from .evaluated_pairs import Source, find_sources
from .matchers.methods import Method
from .matchers.resident_process import stop_residents
from .measure_pair import MeasureRun, MeasureTask, measure_pair

#: Tasks that a worker holds at once: the one in progress, and the next.
_TASKS_PER_WORKER = 2
#: One measurement at a time, because OpenEXR is silenced by exchanging the standard error of the whole process.
_ONE_AT_A_TIME = Lock()


def measure_on_cluster(
    address: str, paths: Sequence[Path], run: MeasureRun, tasks: Iterator[MeasureTask]
) -> Iterator[tuple[MeasureTask, dict[str, Any]]]:
    """Do all tasks on the Dask cluster at an address, and yield events as ``MeasuringProcesses.measure`` does.

    Every worker needs this package, the packages of the evaluator, and the pairs and ``run.out`` at the same paths.
    Raises IcyMoonError if there is no cluster, and DiskError if a file cannot be written.
    """
    setup = json.dumps(
        {
            "paths": [str(path.resolve()) for path in paths],
            "methods": [asdict(method) for method in run.methods],
            "out": str(run.out.resolve()),
            "response": run.response,
            "points": run.points,
            "maps": run.maps,
            "confidence": list(run.confidence),
        }
    )
    with connect_cluster(address) as client:
        from distributed import as_completed

        busy: dict[Any, MeasureTask] = {}
        ended = as_completed()
        try:
            while True:
                workers = max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
                while len(busy) < _TASKS_PER_WORKER * workers and (task := next(tasks, None)) is not None:
                    future = client.submit(measure_task, setup, asdict(task), retries=MAX_CRASHES - 1, pure=False)
                    busy[future] = task
                    ended.add(future)
                if not busy:
                    return
                future = next(ended)
                task = busy.pop(future)
                error = future.exception()
                if isinstance(error, DiskError):
                    raise error
                died = {
                    "type": "died",
                    "message": f"its task ended: {error}; there may be too little memory, give the Dask workers more",
                }
                for event in [died] if error else future.result():
                    yield task, event
        finally:
            client.cancel(list(busy))
            client.run(stop_residents)


def measure_task(setup: str, task: dict[str, Any]) -> list[dict[str, Any]]:
    """Measure the pair of a task, on a worker; return the events."""
    sources, run = _unpack_setup(setup)
    with _ONE_AT_A_TIME:
        return list(measure_pair(sources[task["pair"]], run, MeasureTask(**task)))


@lru_cache(maxsize=2)
def _unpack_setup(setup: str) -> tuple[dict[str, Source], MeasureRun]:
    found = json.loads(setup)
    sources = {source.name: source for source in find_sources([Path(path) for path in found["paths"]])}
    return sources, MeasureRun(
        [Method(**method) for method in found["methods"]],
        Path(found["out"]),
        found["response"],
        found["points"],
        found["maps"],
        found["confidence"],
    )
