"""A data set of a released version goes on: what is taken out of it is rendered again under its old name."""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.workers.verify_dataset import verify_data_set
from olddata import DATA, OLD, copied


@pytest.mark.parametrize("old", OLD)
def test_a_pair_that_was_taken_out_is_made_again_and_the_others_stay(old, tmp_path):
    """What a pair looks like may change from version to version; what it is called and what it is asked for may not."""
    dataset = copied(old, tmp_path)
    gone, *kept = sorted((dataset / "pairs").iterdir())
    was, before = read_pair(gone), {file: file.read_bytes() for folder in kept for file in folder.iterdir()}
    shutil.rmtree(gone)
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "icymoon",
            "batch",
            str(DATA / old / "plan.toml"),
            "--out",
            str(dataset),
            "--workers",
            "1",
            "--threads-per-worker",
            "1",
        ],
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert {file: file.read_bytes() for file in before} == before
    again = read_pair(gone)
    assert (again.settings, again.camera, again.data["seeds"]) == (was.settings, was.camera, was.data["seeds"])
    assert again.data["files"].keys() == was.data["files"].keys()
    assert verify_data_set(dataset).problems == ()
    assert datasets.read_frozen_plan(dataset).find_missing(dataset) == []
