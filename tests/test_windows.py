"""Everything that writes, removes or starts something, under a layer that behaves as Windows does; see ``windows``."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path, PureWindowsPath

import pairs
import pytest
from icymoon.render.pairs.pair_folder import is_complete
from icymoon.render.pairs.publish_pair import publish_pair
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.workers import runner as running
from icymoon.render.workers.detached_process import DetachedProcess, find_unwatched_process
from icymoon.render.workers.pair_claims import Claims
from icymoon.render.workers.process import Process
from icymoon.render.workers.runner import Runner, WorkerOptions
from icymoon.render.workers.verify_dataset import verify_data_set
from icymoon.support import files, system
from icymoon.support.errors import IcyMoonError
from icymoon.support.version import ROOT
from plans import grid
from windows import Windows, wait_until

MAIN = str(ROOT / "__main__.py")
PAIRS = grid(seeds=1)
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the layer asks Linux who has a file open")


@pytest.fixture
def layer(tmp_path, monkeypatch):
    (tmp_path / "C" / "temp").mkdir(parents=True)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "C" / "temp"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "C" / "temp"))
    monkeypatch.setenv("COVERAGE_PROCESS_START", "")
    found = Windows(tmp_path / "C", tmp_path / "processes")
    found.install()
    yield found
    faults = found.all_faults()
    found.remove()
    assert not faults


@pytest.fixture
def drive(layer):
    return Path(layer.drive)


@pytest.fixture
def pair_set(tmp_path):
    """Two synthetic pairs, made before the layer is put on."""
    (tmp_path / "C").mkdir()
    for name in ("0123456789ab", "ba9876543210"):
        pairs.write_pair(tmp_path / "C" / "set" / "pairs" / name, rig=pairs.camera(96, 64))
    return tmp_path / "C" / "set"


def files_in(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def icymoon(*words: object) -> subprocess.CompletedProcess:
    """A command in a process of its own, which lives under the layer too."""
    return subprocess.run(
        [sys.executable, MAIN, *map(str, words)],
        capture_output=True,
        encoding="utf-8",
        check=False,
        stdin=subprocess.DEVNULL,
        timeout=300,
    )


# Files


def held_by_another(path: Path, seconds: float) -> threading.Thread:
    """Another program opens a file, as a virus scanner does, and closes it after a while."""
    stream = path.open("rb")

    def close() -> None:
        time.sleep(seconds)
        stream.close()

    thread = threading.Thread(target=close)
    thread.start()
    return thread


def test_a_file_that_is_open_for_a_moment_is_waited_for(drive):
    files.write_text(drive / "a.toml", "old")
    thread = held_by_another(drive / "a.toml", 0.2)
    files.write_text(drive / "a.toml", "new")
    thread.join()
    assert (drive / "a.toml").read_bytes() == b"new"
    thread = held_by_another(drive / "a.toml", 0.2)
    system.remove(drive / "a.toml")
    thread.join()
    assert files_in(drive) == []


def test_a_file_that_stays_open_is_named_and_keeps_its_content(drive, monkeypatch):
    monkeypatch.setattr(system, "_RETRY_WAITS_S", (0.0,) * 5)
    files.write_text(drive / "report.csv", "old")
    with (drive / "report.csv").open("rb"), pytest.raises(IcyMoonError, match=r"report\.csv: .*open.*close it"):
        files.write_text(drive / "report.csv", "new")
    assert (drive / "report.csv").read_bytes() == b"old"
    assert files_in(drive) == ["report.csv"]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("CON", "of a device"),
        ("nul.toml", "of a device"),
        ("a:b.toml", "':'"),
        ("a?.toml", r"'\?'"),
        ("a.", "full stop"),
    ],
)
def test_a_name_that_windows_takes_for_something_else_is_said_before_anything_is_written(drive, name, why):
    with pytest.raises(IcyMoonError, match=why):
        files.write_text(drive / name / "settings.toml", "x")
    with pytest.raises(IcyMoonError, match=why):
        files.write_text(drive / name, "x")
    assert files_in(drive) == []
    assert [path.name for path in drive.iterdir()] == ["temp"]


def test_a_folder_too_deep_is_said_before_a_pair_is_rendered(drive, monkeypatch):
    """One character more than what is written there may have; with that many a pair can be written."""
    pair = PAIRS[0].id
    name = files.make_part_path(files.make_part_path(drive / "x" / "pairs" / pair) / "pair.json")
    room = system.LONGEST_WINDOWS_PATH - len(str(name)) - 20  # the numbers of parts may grow meanwhile
    deep = drive / ("x" * (room + 22))
    with pytest.raises(IcyMoonError, match=r"26\d characters.*shorter path"):
        Claims(deep).take(pair)
    assert not deep.exists()
    fits = drive / ("x" * room)
    claims = Claims(fits)
    assert claims.take(pair)
    part = files.make_part_path(fits / "pairs" / pair)
    part.mkdir(parents=True)
    files.write_json(part / "pair.json", {})
    for image in ("left_toed_truth.exr", "right_toed_truth.exr"):
        (part / image).write_bytes(b"")
    claims.close()


def test_a_report_whose_path_is_too_long_is_a_sentence(drive):
    with pytest.raises(IcyMoonError, match=r"characters.*shorter path"):
        files.write_text(drive / ("x" * 100) / ("y" * 100) / "report.html", "")
    assert files_in(drive) == []


def test_that_nobody_listens_any_more_is_told_from_a_wrong_name(drive):
    assert system.is_broken_pipe(BrokenPipeError())
    assert system.is_broken_pipe(OSError(22, "Invalid argument"))
    with pytest.raises(OSError, match="syntax is incorrect") as raised:
        (drive / "a?").write_bytes(b"")
    assert not system.is_broken_pipe(raised.value)


# Measuring


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize(
    "words",
    [
        ("truth",),
        ("develop", "--set", "sensor.gain=2"),
        ("export", "--format", "kitti"),
        ("export", "--format", "middlebury"),
        *(pytest.param(("export", "--format", kind), marks=pytest.mark.slow) for kind in ("png8", "coco", "raw")),
    ],
    ids=lambda words: "-".join(words[:3:2]),
)
def test_pairs_are_measured_and_exported(pair_set, drive, words):
    out = drive / "out"
    done = icymoon("stereo", words[0], pair_set, *words[1:], "--out", out)
    assert (done.returncode, "Traceback" in done.stderr) == (0, False), done.stderr
    assert len(files_in(out)) >= 2
    assert not [name for name in files_in(drive) if name.endswith(".part")]
    assert files_in(drive / "temp") == []
    assert not any(system.find_name_fault(part) for name in files_in(out) for part in name.split("/"))


@pytest.mark.long
def test_pairs_are_evaluated_and_a_report_that_a_viewer_has_open_is_a_sentence(pair_set, drive):
    words = ("stereo", "evaluate", pair_set, "--methods", "bm,bm:window=9", "--points", "--out", drive / "out")
    done = icymoon(*words)
    assert done.returncode == 0, done.stderr
    before = (drive / "out" / "results.csv").read_bytes()
    with (drive / "out" / "results.csv").open("rb"):
        done = icymoon(*words)
    assert done.returncode == 1
    assert "results.csv: another program has it open" in done.stderr
    assert "Traceback" not in done.stderr
    assert (drive / "out" / "results.csv").read_bytes() == before
    assert not [name for name in files_in(drive) if name.endswith(".part")]
    assert files_in(drive / "temp") == []


def test_what_is_said_is_utf8_also_into_a_pipe(drive):
    (drive / "Ω月.toml").write_bytes(b"[")
    done = icymoon("render", "--settings", drive / "Ω月.toml", "--out", drive / "out")
    assert done.returncode == 1
    assert "Ω月.toml" in done.stderr


# Processes


TALKS = (
    "import sys; sys.path[:0] = {path!r}\n"
    "from icymoon.support import system\n"
    "from icymoon.render.workers.process import emit\n"
    "import time\n"
    "system.stop_with_starter({at_once})\n"
    "emit('progress', fraction=0)\n"
    "try:\n    time.sleep(600)\n"
    "except KeyboardInterrupt:\n    emit('said', what='stopped')\n"
)


def talks(at_once: bool = False) -> list[str]:
    return [sys.executable, "-c", TALKS.format(path=sys.path, at_once=at_once)]


def first_word(process) -> None:
    wait_until(lambda: bool(process.poll()))


def heard(process) -> list[dict]:
    found: list[dict] = []
    wait_until(lambda: bool(found.extend(process.poll())) or not process.running, 30.0)
    return found + process.poll()


@pytest.mark.parametrize("at_once", [False, True])
def test_a_process_hears_that_it_is_to_stop(drive, at_once):
    process = Process(talks(at_once))
    first_word(process)
    process.cancel()
    assert [message.get("what") for message in heard(process)] == ([] if at_once else ["stopped"])
    assert process.returncode >= 0  # it was not killed


def test_a_process_that_does_not_listen_is_ended(drive):
    process = Process([sys.executable, "-c", 'print(\'{"type": "deaf"}\', flush=True); import time; time.sleep(600)'])
    first_word(process)
    process.cancel()
    heard(process)
    assert process.returncode != 0


def test_a_process_ends_with_the_one_that_started_it(drive):
    starter = (
        f"import sys; sys.path[:0] = {sys.path!r}\nfrom icymoon.render.workers.process import Process\n"
        f"process = Process({talks()!r})\nprint(process.pid, flush=True)\nimport os, time; time.sleep(600)"
    )
    parent = subprocess.Popen([sys.executable, "-c", starter], stdout=subprocess.PIPE)
    child = int(parent.stdout.readline())
    time.sleep(1.0)
    parent.kill()
    wait_until(lambda: not lives(child), 30.0)


def lives(pid: int) -> bool:
    done = subprocess.run(
        [sys.executable, "-I", "-c", "import sys; print(open(f'/proc/{sys.argv[1]}/stat').read())", str(pid)],
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    return done.returncode == 0 and done.stdout.rsplit(")", 1)[1].split()[0] != "Z"


def test_no_process_shows_a_window_or_hears_our_ctrl_c(layer, drive):
    process = Process(talks())
    detached = DetachedProcess.start(talks(), drive / "running" / "one", FACTS)
    program = system.start([sys.executable, "-c", ""])
    system.run([sys.executable, "-c", ""])
    for started in (process, detached):
        started.stop()
    program.wait()
    assert len(layer.started) == 4
    assert not any(window for _, window, _ in layer.started)
    assert not any(hears for _, _, hears in layer.started)


def test_a_program_of_ones_own_is_ended_with_all_that_it_has_started(layer, drive):
    """Which taskkill does there: the system's, not one that lies in the current folder."""
    code = (
        "import subprocess, sys, time\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])\n"
        "print(child.pid, flush=True); time.sleep(600)"
    )
    process = system.start([sys.executable, "-c", code], stdout=subprocess.PIPE)
    child = int(process.stdout.readline())
    system.kill_all(process)
    wait_until(lambda: not lives(child), 30.0)
    taskkill = PureWindowsPath(next(command[0] for command, *_ in layer.started if "taskkill" in command[0]))
    assert taskkill.is_absolute()
    assert taskkill.parent.name == "System32"


def test_no_python_of_the_current_folder_is_started(layer, drive, monkeypatch):
    """Where Windows looks first for a program that has no path."""
    monkeypatch.chdir(drive)
    monkeypatch.setattr(system.shutil, "which", lambda name: str(Path.cwd() / f"{name}.exe"))
    assert Path.cwd() not in {path.parent for path in system.find_pythons(drive / "prefix")}
    monkeypatch.setattr(system.shutil, "which", lambda name: str(drive / "elsewhere" / f"{name}.exe"))
    assert drive / "elsewhere" in {path.parent for path in system.find_pythons(drive / "prefix")}


@pytest.mark.parametrize("gone", [False, True])
def test_who_is_stopped_while_a_program_runs_ends_it_and_tidies_up(drive, gone):
    """As an installation does: pip goes on for minutes, and half an environment would be taken for a whole one."""
    child = "import os, time; open(" + repr(str(drive / "pid")) + ", 'w').write(str(os.getpid())); time.sleep(600)"
    code = (
        f"import sys; sys.path[:0] = {sys.path!r}\nfrom icymoon.support import system\n"
        f"system.stop_with_starter()\ntry:\n    system.run([sys.executable, '-c', {child!r}])\n"
        f"finally:\n    open({str(drive / 'tidy')!r}, 'w').close()"
    )
    process = Process([sys.executable, "-c", code])
    wait_until(lambda: (drive / "pid").exists() and bool((drive / "pid").read_text(encoding="utf-8")))
    if gone:
        process._process.stdin.close()  # as when we had ended
    else:
        process.cancel()
    heard(process)
    assert (drive / "tidy").exists()
    pid = int((drive / "pid").read_text(encoding="utf-8"))
    wait_until(lambda: not lives(pid), 30.0)


def test_a_call_ends_with_who_called(drive):
    code = (
        f"import sys; sys.path[:0] = {sys.path!r}\nfrom icymoon.support import system\n"
        f"system.call_dependent({[*talks()[:2], 'import os; print(os.getpid(), flush=True)' + chr(10) + talks()[2]]!r})"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    child = int(parent.stdout.readline())
    wait_until(lambda: b"progress" in parent.stdout.readline())
    parent.kill()
    wait_until(lambda: not lives(child), 30.0)


FACTS = {"title": "Render Data Set", "dataset": "here"}


@pytest.mark.parametrize("attached", [False, True])
@pytest.mark.parametrize("end", [DetachedProcess.cancel, DetachedProcess.stop])
def test_what_goes_on_alone_is_found_again_and_stopped(drive, attached, end):
    process = DetachedProcess.start(talks(), drive / "running" / "one", FACTS)
    first_word(process)
    with pytest.raises(IcyMoonError, match="running already"):
        DetachedProcess.start(talks(), drive / "running" / "one", FACTS)
    assert find_unwatched_process(drive / "running") is None
    if attached:
        process.leave = True
        process.stop()
        with pytest.raises(IcyMoonError, match="running already"):  # although nobody watches it
            DetachedProcess.start(talks(), drive / "running" / "one", FACTS)
        process = find_unwatched_process(drive / "running")
        assert process is not None
    end(process)
    messages = heard(process)
    assert not process.running
    if end is DetachedProcess.cancel:
        assert messages[-1].get("what") == "stopped"
    assert find_unwatched_process(drive / "running") is None
    again = DetachedProcess.start(talks(), drive / "running" / "one", FACTS)
    first_word(again)
    time.sleep(0.6)  # more than twice as long as between two looks for a wish to stop
    assert again.poll() == []  # an earlier wish does not count
    assert again.running
    again.stop()


# Data sets


@pytest.fixture
def blender(drive):
    """A program that does the jobs of a worker without rendering."""
    here = Path(__file__).parent / "support" / "fake_blender.py"
    path = drive / "Program Files" / "Blender Foundation" / "blender.exe"
    path.parent.mkdir(parents=True)
    text = here.read_text(encoding="utf-8").replace("#!/usr/bin/env python3", f"#!{sys.executable}")
    path.write_text(text, encoding="utf-8", newline="\n")
    path.chmod(0o755)
    (path.parent / "behave.json").write_text("{}", encoding="utf-8")
    return path


def render(dataset: Path, blender: Path, said: list, **options) -> dict[str, str]:
    return Runner(
        dataset,
        PAIRS,
        WorkerOptions(2, 1, str(blender), **options),
        lambda kind, **facts: said.append({"type": kind, **facts}),
    ).run()


def test_a_data_set_is_rendered_whatever_workers_do_and_verified(drive, blender, monkeypatch):
    monkeypatch.setattr(running, "_WAIT_S", 0.05)
    bad = PAIRS[1].id
    (blender.parent / "behave.json").write_text(json.dumps({bad: "crash once"}), encoding="utf-8")
    dataset, said = drive / "My data", []
    datasets.freeze_plan(dataset, PAIRS, "")
    assert render(dataset, blender, said) == {}
    assert sorted(path.name for path in (dataset / "pairs").iterdir()) == sorted(pair.id for pair in PAIRS)
    assert all(is_complete(pair.folder(dataset)) for pair in PAIRS)
    assert not (dataset / "claims").exists()
    assert files_in(drive / "temp") == []
    (dataset / "pairs" / PAIRS[0].id / "left.exr").unlink()
    found = verify_data_set(dataset, remove_broken=True)
    assert found.complete < len(PAIRS)
    assert not is_complete(PAIRS[0].folder(dataset))


@pytest.mark.long
def test_a_batch_that_is_stopped_leaves_nothing_but_pairs_and_the_next_one_goes_on(drive, blender):
    plan = drive / "Plan Ω.toml"
    # As PowerShell 5 writes it by >.
    text = '[plan]\r\ntitle = "Ω"\r\n[[sweep]]\r\nkind = "grid"\r\nrig.heading_deg = [0.0, 90.0]\r\n'
    plan.write_bytes(text.encode("utf-16"))
    words = ("batch", plan, "--out", drive / "set", "--blender", blender, "--workers", 1, "--json")
    done = icymoon("plan", plan, "--dry-run", "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    (blender.parent / "behave.json").write_text(json.dumps({"all": "hang"}), encoding="utf-8")
    process = DetachedProcess.start([sys.executable, MAIN, *map(str, words)], drive / "running" / "one", FACTS)
    wait_until(lambda: any((drive / "set" / "pairs").glob("*.part")))
    process.cancel()
    messages = heard(process)
    assert process.returncode == 130, process.cause
    assert "done" not in {message["type"] for message in messages}
    (blender.parent / "behave.json").write_text("{}", encoding="utf-8")
    done = icymoon(*words)
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads(done.stdout.splitlines()[-1])["type"] == "done"
    assert len([name for name in files_in(drive / "set") if name.endswith("pair.json")]) == 2
    assert not any(name.endswith(".part") for name in files_in(drive / "set"))
    assert files_in(drive / "temp") == []


def test_the_claim_of_a_process_that_was_ended_is_given_to_the_next_at_once(drive):
    program = (
        f"import sys; sys.path[:0] = {sys.path!r}\nfrom pathlib import Path\n"
        f"from icymoon.render.workers.pair_claims import Claims\n"
        f"Claims(Path({str(drive / 'set')!r})).take({PAIRS[0].id!r})\n"
        "print(flush=True); import time; time.sleep(600)"
    )
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
    process.stdout.readline()
    mine = Claims(drive / "set")
    assert not mine.take(PAIRS[0].id)
    process.kill()
    wait_until(lambda: not lives(process.pid))
    assert mine.take(PAIRS[0].id)  # although we have a handle on it still
    process.wait()
    mine.release(PAIRS[0].id)
    assert mine.take(PAIRS[0].id)
    mine.close()


def unfinished(dataset: Path, content: bytes) -> Path:
    """A pair that is rendered and not published yet."""
    part = files.make_part_path(dataset / "pairs" / PAIRS[0].id)
    part.mkdir(parents=True)
    for eye in ("left", "right"):
        (part / f"{eye}.exr").write_bytes(content)
    files.write_json(
        part / "pair.json",
        {
            "id": PAIRS[0].id,
            "files": {f"{eye}.exr": {"bytes": len(content), "sha256": "0" * 64} for eye in ("left", "right")},
        },
    )
    return part


def test_a_pair_is_published_over_one_that_is_looked_at_once_it_is_closed(drive, monkeypatch):
    dataset = drive / "set"
    folder = PAIRS[0].folder(dataset)
    publish_pair(unfinished(dataset, b"old"), folder, lambda: False)
    thread = held_by_another(folder / "left.exr", 0.2)
    publish_pair(unfinished(dataset, b"new"), folder, lambda: False, again=True)
    thread.join()
    assert (folder / "left.exr").read_bytes() == b"new"
    monkeypatch.setattr(system, "_RETRY_WAITS_S", (0.0,) * 5)
    with (folder / "left.exr").open("rb"), pytest.raises(IcyMoonError, match=r"has it open.*close it there"):
        publish_pair(unfinished(dataset, b"newer"), folder, lambda: False, again=True)
    assert (folder / "left.exr").read_bytes() == b"new"
    assert is_complete(folder)
    Claims(dataset).remove_leftovers()
    assert [path.name for path in (dataset / "pairs").iterdir()] == [PAIRS[0].id]


def test_what_is_broken_and_open_stays_and_is_named(drive, monkeypatch):
    monkeypatch.setattr(system, "_RETRY_WAITS_S", (0.0,) * 5)
    dataset = drive / "set"
    datasets.freeze_plan(dataset, PAIRS, "")
    publish_pair(unfinished(dataset, b"old"), PAIRS[0].folder(dataset), lambda: False)
    left = PAIRS[0].folder(dataset) / "left.exr"
    left.write_bytes(b"changed")
    with left.open("rb"):
        found = verify_data_set(dataset, remove_broken=True)
    assert any("is not removed" in problem.text for problem in found.problems)
    assert left.exists()
    verify_data_set(dataset, remove_broken=True)
    assert not left.exists()


def test_claims_are_read_while_they_are_given_back(drive):
    """A claim that another process reads just now cannot be removed; nor is anything said of its maker by a signal."""
    one, other = Claims(drive / "set"), Claims(drive / "set")
    stop = threading.Event()

    def look() -> None:
        while not stop.is_set():
            other.find_claimed_elsewhere()

    thread = threading.Thread(target=look)
    thread.start()
    try:
        for _ in range(30):
            assert one.take(PAIRS[0].id)
            one.release(PAIRS[0].id)
    finally:
        stop.set()
        thread.join()
    one.close()
    other.remove_leftovers()
    assert files_in(drive / "set") == []
