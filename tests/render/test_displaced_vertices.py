"""What places on facets show of the shifts of their corners."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from icymoon.nodes.tree.builder import Tree
from icymoon.physics.light import baked_texels
from icymoon.render.displaced_vertices import is_moved, open_rendered_mesh, solve_corner_shifts
from icymoon.support.blender import compat
from rendering import empty_scene


def on_facets(corners, across):
    """The weights (n, k, k) of the corners of facets at their texels."""
    sides = corners.shape[1]
    if sides == 3:
        return np.broadcast_to(baked_texels._LINEAR_WEIGHTS, (len(corners), 3, 3))
    weights = np.zeros((len(corners), 4, 4))
    for k, of in enumerate(
        ((0, 1, 3), (0, 1, 3), (1, 2, 3), (1, 2, 3)) if across else ((0, 1, 2), (0, 1, 2), (0, 2, 3), (0, 2, 3))
    ):
        shares = np.full(3, 0.15)
        shares[of.index(k)] = 0.7
        weights[:, k, of] = shares
    return weights


@pytest.mark.parametrize(("sides", "across"), [(3, False), (4, False), (4, True)])
def test_shifts_of_corners_follow_from_places_within(sides, across):
    random = np.random.default_rng(sides)
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])[:sides]
    corners = 5.0 + square + 0.1 * random.uniform(-1, 1, (200, sides, 3))
    shifts = random.normal(size=corners.shape)
    weights = on_facets(corners, across)
    found, sure = solve_corner_shifts(corners, weights @ corners, weights @ shifts, np.full(200, across))
    assert sure.all()
    assert found == pytest.approx(shifts, abs=1e-9)


def test_a_facet_without_area_is_not_sure():
    corners = np.zeros((1, 3, 3))
    corners[0, :, 0] = [0.0, 1.0, 2.0]
    shift = np.ones((1, 3, 3))
    found, sure = solve_corner_shifts(corners, corners, shift, np.zeros(1, bool))
    assert not sure.any()
    assert found == pytest.approx(shift)


def moving(name, height_m):
    """A material that moves the surface outward by a height times its x in the world."""
    material = bpy.data.materials.new(name)
    material.displacement_method = "DISPLACEMENT"
    tree = Tree(compat.ensure_nodes(material))
    place = tree.node(
        "ShaderNodeSeparateXYZ", "Place", {"Vector": tree.node("ShaderNodeNewGeometry", "Geometry").outputs["Position"]}
    )
    height = tree.math("MULTIPLY", "Height", place.outputs["X"], height_m)
    moved = tree.node(
        "ShaderNodeDisplacement",
        "Moved",
        {"Height": height, "Midlevel": 0.0, "Scale": 1.0, "Normal": None},
        space="OBJECT",
    ).outputs[0]
    tree.surface(None, Displacement=moved)
    return material


@pytest.mark.parametrize("quads", [True, False])
def test_vertices_move_as_the_material_tells_in_the_world(quads):
    """A plane at x from 9 to 11 that lies on its side and is twice as large: its own z is the world's -y."""
    empty_scene()
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=5, y_subdivisions=7, size=1.0)
    mesh = bpy.context.object.data
    if not quads:
        bpy.ops.object.modifier_add(type="TRIANGULATE")
        bpy.ops.object.modifier_apply(modifier=bpy.context.object.modifiers[0].name)
    mesh.shade_smooth()
    mesh.materials.append(moving("Test", 0.01))
    place = np.array([[2.0, 0, 0, 10], [0, 0, -2.0, 0], [0, 2.0, 0, 0], [0, 0, 0, 1]])
    before = np.array([vertex.co for vertex in mesh.vertices])
    assert is_moved(mesh)
    with open_rendered_mesh(mesh, place) as moved:
        found = np.array([vertex.co for vertex in moved.vertices])
    world = before @ place[:3, :3].T + place[:3, 3]
    wanted = before + np.array([0.0, 0.0, 0.01]) * world[:, :1]
    # Single precision of 10 m, over the factor of 2.
    assert found == pytest.approx(wanted, abs=1e-6)
    assert [len(mesh.uv_layers), mesh.materials[0].displacement_method] == [1, "DISPLACEMENT"]
    assert len(bpy.data.scenes) == len(bpy.data.meshes) == 1
    assert not bpy.data.images


def test_faces_at_a_sharp_edge_move_apart():
    """The top of a cube with sharp edges moves straight up, and its sides, of one normal at each corner, slantwise."""
    empty_scene()
    bpy.ops.mesh.primitive_cube_add()
    mesh = bpy.context.object.data
    mesh.shade_smooth()
    mark = mesh.attributes.new("sharp_edge", "BOOLEAN", "EDGE")
    mark.data.foreach_set("value", [all(mesh.vertices[end].co.z > 0 for end in edge.vertices) for edge in mesh.edges])
    mesh.materials.append(moving("Test", 0.05))
    place = np.eye(4)
    place[0, 3] = 10.0
    with open_rendered_mesh(mesh, place) as moved:
        found = np.array([vertex.co for vertex in moved.vertices])
    top = found[found[:, 2] > 1.2]
    x, y = top[:, :2].T
    assert top == pytest.approx(np.stack([np.sign(x), np.sign(y), 1.0 + 0.05 * (10.0 + np.sign(x))], axis=1), abs=1e-5)
    sides = found[np.abs(found[:, 2] - 1.0) < 0.1]
    assert len(top) == len(sides) == 4
    assert np.sort(np.abs(sides[:, 0])) == pytest.approx(1 + np.repeat([0.45, 0.55], 2) / np.sqrt(2), abs=1e-5)


def test_a_surface_that_is_shaded_only_is_not_moved():
    empty_scene()
    bpy.ops.mesh.primitive_plane_add()
    mesh = bpy.context.object.data
    assert not is_moved(mesh)
    mesh.materials.append(moving("Test", 0.1))
    mesh.materials[0].displacement_method = "BUMP"
    assert not is_moved(mesh)
