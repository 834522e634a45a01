"""Renders a data set with the workers of a Dask cluster. Imports no Blender.

A task renders a run of pairs, as ``icymoon work`` does, so a task may be killed, repeated or run twice at any moment.
Dask chooses the machine of a task, and starts the task again if the machine is lost.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...support.errors import IcyMoonError
from ...support.number_text import format_count
from ..pairs.pair_folder import is_complete
from ..plans import frozen_plan as datasets
from ..plans.planned_pair import PlannedPair
from ..plans.render_order import cut_into_jobs
from .runner import MAX_CRASHES, Runner, WorkerOptions

_POLL_S = 1.0


def render_task(dataset: str, names: Sequence[str], workers: WorkerOptions) -> dict[str, str]:
    """Render these pairs of a frozen data set, as a task of a worker. Return by id the reasons why pairs were set
    aside."""
    wanted = set(names)
    pairs = [pair for pair in datasets.read_frozen_plan(Path(dataset)).pairs if pair.id in wanted]
    return Runner(Path(dataset), pairs, workers, lambda *a, **k: None).run()


@contextmanager
def connect_cluster(address: str) -> Iterator[Any]:
    """Connect to the scheduler at an address, or to workers of this machine (``local:N``), until the end of the
    ``with`` block.
    """
    try:
        import distributed
    except ImportError:
        raise IcyMoonError('--dask needs Dask\'s scheduler; install it with: pip install "icymoon[scale]"') from None
    kind, _, number = address.partition(":")
    if kind == "local":
        if not re.fullmatch(r"[0-9]{1,6}", number) or int(number) == 0:
            raise IcyMoonError(f"--dask is {address!r}; write local:N with N processes, or a scheduler's address.")
        with (
            distributed.LocalCluster(
                n_workers=int(number), threads_per_worker=1, processes=True, dashboard_address=None
            ) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield client
        return
    try:
        client = distributed.Client(address, timeout=20)
    except (OSError, ValueError) as error:
        raise IcyMoonError(f"There is no Dask scheduler at {address} ({error}); check --dask.") from None
    with client:
        yield client


def render_on_cluster(
    address: str, dataset: Path, pairs: Sequence[PlannedPair], workers: WorkerOptions, send: Callable[..., None]
) -> dict[str, str]:
    """Render the missing ``pairs`` on a cluster, as ``Runner.run`` does, with Dask workers.

    Each Dask worker needs this package, the Blender that ``workers`` names, and the folder at the same path.
    """
    with connect_cluster(address) as client:
        there = {pair.id for pair in pairs if is_complete(pair.folder(dataset))}
        missing = [pair for pair in pairs if pair.id not in there]
        slots = max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
        jobs = [[pair.id for pair in shard] for shard in cut_into_jobs(missing, slots, workers.most_scenes)]
        own = WorkerOptions(1, workers.threads, workers.blender, workers.most_scenes)
        futures = [
            client.submit(render_task, str(dataset), names, own, retries=MAX_CRASHES - 1, pure=False) for names in jobs
        ]
        try:
            while True:
                ended = all(future.done() for future in futures)
                for pair in missing:
                    if pair.id not in there and is_complete(pair.folder(dataset)):
                        there.add(pair.id)
                        send(
                            "pair",
                            id=pair.id,
                            folder=str(pair.folder(dataset)),
                            rendered=True,
                            done=len(there),
                            total=len(pairs),
                            seconds=_read_seconds(pair.folder(dataset)),
                        )
                send(
                    "progress",
                    fraction=len(there) / max(1, len(pairs)),
                    done=len(there),
                    total=len(pairs),
                    message=f"{len(there)} of {format_count(len(pairs), 'pair')} on {format_count(slots, 'worker')}",
                )
                if ended:
                    break
                time.sleep(_POLL_S)
        finally:
            client.cancel(futures)
    return _report_failed(jobs, futures, there, send)


def _read_seconds(folder: Path) -> float:
    from ..pairs.pair_folder import read_pair

    return float(sum(read_pair(folder).data["seconds"].get(step, 0.0) for step in ("build", "render", "write")))


def _report_failed(
    jobs: list[list[str]], futures: list[Any], there: set[str], send: Callable[..., None]
) -> dict[str, str]:
    """Report the pairs that are missing, and return the reasons by id."""
    failed: dict[str, str] = {}
    for names, future in zip(jobs, futures, strict=True):
        if future.status == "finished":
            failed |= future.result()
        else:
            why = f"its task ended: {future.exception()}" if future.status == "error" else "its task was cancelled"
            failed |= dict.fromkeys(names, why)
    failed = {name: why for name, why in failed.items() if name not in there}
    for name, why in failed.items():
        send("error", message=f"Pair {name}: {why}", pair=name)
    return failed
