"""Rocks in Blender: the same every time, on the mesh, noticed when edited, gone when cleared."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.datablocks.fingerprint import TAG, make_fingerprint
from icymoon.nodes.ground.heights_under import probe_heights
from icymoon.physics.surfaces.principled import base_colour
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from icymoon.support.labels import FIRST_ROCK_INSTANCE, INSTANCE_ATTRIBUTE
from rendering import complete, empty_scene

#: Ground with a trench.
DUG = {"excavation": {"path": "LINE", "states": 3, "bite_m": 0.05, "length_m": 0.2, "cell_m": 0.01, "start_y_m": 2.0}}
STREWN = {"rocks": {"coverage": 0.1, "smallest_m": 0.15}}


def carrier(built: scenes.Built) -> bpy.types.Object:
    """The object whose points carry the blocks."""
    return next(item for item in built.collection.all_objects if item.get(TAG) == "rock")


def instances(built: scenes.Built) -> list[tuple[Array, bpy.types.Mesh]]:
    """Matrix and mesh of every block as the dependency graph makes them, in the order of the points."""
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    return [
        (np.array(i.matrix_world), i.object.original.data)
        for i in graph.object_instances
        if i.is_instance and i.parent.original == carrier(built)
    ]


def corners(mesh: bpy.types.Mesh) -> Array:
    """Vertex positions (n, 3) of a mesh."""
    out = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", out)
    return out.reshape(-1, 3).astype(float)


def data_blocks() -> dict[str, int]:
    """Number of data-blocks of every kind that blocks are made of."""
    return {
        kind: len(getattr(bpy.data, kind))
        for kind in ("objects", "meshes", "materials", "collections", "scenes", "node_groups")
    }


def test_two_builds_are_equal_and_clear_removes_everything():
    scene = empty_scene()
    before = data_blocks()
    first = scenes.build_scene(scene, complete(STREWN))
    mark, counts, blocks = make_fingerprint(first.collection), data_blocks(), first.rock_count
    assert blocks > 100
    names = sorted(o.name for o in bpy.data.objects)
    for _ in range(2):
        again = scenes.build_scene(scene, complete(STREWN))
        assert (make_fingerprint(again.collection), data_blocks(), again.rock_count) == (mark, counts, blocks)
        assert sorted(o.name for o in bpy.data.objects) == names
    assert make_fingerprint(scenes.build_scene(scene, complete(STREWN, {"dataset": {"seed": 2}})).collection) != mark
    scenes.build_scene(scene, complete())
    assert scenes.find_built(scene).rock_count == 0
    scenes.build_scene(scene, complete(STREWN))
    scenes.clear_scene(scene)
    assert data_blocks() == before


@pytest.mark.parametrize("more", [{}, {"mesh": {"kind": "GRADED", "most": 60000, "farthest_m": 100.0}}, DUG], ids=str)
def test_a_skirt_moves_no_rock_and_leaves_no_gap(more):
    """The mesh is linear between its vertices and a skirt is not, so rocks stand within the longest edge times the
    slope of repose of where they stand without skirts."""
    patch = {"terrain": {"size_m": 8.0, "resolution": 513}, "rocks": {"coverage": 0.1, "smallest_m": 0.3}}
    without = scenes.build_scene(empty_scene(), complete(patch, more))
    expected = corners(carrier(without).data)
    built = scenes.build_scene(empty_scene(), complete(patch, more, {"rocks": {"skirt": 0.4}}))
    found = corners(carrier(built).data)
    assert len(found) == len(expected) > 20
    assert np.array_equal(found[:, :2], expected[:, :2])
    near = np.hypot(*found[:, :2].T) < 3.0
    at = corners(built.terrain.data)
    ends = at[[edge.vertices[:] for edge in built.terrain.data.edges]][:, :, :2]
    longest = np.hypot(*(ends[:, 0] - ends[:, 1]).T)[np.hypot(*ends.mean(axis=1).T) < 3.5].max()
    assert np.abs(found - expected)[near, 2].max() < math.tan(math.radians(35.0)) * longest
    points = [corners(mesh) @ matrix[:3, :3].T + matrix[:3, 3] for matrix, mesh in instances(built)]
    with probe_heights(built.terrain) as height_at:
        gaps = np.concatenate(points)[:, 2] - height_at(*np.concatenate(points)[:, :2].T)
    lowest, highest = (f.reduceat(gaps, np.cumsum([0, *map(len, points)])[:-1]) for f in (np.fmin, np.fmax))
    assert np.nanmax(lowest) <= 1e-4  # positions are in single precision
    assert (highest > 0.0).mean() > 0.9  # a skirt of a larger neighbour buries a small rock


@pytest.mark.parametrize("more", [{}, DUG], ids=str)
def test_debris_follows_the_rocks_and_rests_on_skirts(more):
    patch = {
        "terrain": {"size_m": 6.0, "resolution": 257},
        "rocks": {"coverage": 0.1, "smallest_m": 0.3, "skirt": 0.3, "burial": 0.0},
    }
    rocks = corners(carrier(scenes.build_scene(empty_scene(), complete(patch, more))).data)
    asked = {"rocks": {"debris": 0.1, "debris_smallest_m": 0.03, "debris_most": 300}}
    built = scenes.build_scene(empty_scene(), complete(patch, more, asked))
    mesh, first = carrier(built).data, len(rocks)
    found, labels = corners(mesh), np.empty(len(mesh.vertices), np.float32)
    mesh.attributes[INSTANCE_ATTRIBUTE].data.foreach_get("value", labels)
    assert first > 10
    assert 250 < len(found) - first <= 300
    assert np.array_equal(labels, FIRST_ROCK_INSTANCE + np.arange(len(found)))
    assert np.array_equal(found[:first], rocks)
    points = [corners(mesh) @ matrix[:3, :3].T + matrix[:3, 3] for matrix, mesh in instances(built)][first:]
    with probe_heights(built.terrain) as height_at:
        gaps = np.concatenate(points)[:, 2] - height_at(*np.concatenate(points)[:, :2].T)
    lowest, highest = (f.reduceat(gaps, np.cumsum([0, *map(len, points)])[:-1]) for f in (np.fmin, np.fmax))
    assert np.nanmax(lowest) <= 1e-4  # positions are in single precision
    assert (highest > 0.0).all()
    assert any("Debris under" in warning and "300 fragments" in warning for warning in built.warnings)


def test_every_point_is_an_instance_with_the_pose_that_was_computed():
    built = scenes.build_scene(empty_scene(), complete(STREWN))
    found = instances(built)
    mesh = carrier(built).data
    assert len(found) == built.rock_count == len(mesh.vertices)
    scales = np.empty(len(found) * 3, np.float32)
    mesh.attributes["scale"].data.foreach_get("vector", scales)
    positions = corners(mesh)
    picked = np.empty(len(found), np.int32)
    mesh.attributes["shape"].data.foreach_get("value", picked)
    names = sorted({m.name for _, m in found})
    for k, (matrix, shape) in enumerate(found):
        assert np.allclose(matrix[:3, 3], positions[k], atol=1e-6)
        assert np.allclose(np.linalg.norm(matrix[:3, :3], axis=0), scales.reshape(-1, 3)[k], rtol=1e-4)
        assert shape.name == names[picked[k]]
    labels = np.empty(len(found), np.float32)
    mesh.attributes[INSTANCE_ATTRIBUTE].data.foreach_get("value", labels)
    assert np.array_equal(labels, FIRST_ROCK_INSTANCE + np.arange(len(found)))


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(
    ("terrain", "kind"),
    [
        pytest.param({"rms_slope_deg": 5.0}, "GRID", marks=pytest.mark.long),
        ({"rms_slope_deg": 30.0, "resolution": 129}, "GRID"),
        pytest.param({"rms_slope_deg": 55.0, "resolution": 33}, "GRID", marks=pytest.mark.long),
        ({"rms_slope_deg": 15.0, "regional_slope_deg": 35.0}, "GRID"),
        ({"rms_slope_deg": 30.0}, "GRADED"),
    ],
    ids=["smooth", "rough", "steep and coarse", "slope", "graded"],
)
def test_no_block_floats_over_the_mesh_that_is_rendered(terrain, kind):
    built = scenes.build_scene(
        empty_scene(),
        complete(
            {"terrain": terrain, "mesh": {"kind": kind}},
            {"rocks": {"coverage": 0.05, "smallest_m": 0.1, "burial": 0.0, "tilt_deg": 25.0}},
        ),
    )
    found = instances(built)
    assert len(found) > 300
    shapes = {mesh: corners(mesh) for mesh in {m for _, m in found}}
    vertices = [shapes[mesh] @ matrix[:3, :3].T + matrix[:3, 3] for matrix, mesh in found]
    starts = np.append(0, np.cumsum([len(v) for v in vertices])[:-1])
    x, y, z = np.concatenate(vertices).T
    with probe_heights(built.terrain) as height_at:
        gap = z - height_at(x, y)  # NaN beyond the patch
    # The deepest vertex is in the ground; float32 leaves a few micrometres at 10 m from the origin.
    assert np.fmin.reduceat(gap, starts).max() < 1e-5
    # Rough ground may swallow a small block that lies in a hollow, but not the blocks.
    assert np.mean(np.fmax.reduceat(gap, starts) < 0) < 0.1


def test_heights_are_those_of_the_triangles():
    built = scenes.build_scene(
        empty_scene(), complete({"terrain": {"resolution": 17, "size_m": 8.0, "rms_slope_deg": 30.0}})
    )
    bpy.context.view_layer.update()
    ground = built.terrain.evaluated_get(bpy.context.evaluated_depsgraph_get())
    x, y = np.random.default_rng(0).uniform(-4.5, 4.5, (2, 3, 200))
    before = data_blocks()
    with probe_heights(built.terrain) as height_at:
        heights = height_at(x, y)
        assert height_at(np.zeros(0), np.zeros(0)).shape == (0,)
    assert data_blocks() == before
    outside = np.maximum(np.abs(x), np.abs(y)) > 4.0
    assert np.array_equal(np.isnan(heights), outside)
    for a, b, z in zip(x[~outside], y[~outside], heights[~outside], strict=True):
        assert ground.ray_cast((a, b, 4.0), (0.0, 0.0, -1.0))[1].z == pytest.approx(z, abs=1e-5)


def test_edits_of_blocks_are_noticed():
    def move(item):
        item.data.vertices[3].co.x += 0.01

    def turn(item):
        item.data.attributes["rotation"].data[0].vector[2] += 0.1

    def reshape(item):
        item.modifiers[0].node_group.nodes["Shapes"].inputs["Collection"].default_value.objects[0].data.vertices[
            0
        ].co.z += 0.1

    def unplug(item):
        group = item.modifiers[0].node_group
        group.links.remove(next(link for link in group.links if link.to_socket.name == "Scale"))

    for edit in (move, turn, reshape, unplug):
        built = scenes.build_scene(empty_scene(), complete(STREWN))
        assert not built.edited
        edit(carrier(built))
        assert built.edited, edit.__name__


def test_blocks_survive_saving_and_loading(tmp_path):
    built = scenes.build_scene(empty_scene(), complete(STREWN))
    mark, n = make_fingerprint(built.collection), built.rock_count
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    found = scenes.find_built(bpy.context.scene)
    assert (make_fingerprint(found.collection), found.rock_count, len(instances(found))) == (mark, n, n)


def test_blocks_are_made_of_the_ground_or_of_their_own():
    def reflectance(**rocks) -> float:
        built = scenes.build_scene(
            empty_scene(),
            complete(
                {"rocks": {**STREWN["rocks"], **rocks}}, {"surface": {"albedo": 0.9}, "rock_surface": {"albedo": 0.3}}
            ),
        )
        material = instances(built)[0][1].materials[0]
        return material.node_tree.nodes["Snow"].inputs["Base Color"].default_value[0]

    defaults = complete()
    assert reflectance(own_surface=False) == pytest.approx(base_colour(defaults.surface, 0.9))
    assert reflectance(own_surface=True) == pytest.approx(base_colour(defaults.rock_surface, 0.3))


def test_a_contradiction_is_a_sentence_and_changes_nothing():
    scene = empty_scene()
    built = scenes.build_scene(scene, complete(STREWN))
    mark, counts = make_fingerprint(built.collection), data_blocks()
    with pytest.raises(IcyMoonError, match=r"rocks\.largest_m"):
        scenes.build_scene(scene, complete({"rocks": {"coverage": 0.1, "smallest_m": 0.5, "largest_m": 0.2}}))
    assert (make_fingerprint(built.collection), data_blocks()) == (mark, counts)


def test_left_out_blocks_are_a_warning():
    built = scenes.build_scene(empty_scene(), complete({"rocks": {"coverage": 0.1, "smallest_m": 0.02, "most": 50}}))
    assert built.rock_count <= 50
    assert any("rocks.most" in warning for warning in built.warnings)


@pytest.mark.long
def test_a_hundred_thousand_blocks_are_few_objects():
    built = scenes.build_scene(
        empty_scene(), complete({"rocks": {"coverage": 0.3, "smallest_m": 0.01, "largest_m": 1.0, "most": 100_000}})
    )
    assert built.rock_count == 100_000
    assert len({o.data for o in bpy.data.objects}) < 70
    assert len(bpy.data.objects) < 80  # as single objects they would take ten times as long to build
