"""Decide Where to Dig: the pairs of the data set, from the window."""

from __future__ import annotations

import json
import sys

import bpy
import pytest
import workspaces
from icymoon.operators import decide, trusted_reports
from icymoon.operators.session import session
from icymoon.panels import sidebar
from icymoon.support.errors import IcyMoonError
from panel_drawing import drawn, texts
from stand_ins import stand_in


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
def test_the_data_set_is_decided_and_its_page_is_known_as_ours(scene, tmp_path):
    assert bpy.ops.icymoon.decide() == {"FINISHED"}
    page = tmp_path / "decisions" / "decisions.html"
    assert trusted_reports.is_own_report(page)
    assert "StereoBM" in page.read_text(encoding="utf-8")
    told = session.decided[scene.session_uid]
    assert any("StereoBM" in sentence for sentence in told)
    shown = texts(drawn(sidebar.ICYMOON_PT_evaluation))
    assert all(" ".join(sentence.split()[:3]) in shown for sentence in told)
    session.reset()
    assert "StereoBM under" not in texts(drawn(sidebar.ICYMOON_PT_evaluation))


@pytest.mark.heavy
@pytest.mark.usefixtures("scene")
def test_several_suns_of_a_site_are_decided_on_once(tmp_path):
    workspaces.write_under_sun(tmp_path / "pairs" / "b", 90)
    assert bpy.ops.icymoon.decide(fuse_suns=True) == {"FINISHED"}
    report = json.loads((tmp_path / "decisions" / "decisions.json").read_text(encoding="utf-8"))
    assert [(row["pair"], row["suns"]) for row in report["rows"]] == [("b", 2), ("b", 2)]


def test_decisions_are_shown_in_the_scene_whose_data_set_they_are_of(scene, tmp_path):
    kind = decide.ICYMOON_OT_decide
    job = stand_in(result={"head": ["The site is safe."]})
    operator = stand_in(_page=tmp_path, _scene_uid=scene.session_uid, _job=job, report=lambda kind, text: None)
    kind.report_success(operator, bpy.context)
    other = bpy.data.scenes.new("other")
    assert "The site is safe" in texts(drawn(sidebar.ICYMOON_PT_evaluation))
    with bpy.context.temp_override(scene=other):
        assert "The site is safe" not in texts(drawn(sidebar.ICYMOON_PT_evaluation))
    operator._scene_uid, job.result = other.session_uid, {"head": []}
    kind.report_success(operator, bpy.context)
    assert "The site is safe" in texts(drawn(sidebar.ICYMOON_PT_evaluation))
    scene.name = "renamed"  # neither name nor place in memory counts
    assert "The site is safe" in texts(drawn(sidebar.ICYMOON_PT_evaluation))
    bpy.data.scenes.remove(other)
    session.reset()


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
def test_suns_are_fused_on_request_by_the_shipped_rules_and_by_files_of_ones_own(tmp_path, commands):
    for operator, file in (("decide", ""), ("decide_by_rules", "mine.toml"), ("decide_with_guarantee", "c.json")):
        options = {"filepath": str(tmp_path / file)} if file else {}
        for fused in ({"fuse_suns": True}, {}):  # the second must not keep the answer of the first
            with pytest.raises(RuntimeError, match="not started here"):
                getattr(bpy.ops.icymoon, operator)(**options, **fused)
        fusing, plain = commands[-2:]
        assert [word for word in fusing if word != "--fuse-suns"] == plain
        assert fusing.count("--fuse-suns") == 1


def test_the_tooltip_states_what_becomes_of_several_suns():
    kind = bpy.types.ICYMOON_OT_decide
    rna = bpy.ops.icymoon.decide.get_rna_type()
    plain, fusing = (kind.description(bpy.context, stand_in(fuse_suns=fused, rna_type=rna)) for fused in (False, True))
    assert fusing == f"{plain}. {rna.properties['fuse_suns'].description}"


@pytest.mark.usefixtures("scene")
def test_without_a_file_nothing_is_decided(commands):
    with pytest.raises(RuntimeError, match="the file of rules is empty"):
        bpy.ops.icymoon.decide_by_rules(filepath="")
    with pytest.raises(RuntimeError, match="the file of a calibration is empty"):
        bpy.ops.icymoon.decide_with_guarantee(filepath="")
    assert not commands
