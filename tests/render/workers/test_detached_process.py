"""A process that outlives the one that started it, is heard again, and is never mistaken for another."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest
from icymoon.render.workers.detached_process import DetachedProcess, find_unwatched_process
from icymoon.support.errors import IcyMoonError

TALKS = (
    "import json, sys, time\n"
    "for k in range(int(sys.argv[1])):\n"
    "    print(json.dumps({'type': 'progress', 'fraction': k, 'message': 'working'}), flush=True)\n"
    "    time.sleep(0.05)\n"
    "print('last words', flush=True)\n"
)
FACTS = {"title": "Render Data Set", "dataset": "here"}


def start(folder, program=TALKS, *arguments):
    return DetachedProcess.start([sys.executable, "-c", program, *arguments], folder / "one", FACTS)


def heard(process, seconds=30.0):
    """Everything until the end."""
    messages, end = [], time.monotonic() + seconds
    while process.running and time.monotonic() < end:
        messages += process.poll()
        time.sleep(0.02)
    return messages + process.poll()


def test_it_is_heard_to_the_end(tmp_path):
    process = start(tmp_path, TALKS, "5")
    assert [m["fraction"] for m in heard(process)] == [0, 1, 2, 3, 4]
    assert process.returncode == 0
    assert process.cause == "last words"
    assert not process.running
    assert find_unwatched_process(tmp_path) is None


def test_it_goes_on_without_its_watcher_and_is_heard_again(tmp_path):
    first = start(tmp_path, TALKS, "60")
    while not first.poll():
        time.sleep(0.02)
    assert find_unwatched_process(tmp_path) is None  # it is watched
    first.leave = True
    first.stop()
    assert not first.running
    assert not first.cancelled
    second = find_unwatched_process(tmp_path)
    assert second.facts["dataset"] == "here"
    assert find_unwatched_process(tmp_path) is None  # and now again
    assert [m["fraction"] for m in heard(second)] == list(range(60))  # from the beginning: nothing is missed
    assert second.cause == "last words"


def test_it_outlives_the_python_that_started_it(tmp_path):
    starter = (
        f"import sys; sys.path[:0] = {sys.path!r}\n"
        "from pathlib import Path\n"
        "from icymoon.render.workers.detached_process import DetachedProcess\n"
        f"DetachedProcess.start([sys.executable, '-c', {TALKS!r}, '40'], Path({str(tmp_path / 'one')!r}), {FACTS!r})\n"
        "import os; os._exit(1)"
    )
    subprocess.run([sys.executable, "-c", starter], check=False, timeout=60)
    process = find_unwatched_process(tmp_path)
    assert len(heard(process)) == 40
    assert process.returncode is None  # only who started it is told


@pytest.mark.skipif(sys.platform == "win32", reason="there a process is ended alone")
@pytest.mark.parametrize("end", [DetachedProcess.cancel, DetachedProcess.stop])
def test_what_it_has_started_ends_with_it(tmp_path, end):
    parent = (
        "import subprocess, sys\n"
        f"subprocess.call([sys.executable, '-c', {TALKS!r}, '2000'], stdin=subprocess.DEVNULL)\n"
    )
    process = start(tmp_path, parent)
    while not process.poll():
        time.sleep(0.02)
    end(process)
    heard(process)
    size = (tmp_path / "one.log").stat().st_size
    time.sleep(0.5)  # in which the child would have spoken ten times
    assert (tmp_path / "one.log").stat().st_size == size


@pytest.mark.parametrize("attached", [False, True])
def test_cancel_and_stop_end_it(tmp_path, attached):
    for end in (DetachedProcess.cancel, DetachedProcess.stop):
        process = start(tmp_path, TALKS, "2000")
        while not process.poll():
            time.sleep(0.02)
        if attached:
            process.leave = True
            process.stop()
            process = find_unwatched_process(tmp_path)
        end(process)
        heard(process)
        assert process.cancelled
        assert not process.running
        assert find_unwatched_process(tmp_path) is None


def test_one_that_does_not_obey_is_made_to(tmp_path):
    process = start(
        tmp_path,
        "import signal, time\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        'print(\'{"type": "deaf"}\', flush=True)\ntime.sleep(600)',
    )
    while not process.poll():
        time.sleep(0.02)
    process.cancel()
    heard(process)
    assert not process.running


def test_it_runs_once(tmp_path):
    process = start(tmp_path, TALKS, "2000")
    with pytest.raises(IcyMoonError, match="running already for here"):
        start(tmp_path)
    process.stop()
    again = start(tmp_path, TALKS, "1")
    assert len(heard(again)) == 1


def test_what_cannot_be_started_is_named_and_locks_nothing(tmp_path):
    with pytest.raises(IcyMoonError, match="/nowhere/python"):
        DetachedProcess.start(["/nowhere/python"], tmp_path / "one", FACTS)
    assert len(heard(start(tmp_path, TALKS, "1"))) == 1


def test_leftovers_of_what_has_ended_are_not_taken_for_it(tmp_path):
    heard(start(tmp_path, TALKS, "1"))
    (tmp_path / "two.lock").write_bytes(b"")
    (tmp_path / "three.lock").write_bytes(b"")
    (tmp_path / "three.json").write_text("nonsense")
    assert find_unwatched_process(tmp_path) is None
