"""Continuing an evaluation that was stopped, and marking pairs that fail the self-check."""

import json
import os
import signal
import subprocess
import sys
import tracemalloc

import numpy as np
import pairs
import pytest
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.fusion import fuse
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.metrics import COSTS
from icymoon.stereo.report import row_log
from icymoon.stereo.report.row_log import LazyRows, RowLog
from icymoon.support.errors import IcyMoonError

pytestmark = [pytest.mark.filterwarnings("error"), pytest.mark.usefixtures("undrawn")]

NAMES = ("a", "b", "c")


@pytest.fixture
def dataset(tmp_path):
    for name in NAMES:
        pairs.write_pair(tmp_path / "set" / "pairs" / name, rig=pairs.camera(192, 96))
    return tmp_path / "set"


@pytest.fixture
def matched(monkeypatch):
    """The methods that were really run."""
    runs = []
    real = fuse.match_checked

    def match(method, *arguments):
        runs.append(method)
        return real(method, *arguments)

    monkeypatch.setattr(fuse, "match_checked", match)
    return runs


def same_but_time(one, other):
    def timeless(rows):
        return [{**row, **dict.fromkeys(COSTS)} for row in rows]

    return timeless(one) == timeless(other)


def test_only_what_is_missing_is_made(dataset, tmp_path, matched):
    once = evaluate([dataset], parse_methods("bm,sgbm"), tmp_path / "once")
    matched.clear()
    evaluate([dataset / "pairs" / "b"], parse_methods("sgbm"), tmp_path / "out")
    evaluate([dataset], parse_methods("sgbm"), tmp_path / "out")
    assert matched == ["sgbm"] * 3
    report = evaluate([dataset], parse_methods("bm,sgbm"), tmp_path / "out")
    assert matched == ["sgbm"] * 3 + ["bm"] * 3
    # Bit by bit it is what one run gives: what the methods have in common was worked out anew.
    assert same_but_time(report["rows"], once["rows"])
    assert list(report["pairs"]) == list(once["pairs"])


@pytest.mark.long
def test_other_options_sensors_and_images_are_other_rows(dataset, tmp_path, matched):
    def run(methods="bm", options=(), sensor=None):
        matched.clear()
        evaluate([dataset], parse_methods(methods, options), tmp_path / "out", sensor)
        return len(matched)

    assert run() == 3
    assert run(options=["bm.window=21"]) == 3
    assert run(options=["bm.window=21"]) == 0
    assert run("bm:window=21,bm") == 6  # under another label
    assert run("bm:window=21,bm") == 0
    assert run("bm", sensor={"sensor": {"bits": 12}}) == 3
    pair = dataset / "pairs" / "b" / "pair.json"
    pair.write_text(json.dumps(json.loads(pair.read_text()) | {"platform": "elsewhere"}))
    assert run("bm", sensor={"sensor": {"bits": 12}}) == 1


def _log_turned_into(turn):
    def harm(out):
        log = out / "results.jsonl"
        log.write_bytes(turn(log.read_bytes()))

    return harm


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize(
    "harm",
    [
        lambda out: (out / "pairs" / "b" / "bm.npz").unlink(),
        lambda out: (out / "pairs" / "b" / "bm_error.png").unlink(),
        _log_turned_into(lambda content: content[:-20]),
        _log_turned_into(lambda content: content.replace(b'"pair"', b'"poir"', 1)),
        _log_turned_into(lambda content: b"\x00\xff\n" + content.split(b"\n", 1)[1]),
    ],
    ids=["disparity gone", "picture gone", "last row cut", "key misspelt", "row overwritten"],
)
def test_only_damaged_files_are_made_again(dataset, tmp_path, matched, harm):
    before = evaluate([dataset], parse_methods("bm"), tmp_path)
    rows = list(before["rows"])
    matched.clear()
    harm(tmp_path)
    after = evaluate([dataset], parse_methods("bm"), tmp_path)
    assert matched == ["bm"]
    assert same_but_time(after["rows"], rows)


def test_a_damaged_disparity_is_found_when_it_is_needed(dataset, tmp_path, matched):
    evaluate([dataset], parse_methods("bm"), tmp_path)
    npz = tmp_path / "pairs" / "b" / "bm.npz"
    npz.write_bytes(npz.read_bytes()[:200])
    matched.clear()
    evaluate([dataset], parse_methods("bm,sgbm"), tmp_path)
    assert sorted(matched) == ["bm", "sgbm", "sgbm", "sgbm"]


def test_missing_facts_of_a_pair_cost_no_matching(dataset, tmp_path, matched):
    facts = list(evaluate([dataset], parse_methods("bm"), tmp_path)["pairs"])
    matched.clear()
    (tmp_path / "pairs" / "a" / "facts.json").write_text("{")
    assert list(evaluate([dataset], parse_methods("bm"), tmp_path)["pairs"]) == facts
    assert not matched


def test_failures_are_tried_again(dataset, tmp_path, matched):
    left = dataset / "pairs" / "a" / "left.exr"
    whole = left.read_bytes()
    left.write_bytes(whole[:500])
    assert [r["status"] for r in evaluate([dataset], parse_methods("bm"), tmp_path)["rows"]] == ["failed", "ok", "ok"]
    left.write_bytes(whole)
    matched.clear()
    report = evaluate([dataset], parse_methods("bm"), tmp_path)
    assert [row["status"] for row in report["rows"]] == ["ok"] * 3
    assert (matched, report["failed"]) == (["bm"], [])


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_a_killed_run_loses_one_row_at_most(dataset, tmp_path, matched):
    command = [
        sys.executable,
        "-m",
        "icymoon.stereo",
        "evaluate",
        str(dataset),
        "--methods",
        "bm,sgbm",
        "--out",
        str(tmp_path / "out"),
        "--json-lines",
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    for _ in range(3):
        told = json.loads(process.stdout.readline())
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=240)
    assert not (tmp_path / "out" / "report.json").exists()
    report = evaluate([dataset], parse_methods("bm,sgbm"), tmp_path / "out")
    assert len(matched) <= 6 - told["done"]  # what was told as done is kept, also the first method of a pair
    assert [row["status"] for row in report["rows"]] == ["ok"] * 6
    assert same_but_time(report["rows"], evaluate([dataset], parse_methods("bm,sgbm"), tmp_path / "once")["rows"])


def test_a_pair_that_contradicts_itself_is_marked_and_not_averaged(dataset, tmp_path):
    """Its baseline is 6 % too short, as that of the reference code."""
    path = dataset / "pairs" / "b" / "pair.json"
    data = json.loads(path.read_text())
    for topic in (data["camera"], data["settings"]["rig"]):
        topic["baseline_m"] *= 80 / 85.333
    data["camera"]["focal_baseline_px_m"] *= 80 / 85.333
    path.write_text(json.dumps(data))
    events = []
    report = evaluate([dataset], parse_methods("bm,sgbm"), tmp_path, on_event=events.append)
    for again in (report, evaluate([dataset], parse_methods("bm,sgbm"), tmp_path)):
        rows = list(again["rows"])
        assert [row["status"] for row in rows] == ["ok", "ok", "suspect", "suspect", "ok", "ok"]
        assert rows[2]["l1_m"] > 0.1
        assert [entry["pair"] for entry in again["suspect"]] == ["b"]
        for k, entry in enumerate(again["summary"]):
            assert (entry["pairs"], entry["suspect"], entry["failed"]) == (2, 1, 0)
            assert entry["l1_m"] == pytest.approx(np.mean([rows[k]["l1_m"], rows[4 + k]["l1_m"]]))
            assert entry["n"] == rows[k]["n"] + rows[4 + k]["n"]
        assert all(entry["pairs"] == 2 for entry in again["comparisons"])
    assert "f·B is changed by +6.67 %" in next(event for event in events if event["type"] == "warning")["message"]
    assert "left out of the averages" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_two_pairs_of_one_name_are_not_mixed_up(tmp_path):
    for name in ("one", "two", "copy"):
        pairs.write_pair(tmp_path / name / "pairs" / "pair")
    path = tmp_path / "two" / "pairs" / "pair" / "pair.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"id": pairs.id_of("another")}))
    with pytest.raises(IcyMoonError, match="different pairs of the same name"):
        evaluate([tmp_path / "one", tmp_path / "two"], parse_methods("bm"), tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert len(evaluate([tmp_path / "one", tmp_path / "copy"], parse_methods("bm"), tmp_path / "out")["rows"]) == 1


def test_the_log_holds_no_rows_in_memory(tmp_path):
    def measure():
        """What the log holds, bytes: threads that earlier tests have left allocate, too."""
        own = tracemalloc.Filter(True, row_log.__file__, all_frames=True)
        return sum(each.size for each in tracemalloc.take_snapshot().filter_traces([own]).traces)

    tracemalloc.start(12)
    log = RowLog(tmp_path / "rows.jsonl")
    row = {"method": "bm", "key": "k", "long": "x" * 5000}
    for k in range(400):
        log.append(row | {"pair": f"pair{k}"})
    rows = iter(LazyRows(400, lambda k: log.read(f"pair{k}", "bm")))
    assert [len(next(rows)["long"]) for _ in range(399)] == [5000] * 399
    last, held = next(rows), measure()  # while rows are read
    tracemalloc.stop()
    assert 5000 < held < 400 * 1000  # of 2 MB: the last row, and the place of each
    assert last["pair"] == "pair399"
    assert RowLog(tmp_path / "rows.jsonl").find("pair7", "bm", "k")["pair"] == "pair7"


def test_of_several_rows_the_last_one_counts_and_compacting_keeps_it(tmp_path):
    log = RowLog(tmp_path / "rows.jsonl")
    for pair, value in (("b", 1), ("a", 2), ("b", 3), ("z", 4)):
        log.append({"pair": pair, "method": "bm", "key": str(value), "value": value})
    assert log.find("b", "bm", "1") is None
    log.compact([("a", "bm"), ("b", "bm")])
    assert [json.loads(line)["value"] for line in (tmp_path / "rows.jsonl").read_text().splitlines()] == [2, 3, 4]
    for reader in (log, RowLog(tmp_path / "rows.jsonl")):
        assert [reader.read(pair, "bm")["value"] for pair in "abz"] == [2, 3, 4]


def test_a_log_that_another_program_removes_is_reported_in_a_sentence(tmp_path):
    log = RowLog(tmp_path / "results.jsonl")
    for pair in ("one", "two"):
        log.append({"pair": pair, "method": "bm", "key": "k", "value": 1})
    (tmp_path / "results.jsonl").write_text('{"pair": "another", "method": "bm", "key": "k"}\n')
    for read in (lambda: log.read("one", "bm"), lambda: log.find("two", "bm", "k")):
        with pytest.raises(IcyMoonError, match=r"results\.jsonl was changed by another program .*; evaluate again"):
            read()
