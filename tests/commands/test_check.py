"""The check of an installation passes here, and fails where depth, light or matching are wrong."""

from __future__ import annotations

import json

import pytest
from icymoon.commands import check
from icymoon.commands.cli import main


def test_it_passes_here_and_leaves_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["check"]) == 0
    assert "The installation is right." in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"surface": {"albedo": 0.6}}, "light under Lambert's law"),
        ({"rig": {"height_m": 1.6}}, None),
        ({"terrain": {"rms_slope_deg": 5.0}}, "depth of a plane"),
        ({"surface": {"albedo_variation": 0.0}}, "by SGBM"),
    ],
)
def test_a_fault_is_named(monkeypatch, capsys, changes, words):
    scene = json.loads(json.dumps(check._TEST_SCENE))
    for topic, values in changes.items():
        scene[topic] |= values
    monkeypatch.setattr(check, "_TEST_SCENE", scene)
    assert main(["check"]) == (0 if words is None else 1)
    shown = capsys.readouterr().err
    assert words is None or (words in shown and "Run icymoon doctor" in shown)


def test_a_blender_that_is_not_there_is_a_sentence(capsys):
    assert main(["check", "--blender", "/no/blender"]) == 1
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
