"""A program that is started once: what it gets and answers, and every way in which it can fail."""

import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pairs
import pytest
from icymoon.stereo.adapters.icymoon_serve import to_disparity_map
from icymoon.stereo.matchers import check_options, match, resident_process
from icymoon.stereo.matchers.resident_process import ADAPTERS, stop_residents
from icymoon.stereo.matchers.search_range import SearchRange
from icymoon.support import temporary_folders
from icymoon.support.errors import IcyMoonError

SHAPE = 20, 30
RIG = pairs.camera(30, 20)
#: Answers by the first number of the left image.
SERVED = """
import os, signal, sys, time
print("loading")  # into the protocol, as libraries do before and after they are imported
import numpy as np
from icymoon_serve import serve
calls = []
def disparity(left, right, camera):
    print("working"); os.write(1, b'{"id": 1, "ok": true}\\n'); calls.append(0)
    good = np.full(left.shape[:2], 5.0)
    do = int(left[0, 0, 0])
    if do == 0: return np.arange(600).reshape(20, 30) / 16 + 1
    if do == 1: return np.stack([right[..., 0] + camera.focal_px, *[good] * 0])
    if do == 2: good[0, 0] = os.getpid(); good[0, 1] = len(calls); return good[None, ..., None]
    if do == 10: return good, good / 10
    if do == 11: return good, good
    if do == 9: good[0, :2] = camera.range_px or (0, 0); return good
    if do == 3: return good[:, 1:]
    if do == 4: return good * np.nan
    if do == 5: return -good
    if do == 6: return np.full(good.shape, "a")
    if do == 7: raise RuntimeError("no\\nmemory")
    if do == 8: return None
    if do == 20: os.kill(os.getpid(), signal.SIGKILL)
    if do == 21: print("bye", file=sys.stderr); os._exit(3)
    if do == 22: time.sleep(3600)
    if do == 23: sys.exit("gone")
serve(disparity, "net", lambda: {"size": "small"})
"""
GOOD, SEEN, COUNT, SURE, TOO_SURE, KILLED, DIES, HANGS = 0, 1, 2, 10, 11, 20, 21, 22


@pytest.fixture(autouse=True)
def _none_is_left():
    yield
    stop_residents()


def command(folder, body):
    """A program of Python statements, whose name has a space."""
    script = folder / "a program.py"
    script.write_text(body, encoding="utf-8")
    return f"{shlex.quote(sys.executable)} {shlex.quote(str(script))}"


def ask(text, do=GOOD, camera=RIG, **options):
    left = np.full((*SHAPE, 3), do, np.uint8)
    right = np.random.default_rng(0).integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
    return match("resident", left, right, {"command": text} | options, camera)


def is_there(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_one_process_answers_all_pairs_and_what_it_prints_is_no_answer(tmp_path):
    text = command(tmp_path, SERVED)
    disparity, valid, info = ask(text)
    assert valid.all()
    np.testing.assert_array_equal(disparity, np.arange(600).reshape(SHAPE) / 16 + 1)
    pid, calls = ask(text, COUNT)[0][0, :2]
    assert calls == 3  # the first pair was computed twice
    assert tuple(ask(text, COUNT)[0][0, :2]) == (pid, 4)
    assert info["confidence"] is None
    assert (ask(text, SURE)[2]["confidence"] == 0.5).all()
    with pytest.raises(IcyMoonError, match="resident states confidences from 5 to 5"):
        ask(text, TOO_SURE)
    assert info["facts"]["name"] == "net"
    assert info["facts"]["size"] == "small"
    assert info["facts"]["first_seconds"] >= info["wall_seconds"] > 0
    assert info["facts"]["start_seconds"] > 0.02  # Python and numpy took that, and no pair states it
    assert info["seconds"] < 0.05
    assert info["gpu_mb"] is None


def test_it_gets_both_images_in_rgb_and_the_camera(tmp_path):
    image = np.random.default_rng(0).integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
    left = np.full((*SHAPE, 3), SEEN, np.uint8)
    text = command(tmp_path, SERVED)
    disparity, *_ = match("resident", left, image, {"command": text}, RIG)
    np.testing.assert_array_equal(disparity, image[..., 2] + np.float32(RIG.focal_px))  # BGR, as OpenCV reads it
    with pytest.raises(IcyMoonError, match="AttributeError"):
        match("resident", left, image, {"command": text})  # no camera is known


def test_it_is_told_which_disparities_the_rig_can_see(tmp_path):
    left, text = np.full((*SHAPE, 3), 9, np.uint8), command(tmp_path, SERVED)
    ranges = {"auto": SearchRange(16, 63, "rig"), "truth": SearchRange(1, 2, "truth")}  # which no camera knows
    disparity, _, info = match("resident", left, left, {"command": text}, RIG, ranges)
    assert list(disparity[0, :2]) == [16, 63]
    assert info["search"] is None  # it need not obey
    assert np.isnan(ask(text, 9)[0][0, :2]).all()


@pytest.mark.parametrize(
    ("do", "reason"),
    [
        (3, r"shape \(20, 29\), the images have \(20, 30\)"),
        (4, "no finite number"),
        (5, "negative.*multiply by -1"),
        (6, "values of type <U1"),
        (7, "RuntimeError: no memory"),
        (8, "values of type object"),
    ],
)
def test_a_bad_disparity_map_or_an_exception_fails_this_pair_only(do, reason, tmp_path):
    text = command(tmp_path, SERVED)
    pid = ask(text, COUNT)[0][0, 0]
    for _ in range(4):  # it is no failure of the program
        with pytest.raises(IcyMoonError, match=reason) as caught:
            ask(text, do)
    assert "\n" not in str(caught.value)
    assert ask(text, COUNT)[0][0, 0] == pid


@pytest.mark.parametrize(
    ("do", "reason"),
    [
        (KILLED, "was ended by signal 9 before it had answered"),
        (DIES, r"ended with status 3 before .* \(bye\)"),
        (23, r"ended with status 1 before .* \(gone\)"),
        (HANGS, r"took more than 3 s for a pair and was stopped.*resident.timeout_s"),
    ],
)
def test_one_that_dies_or_hangs_is_started_again_for_the_next_pair(do, reason, tmp_path):
    text = command(tmp_path, SERVED)
    pid = ask(text, COUNT, timeout_s=3)[0][0, 0]
    with pytest.raises(IcyMoonError, match=reason):
        ask(text, do, timeout_s=3)
    assert not is_there(int(pid))
    assert ask(text, COUNT, timeout_s=3)[0][0, 0] != pid


def test_after_three_failures_in_a_row_it_is_not_started_again(tmp_path):
    text = command(tmp_path, SERVED.replace("calls = []", f"calls = []; open({str(tmp_path / 'n')!r}, 'a').write('x')"))
    for do in (DIES, DIES, GOOD, DIES, DIES, DIES):
        if do == GOOD:
            ask(text)  # which ends the row
            continue
        with pytest.raises(IcyMoonError, match="ended with status 3"):
            ask(text, do)
    with pytest.raises(IcyMoonError, match=r"failed 3 times in a row and is not started again.*status 3.*\(bye\)"):
        ask(text)
    assert (tmp_path / "n").read_text() == "x" * 5


#: What a program with PyTorch on a GPU has, as far as it is asked; its clock is that of the processor.
ON_A_GPU = """
import sys, time
from types import SimpleNamespace
class Event:
    def __init__(self, enable_timing): assert enable_timing
    def record(self): self.at = time.perf_counter()
    def elapsed_time(self, end): return 1000 * (end.at - self.at)
ready = []
sys.modules["torch"] = SimpleNamespace(cuda=SimpleNamespace(
    is_available=lambda: True, is_initialized=lambda: bool(ready), Event=Event, synchronize=lambda: None,
    get_device_name=lambda: "H100", max_memory_allocated=lambda: 3 * 2**20))
import numpy as np
from icymoon_serve import serve
def disparity(left, right, camera):
    ready.append(0)  # the first pair initialises CUDA
    time.sleep(0.3)
    return np.ones(left.shape[:2])
serve(disparity)
"""


def test_time_and_memory_of_a_gpu_are_stated(tmp_path):
    info = ask(command(tmp_path, ON_A_GPU))[2]
    assert info["facts"]["gpu"] == "H100"
    assert info["gpu_mb"] == 3
    assert info["gpu_seconds"] >= 0.3
    assert info["seconds"] < 0.2  # of the processor, which slept


HELLO = "import json, os, sys, time\nimport numpy as np\nsay = lambda **m: print(json.dumps(m), flush=True)\n"
ANSWER = HELLO + "say(hello=1)\nfor line in sys.stdin:\n    r = json.loads(line)\n    "
WRITE = "np.save(r['out'], np.ones((20, 30)))\n    "


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (HELLO + "say(hello=2)\ntime.sleep(9)", "speaks version 2 of the protocol, not 1"),
        ("raise ImportError('no torch')", r"ended with status 1 before it was ready \(ImportError: no torch\)"),
        ("print('only this')", r"ended with status 0 before it was ready \(only this\)"),
        ("print('wait')\nimport time\ntime.sleep(9)", r"took more than 1 s to be ready.*start_s"),
        ("import os, time\nos.close(1)\ntime.sleep(9)", "closed its output before it was ready"),
        (ANSWER + "say(id=r['id'], ok=True)", "wrote no disparity map"),
        (ANSWER + "open(r['out'], 'wb').write(b'\\x93NUMPY')\n    say(id=r['id'], ok=True)", "cannot be used"),
        (ANSWER + WRITE + "os.truncate(r['out'], 500)\n    say(id=r['id'], ok=True)", "cannot be used"),
        (ANSWER + "np.save(r['out'], -np.ones((20, 30)))\n    say(id=r['id'], ok=True)", "negative"),
        (
            ANSWER + "np.save(r['out'], np.array([{}]), allow_pickle=True)\n    say(id=r['id'], ok=True)",
            "cannot be used",
        ),
        (ANSWER + "say(id=r['id'])", "neither ok nor an error"),
        (ANSWER + "say(id=r['id'], error=['no', 3])", r"reports \['no', 3\]"),
    ],
)
def test_programs_without_python_s_helper_fail_in_one_sentence(body, reason, tmp_path, monkeypatch):
    monkeypatch.setattr(resident_process, "_GRACE_S", 0.2)
    with pytest.raises(IcyMoonError, match=reason) as caught:
        ask(command(tmp_path, body), start_s=1 if "wait" in body else 60, timeout_s=60)
    assert "\n" not in str(caught.value)


SHELL = r"""
echo '{"hello": 1, "name": "shell"}'
while read -r line; do
    cp "$1" "$(echo "$line" | sed 's/.*"out": "\([^"]*\)".*/\1/')"
    echo "$line" | sed 's/.*"id": \([0-9]*\).*/{"id": \1, "ok": true}/'
done
"""


@pytest.mark.skipif(not shutil.which("sh"), reason="Windows has no sh")
def test_a_program_in_another_language_needs_the_protocol_alone(tmp_path):
    np.save(tmp_path / "ready.npy", np.full(SHAPE, 7.5))
    (tmp_path / "net.sh").write_text(SHELL, encoding="utf-8")
    disparity, _, info = ask(shlex.join(["sh", str(tmp_path / "net.sh"), str(tmp_path / "ready.npy")]))
    assert (disparity == 7.5).all()
    assert info["facts"]["name"] == "shell"


def test_lines_that_are_no_answer_are_passed_over(tmp_path):
    noise = "say(id=r['id'] - 1, ok=True)\n    say(id=99, ok=True)\n    print('{}\\n[]\\n{' + 70000 * 'x')\n    "
    took = "seconds=-1, cpu_seconds='a', gpu_mb=12.5, facts=[1], gpu='H100'"
    _, valid, info = ask(command(tmp_path, f"{ANSWER}{noise}{WRITE}say(id=r['id'], ok=True, {took})"))
    assert valid.all()
    assert info["facts"]["gpu"] == "H100"
    assert info["gpu_mb"] == 12.5
    assert info["gpu_seconds"] is None
    assert info["seconds"] == info["wall_seconds"] > 0  # what it stated is no time


@pytest.mark.parametrize("do", [HANGS, "loop"])
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="it asks Linux what became of a process")
def test_no_program_outlives_a_killed_parent(do, tmp_path):
    body = SERVED.replace(
        "time.sleep(3600)",
        f"open({str(tmp_path / 'pid')!r}, 'w').write(str(os.getpid())); "
        + ("time.sleep(3600)" if do == HANGS else "[None for _ in iter(int, 1)]"),
    )
    parent = subprocess.Popen(
        [
            sys.executable,
            "-c",
            f"""
import numpy as np
from icymoon.stereo.matchers import match
image = np.full((20, 30, 3), {HANGS}, np.uint8)
match("resident", image, image, {{"command": {command(tmp_path, body)!r}}})""",
        ],
        start_new_session=True,
    )
    try:
        wait_for(lambda: (tmp_path / "pid").is_file() and (tmp_path / "pid").read_text())
        child = int((tmp_path / "pid").read_text())
        assert is_there(child)
    finally:
        os.kill(parent.pid, signal.SIGKILL)
        parent.wait()
    wait_for(lambda: not is_there(child))


def wait_for(state):
    for _ in range(1200):
        if state():
            return
        time.sleep(0.05)
    pytest.fail("it has not happened in 60 s")


def test_all_ends_with_us_and_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.setattr(temporary_folders.tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    text = command(tmp_path, SERVED)
    pid = int(ask(text, COUNT)[0][0, 0])
    (folder,) = (tmp_path / "temporary").iterdir()
    assert {path.name for path in folder.iterdir()} == {".icymoon.json", "errors.txt"}
    (resident,) = resident_process._running.values()
    monkeypatch.setattr(resident_process, "_GRACE_S", 60)
    stop_residents()
    assert resident._process.returncode == 0  # it ended by itself
    assert not is_there(pid)
    assert not list((tmp_path / "temporary").iterdir())


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "resident.command is empty"),
        ("python3 'mine", "cannot be split.*quotes"),
        ("no-such-program-here mine.py", "not a program on this machine"),
    ],
)
def test_commands_that_cannot_run_are_refused_before_anything_else(text, reason):
    with pytest.raises(IcyMoonError, match=reason):
        check_options("resident", {"command": text})


def test_the_helper_runs_alone_and_tells_who_starts_it_by_hand(tmp_path):
    """It is one file, which needs nothing of ours, and a terminal is nobody to answer to."""
    pty = pytest.importorskip("pty", reason="Windows has no pseudo-terminals")
    helper = tmp_path / "icymoon_serve.py"
    helper.write_bytes((ADAPTERS / "icymoon_serve.py").read_bytes())
    terminal, end = pty.openpty()
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys; sys.modules['icymoon'] = None\nfrom icymoon_serve import serve; serve(None)",
        ],
        stdin=end,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        timeout=60,
        check=False,
    )
    os.close(terminal)
    os.close(end)
    assert done.returncode == 1
    assert "--method 'NAME=resident:command=python -c'" in done.stderr


def test_tensors_and_integers_are_disparity_maps():
    torch = pytest.importorskip("torch")
    half = torch.full((1, 1, 2, 3), 2.5, dtype=torch.bfloat16, requires_grad=True)
    found = to_disparity_map(half, (2, 3))
    assert found.dtype == np.float32
    assert (found == 2.5).all()
    assert (to_disparity_map(np.ones((2, 3), np.uint16), (2, 3)) == 1).all()
    mixed = np.full((10, 20), -1.0)
    mixed[0, :3] = 1
    assert np.isfinite(
        to_disparity_map(mixed, (10, 20))
    ).all()  # 1.5 % are positive: a matcher's own marks, not its sign
