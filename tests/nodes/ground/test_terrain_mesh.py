"""The ground as Blender has it: the heights of the function, their measured roughness, and the list of layers."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.ground.terrain_mesh import (
    compute_vertex_spacing_m,
    make_roughness_table,
    measure_patch_roughness,
    read_grid_heights,
    shortest_wavelength_m,
)
from icymoon.panels import CLASSES
from icymoon.physics.terrain.roughness.statistics import measure_roughness
from icymoon.settings import description
from icymoon.settings.blender import scene_properties
from panel_drawing import drawn, texts
from rendering import complete, empty_scene

#: A mesh that carries all of its ground's waves, and two thirds of a decade of law beyond its cut-offs.
LAW = {"terrain": {"resolution": 257, "hurst": 0.7, "outer_scale_m": 12.0, "inner_scale_m": 0.24}}


def _built(*parts: dict) -> scenes.Built:
    return scenes.build_scene(empty_scene(), complete(*parts))


def test_the_mesh_has_the_heights_of_the_ground():
    built = _built(LAW, {"craters": {"coverage": 0.1, "smallest_m": 1.0}})
    terrain = built.settings.terrain
    axis = np.linspace(-10, 10, 257)
    ground = scenes.make_ground(built.settings)
    heights = ground.heights(axis[None, :], axis[:, None], shortest_wavelength_m(terrain))
    made = read_grid_heights(built.terrain.data, terrain)
    assert made is not None
    assert np.array_equal(made, heights.astype(np.float32))
    normals = np.empty(3 * 257**2, np.float32)
    built.terrain.data.vertices.foreach_get("normal", normals)
    assert normals[2::3].min() > 0  # the upper side is up


@pytest.mark.parametrize("hurst", [0.4, 0.7, 0.95])
@pytest.mark.parametrize("multifractality", [0.0, 1.0])
def test_the_built_mesh_has_the_stated_roughness(hurst, multifractality):
    built = _built(LAW, {"terrain": {"hurst": hurst, "multifractality": multifractality}})
    terrain = built.settings.terrain
    found = measure_patch_roughness(scenes.measure_patch(built), terrain)
    assert found is not None
    spacing = compute_vertex_spacing_m(terrain)
    inside = (found.lag_m >= 3 * spacing) & (found.lag_m <= 0.25 * 12.0)
    asked = math.tan(math.radians(terrain.rms_slope_deg)) * found.lag_m**hurst
    assert inside.sum() > 8
    assert np.abs(found.deviation_m / asked - 1)[inside].max() < 0.1
    assert found.slope_deg == pytest.approx(terrain.rms_slope_deg, rel=0.04)
    assert found.hurst == pytest.approx(hurst, abs=0.06)


def test_what_the_panel_says_is_what_is_measured():
    empty = empty_scene()
    scene_properties.write_settings(
        empty.icymoon,
        description.check({"mesh": {"kind": "GRID"}, "terrain": {**LAW["terrain"], "rms_slope_deg": 9.0}}, "test"),
    )
    assert not bpy.ops.icymoon.show_roughness.poll()
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    built = scenes.find_built(bpy.context.scene)
    assert built is not None
    # Measured again, from the vertices, with nothing of the builders.
    positions = np.empty(3 * 257**2, np.float32)
    built.terrain.data.vertices.foreach_get("co", positions)
    found = measure_roughness(
        positions[2::3].reshape(257, 257).astype(float), 20 / 256, 1.0, (6 * 20 / 256, 0.3 * 12.0)
    )
    heading, asked, made = scenes.describe_ground_statistics(bpy.context.scene)
    assert heading == "RMS slope over 1 m, RMS height"
    assert made == f"Built: {found.slope_deg:.1f}°, {found.height_m:.2g} m"
    assert asked.startswith("By roughness: 9.0°, ")
    assert found.slope_deg == pytest.approx(9.0, abs=0.4)
    assert found.hurst == pytest.approx(0.7, abs=0.05)
    plane = np.stack([*positions.reshape(-1, 3)[:, :2].T, np.ones(257**2)], axis=1)
    _, (squares,), *_ = np.linalg.lstsq(plane, positions[2::3].astype(float), rcond=None)
    assert found.height_m == pytest.approx(math.sqrt(squares / 257**2), rel=1e-6)
    panel = next(cls for cls in CLASSES if getattr(cls, "bl_idname", "") == "ICYMOON_PT_terrain")
    assert ("operator", "icymoon.show_roughness", made) in drawn(panel)
    assert all(line in texts(drawn(panel)) for line in ("Of the ground as it is built:", heading, asked))
    assert bpy.ops.icymoon.show_roughness() == {"FINISHED"}


def test_the_table_of_roughness():
    built = _built(LAW)
    terrain = built.settings.terrain
    head, *rows, last = make_roughness_table(scenes.measure_patch(built), terrain)
    assert head == ("Distance", "RMS deviation", "Setting", "Ratio", "PSD")
    assert last[0] == "Hurst exponent"
    assert float(last[1]) == pytest.approx(0.7, abs=0.06)
    assert last[2] == "0.70"
    heights = read_grid_heights(built.terrain.data, terrain)
    assert heights is not None
    ratios, waves, densities = [], [], []
    for distance, deviation, asked, ratio, density in rows:
        metres, made = float(distance.split()[0]), float(deviation.split()[0]) / 1e3
        lag = round(metres / compute_vertex_spacing_m(terrain))
        difference = np.concatenate(
            [(heights[:, lag:] - heights[:, :-lag]).ravel(), (heights[lag:] - heights[:-lag]).ravel()]
        )
        # The plane of the patch is taken off before measuring, which counts at the longest lags.
        assert made == pytest.approx(math.sqrt(np.mean(difference**2)), rel=0.15 if metres > 2 else 0.03)
        if ratio:
            expected = math.tan(math.radians(12.0)) * metres**0.7
            assert float(asked.split()[0]) / 1e3 == pytest.approx(expected, rel=0.02)
            assert float(ratio) == pytest.approx(made / expected, abs=0.02)
            ratios.append(float(ratio))
        if density and 0.5 < metres < 5:
            waves.append(1 / metres)
            densities.append(float(density.split()[0]))
    assert len(ratios) > 5
    assert np.abs(np.array(ratios) - 1).max() < 0.1
    slope = np.polyfit(np.log(waves), np.log(densities), 1)[0]
    assert slope == pytest.approx(-(2 * 0.7 + 2), abs=0.5)  # four bins


def test_no_roughness_is_shown_of_a_mesh_that_is_not_the_grid():
    built = _built(LAW)
    built.terrain.data = bpy.data.meshes.new("other")
    assert measure_patch_roughness(scenes.measure_patch(built), built.settings.terrain) is None
    assert make_roughness_table(scenes.measure_patch(built), built.settings.terrain) == []
    flat = _built({"terrain": {"rms_slope_deg": 0.0}})
    assert scenes.describe_ground_statistics(bpy.context.scene) == (
        "RMS slope over 1 m, RMS height",
        "By roughness: 0.0°, 0 m",
        "Built: 0.0°, 0 m",
    )
    assert make_roughness_table(scenes.measure_patch(flat), flat.settings.terrain)[1][2:4] == ("", "")


def test_what_was_measured_on_an_earlier_ground_is_shown_as_such():
    empty = empty_scene()
    scene_properties.write_settings(
        empty.icymoon, description.check({**LAW, "mesh": {"kind": "GRID"}, "ridges": {"height_m": 0.3}}, "test")
    )
    roughness = empty.icymoon.terrain.rms_slope_deg
    bpy.ops.icymoon.build_scene()
    before = scenes.describe_ground_statistics(empty)
    assert before[2].startswith("With landforms: "), "what roughness asks for is not what ridges add"

    def shown() -> str:
        return texts(drawn(bpy.types.ICYMOON_PT_terrain))

    assert "Of the ground as it is built:" in shown()
    empty.icymoon.terrain.rms_slope_deg = 3.0
    assert "Of the ground built before:" in shown()
    assert all(line in shown() for line in before), "fields below would move"
    empty.icymoon.terrain.rms_slope_deg = roughness
    empty.icymoon.light.sun_elevation_deg += 5.0  # of no effect on the ground
    assert "Of the ground as it is built:" in shown()
    bpy.ops.icymoon.clear_scene()
    assert "Of the ground" not in shown()


def test_layers_are_added_moved_and_removed(scene):
    terrain = scene.icymoon.terrain
    assert not bpy.ops.icymoon.layer_remove.poll()
    for k in range(3):
        bpy.ops.icymoon.layer_add()
        terrain.layers[-1].amplitude_m = 0.1 * (k + 1)
    assert terrain.layers_active == 2
    bpy.ops.icymoon.layer_move(direction="UP")
    assert [round(entry.amplitude_m, 3) for entry in terrain.layers] == [0.1, 0.3, 0.2]
    assert terrain.layers_active == 1
    assert bpy.ops.icymoon.layer_move(direction="DOWN") == {"FINISHED"}
    assert bpy.ops.icymoon.layer_move(direction="DOWN") == {"CANCELLED"}
    bpy.ops.icymoon.layer_remove()
    assert [round(entry.amplitude_m, 3) for entry in terrain.layers] == [0.1, 0.2]
    for _ in range(2):
        bpy.ops.icymoon.layer_remove()
    assert len(terrain.layers) == 0
    assert terrain.layers_active == 0


def test_layers_reach_the_mesh():
    bare, layered = (
        _built({"terrain": {"rms_slope_deg": 0.0, "layers": layers}})
        for layers in ([], [{"amplitude_m": 0.5, "scale_m": 4.0}])
    )
    heights = read_grid_heights(layered.terrain.data, layered.settings.terrain)
    assert heights is not None
    # Twenty-five waves on the patch: their RMS height is that of all within a fifth.
    assert heights.std() == pytest.approx(0.5, rel=0.25)
    assert bare.settings.terrain.layers == []
