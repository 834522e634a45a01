"""Painting where rocks lie: what is painted is what the file states, and rocks that stay do not move."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.ground import mask_sheet
from icymoon.operators import painted_masks
from icymoon.panels import sidebar
from icymoon.physics.rocks.painted_mask import find_pixel_centres, read_mask
from panel_drawing import drawn, texts


def list_rocks() -> set[tuple[float, float, float]]:
    item = next(item for item in bpy.data.objects if item.get("icymoon") == "rock")
    return {tuple(vertex.co) for vertex in item.data.vertices}


def paint_north(sheet: bpy.types.Object, weight: float) -> None:
    """As a brush does, on the northern half."""
    north = [k for k, vertex in enumerate(sheet.data.vertices) if vertex.co.y > 0]
    sheet.vertex_groups.active.add(north, weight, "REPLACE")


def read_named_mask(group: bpy.types.PropertyGroup, key: str = "mask_file") -> np.ndarray:
    return read_mask(Path(bpy.path.abspath(getattr(group, key))))


def test_rocks_lie_where_they_are_painted_and_everywhere_after_clearing(small):
    small.icymoon.rocks.coverage = 0.1
    bpy.ops.icymoon.build_scene()
    before = list_rocks()
    assert bpy.ops.icymoon.paint_mask(kind="ROCKS") == {"FINISHED"}
    sheet = bpy.context.active_object
    assert (sheet.mode, sheet.hide_render) == ("WEIGHT_PAINT", True)
    paint_north(sheet, 1.0)
    assert bpy.ops.icymoon.use_painted_mask(kind="ROCKS") == {"FINISHED"}
    stated = read_named_mask(small.icymoon.rocks)
    np.testing.assert_array_equal(stated, np.arange(256)[:, None] < np.full(256, 128))
    stayed = list_rocks()
    assert {rock for rock in before if rock[1] > 0.1} <= stayed < {rock for rock in before if rock[1] > -0.1}
    assert sheet.hide_get()
    assert mask_sheet.find_sheet(small) == sheet  # it outlives the ground
    assert sheet.name not in scenes.find_collection(small).all_objects
    assert bpy.ops.icymoon.clear_mask(kind="ROCKS") == {"FINISHED"}
    assert (list_rocks(), small.icymoon.rocks.mask_file) == (before, "")
    assert mask_sheet.find_sheet(small) is None


def test_the_panel_offers_the_end_of_painting_and_clearing_the_scene_ends_it(small):
    bpy.ops.icymoon.build_scene()
    assert "Painting" not in texts(drawn(sidebar.ICYMOON_PT_main))
    bpy.ops.icymoon.paint_mask(kind="DIRT")
    sheet = bpy.context.active_object
    paint_north(sheet, 0.5)
    assert painted_masks.find_painted_kind(bpy.context) == "DIRT"
    shown = drawn(sidebar.ICYMOON_PT_main)
    assert "Painting: red is all" in texts(shown)
    assert "icymoon.use_painted_mask" in str(shown)
    assert bpy.ops.icymoon.clear_scene() == {"FINISHED"}
    assert (bpy.context.mode, sheet.hide_get()) == ("OBJECT", True)
    assert painted_masks.find_painted_kind(bpy.context) == ""
    assert mask_sheet.read_shares(sheet, "Icy Moon Dirt").max() == 0.5  # what was painted stays


def test_clearing_the_scene_leaves_the_users_own_mode(small):
    bpy.ops.icymoon.build_scene()
    own = bpy.data.objects.new("Own", bpy.data.meshes.new("Own"))
    small.collection.objects.link(own)
    bpy.context.view_layer.objects.active = own
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.icymoon.clear_scene()
    assert bpy.context.mode == "EDIT_MESH"
    bpy.ops.object.mode_set(mode="OBJECT")


def test_a_mask_can_be_painted_on_and_lies_on_the_ground(small):
    bpy.ops.icymoon.build_scene()
    terrain = scenes.find_built(small).terrain
    size_m = float(small.icymoon.terrain.size_m)
    sheet = mask_sheet.lay_sheet(small, terrain, size_m)
    values = np.array([[0.0, 1.0], [0.25, 0.5]])
    mask_sheet.make_group(sheet, "Icy Moon Frost", values)
    shares = mask_sheet.read_shares(sheet, "Icy Moon Frost")
    assert shares[[0, 0, -1, -1], [0, -1, 0, -1]] == pytest.approx(values.ravel())  # north first, west first
    places = np.array([vertex.co for vertex in sheet.data.vertices]).reshape(256, 256, 3)
    half = size_m / 2 * (1 - 1 / 256)
    assert places[0, 0, :2] == pytest.approx([-half, half])
    x_m, y_m = find_pixel_centres(size_m, mask_sheet.SIDE)
    with mask_sheet.probe_heights(terrain) as height_at:
        above = places[..., 2] - height_at(x_m, y_m)
    assert above.min() > 0
    assert np.median(above) < size_m / 50


def test_an_image_is_taken_as_a_mask_with_its_north_up(small):
    bpy.ops.icymoon.build_scene()
    image = bpy.data.images.new("Mine", 3, 2, float_buffer=True)
    rows = np.array([[0.0, 0.25, 0.5], [1.0, 2.0, 0.75]])  # from the south
    image.pixels.foreach_set(np.repeat(rows[..., None], 4, axis=-1).astype(np.float32).ravel())
    assert bpy.ops.icymoon.use_image_as_mask(kind="FROST", image="Mine") == {"FINISHED"}
    surface = small.icymoon.surface
    expected = [[1.0, 1.0, 0.75], [0.0, 0.25, 0.5]]
    assert read_named_mask(surface, "frost_mask_file") == pytest.approx(np.array(expected), abs=1e-5)
    assert surface.frost_share == 0.5  # what was none is turned on
    names = {node.name for node in scenes.find_built(small).terrain.data.materials[0].node_tree.nodes}
    assert "Painted Frost" in names


def test_nothing_is_painted_before_a_build(small):
    assert not bpy.ops.icymoon.paint_mask.poll()
    assert not bpy.ops.icymoon.use_painted_mask.poll()
    assert not bpy.ops.icymoon.clear_mask.poll()
