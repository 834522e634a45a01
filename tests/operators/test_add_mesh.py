"""Add ▸ Mesh: ground and rocks as ordinary objects."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from icymoon.settings.table import TOPICS
from icymoon.settings.topics.declaration import LANDFORMS
from icymoon.support.arrays import Array
from mathutils import Vector

SMALL = {"size_m": 8.0, "resolution": 65}


def positions(item: bpy.types.Object) -> Array:
    found = np.empty(3 * len(item.data.vertices), np.float32)
    item.data.attributes["position"].data.foreach_get("vector", found)
    return found.reshape(-1, 3)


def test_terrain_has_the_size_and_slope_that_are_asked_for(scene):
    assert bpy.ops.icymoon.add_terrain(**SMALL, rms_slope_deg=10.0) == {"FINISHED"}
    item = bpy.context.object
    assert item.select_get()
    assert np.ptp(positions(item), axis=0)[:2] == pytest.approx((8.0, 8.0))
    assert len(item.data.vertices) == 65 * 65
    assert item.data.materials[0] is not None
    gentle = np.ptp(positions(item)[:, 2])
    bpy.ops.icymoon.add_terrain(**SMALL, rms_slope_deg=20.0)
    # The heights of one seed are in proportion to the slope's tangent.
    assert np.ptp(positions(bpy.context.object)[:, 2]) / gentle == pytest.approx(
        np.tan(np.radians(20.0)) / np.tan(np.radians(10.0)), rel=0.02
    )


def test_terrain_is_that_of_the_sidebar_but_for_what_is_given(scene):
    scene.icymoon.terrain.rms_slope_deg = 20.0
    bpy.ops.icymoon.add_terrain(**SMALL)
    as_described = positions(bpy.context.object)
    bpy.ops.icymoon.add_terrain(**SMALL, rms_slope_deg=20.0)
    np.testing.assert_array_equal(positions(bpy.context.object), as_described)
    bpy.ops.icymoon.add_terrain(**SMALL, ridges_height_m=1.0)
    assert np.ptp(positions(bpy.context.object)[:, 2]) > np.ptp(as_described[:, 2])
    assert scene.icymoon.ridges.height_m == 0.0


def test_terrain_of_a_preset_is_what_the_sidebar_makes_of_it(scene):
    scene.icymoon.ridges.height_m = 1.0  # which the preset does not have
    bpy.ops.icymoon.add_terrain(**SMALL, preset="terrains/high_1")
    of_preset = positions(bpy.context.object)
    scene.icymoon.ridges.height_m = 0.0
    bpy.ops.icymoon.load_preset(preset="terrains/high_1")
    bpy.ops.icymoon.add_terrain(**SMALL)
    np.testing.assert_array_equal(positions(bpy.context.object), of_preset)


def test_the_redo_panel_shows_every_setting_of_ground_and_landforms(scene):
    kind = bpy.types.ICYMOON_OT_add_terrain
    there = set(bpy.ops.icymoon.add_terrain.get_rna_type().properties.keys())
    numbers = {s.key for s in TOPICS["terrain"].settings if s.kind in ("int", "float")} - {"body_radius_m"}
    numbers |= {f"{key}_{s.key}" for key, topic in TOPICS.items() if topic.parent == LANDFORMS for s in topic.settings}
    assert numbers <= there
    shown: list[str] = []
    layout = SimpleNamespace(prop=lambda data, key, **_: shown.append(key))
    layout.column = lambda align: layout
    values = dict.fromkeys(kind.own_settings, 1.0)
    kind.draw(SimpleNamespace(layout=layout, own_settings=kind.own_settings, advanced=True, **values), bpy.context)
    assert numbers | {"seed", "preset"} <= set(shown)
    assert len(shown) == len(set(shown))


def test_a_block_stands_on_the_cursor_and_is_as_wide_as_asked_for(scene):
    scene.cursor.location = (1.0, 2.0, 3.0)
    assert bpy.ops.icymoon.add_block(diameter_m=2.0, elongation=1.0, height_ratio=0.5) == {"FINISHED"}
    item = bpy.context.object
    assert item.location == Vector((1.0, 2.0, 3.0))
    low, high = positions(item).min(axis=0), positions(item).max(axis=0)
    assert low[2] == pytest.approx(0.0, abs=1e-6)
    assert high[2] == pytest.approx(2.0 * 0.5, rel=1e-5)
    # Seen from above it covers as much as a circle of 2 m; a convex shape is within its bounds and over half of them.
    assert np.pi < np.prod((high - low)[:2]) < 2 * np.pi


def test_the_same_seed_gives_the_same_block_and_another_one_another(scene):
    shapes = []
    for seed in (1, 1, 2):
        bpy.ops.icymoon.add_block(seed=seed)
        shapes.append(positions(bpy.context.object))
    assert np.array_equal(shapes[0], shapes[1])
    assert not np.allclose(shapes[0], shapes[2])


def test_build_and_clear_leave_what_was_added_alone(small):
    bpy.ops.icymoon.add_block()
    item, material = bpy.context.object, bpy.context.object.data.materials[0]
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    assert bpy.ops.icymoon.clear_scene() == {"FINISHED"}
    assert item.name in small.objects
    assert item.data.materials[0] == material


def test_a_missing_texture_is_one_sentence_and_adds_nothing(scene, tmp_path):
    scene.icymoon.textures.set = "OWN"
    scene.icymoon.textures.albedo_file = str(tmp_path / "none.png")
    before = len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.materials)
    with pytest.raises(RuntimeError, match=r"none\.png"):
        bpy.ops.icymoon.add_terrain(**SMALL)
    assert (len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.materials)) == before
