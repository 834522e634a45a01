"""The beams and points of a LiDAR in the 3D View."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest
from icymoon.formats.lidar_file import read_lidar
from icymoon.nodes import lidar_in_view, painted_errors
from icymoon.nodes.datablocks.fingerprint import TAG
from icymoon.nodes.lidar_in_view import ATTRIBUTES, make_rods
from icymoon.settings.preset_files import LIDARS
from icymoon.stereo.lidar_view import ICE_DELAY, RETURN_NUMBER, ShownPoints, colour_points, list_values
from stand_ins import stand_in


def make_points(count: int) -> ShownPoints:
    random = np.random.default_rng(1)
    return ShownPoints(
        point_m=random.normal(size=(count, 3)),
        range_m=random.uniform(1, 2, count),
        error_m=random.normal(scale=0.01, size=count),
        light=random.uniform(1, 100, count),
        ice_m=random.uniform(0, 0.1, count),
        order=random.integers(0, 4, count),
        position_m=np.array([0.0, 0.0, 5.0]),
        total=3 * count,
        title="Test",
        beams=10 * count,
        returned=2 * count,
    )


def read_colours(item: bpy.types.Object, corners: int = 4) -> np.ndarray:
    colours = np.zeros(4 * len(item.data.vertices), np.float32)
    item.data.color_attributes[0].data.foreach_get("color_srgb", colours)
    return np.rint(255 * colours.reshape(-1, corners, 4)[:, 0, :3]).astype(int)


def list_data() -> list[str]:
    kinds = bpy.data.objects, bpy.data.meshes, bpy.data.materials, bpy.data.node_groups, bpy.data.collections
    return [each.name for kind in kinds for each in kind]


def test_points_are_squares_with_their_values_of_which_the_first_are_shown(scene):
    points = make_points(20)
    item = lidar_in_view.show_points(scene, points, ICE_DELAY, 7)

    def count_shown() -> int:
        return len(item.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.polygons)

    assert (len(item.data.polygons), count_shown()) == (20, 7)
    lidar_in_view.limit_points(scene, 100)
    assert count_shown() == 20
    for value, array in list_values(points).items():
        data = item.data.attributes[ATTRIBUTES[value][0]].data
        assert [each.value for each in data] == pytest.approx(array.tolist(), rel=1e-6)
    centres = [np.array(polygon.center) for polygon in item.data.polygons]
    assert centres == pytest.approx(points.point_m, abs=1e-6)
    assert read_colours(item).tolist() == colour_points(ICE_DELAY, list_values(points)).astype(int).tolist()
    lidar_in_view.recolour(scene, RETURN_NUMBER)
    assert len(np.unique(read_colours(item), axis=0)) == 4
    near, far = points.range_m.min(), points.range_m.max()
    assert [text for text, _ in lidar_in_view.make_legend(scene, RETURN_NUMBER)[:4]] == [
        "Test",
        "40 of 200 beams returned",
        f"Range: {near:.3g} to {far:.3g} m",
        "20 of 60 points can be shown",
    ]
    assert item.hide_render


def test_removal_leaves_nothing_of_ours_and_all_of_the_user(scene):
    before = list_data()
    lidar_in_view.show_points(scene, make_points(3), ICE_DELAY, 3)
    lidar_in_view.show_points(scene, make_points(4), ICE_DELAY, 3)
    collection = next(c for c in scene.collection.children if c.name == lidar_in_view.NAME)
    own = bpy.data.objects.new("Own", None)
    collection.objects.link(own)
    assert len(lidar_in_view.find_points(scene).data.polygons) == 4
    assert lidar_in_view.clear_scan(scene)
    assert not lidar_in_view.clear_scan(scene)
    assert list_data() == ["Own", *before]
    assert own.name in scene.collection.objects
    assert lidar_in_view.make_legend(scene, ICE_DELAY) == ()
    lidar_in_view.recolour(scene, ICE_DELAY)  # nothing is shown
    lidar_in_view.limit_points(scene, 3)


def test_attributes_that_the_user_removed_leave_points_without_a_legend(scene):
    item = lidar_in_view.show_points(scene, make_points(3), ICE_DELAY, 3)
    item.data.attributes.remove(item.data.attributes["intensity"])
    assert lidar_in_view.make_legend(scene, ICE_DELAY) == ()
    lidar_in_view.recolour(scene, RETURN_NUMBER)


def test_beams_end_on_the_ground_that_they_meet_and_pass_through_points(scene):
    """A camera looks straight down from 2 m on a plane: a beam at the angle a from the axis is 2 / cos(a) long."""
    bpy.ops.mesh.primitive_plane_add(size=1000.0)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    camera.location = (0, 0, 2)
    bpy.context.view_layer.update()
    built = stand_in(camera=camera)
    lidar_in_view.show_points(scene, make_points(5), ICE_DELAY, 5)
    bpy.ops.mesh.primitive_plane_add(size=1000.0, location=(0, 0, 1))
    bpy.context.active_object[TAG] = painted_errors.ROLE  # as copies of rocks have it
    found = read_lidar(LIDARS / "livox_hap.toml")
    lidar = replace(found, instrument=replace(found.instrument, farthest_m=150.0))
    item = lidar_in_view.show_beams(scene, built, lidar)
    assert lidar_in_view.find_points(scene) is None  # they gave way
    corners = np.array([vertex.co for vertex in item.data.vertices]).reshape(-1, 6, 3)
    assert len(corners) == 9 * 25
    end = corners[:, 3:].mean(axis=1)
    assert corners[:, :3].mean(axis=1) == pytest.approx(np.tile((0, 0, 2), (len(corners), 1)), abs=1e-5)
    assert end[:, 2] == pytest.approx(0.0, abs=1e-4)
    assert (read_colours(item, 6) == (90, 255, 120)).all()
    legend = [text for text, _ in lidar_in_view.make_legend(scene, ICE_DELAY)]
    length_m = np.linalg.norm(end - (0, 0, 2), axis=1)
    assert legend == [
        lidar.title,
        "225 of 225 beams meet the ground",
        f"Range: {length_m.min():.3g} to {length_m.max():.3g} m",
        "Green: meets the ground",
        "Grey: meets nothing",
    ]
    camera.rotation_euler.x = np.pi  # to the sky
    bpy.context.view_layer.update()
    sky = lidar_in_view.show_beams(scene, built, lidar)
    assert len(np.unique(read_colours(sky, 6), axis=0)) == 1
    assert (read_colours(sky, 6)[0] != (90, 255, 120)).any()
    assert [text for text, _ in lidar_in_view.make_legend(scene, ICE_DELAY)][1:3] == [
        "0 of 225 beams meet the ground",
        "No range was measured",
    ]


def test_rods_are_closed_and_as_long_as_stated():
    direction = np.array([[0.0, 0, 1], [0.6, 0, -0.8]])
    corners, faces = make_rods(np.zeros(3), direction, np.array([2.0, 5.0]), 0.005, np.array([0.01, 0.02]))
    ends = corners.reshape(2, 6, 3)[:, 3:]
    assert ends.mean(axis=1) == pytest.approx(direction * [[2.0], [5.0]])
    assert np.linalg.norm(ends - ends.mean(axis=1, keepdims=True), axis=2) == pytest.approx(
        np.array([[0.01] * 3, [0.02] * 3])
    )
    assert np.linalg.norm(corners.reshape(2, 6, 3)[:, :3], axis=2) == pytest.approx(0.005)
    assert (faces.min(), faces.max(), len(faces)) == (0, 11, 14)
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert sorted(count.tolist()) == [1] * 6 + [2] * 18  # only the ends at the sensor are open
