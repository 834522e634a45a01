"""A mesh that gets its edges back is the mesh that it was."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np
import pytest
from icymoon.nodes.datablocks.array_marks import list_mesh_marks
from icymoon.nodes.datablocks.mesh_arrays import read_property
from icymoon.nodes.ground.mesh_edges import give_edges, read_edges, take_edges, write_edges
from icymoon.nodes.ground.terrain_mesh import build_mesh_from_arrays, shade_flat
from icymoon.support.steps import finish
from pieces import count_pauses

QUADS = np.array([[0, 1, 4, 3], [1, 2, 5, 4]], np.int32)
TRIANGLES = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]], np.int32)


@pytest.fixture
def strip(request: pytest.FixtureRequest) -> Iterator[bpy.types.Object]:
    """A strip with all that a ground may have."""
    mesh = make_mesh(getattr(request, "param", QUADS))
    yield bpy.data.objects.new("Strip", mesh)
    bpy.data.meshes.remove(mesh)


def make_mesh(faces: np.ndarray) -> bpy.types.Mesh:
    positions = np.array([(x, y, 0.1 * x * y) for y in (0, 1) for x in (0, 1, 2)], np.float32)
    uv = np.random.default_rng(1).random((*faces.shape, 2), np.float32)
    mesh = build_mesh_from_arrays("Strip", positions, faces, np.array([[1, 4]]), uv)
    mesh.attributes.new("thickness", "FLOAT", "POINT").data.foreach_set("value", np.arange(6, dtype=np.float32))
    mesh.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    mesh.color_attributes.new("More Paint", "BYTE_COLOR", "CORNER")
    mesh.attributes.default_color_name = "More Paint"
    shade_flat(mesh, np.arange(len(faces)) % 2 == 1)
    return mesh


def describe(mesh: bpy.types.Mesh) -> tuple[object, ...]:
    """All that is marked, and the edges of corners, which are not."""
    corners = read_property(mesh.attributes[".corner_edge"].data, "value", np.int32)
    return list_mesh_marks(mesh), corners.tolist(), mesh.uv_layers.active.name, mesh.attributes.active_color_name


@pytest.mark.parametrize("strip", [QUADS, TRIANGLES], indirect=True)
def test_a_mesh_is_as_before(strip, tmp_path):
    mesh = strip.data
    expected, faces = describe(mesh), len(mesh.polygons)
    taken = take_edges(strip)
    assert len(mesh.edges) == 0
    assert len(mesh.polygons) == faces
    write_edges(taken, tmp_path / "edges.npz")
    finish(give_edges(mesh, read_edges(tmp_path / "edges.npz")))
    assert describe(mesh) == expected
    assert not mesh.validate(), "Blender found nothing to correct"


def test_a_piece_gives_one_array(strip):
    taken = take_edges(strip)
    assert set(taken) == {"INT32_2D .edge_verts", "INT .corner_edge", "BOOLEAN sharp_edge"}
    assert count_pauses(give_edges(strip.data, taken))[0] == 1 + len(taken)


def test_a_mesh_that_could_not_be_brought_back_stays(strip):
    strip.vertex_groups.new(name="Group").add([3], 0.5, "REPLACE")
    expected = describe(strip.data)
    assert take_edges(strip) == {}
    finish(give_edges(strip.data, {}))
    assert describe(strip.data) == expected
    assert strip.data.vertices[3].groups[0].weight == 0.5
