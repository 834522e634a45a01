"""The maps that Evaluate writes from the window: what is asked of the evaluator, and why there are none."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.nodes.build_scene import build_scene
from icymoon.operators import dataset, evaluate
from icymoon.settings.blender import scene_properties
from rendering import complete, empty_scene


@pytest.fixture
def scene():
    scene = empty_scene()
    scene.icymoon.source.kind, scene.icymoon.dataset.maps = "HEIGHT_MAP", True
    return scene


def _ask(scene):
    return evaluate.make_map_arguments(scene, scene_properties.read_settings(scene.icymoon))


def test_maps_are_asked_for_with_the_cell_that_is_set(scene):
    assert not evaluate.explain_missing_maps(scene)
    assert _ask(scene) == ["--maps"]
    scene.icymoon.dataset.map_cell_m = 0.25
    assert _ask(scene) == ["--maps", "0.25"]
    scene.icymoon.dataset.maps = False
    assert _ask(scene) == []


@pytest.mark.long
def test_a_data_set_that_is_evaluated_while_it_is_rendered_has_them_too(scene, monkeypatch):
    monkeypatch.setattr(evaluate, "find_evaluator_python", lambda: "python")
    monkeypatch.setattr(dataset, "find_evaluator_python", lambda: "python")
    settings = scene_properties.read_settings(scene.icymoon)
    assert "--maps" not in dataset.make_batch_command(scene, settings, "plan.toml")
    settings.dataset.evaluate = True
    assert "--maps" in dataset.make_batch_command(scene, settings, "plan.toml")


@pytest.mark.long
def test_ground_that_is_on_no_map_has_none_and_the_window_tells_why(scene, tmp_path):
    scene.icymoon.source.kind = "PROCEDURAL"
    assert evaluate.explain_missing_maps(scene) == "Maps need ground from a GeoTIFF with a coordinate system."
    assert _ask(scene) == []
    np.save(tmp_path / "dem.npy", np.zeros((9, 9), np.float32))
    source = {"kind": "HEIGHT_MAP", "file": str(tmp_path / "dem.npy"), "metres_per_pixel": 1.0}
    settings = complete({"source": source, "terrain": {"size_m": 6.0, "resolution": 9}, "rocks": {"coverage": 0.0}})
    settings.dataset.maps = True
    scene_properties.write_settings(scene.icymoon, settings)
    assert not evaluate.explain_missing_maps(scene)  # the file is read when the scene is built
    build_scene(scene, scene_properties.read_settings(scene.icymoon))
    assert "no coordinate system" in evaluate.explain_missing_maps(scene)
    assert _ask(scene) == []
