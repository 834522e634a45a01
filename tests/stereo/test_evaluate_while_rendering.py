"""Pairs that are measured while others are rendered: the same tables as from one evaluation of all."""

import json
import shutil
import subprocess
import sys
import threading
import time

import icymoon.stereo.evaluate as evaluating
import pairs
import pytest
from icymoon.render.workers.job_commands import python_command
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.evaluate_while_rendering import measure_completed_pairs
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.metrics import COSTS
from icymoon.support.errors import IcyMoonError

METHODS = parse_methods("bm,bm:window=21")
SCENES = {"aaa": pairs.Scene(), "bbb": pairs.Scene(sky_rows=24, distance_m=3.0), "ccc": pairs.Scene(rock=False)}


def rows(out):
    """The lines of the log without what a computer took."""
    return [
        {key: value for key, value in json.loads(line).items() if key not in COSTS}
        for line in (out / "results.jsonl").read_text(encoding="utf-8").splitlines()
    ]


@pytest.fixture(scope="module")
def complete(tmp_path_factory):
    root = tmp_path_factory.mktemp("whole")
    for name, scene in SCENES.items():
        pairs.write_pair(root / "set" / "pairs" / name, scene)
    evaluate([root / "set"], METHODS, root / "out", jobs=1)
    return root


@pytest.mark.long
def test_tables_are_those_of_an_evaluation_of_all_and_nothing_is_measured_twice(complete, tmp_path, monkeypatch):
    data, out = tmp_path / "set", tmp_path / "out"
    data.mkdir()
    looks = iter(range(10**6))

    def is_over():
        """Let another pair be complete at each look, the last one first, and then end."""
        k = next(looks)
        if 0 < k <= 2:  # nothing is there yet at the first look
            name = sorted(SCENES)[-k]
            shutil.copytree(complete / "set" / "pairs" / name, data / "pairs" / name)
        return k > 8

    measure_completed_pairs(data, METHODS, out, {}, is_over)
    assert {row["pair"] for row in rows(out)} == {"bbb", "ccc"}
    assert not (out / "report.json").exists()

    measured = []
    real = evaluating.measure_pair
    monkeypatch.setattr(
        evaluating, "measure_pair", lambda source, run, task: measured.append(task.pair) or real(source, run, task)
    )
    pairs.write_pair(data / "pairs" / "aaa", SCENES["aaa"])
    evaluate([data], METHODS, out, jobs=1)
    assert measured == ["aaa"]
    assert rows(out) == rows(complete / "out")
    tables = [json.loads((folder / "summary.json").read_text(encoding="utf-8")) for folder in (out, complete / "out")]
    for table in tables:
        table.pop("provenance")
        table.pop("shown")  # rows that are compared already
        table["comparisons"] = [entry for entry in table["comparisons"] if entry["metric"] not in COSTS]
        for entry in table["summary"]:
            for key in [key for key in entry if any(cost in key for cost in COSTS)]:
                entry.pop(key)
    assert tables[0] == tables[1]


@pytest.mark.long
def test_a_damaged_pair_is_left_for_the_evaluation_that_tells_of_it(complete, tmp_path):
    data, out = tmp_path / "set", tmp_path / "out"
    pairs.write_pair(data / "pairs" / "aaa", SCENES["aaa"])
    pairs.write_pair(data / "pairs" / "bad", SCENES["ccc"])
    (data / "pairs" / "bad" / "left.exr").write_bytes(b"no image")
    looks = iter(range(100))
    measure_completed_pairs(data, METHODS, out, {}, lambda: next(looks) > 4)
    report = evaluate([data], METHODS, out, jobs=1)
    assert {entry["pair"] for entry in report["failed"]} == {"bad"}
    assert {row["pair"]: row["status"] for row in rows(out)} == {"aaa": "ok", "bad": "failed"}


@pytest.mark.long
def test_files_that_no_evaluation_wrote_are_kept(complete, tmp_path):
    (tmp_path / "results.jsonl").write_text("mine\n")
    with pytest.raises(IcyMoonError, match="not written by an evaluation"):
        measure_completed_pairs(complete / "set", METHODS, tmp_path, {}, lambda: True)
    assert (tmp_path / "results.jsonl").read_text() == "mine\n"


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("killed", [False, True])
def test_the_process_ends_with_its_input_and_what_is_killed_is_done_again(complete, tmp_path, killed):
    out = tmp_path / "out"
    command = python_command(
        sys.executable,
        "stereo",
        "evaluate",
        str(complete / "set"),
        "--methods",
        "bm,bm:window=21",
        "--out",
        str(out),
        "--follow",
    )
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        limit = threading.Timer(300, process.kill)
        limit.start()
        while process.poll() is None and not (out / "results.jsonl").is_file():
            time.sleep(0.05)
        if killed:
            process.kill()
        process.stdin.close()
        status = process.wait()
        limit.cancel()
    assert killed or status == 0, process.stderr
    assert not (out / "report.html").exists()
    evaluate([complete / "set"], METHODS, out, jobs=1)
    assert rows(out) == rows(complete / "out")
    assert not list(out.rglob("*.part*"))
