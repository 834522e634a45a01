"""Evaluate Other Pairs: a folder that was not rendered here, from the window."""

from __future__ import annotations

import sys

import bpy
import foreign
import pytest
from icymoon.operators import evaluate, trusted_reports


@pytest.fixture
def scene(monkeypatch):
    monkeypatch.setattr(evaluate, "find_evaluator_python", lambda: sys.executable)
    scene = bpy.data.scenes.new("other pairs")
    with bpy.context.temp_override(scene=scene):
        scene.icymoon.dataset.methods = "bm:disparities=16"
        yield scene
    bpy.data.scenes.remove(scene)


@pytest.mark.long
@pytest.mark.heavy
def test_a_folder_of_photographs_is_evaluated_and_its_report_is_known_as_ours(scene, tmp_path):
    root = foreign.plain(tmp_path, 'disparity = "truth/{pair}.npy"', file=foreign.constant())
    assert bpy.ops.icymoon.evaluate_folder(directory=str(root)) == {"FINISHED"}
    page = root / "evaluation" / "report.html"
    assert trusted_reports.is_own_report(page)
    assert "Plain folder" in page.read_text(encoding="utf-8")
    assert not scene.icymoon.results  # they are not those of the scene


@pytest.mark.heavy
def test_a_folder_without_pairs_is_one_sentence(scene, tmp_path):
    with pytest.raises(RuntimeError, match=r"contains no complete stereo pair.*KITTI"):
        bpy.ops.icymoon.evaluate_folder(directory=str(tmp_path))
    with pytest.raises(RuntimeError, match="is empty; choose a path"):
        bpy.ops.icymoon.evaluate_folder(directory="")
    assert not (tmp_path / "evaluation").exists()
