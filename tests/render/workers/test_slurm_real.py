"""The job script in a real SLURM of this one machine, some of whose jobs are killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import slurm
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.plans.render_order import order_pairs
from icymoon.render.workers.slurm_scripts import SlurmRequest, write_script
from icymoon.render.workers.verify_dataset import verify_data_set
from plans import grid
from stand import Stand

PAIRS = order_pairs(grid(seeds=3))


def _runners(dataset: Path) -> list[int]:
    """Processes that run a shard of a data set."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = entry.read_bytes().split(b"\0")
        except OSError:
            continue
        if b"work" in words and str(dataset).encode() in words:
            found.append(int(entry.parent.name))
    return found


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.skipif(bool(slurm.missing()), reason=slurm.missing() or "SLURM is here")
def test_an_array_of_shares_makes_the_data_set_though_one_is_killed(tmp_path):
    folder = tmp_path / "it's 50 % #1"  # which every line of the script must survive
    folder.mkdir()
    stand = Stand(folder)
    stand.behave(**{pair.id: "sleep" for pair in PAIRS} | {PAIRS[5].id: "crash once"})
    frozen = datasets.freeze_plan(stand.dataset, PAIRS, "")
    script = write_script(
        stand.dataset, frozen, SlurmRequest(3, 2, 1, "100M", "00:10:00", ()), sys.executable, str(stand.blender)
    )
    with slurm.cluster() as environment:
        subprocess.run(["sbatch", str(script)], env=environment, check=True, capture_output=True)
        deadline = time.monotonic() + 500
        killed = 0
        while frozen.find_missing(stand.dataset):
            said = "".join(log.read_text() for log in stand.dataset.glob("slurm/*.log"))
            assert time.monotonic() < deadline, said
            runners = _runners(stand.dataset)
            if runners and not killed and (stand.folder / "log").exists():
                killed = runners[0]
                os.kill(killed, signal.SIGKILL)
            time.sleep(0.5)
        said = "".join(log.read_text() for log in stand.dataset.glob("slurm/*.log"))
        assert killed
        assert "the share is requeued" in said
        while subprocess.run(["squeue", "-h"], env=environment, capture_output=True, text=True, check=True).stdout:
            assert time.monotonic() < deadline, said
            time.sleep(0.5)
    stand.assert_done()
    assert not [p for p in verify_data_set(stand.dataset).problems if p.kind in ("missing", "leftover", "foreign")]
