"""Several processes measure what one does; a killed one loses its pair, and a killed evaluation goes on."""

import os
import signal
import subprocess
import sys
import time

import pairs
import pytest
from icymoon.stereo import measuring_processes as module
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.matchers.methods import Method, parse_methods
from icymoon.stereo.measure.metrics import COSTS
from icymoon.support import system
from icymoon.support.files import PART_SUFFIX

pytestmark = [pytest.mark.filterwarnings("error"), pytest.mark.usefixtures("undrawn")]

NAMES = ("a", "b", "c", "d", "e")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("set")
    for name in NAMES:
        pairs.write_pair(root / "pairs" / name, rig=pairs.camera(96, 48))
    return root


def timeless(report):
    return [{**row, **dict.fromkeys(COSTS)} for row in report["rows"]]


@pytest.mark.parametrize(
    ("jobs", "methods", "many", "count"),
    [
        (None, ["bm", "sgbm"], 5000, 2),
        (None, ["bm"], 7, 1),
        (None, ["bm"], 8, 2),
        (None, ["bm", "igev"], 5000, 1),
        (None, ["external"], 5000, 1),
        (3, ["igev"], 2, 3),
        (None, ["prediction", "jplv", "sgbm_wls"], 16, 2),
    ],
)
def test_as_many_processes_as_there_are_processors_and_pairs_for(monkeypatch, jobs, methods, many, count):
    monkeypatch.setattr(module, "count_processors", lambda: 2)
    assert module.choose_process_count(jobs, [Method(name, name, {}) for name in methods], many) == count


@pytest.mark.long
@pytest.mark.heavy
def test_several_processes_give_what_one_gives(dataset, tmp_path):
    one = evaluate([dataset], parse_methods("bm,sgbm"), tmp_path / "one", jobs=1)
    events = []
    two = evaluate([dataset], parse_methods("bm,sgbm"), tmp_path / "two", on_event=events.append, jobs=2)
    assert timeless(two) == timeless(one)
    assert list(two["pairs"]) == list(one["pairs"])
    done = [event["done"] for event in events if event["type"] == "progress"]
    assert done == list(range(1, 11))
    for path in (tmp_path / "one" / "pairs").rglob("*.png"):
        assert path.read_bytes() == (tmp_path / "two" / path.relative_to(tmp_path / "one")).read_bytes()
    # Nothing is left to do, so no process starts.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "start", None)
        assert timeless(evaluate([dataset], parse_methods("bm,sgbm"), tmp_path / "two", jobs=2)) == timeless(one)


def note_starts(monkeypatch):
    """The measuring processes that are started from now on."""
    started, real = [], module.start

    def start(*arguments, **streams):
        started.append(real(*arguments, **streams))
        return started[-1]

    monkeypatch.setattr(module, "start", start)
    return started


def write_part(folder, pid):
    part = folder / f"bm.npz.{system.find_computer_name()}-{pid}-1{PART_SUFFIX}"
    part.parent.mkdir(parents=True, exist_ok=True)
    part.write_bytes(b"half")
    return part


@pytest.mark.heavy
def test_an_interrupt_leaves_nothing_half_written(dataset, tmp_path, monkeypatch):
    started = note_starts(monkeypatch)

    def interrupt(event):
        for process in started:
            write_part(tmp_path / "pairs" / "a", process.pid)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate([dataset], parse_methods("bm"), tmp_path, on_event=interrupt, jobs=2)
    assert started
    assert not list(tmp_path.rglob(f"*{PART_SUFFIX}"))


@pytest.mark.skipif(os.name == "nt", reason="a number may be used again at once there")
def test_what_a_killed_evaluation_left_is_removed_and_what_another_writes_is_not(dataset, tmp_path):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    left = [write_part(tmp_path / "pairs" / "b", gone.pid), write_part(tmp_path / "pairs" / "of-another", gone.pid)]
    ours = write_part(tmp_path / "pairs" / "b", os.getpid())
    of_a_user = tmp_path / "pairs" / "b" / "half.part"
    of_a_user.write_bytes(b"")
    evaluate([dataset], parse_methods("bm"), tmp_path, jobs=1)
    assert not any(path.exists() for path in left)
    assert ours.exists()
    assert of_a_user.exists()


@pytest.mark.long
@pytest.mark.heavy
@pytest.mark.skipif(os.name == "nt", reason="no signal ends a process there")
def test_a_process_that_is_killed_fails_its_pair_and_no_other(dataset, tmp_path, monkeypatch):
    started = note_starts(monkeypatch)

    def kill_the_first(event):
        if event["type"] == "progress" and len(killed) == 0:
            killed.append(started[0].pid)
            os.kill(started[0].pid, signal.SIGKILL)

    killed = []
    report = evaluate([dataset], parse_methods("bm,sgbm"), tmp_path, on_event=kill_the_first, jobs=1 + 1)
    failed = {entry["pair"] for entry in report["failed"]}
    assert len(failed) <= 1
    assert len(report["rows"]) == 10
    assert all(
        "was ended by signal 9; there may be too little memory" in entry["message"] for entry in report["failed"]
    )
    again = evaluate([dataset], parse_methods("bm,sgbm"), tmp_path, jobs=1)
    assert [row["status"] for row in again["rows"]] == ["ok"] * 10


@pytest.mark.long
@pytest.mark.heavy
@pytest.mark.skipif(os.name == "nt", reason="no signal ends a process there")
def test_after_kill_9_the_rows_that_were_made_are_kept_and_no_process_stays(dataset, tmp_path):
    command = [
        sys.executable,
        "-m",
        "icymoon.stereo",
        "evaluate",
        str(dataset),
        "--methods",
        "bm,sgbm",
        "--jobs",
        "2",
        "--out",
        str(tmp_path),
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    log = tmp_path / "results.jsonl"
    while process.poll() is None and not (log.exists() and log.stat().st_size):
        time.sleep(0.01)
    children = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(process.pid)], capture_output=True, text=True, check=False
    ).stdout.split()
    process.kill()
    process.wait()
    rows = log.read_bytes().count(b"\n")
    assert rows > 0
    events = []
    report = evaluate([dataset], parse_methods("bm,sgbm"), tmp_path, on_event=events.append, jobs=1)
    assert [row["status"] for row in report["rows"]] == ["ok"] * 10
    for _ in range(100):
        if not any(os.path.exists(f"/proc/{child}/cmdline") for child in children):
            break
        time.sleep(0.1)
    assert not any(os.path.exists(f"/proc/{child}/cmdline") for child in children)


@pytest.mark.heavy
def test_what_a_matcher_prints_is_no_message(tmp_path):
    code = (
        "import os\nfrom icymoon.stereo import measuring_processes as m\n"
        "out = m._take_standard_output()\nprint('noise')\nos.write(1, b'more')\nm._write_event(out, {'type': 'done'})\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == '{"type": "done"}\n'
    assert "noise" in done.stderr
