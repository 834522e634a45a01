"""Render Stereo Pair hands the worker what is built here, and the pair is the one that the settings alone give."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from icymoon.operators import jobs, render
from icymoon.render.pairs.pair_folder import find_pairs
from icymoon.render.workers.job_commands import Job, blender_command, read_job
from icymoon.settings.blender import scene_properties
from icymoon.settings.topics.scene import Settings
from icymoon.support.files import hash_file


@pytest.fixture
def started(monkeypatch):
    """Starts the operator as in a window; returns the job of the worker, which does not run."""
    commands: list[list[str]] = []

    class FakeProcess:
        def __init__(self, command, environment=None):
            commands.append(command)

    monkeypatch.setattr(jobs, "Process", FakeProcess)

    def start(context):
        operator: Any = SimpleNamespace(again=False, _warn=lambda built: None, _hear=lambda message: None)
        job = render.ICYMOON_OT_render_pair.start(operator, context)
        return job, read_job(Path(commands[-1][-1]))

    return start


def read_settings() -> Settings:
    return scene_properties.read_settings(bpy.context.scene.icymoon)


def test_the_worker_opens_what_is_built_and_makes_the_pair_that_the_settings_give(small, started, tmp_path):
    small.icymoon.rocks.coverage = 0.05
    small.icymoon.penitentes.height_m = 0.5
    small.icymoon.mesh.crests = "CUT"
    job, facts = started(bpy.context)
    assert Path(facts["blend"]).is_file()
    other = Job(tmp_path / "other", read_settings())
    for file in (Path(facts["blend"]).with_name("job.json"), other.file):
        subprocess.run(blender_command(sys.executable, "worker", str(file)), check=True, timeout=240)
    job.clean_up()
    one, two = find_pairs(Path(facts["dataset"]))[0], find_pairs(tmp_path / "other")[0]
    assert one.id == two.id
    for eye in ("left", "right"):
        assert hash_file(one.image(eye)) == hash_file(two.image(eye))


def test_headings_have_meshes_of_their_own_so_each_is_built(small, started):
    small.icymoon.dataset.headings = 2
    job, facts = started(bpy.context)
    assert facts["blend"] is None
    job.clean_up()


def test_what_was_edited_by_hand_is_rendered_with_all_headings(small, started):
    small.icymoon.dataset.headings = 2
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    next(item for item in bpy.data.objects if item.type == "LIGHT").rotation_euler.x += 0.1
    job, facts = started(bpy.context)
    assert Path(facts["blend"]).is_file()
    job.clean_up()
