"""Data sets from Blender: dry run, rendering in other processes, stopping, leaving it running and finding it again."""

from __future__ import annotations

import json
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from icymoon.operators import dataset, results
from icymoon.operators.session import session
from icymoon.render.pairs.pair_folder import find_pairs
from icymoon.support.files import PART_SUFFIX
from stand_ins import stand_in

TINY = """
[mesh]
kind = "GRID"
[terrain]
resolution = 17
[rig]
width_px = 32
height_px = 24
[quality]
samples = 1
"""
GRID = '[[sweep]]\nkind = "grid"\nlight.sun_elevation_deg = [20, 40]\n'


@pytest.fixture
def described(scene, tmp_path, monkeypatch):
    """A scene whose data set is small, and in a folder of the test's own."""
    monkeypatch.setattr(dataset, "find_state_folder", lambda: tmp_path / "running")
    (tmp_path / "plan.toml").write_text('[plan]\ntitle = "Tiny"\n' + TINY + GRID)
    group = scene.icymoon.dataset
    group.plan, group.folder, group.leave_running = str(tmp_path / "plan.toml"), str(tmp_path / "set"), False
    dataset.readout.update(plan="", lines=[], set_aside=[], last=None)
    yield scene
    process = dataset.find_unwatched_process(tmp_path / "running")
    if process is not None:
        process.stop()


def run_until(job, there, seconds=120.0):
    """Watch a job until a condition holds; whether it did."""
    end = time.monotonic() + seconds
    while not there() and time.monotonic() < end:
        if not job.poll():
            break
        time.sleep(0.02)
    return there()


def started(scene, name="icymoon.render_dataset"):
    """The job that an operator would watch in a window, and the operator's stand-in."""
    kind: Any = {
        "icymoon.render_dataset": dataset.ICYMOON_OT_render_dataset,
        "icymoon.watch_dataset": dataset.ICYMOON_OT_watch_dataset,
    }[name]
    operator = stand_in(bl_label=kind.bl_label)
    operator._make_job = lambda process, context: kind._make_job(operator, process, context)
    return kind.start(operator, SimpleNamespace(scene=scene)), operator


def test_a_dry_run_says_what_the_plan_will_take(described, tmp_path):
    assert bpy.ops.icymoon.plan_dry_run() == {"FINISHED"}
    assert dataset.readout["plan"] == str(tmp_path / "plan.toml")
    assert dataset.readout["lines"][:2] == ["2 pairs", "1 ground, 1 surface, 2 lights; 1 scene to build"]
    assert not (tmp_path / "set").exists()


def test_a_plan_that_cannot_be_is_told_with_its_line(described, tmp_path):
    (tmp_path / "plan.toml").write_text('[plan]\ntitle = "Tiny"\n[terrain]\nsizem = 3\n')
    for run in (bpy.ops.icymoon.plan_dry_run, bpy.ops.icymoon.render_dataset):
        with pytest.raises(RuntimeError, match=r"plan\.toml, line 4: .*size_m"):
            run()
    described.icymoon.dataset.plan = "datasets/guiss_rock"
    with pytest.raises(RuntimeError, match="guiss_rocks"):
        bpy.ops.icymoon.plan_dry_run()
    assert not (tmp_path / "set" / "pairs").exists()


def test_a_shipped_plan_is_chosen_by_its_name_and_another_by_its_file(described, tmp_path):
    assert bpy.ops.icymoon.choose_plan(plan="datasets/guiss_rocks") == {"FINISHED"}
    assert described.icymoon.dataset.plan == "datasets/guiss_rocks"
    assert dataset.find_plan_title("datasets/guiss_rocks") == "Paper: rocks"
    assert bpy.ops.icymoon.open_plan(filepath=str(tmp_path / "plan.toml")) == {"FINISHED"}
    assert described.icymoon.dataset.plan == str(tmp_path / "plan.toml")
    with pytest.raises(RuntimeError, match="cannot be read"):
        bpy.ops.icymoon.open_plan(filepath=str(tmp_path / "absent.toml"))


@pytest.mark.long
@pytest.mark.slow
def test_a_data_set_is_rendered_and_the_scene_is_left_alone(described, tmp_path):
    bpy.data.objects.new("Mine", None)
    before = [len(getattr(bpy.data, kind)) for kind in ("objects", "meshes", "materials", "scenes", "images")]
    assert bpy.ops.icymoon.render_dataset() == {"FINISHED"}
    pairs = find_pairs(tmp_path / "set")
    assert {p.settings.light.sun_elevation_deg for p in pairs} == {20.0, 40.0}
    assert [len(getattr(bpy.data, kind)) for kind in ("objects", "meshes", "materials", "scenes", "images")] == before
    assert session.job is None
    assert dataset.readout["last"].parent == tmp_path / "set" / "pairs"
    # Again: nothing is left to do.
    written = {p.folder: (p.folder / "pair.json").stat().st_mtime_ns for p in pairs}
    assert bpy.ops.icymoon.render_dataset() == {"FINISHED"}
    assert written == {p.folder: (p.folder / "pair.json").stat().st_mtime_ns for p in pairs}
    bpy.ops.icymoon.plan_dry_run()
    assert dataset.readout["lines"][0] == "2 pairs, 2 already rendered"


@pytest.mark.long
@pytest.mark.slow
def test_it_is_evaluated_afterwards_if_asked(described, tmp_path):
    described.icymoon.dataset.evaluate, described.icymoon.dataset.methods = True, "sgbm"
    described.icymoon.dataset.workers = 1
    assert bpy.ops.icymoon.render_dataset() == {"FINISHED"}
    assert (tmp_path / "set" / "evaluation" / "report.html").is_file()
    assert results.read_summary(described)[0]["method"] == "sgbm"
    described.icymoon.dataset.methods = "no such matcher"
    with pytest.raises(RuntimeError, match="no such matcher"):
        bpy.ops.icymoon.render_dataset()


@pytest.mark.long
def test_it_is_stopped_within_a_sample_and_goes_on_later(described, tmp_path):
    (tmp_path / "plan.toml").write_text(
        '[plan]\ntitle = "Long"\n' + TINY.replace("samples = 1", "samples = 20000") + GRID
    )
    job, _ = started(described)
    assert run_until(job, lambda: job.fraction > 0.01)
    job.process.cancel()
    start = time.monotonic()
    while job.poll():
        time.sleep(0.02)
    assert time.monotonic() - start < 10.0  # of minutes
    assert "was stopped" in job.failure
    assert not list((tmp_path / "set" / "pairs").glob("*/pair.json"))
    assert not list((tmp_path / "set" / "pairs").glob(f"*{PART_SUFFIX}"))


@pytest.mark.slow
def test_it_is_left_running_and_found_again(described, tmp_path):
    job, operator = started(described)
    described.icymoon.dataset.leave_running = True
    operator._job = job
    dataset.ICYMOON_OT_render_dataset.watch(operator, SimpleNamespace(scene=described))
    session.job = job
    session.reset()  # as when Blender closes
    assert session.job is None
    assert job.process.left
    group = described.icymoon.dataset
    group.folder, group.plan, group.leave_running = "elsewhere", "another", False  # as in a new Blender
    again, _ = started(described, "icymoon.watch_dataset")
    assert (group.folder, group.plan) == (str(tmp_path / "set"), str(tmp_path / "plan.toml"))
    assert group.leave_running
    assert again.started <= job.started + 1.0  # what is left is reckoned from the beginning
    while again.poll():
        time.sleep(0.02)
    assert again.failure == ""
    assert len(find_pairs(tmp_path / "set")) == 2
    with pytest.raises(RuntimeError, match="No data set was left running"):
        bpy.ops.icymoon.watch_dataset()


@pytest.mark.slow
def test_what_is_left_running_is_evaluated_too(described, tmp_path):
    group = described.icymoon.dataset
    group.evaluate, group.methods, group.workers = True, "sgbm", 1
    described.icymoon.sensor.bits = 10
    job, _ = started(described)
    job.process.leave = True
    job.process.stop()  # as when Blender closes; nobody watches from now on
    report = tmp_path / "set" / "evaluation" / "report.json"
    end = time.monotonic() + 240.0
    while not report.is_file() and time.monotonic() < end:
        time.sleep(0.1)
    found = json.loads(report.read_text())
    assert [row["method"] for row in found["summary"]] == ["sgbm"]
    assert '"sensor.bits": 10' in json.dumps(found) or '"bits": 10' in json.dumps(found)


def test_a_data_set_without_its_evaluation_is_not_done():
    said = [{"type": "progress", "fraction": 1.0, "message": "2 of 2 pairs"}, {"type": "done", "pairs": 2}]
    process = stand_in(cancelled=False, poll=lambda: said, running=True, returncode=1, cause="Killed")
    job = dataset.DatasetJob("Render Data Set", process, dataset._note_pairs)
    job.evaluates = True
    job.poll()
    assert job.fraction == 0.0
    assert job.failure == "Render Data Set ended without a result (status 1): Killed"
    job.hear({"type": "result", "report": "report.html"})
    assert job.failure == ""


def test_evaluation_that_cannot_be_is_refused_before_anything_is_rendered(described, tmp_path, monkeypatch):
    described.icymoon.dataset.evaluate = True
    monkeypatch.setenv("ICYMOON_EVALUATOR", str(tmp_path / "no_python"))
    with pytest.raises(RuntimeError, match="no_python"):
        bpy.ops.icymoon.render_dataset()
    assert not (tmp_path / "set").exists()


def test_a_pair_that_is_set_aside_is_named_and_does_not_end_the_others():
    process = stand_in(
        cancelled=False,
        poll=lambda: [
            {"type": "error", "pair": "abc", "message": "Cycles could not"},
            {"type": "progress", "fraction": 0.5, "message": "Pair 2 of 3"},
            {"type": "pair", "id": "b", "folder": "/set/pairs/b"},
            {"type": "done", "pairs": 2},
        ],
        running=True,
    )
    dataset.readout.update(set_aside=[], last=None)
    job = dataset.DatasetJob("Render Data Set", process, dataset._note_pairs)
    job.poll()
    assert job.shown[0] == "Pair 2 of 3  50 %"
    assert job.failure == "1 pair was set aside, first abc: Cycles could not"
    assert dataset.readout["last"] == Path("/set/pairs/b")
