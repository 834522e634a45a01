"""Render Stereo Pair hands the worker what is built here, and the pair is the one that the settings alone give."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.operators import jobs, render, sidebar_text
from icymoon.render.cost.machine_speed import Speed
from icymoon.render.pairs.pair_folder import find_pairs
from icymoon.render.workers.job_commands import blender_command, read_job
from icymoon.settings.blender import scene_properties
from icymoon.settings.description import defaults
from icymoon.settings.topics.scene import Settings
from icymoon.stereo.images.exr import read_view
from icymoon.support import cache_folder
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import hash_file
from icymoon.support.steps import finish
from icymoon.support.system import count_processors
from own_groups import make_group


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
        job = finish(render.ICYMOON_OT_render_pair.prepare(operator, context))
        return job, read_job(Path(commands[-1][-1])) | {"job": commands[-1][-1]}

    return start


def test_estimates_rest_on_the_pair_that_was_just_rendered(monkeypatch, tmp_path):
    monkeypatch.setenv(cache_folder.FOLDER_VARIABLE, str(tmp_path))
    sidebar_text.recall_known_speed.cache_clear()
    speed = Speed(2.0, "CPU", bpy.app.version_string, count_processors(), "2038-06-01T12:34+00:00", by="a pair")
    monkeypatch.setattr(render, "read_speed_of_pair", lambda folder: speed)
    operator: Any = SimpleNamespace(_rendered=[])
    message = {"type": "pair", "id": "0123456789ab", "folder": str(tmp_path), "rendered": False}
    render.ICYMOON_OT_render_pair._hear(operator, message)  # it was there already, perhaps from another machine
    assert sidebar_text.describe_speed(defaults()) == "Timed on another machine"
    render.ICYMOON_OT_render_pair._hear(operator, message | {"rendered": True})
    told = sidebar_text.describe_speed(defaults())
    assert told.startswith("Timed on this machine")
    assert told.endswith("measured 2038-06-01 by a pair")

    def refuse(folder: Path) -> None:
        raise IcyMoonError("unreadable")

    monkeypatch.setattr(render, "read_speed_of_pair", refuse)
    render.ICYMOON_OT_render_pair._hear(operator, message | {"rendered": True})
    assert operator._rendered == [message["id"]] * 3  # the pair is rendered all the same
    sidebar_text.recall_known_speed.cache_clear()


def read_settings() -> Settings:
    return scene_properties.read_settings(bpy.context.scene.icymoon)


def test_the_worker_builds_what_was_not_edited_and_makes_the_pair_that_is_built_here(small, started, tmp_path):
    small.icymoon.rocks.coverage = 0.05
    small.icymoon.penitentes.height_m = 0.5
    small.icymoon.mesh.crests = "CUT"
    small.icymoon.dataset.folder = str(tmp_path / "here")
    assert bpy.ops.icymoon.render_pair() == {"FINISHED"}
    small.icymoon.dataset.folder = str(tmp_path / "there")
    job, facts = started(bpy.context)
    assert facts["blend"] is None
    subprocess.run(blender_command(sys.executable, "worker", facts["job"]), check=True, timeout=240)
    job.clean_up()
    one, two = (find_pairs(tmp_path / name)[0] for name in ("here", "there"))
    assert one.id == two.id
    for eye in ("left", "right"):
        assert hash_file(one.image(eye)) == hash_file(two.image(eye))


def test_the_window_shows_a_coarse_ground_and_the_fine_one_follows(small, started, monkeypatch):
    """The ground at full resolution is never made while the window waits."""
    small.icymoon.terrain.resolution = 1025
    small.icymoon.mesh.kind = "GRID"
    job, _ = started(bpy.context)
    job.clean_up()
    assert job.expected.seconds > 0  # told until the first progress
    assert job.expected.factor > 1
    built = scenes.find_built(small)
    assert len(built.terrain.data.vertices) <= preview.MAX_VERTICES
    assert preview.find_preview_of(small, read_settings())
    monkeypatch.setattr(render.preview, "make_coarse", None)  # the coarse ground is not made once more
    job, _ = started(bpy.context)
    job.clean_up()


def test_the_scene_that_is_shown_has_the_settings_that_are_rendered(scene):
    """Build Scene turns the Sun of untouched settings; the pair would have another one."""
    settings = read_settings()
    assert finish(render.show_rendered_scene(scene.session_uid, settings)) is None
    assert read_settings() == settings
    assert scenes.find_built(scene).settings.light == settings.light


def test_ground_from_a_file_is_not_read_while_the_window_waits(small, started, monkeypatch):
    small.icymoon.source.kind = "STAND_IN"
    monkeypatch.setattr(scenes, "build_scene", None)
    monkeypatch.setattr(render.preview, "make_coarse", None)
    job, facts = started(bpy.context)
    job.clean_up()
    assert facts["blend"] is None
    assert scenes.find_built(small) is None


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


@pytest.mark.long
def test_a_node_group_of_the_users_is_rendered_by_the_worker(small, started):
    """Without light that is reflected twice, the images have the ratio of the factors. Pairs of two ids have noise of
    their own, which 64 samples keep far below 2 %."""
    small.icymoon.surface.model, small.icymoon.surface.albedo = "LAMBERT", 0.1
    small.icymoon.quality.diffuse_bounces, small.icymoon.quality.samples = 0, 64
    means = []
    for name, factor in (("Whole", 1.0), ("Half", 0.5)):
        make_group(name, factor)
        small.icymoon.surface.albedo_group = name
        job, facts = started(bpy.context)
        subprocess.run(blender_command(sys.executable, "worker", facts["job"]), check=True, timeout=240)
        job.clean_up()
        expected = render.plan_pairs(small, read_settings())[0].id
        (pair,) = [pair for pair in find_pairs(Path(small.icymoon.dataset.folder)) if pair.id == expected]
        assert pair.data["edited_by_hand"]
        means.append(np.nanmean(read_view(pair.image("left")).radiance))
    assert means[1] / means[0] == pytest.approx(0.5, rel=0.02)
