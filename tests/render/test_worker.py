"""The worker process as the command line starts it: resume, kill, full disk, determinism."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from icymoon.render.pairs.pair_folder import find_pairs
from icymoon.stereo.images.exr import read_view

SMALL = ("terrain.resolution=65", "quality.samples=2", "rig.width_px=96", "rig.height_px=72", "quality.threads=1")


def command(out: Path, *overrides: str) -> list[str]:
    """``python -m icymoon render`` of a small scene into a folder."""
    words = [word for text in (*SMALL, *overrides) for word in ("--set", text)]
    return [sys.executable, "-m", "icymoon", "render", *words, "--out", str(out)]


def run(out: Path, *overrides: str, **options) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(out, *overrides), capture_output=True, text=True, timeout=240, check=False, **options)


def assert_nothing_half_written(out: Path) -> None:
    leftovers = [p.name for p in out.rglob("*") if p.name.endswith(".part")]
    assert leftovers == []
    for folder in (out / "pairs").glob("*"):
        assert (folder / "pair.json").is_file()


@pytest.mark.long
def test_two_processes_give_the_same_truth_and_the_same_images(tmp_path):
    for name in ("a", "b"):
        done = run(tmp_path / name, "rocks.coverage=0.05")
        assert done.returncode == 0, done.stderr
        assert_nothing_half_written(tmp_path / name)
    first, second = (find_pairs(tmp_path / name)[0] for name in ("a", "b"))
    assert first.id == second.id
    for eye in ("left", "right"):
        one, two = read_view(first.image(eye)), read_view(second.image(eye))
        for field in ("depth", "normal", "instance", "semantic", "radiance"):
            assert np.array_equal(getattr(one, field), getattr(two, field), equal_nan=field == "depth"), field


@pytest.mark.long
def test_the_eyes_have_noise_of_their_own(tmp_path):
    # A wide walk: Blender 4.2 renders a mean free path below a quarter of a pixel as plain diffuse, without noise.
    assert (
        run(
            tmp_path,
            "terrain.rms_slope_deg=0",
            "surface.grain_amplitude_m=0",
            "surface.subsurface_weight=1",
            "surface.subsurface_radius_m=0.1",
            "surface.specular=0",
            "rig.pitch_deg=90",
        ).returncode
        == 0
    )
    pair = find_pairs(tmp_path)[0]
    left, right = (read_view(pair.image(eye)).radiance.mean(axis=2).ravel() for eye in ("left", "right"))
    # A uniform plane: all variation is noise. 6912 independent pixels correlate within 5/sqrt(6912) = 0.06.
    assert left.std() > 0
    assert abs(np.corrcoef(left, right)[0, 1]) < 0.06


def test_resume_renders_only_what_is_missing(tmp_path):
    assert run(tmp_path, "dataset.headings=2").returncode == 0
    pairs = find_pairs(tmp_path)
    assert len(pairs) == 2
    stamps = {p.id: (p.folder / "pair.json").stat().st_mtime_ns for p in pairs}
    gone = pairs[0]
    (gone.folder / "pair.json").unlink()
    done = run(tmp_path, "dataset.headings=2")
    assert done.returncode == 0
    assert "was already there" in done.stdout
    again = {p.id: (p.folder / "pair.json").stat().st_mtime_ns for p in find_pairs(tmp_path)}
    assert again.keys() == stamps.keys()
    assert again[pairs[1].id] == stamps[pairs[1].id]
    assert again[gone.id] != stamps[gone.id]


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("how", ["kill the worker", "kill everything", "interrupt"])
def test_a_stopped_render_leaves_no_half_pair_and_the_next_run_completes_it(tmp_path, how):
    process = subprocess.Popen(
        command(tmp_path, "quality.samples=4096"),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 240
    while not list(tmp_path.glob("pairs/*.part")):
        assert time.monotonic() < deadline, "the render did not start"
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    worker = _child_of(process.pid)
    if how == "interrupt":
        process.send_signal(signal.SIGINT)
    elif how == "kill the worker":
        os.kill(worker, signal.SIGKILL)
    else:
        process.kill()
        os.kill(worker, signal.SIGKILL)
    out, err = process.communicate(timeout=240)
    assert process.returncode == {"interrupt": 130, "kill the worker": 1, "kill everything": -9}[how]
    assert "Traceback" not in out + err
    if how != "kill everything":
        assert len(err.strip().splitlines()) == 1
        assert_nothing_half_written(tmp_path)
    _wait_until_gone(worker)
    assert run(tmp_path).returncode == 0
    assert_nothing_half_written(tmp_path)
    assert len(find_pairs(tmp_path)) == 1


def _child_of(parent: int) -> int:
    """Process id of the one child of a process."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return int(children[0])


def _wait_until_gone(pid: int) -> None:
    for _ in range(2400):
        try:
            if Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z":
                return
        except FileNotFoundError:
            return
        time.sleep(0.05)
    pytest.fail(f"the worker {pid} lives on")


def test_a_disk_that_fills_up_is_a_sentence_and_leaves_nothing(tmp_path):
    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))  # writing more fails, as on a full disk

    done = run(tmp_path, preexec_fn=small_files)
    assert done.returncode == 1, done.stdout
    assert "Traceback" not in done.stdout + done.stderr
    assert "icymoon: " in done.stderr
    assert_nothing_half_written(tmp_path)
    assert list((tmp_path / "pairs").iterdir()) == []


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    done = run(tmp_path / "file" / "set")
    assert done.returncode == 1
    assert str(tmp_path / "file" / "set") in done.stderr
    assert "Traceback" not in done.stderr


def test_impossible_quality_is_refused_before_the_build(tmp_path):
    done = run(tmp_path, "quality.device=GPU")
    assert done.returncode == 1
    assert "quality.device" in done.stderr


@pytest.mark.long
def test_pair_json_says_what_was_done(tmp_path):
    assert run(tmp_path, "dataset.seed=7").returncode == 0
    data = json.loads((find_pairs(tmp_path)[0].folder / "pair.json").read_text())
    assert data["settings"]["dataset"]["seed"] == data["seeds"]["dataset"] == 7
    assert data["seconds"].keys() == {"build", "render", "sampling", "write"}
    assert 0 < data["seconds"]["sampling"] < data["seconds"]["render"]
    assert data["peak_memory_mib"] > 50
    assert data["edited_by_hand"] is False
    assert data["versions"]["blender"]
