"""A data set on Dask's workers, of which some are killed, with a Blender that only pretends."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import pytest
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.plans.render_order import order_pairs
from icymoon.render.workers import dask_cluster
from icymoon.render.workers.runner import WorkerOptions
from icymoon.support.errors import IcyMoonError
from plans import grid
from stand import Stand

PAIRS = order_pairs(grid(seeds=3))


@pytest.fixture
def stand(tmp_path):
    pytest.importorskip("distributed", reason="Dask is not installed; pip install icymoon[scale]")
    stand = Stand(tmp_path)
    datasets.freeze_plan(stand.dataset, PAIRS, "")
    return stand


def run(stand: Stand, address: str = "local:2") -> dict[str, str]:
    return dask_cluster.render_on_cluster(
        address,
        stand.dataset,
        PAIRS,
        WorkerOptions(1, 1, str(stand.blender)),
        lambda kind, **facts: stand.said.append({"type": kind, **facts}),
    )


def test_an_address_that_is_none_is_a_sentence(stand):
    for address in ("local:none", "nowhere:at:all", "tcp://127.0.0.1:9"):
        with pytest.raises(IcyMoonError, match="--dask"):
            run(stand, address)


@pytest.mark.slow
def test_workers_of_a_cluster_make_the_data_set(stand):
    bad = PAIRS[3].id
    stand.behave(**{bad: "crash", PAIRS[6].id: "crash once"})
    assert list(run(stand)) == [bad]
    stand.assert_done(bad)
    assert stand.rendered.count(bad) == 3
    assert len([m for m in stand.said if m["type"] == "pair"]) == len(PAIRS) - 1
    stand.behave()
    assert run(stand) == {}
    stand.assert_done()


@pytest.mark.slow
def test_killed_workers_are_replaced_and_nothing_is_lost(stand):
    stand.behave(**{pair.id: "sleep" for pair in PAIRS})
    ended = threading.Event()
    killed = []

    def kill_some() -> None:
        while len(killed) < 2 and not ended.wait(1.5):
            threads = Path(f"/proc/{os.getpid()}/task").glob("*/children")
            mine = [pid for thread in threads for pid in thread.read_text().split()]
            workers = [int(pid) for pid in mine if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
            if workers and stand.folder.joinpath("log").exists():
                os.kill(workers[-1], signal.SIGKILL)
                killed.append(workers[-1])

    killer = threading.Thread(target=kill_some)
    killer.start()
    try:
        assert run(stand) == {}
    finally:
        ended.set()
        killer.join()
    assert killed
    time.sleep(0.1)
    stand.assert_done()
