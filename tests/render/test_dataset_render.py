"""Whole data sets in real workers: order and reuse change no pixel, and nothing is lost whatever is killed.

What two runs of a data set have in common is everything but times: the images are equal byte for byte (Cycles
on the CPU is reproducible), ``pair.json`` differs in ``seconds`` and ``peak_memory_mib``.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from icymoon.nodes.change_scene import adapt_scene, open_empty_scene
from icymoon.nodes.datablocks.fingerprint import read_parts
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.render.plans.render_order import order_pairs
from icymoon.render.scene_source import ScenesFromSettings
from icymoon.render.worker import render_from
from icymoon.render.workers.verify_dataset import verify_data_set
from marks import heavy_but
from plans import grid, planned

#: Descriptions that differ in each kind of setting, and whether one may be made out of the first.
CHANGES: dict[str, tuple[dict[str, Any], bool]] = {
    "camera": ({"rig": {"heading_deg": 33.0, "pitch_deg": 20.0}}, True),
    "site": ({"rig": {"x_m": -3.0, "y_m": 2.0, "height_m": 2.0}}, True),
    "sun": ({"light": {"sun_azimuth_deg": 10.0, "sun_elevation_deg": 33.0}}, True),
    "stars": ({"light": {"stars": True}, "rig": {"focal_length_mm": 40.0}}, True),
    "albedo": ({"surface": {"albedo": 0.5}}, True),
    "relief": ({"surface": {"grain_amplitude_m": 0.004}}, True),
    "law": ({"surface": {"model": "HAPKE"}}, True),
    "traced law": (
        {"surface": {"model": "HAPKE"}, "hapke": {"accuracy": "ACCURATE"}, "light": {"sun_elevation_deg": 50.0}},
        True,
    ),
    "texture": ({"textures": {"set": "FROST"}}, True),
    "samples": ({"quality": {"samples": 3}}, True),
    "threshold": ({"quality": {"samples": 16, "noise_threshold": 0.1}}, True),
    "size of the image": ({"rig": {"width_px": 40}}, True),
    "own ice of blocks": ({"rocks": {"own_surface": True}, "rock_surface": {"albedo": 0.3}}, True),
    "marks": ({"surface": {"trough_dirt": 0.5}}, False),
    "ground": ({"dataset": {"seed": 5}}, False),
    "graded": ({"mesh": {"kind": "GRADED"}}, False),
}
ROCKS = {"rocks": {"coverage": 0.05}}
PAIRS = grid(seeds=3)


def images(dataset: Path) -> dict[str, bytes]:
    """The content of every image of a data set."""
    return {f"{path.parent.name}/{path.name}": path.read_bytes() for path in sorted(dataset.glob("pairs/*/*.exr"))}


def freeze(dataset: Path, pairs: list[PlannedPair] = PAIRS) -> Path:
    datasets.freeze_plan(dataset, order_pairs(pairs), "test")
    return dataset


def command(dataset: Path, *words: str) -> list[str]:
    return [sys.executable, "-m", "icymoon", "work", str(dataset), "--json", *words]


def run(dataset: Path, *words: str, **options) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(dataset, *words), capture_output=True, text=True, timeout=280, check=False, **options)


def assert_whole(dataset: Path) -> None:
    assert verify_data_set(dataset).problems == ()


@pytest.fixture(scope="module")
def reference(tmp_path_factory) -> Path:
    """The data set as one worker makes it without interruption."""
    dataset = freeze(tmp_path_factory.mktemp("reference"))
    done = run(dataset)
    assert done.returncode == 0, done.stderr
    assert_whole(dataset)
    return dataset


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(
    "kind",
    heavy_but(
        ["camera", "sun", "albedo", "marks", "ground"],
        CHANGES,
        [
            "site",
            "stars",
            "relief",
            "traced law",
            "texture",
            "samples",
            "threshold",
            "size of the image",
            "own ice of blocks",
        ],
    ),
)
def test_a_scene_made_out_of_another_is_the_scene_built_anew(kind, scene):
    change, reuse = CHANGES[kind]
    first, second = planned(ROCKS).settings, planned(ROCKS, change).settings
    for one, other in ((first, second), (second, first)):
        wanted = read_parts(open_empty_scene(other).collection)
        built, kept = adapt_scene(open_empty_scene(one), other)
        assert kept == reuse
        assert read_parts(built.collection) == wanted
        assert built.settings == other
        assert not built.edited


def test_a_scene_that_is_gone_is_built_anew(scene):
    settings = planned().settings
    assert adapt_scene(None, settings)[1] is False


@pytest.mark.long
@pytest.mark.parametrize(
    "kind",
    heavy_but(
        ["camera", "sun", "albedo"],
        ["camera", "sun", "stars", "albedo", "traced law", "samples", "threshold", "size of the image"],
        ["stars", "threshold", "size of the image"],
    ),
)
def test_reuse_changes_no_byte_of_an_image(kind, scene, tmp_path):
    pairs = [planned(ROCKS), planned(ROCKS, CHANGES[kind][0])]
    for name, stages in (("shared", [pairs]), ("alone", [[pairs[0]], [pairs[1]]])):
        for together in stages:
            with ScenesFromSettings(pytest.fail) as stage:
                render_from(stage, together, tmp_path / name, lambda *a, **k: None)
    assert len(images(tmp_path / "alone")) == 4
    assert images(tmp_path / "shared") == images(tmp_path / "alone")


@pytest.mark.long
def test_several_workers_make_what_one_makes(reference, tmp_path):
    dataset = freeze(tmp_path)
    done = run(dataset, "--workers", "2", "--scenes-per-worker", "1")
    assert done.returncode == 0, done.stderr
    assert images(dataset) == images(reference)
    said = [json.loads(line) for line in done.stdout.splitlines()]
    assert [m["type"] for m in said].count("pair") == len(PAIRS)
    assert said[-1] == {"type": "done", "pairs": len(PAIRS), "failed": {}}
    manifest = json.loads((dataset / "manifest.json").read_text())
    assert manifest["complete"] == len(PAIRS)
    assert manifest["seconds"].keys() == {"build", "render", "sampling", "write"}


@pytest.mark.long
def test_shares_put_together_are_the_data_set(reference, tmp_path):
    dataset = freeze(tmp_path)
    for number in ("1/2", "2/2"):
        done = run(dataset, "--shard", number)
        assert done.returncode == 0, done.stderr
    assert_whole(dataset)
    assert images(dataset) == images(reference)


@pytest.mark.long
def test_a_pair_that_cannot_be_made_is_named_and_the_others_are_there(tmp_path):
    bad = planned({"source": {"kind": "MESH", "file": str(tmp_path / "absent.obj")}})
    dataset = freeze(tmp_path / "set", [bad, *grid(seeds=1)])
    done = run(dataset)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    found = verify_data_set(dataset)
    assert [(p.kind, p.what) for p in found.problems] == [("missing", bad.id)]
    assert bad.id in json.loads((dataset / "manifest.json").read_text())["set_aside"]


@pytest.mark.long
def test_another_content_than_planned_is_refused(tmp_path):
    ours = planned()
    dataset = freeze(tmp_path, [PlannedPair("0123456789ab", ours.settings, 0.0)])
    done = run(dataset)
    assert done.returncode == 1
    assert "would differ from its plan" in done.stdout


def _tree(pid: int) -> list[int]:
    """A process and those that it started."""
    found = [pid]
    with contextlib.suppress(OSError):
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            found += _tree(int(child))
    return found


def _kill(pids: list[int]) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _start(dataset: Path, *words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(command(dataset, *words), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def _begun(dataset: Path) -> subprocess.Popen[str]:
    """A run that is in the middle of a pair."""
    process = _start(dataset)
    deadline = time.monotonic() + 60
    while not list(dataset.glob("pairs/*.part")):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return process


def _complete(dataset: Path) -> int:
    return len(list(dataset.glob("pairs/*/pair.json")))


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("times", [5, pytest.param(20, marks=pytest.mark.long)])
def test_whatever_is_killed_whenever_nothing_is_lost_and_no_byte_differs(reference, tmp_path, times):
    """A runner starts and, at a random moment, it, its workers or all of them are killed."""
    rng = random.Random(1)
    dataset = freeze(tmp_path)
    before = 0
    for _ in range(times):
        process = _start(dataset, "--workers", "2")
        time.sleep(rng.uniform(0.2, 4.0))
        tree = _tree(process.pid)
        _kill({"all": tree, "runner": tree[:1], "workers": tree[1:]}[rng.choice(["all", "runner", "workers"])])
        if rng.random() < 0.5 and process.poll() is None:
            time.sleep(rng.uniform(0.0, 1.0))
        _kill(_tree(process.pid))
        process.wait(30)
        assert process.stderr is not None
        process.stderr.close()
        assert _complete(dataset) >= before  # what was there stays there
        before = _complete(dataset)
        if before >= len(PAIRS) and rng.random() < 0.7:  # begin again with some of them
            for folder in list((dataset / "pairs").glob("????????????"))[:8]:
                shutil.rmtree(folder)
            before = _complete(dataset)
    done = run(dataset, "--workers", "2")
    assert done.returncode == 0, done.stderr
    assert_whole(dataset)
    assert images(dataset) == images(reference)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_worker_dies_with_its_runner(tmp_path):
    dataset = freeze(tmp_path, [planned({"quality": {"samples": 60000}})])
    process = _begun(dataset)
    worker = _tree(process.pid)[1]
    process.kill()
    process.wait(30)
    deadline = time.monotonic() + 30
    while Path(f"/proc/{worker}").exists():
        assert time.monotonic() < deadline, "the worker lives on"
        time.sleep(0.1)


@pytest.mark.long
@pytest.mark.timeout(900)
def test_two_runners_on_one_data_set_do_no_pair_twice(reference, tmp_path):
    dataset = freeze(tmp_path)
    both = [
        subprocess.Popen(command(dataset), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)
    ]
    rendered = []
    for process in both:
        out, err = process.communicate(timeout=280)
        assert process.returncode == 0, err
        rendered += [m["id"] for m in map(json.loads, out.splitlines()) if m["type"] == "pair" and m["rendered"]]
    assert sorted(rendered) == sorted(p.id for p in PAIRS)
    assert_whole(dataset)
    assert images(dataset) == images(reference)


def test_an_interrupted_run_stops_at_once_and_says_so(tmp_path):
    dataset = freeze(tmp_path, [planned({"quality": {"samples": 60000}})])
    process = _begun(dataset)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert list((dataset / "pairs").iterdir()) == []
    assert not (dataset / "claims").exists()


@pytest.mark.long
def test_a_disk_that_fills_up_ends_the_run_with_a_sentence_and_the_next_run_goes_on(tmp_path, reference):
    dataset = freeze(tmp_path)

    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (16_000, 16_000))  # writing more fails, as on a full disk

    done = run(dataset, preexec_fn=small_files)
    assert done.returncode == 1
    assert "Traceback" not in done.stdout + done.stderr
    last = json.loads(done.stdout.splitlines()[-1])
    assert last["type"] == "error"
    assert "pair" not in last
    assert not list(dataset.rglob("*.part"))
    assert run(dataset).returncode == 0
    assert images(dataset) == images(reference)


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="only root may mount a small disk")
def test_a_small_disk_that_really_fills_up(tmp_path, reference):
    size = sum(map(len, images(reference).values())) // 2
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(tmp_path)], check=False, capture_output=True
    ).returncode:
        pytest.skip("no tmpfs can be mounted here")
    try:
        dataset = freeze(tmp_path / "set")
        done = run(dataset)
        assert done.returncode == 1
        assert "full" in done.stdout or "free" in done.stdout
        kept = images(dataset)
        assert not list(dataset.rglob("*.part"))
        subprocess.run(["mount", "-o", f"remount,size={8 * size}", str(tmp_path)], check=True)
        assert run(dataset).returncode == 0
        assert_whole(dataset)
        assert images(dataset) == images(reference)
        assert kept.items() <= images(dataset).items()
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)
