"""The paper's tables and figures from nothing, and what is left of a run that was killed."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import time

import pytest
from icymoon.render.workers.job_commands import python_command

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
TINY = (
    "reproduce",
    "guiss",
    "--pairs",
    "7",
    "--scale",
    "0.2",
    "--no-figures",
    "--set",
    "quality.bake_samples=4",
    "--set",
    "terrain.resolution=65",
)


@pytest.mark.long
def test_a_killed_run_goes_on_and_makes_the_tables(tmp_path, monkeypatch):
    monkeypatch.setenv("ICYMOON_CHECKPOINTS", str(tmp_path / "none"))
    command = python_command(sys.executable, *TINY, "--out", str(tmp_path / "paper"))
    first = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    data = tmp_path / "paper" / "data"
    end = time.monotonic() + 600
    while not any(data.glob("pairs/*/pair.json")):
        assert first.poll() is None, "it ended before the first pair"
        assert time.monotonic() < end
        time.sleep(0.1)
    os.killpg(first.pid, signal.SIGKILL)
    first.wait()
    before = {path: path.stat().st_mtime_ns for path in data.rglob("pair.json")}
    assert before
    ended = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert ended.returncode == 0, ended.stderr
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert "no checkpoint" in ended.stderr
    with (tmp_path / "paper" / "results.csv").open(encoding="utf-8") as stream:
        rows = {(row["group"], row["method"], row["metric"]): row for row in csv.DictReader(stream)}
    assert [rows[group, "StereoBM", "l1_m"]["pairs"] for group in ("All", "Reconstructed", "Synthetic")] == [
        "10",
        "4",
        "6",
    ]
    assert rows["All", "IGEV", "l1_m"]["measured"] == ""
    assert 0 < float(rows["All", "JPLV", "coverage"]["measured"]) <= 1
    page = (tmp_path / "paper" / "paper.html").read_text(encoding="utf-8")
    assert "IGEV: igev has no checkpoint" in page
    assert "10 pairs of 10 (4 reconstructed and 6 synthetic) from" in page
