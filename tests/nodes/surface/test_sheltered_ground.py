"""Ground that rocks shelter from falling frost: where it lies, and that other ground has no mark of it."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from icymoon.nodes.build_scene import build_scene
from icymoon.nodes.ground.rocks import ROCK_SHELTER, ROCK_SHELTER_SLOPE
from icymoon.nodes.surface.sheltered_ground import SHELTERED, mark_shelter
from icymoon.nodes.tree.evaluate_field import read_numbers
from icymoon.physics.surfaces.fallen_frost import find_origin
from icymoon.render.mesh_arrays import read_vertices
from mathutils import Vector
from rendering import complete, empty_scene

#: One rock of 1 m at the origin, on level ground whose vertices are 0.1 m apart.
LEVEL = {
    "terrain": {"size_m": 12.8, "resolution": 129, "rms_slope_deg": 0.0},
    "rig": {"y_m": -5.0},
    "surface": {"frost_from": "FALL", "frost_tilt_deg": 60.0, "frost_azimuth_deg": 90.0, "frost_spread_deg": 0.0},
}


def with_rock(tmp_path, *changes):
    table = tmp_path / "rocks.csv"
    table.write_text("x_m,y_m,diameter_m\n0.05,0,1\n", encoding="utf-8")
    rocks = {"law": "TABLE", "file": str(table), "coverage": 0.1, "burial": 0.0, "tilt_deg": 0.0}
    return complete(LEVEL, {"rocks": rocks}, *changes)


@pytest.mark.parametrize("tilt_deg", [60.0, 20.0])
def test_blender_s_own_rays_find_the_same_ground_sheltered(tmp_path, tilt_deg):
    scene = empty_scene()
    built = build_scene(scene, with_rock(tmp_path, {"surface": {"frost_tilt_deg": tilt_deg}}))
    mesh = built.terrain.data
    where, sheltered = read_vertices(mesh), read_numbers(mesh, SHELTERED)
    assert set(np.unique(sheltered)) == {0.0, 1.0}
    near = np.hypot(where[:, 0], where[:, 1]) < 2.0
    toward, depsgraph = Vector(find_origin(built.settings.surface)), bpy.context.evaluated_depsgraph_get()
    hit = [scene.ray_cast(depsgraph, Vector(place) + Vector((0.0, 0.0, 1e-3)), toward)[0] for place in where[near]]
    # Single rays may pass an edge of the rock on either side.
    assert np.mean(np.array(hit) != sheltered[near].astype(bool)) < 2e-3
    assert (sheltered[near] == 1.0).sum() > 30


def test_straight_down_only_what_is_under_the_rock_is_sheltered(tmp_path):
    mesh = build_scene(empty_scene(), with_rock(tmp_path, {"surface": {"frost_tilt_deg": 0.0}})).terrain.data
    dark = read_vertices(mesh)[read_numbers(mesh, SHELTERED) == 1.0]
    assert len(dark) > 30
    assert np.hypot(*dark[:, :2].T).max() < 1.0


def test_a_rock_in_the_lee_of_another_gets_no_frost(tmp_path):
    table = tmp_path / "two.csv"
    table.write_text("x_m,y_m,diameter_m\n0.05,0,2\n-1.3,0,0.1\n4,4,0.1\n", encoding="utf-8")
    built = build_scene(empty_scene(), with_rock(tmp_path, {"rocks": {"file": str(table)}}))
    rocks = next(item for item in built.collection.all_objects if item.get("icymoon") == "rock").data
    position = read_vertices(rocks)
    level = read_numbers(rocks, ROCK_SHELTER)
    slope = np.empty(3 * len(position), np.float32)
    rocks.attributes[ROCK_SHELTER_SLOPE].data.foreach_get("vector", slope)
    middle = np.clip(level + (slope.reshape(-1, 3) * position).sum(axis=1), 0.0, 1.0)
    # Grains come from the east at 30 degrees: the first rock hides the second, and nothing hides the third.
    order = [np.argmin(np.hypot(position[:, 0] - x, position[:, 1] - y)) for x, y in ((-1.3, 0), (4, 4))]
    assert middle[order] == pytest.approx([1.0, 0.0], abs=1e-3)


def test_ground_whose_frost_does_not_fall_has_no_mark(tmp_path):
    built = build_scene(empty_scene(), with_rock(tmp_path, {"surface": {"frost_from": "VAPOUR", "frost_share": 0.5}}))
    assert SHELTERED not in built.terrain.data.attributes
    mark_shelter(built.terrain.data, complete(LEVEL))
    assert read_numbers(built.terrain.data, SHELTERED) == pytest.approx(0.0)  # level ground without rocks
    mark_shelter(built.terrain.data, built.settings)
    assert SHELTERED not in built.terrain.data.attributes
