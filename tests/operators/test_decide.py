"""Decide Where to Dig: the pairs of the data set, from the window."""

from __future__ import annotations

import sys

import bpy
import pytest
import workspaces
from icymoon.operators import decide, trusted_reports
from icymoon.support.errors import IcyMoonError


@pytest.fixture
def scene(monkeypatch, tmp_path):
    monkeypatch.setattr(decide, "find_evaluator_python", lambda: sys.executable)
    workspaces.write(tmp_path / "pairs" / "a")
    scene = bpy.data.scenes.new("decided")
    with bpy.context.temp_override(scene=scene):
        scene.icymoon.dataset.methods, scene.icymoon.dataset.folder = "bm", str(tmp_path)
        yield scene
    bpy.data.scenes.remove(scene)


@pytest.mark.heavy
@pytest.mark.usefixtures("scene")
def test_the_data_set_is_decided_and_its_page_is_known_as_ours(tmp_path):
    assert bpy.ops.icymoon.decide() == {"FINISHED"}
    page = tmp_path / "decisions" / "decisions.html"
    assert trusted_reports.is_own_report(page)
    assert "StereoBM" in page.read_text(encoding="utf-8")


@pytest.fixture
def commands(monkeypatch):
    """The commands that would have been started."""
    started: list[list[str]] = []

    def start(title, command):
        started.append(command)
        raise IcyMoonError("not started here")

    monkeypatch.setattr(decide.MeasuringJob, "start", start)
    return started


@pytest.mark.usefixtures("scene")
def test_files_of_ones_own_reach_the_evaluator(tmp_path, commands):
    with pytest.raises(RuntimeError, match="not started here"):
        bpy.ops.icymoon.decide_by_rules(filepath=str(tmp_path / "mine.toml"))
    with pytest.raises(RuntimeError, match="not started here"):
        bpy.ops.icymoon.decide()
    with pytest.raises(RuntimeError, match="not started here"):
        bpy.ops.icymoon.decide_with_guarantee(filepath=str(tmp_path / "calibration.json"))
    own, shipped, guaranteed = commands
    for command, option, name in ((own, "--rules", "mine.toml"), (guaranteed, "--calibration", "calibration.json")):
        at = command.index(option)
        assert command[at + 1] == str(tmp_path / name)
        assert [*command[:at], *command[at + 2 :]] == shipped


@pytest.mark.usefixtures("scene")
def test_without_a_file_nothing_is_decided(commands):
    with pytest.raises(RuntimeError, match="the file of rules is empty"):
        bpy.ops.icymoon.decide_by_rules(filepath="")
    with pytest.raises(RuntimeError, match="the file of a calibration is empty"):
        bpy.ops.icymoon.decide_with_guarantee(filepath="")
    assert not commands
