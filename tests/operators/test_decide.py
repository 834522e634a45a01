"""Decide Where to Dig: the pairs of the data set, from the window."""

from __future__ import annotations

import sys

import bpy
import pytest
import workspaces
from icymoon.operators import decide, trusted_reports


@pytest.mark.heavy
def test_the_data_set_is_decided_and_its_page_is_known_as_ours(monkeypatch, tmp_path):
    monkeypatch.setattr(decide, "find_evaluator_python", lambda: sys.executable)
    workspaces.write(tmp_path / "pairs" / "a")
    scene = bpy.data.scenes.new("decided")
    with bpy.context.temp_override(scene=scene):
        scene.icymoon.dataset.methods, scene.icymoon.dataset.folder = "bm", str(tmp_path)
        assert bpy.ops.icymoon.decide() == {"FINISHED"}
    bpy.data.scenes.remove(scene)
    page = tmp_path / "decisions" / "decisions.html"
    assert trusted_reports.is_own_report(page)
    assert "StereoBM" in page.read_text(encoding="utf-8")
