"""Meshes in many places are read back by foreign readers where they stand."""

from __future__ import annotations

import json

import numpy as np
import pytest
from icymoon.formats import placed_meshes
from icymoon.formats.placed_meshes import PlacedMesh, write_gltf, write_obj, write_ply, write_usd
from icymoon.support.errors import IcyMoonError
from mesh_rays import read_mesh

#: A tetrahedron that no turn maps to itself, and its outward triangles.
VERTICES = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], np.float32)
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
NORMALS = (VERTICES - VERTICES.mean(axis=0)) / np.linalg.norm(VERTICES - VERTICES.mean(axis=0), axis=1)[:, None]
WRITERS = {"ply": write_ply, "obj": write_obj, "usd": write_usd, "glb": write_gltf}


def matrix(turn, scale, place):
    """A matrix that scales, turns about (1, 2, 3) and moves."""
    axis = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    cross = np.cross(np.eye(3), axis)
    found = np.eye(4)
    found[:3, :3] = (np.eye(3) + np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross) * scale
    found[:3, 3] = place
    return found


@pytest.fixture
def meshes():
    """Ground in one place, and a rock in three, one of them mirrored."""
    return [
        PlacedMesh("terrain", VERTICES * 10, NORMALS, TRIANGLES, np.eye(4)[None]),
        PlacedMesh(
            "rock",
            VERTICES,
            NORMALS,
            TRIANGLES,
            np.array(
                [
                    matrix(0.3, (1, 1, 1), (5, 6, 7)),
                    matrix(2.0, (0.5, 2, 1), (-5, 6, 1 / 3)),
                    matrix(-1.0, (-1, 1, 1), (0, 0, -7)),
                ]
            ),
        ),
    ]


def volumes(places, triangles):
    """Volumes within the tetrahedra, which are below 0 where triangles face inward."""
    corners = places[triangles]
    return np.linalg.det(corners).reshape(-1, 4).sum(axis=1) / 6


@pytest.mark.parametrize("suffix", WRITERS)
def test_triangles_are_where_the_meshes_stand_and_face_outward(suffix, meshes, tmp_path):
    path = tmp_path / f"ground.{suffix}"
    WRITERS[suffix](path, meshes, "a frame, in metres")
    places, triangles = read_mesh(path)
    wanted = np.sort(
        np.concatenate([mesh.vertices @ at[:3, :3].T + at[:3, 3] for mesh in meshes for at in mesh.places]), axis=0
    )
    assert np.sort(places, axis=0) == pytest.approx(wanted, abs=2e-6)
    if suffix in ("ply", "obj"):  # instances of the others are turned by their readers
        assert volumes(places, triangles) == pytest.approx([1000.0, 1.0, 1.0, 1.0], rel=1e-5)


def test_normals_lean_with_the_scale():
    """On what is stretched twofold along y, a normal in the diagonal leans to x by half."""
    lean = PlacedMesh(
        "rock", VERTICES, np.full((4, 3), [1.0, 1.0, 0.0]) / np.sqrt(2), TRIANGLES, np.diag([1.0, 2.0, 1.0, 1.0])[None]
    )
    _, normals, _ = next(lean.transform_to_instances())
    assert normals == pytest.approx(np.tile([2.0, 1.0, 0.0], (4, 1)) / np.sqrt(5))


def test_a_mesh_is_in_usd_and_gltf_once(meshes, tmp_path):
    write_usd(tmp_path / "a.usd", meshes, 'a "frame"')
    text = (tmp_path / "a.usd").read_text(encoding="utf-8")
    assert (text.count("def Mesh"), text.count("instanceable = true")) == (2, 3)
    assert r"a \"frame\"" in text
    write_gltf(tmp_path / "a.glb", meshes, "a frame")
    data = (tmp_path / "a.glb").read_bytes()
    described = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert len(described["meshes"]) == 2
    assert [node.get("mesh") for node in described["nodes"]] == [None, None, 0, None, 1, 1, 1]
    assert int.from_bytes(data[8:12], "little") == len(data)
    assert len(data) % 4 == 0


@pytest.mark.parametrize("suffix", WRITERS)
def test_numbers_are_exact_to_single_precision(suffix, tmp_path):
    vertices = np.array([[1 / 3, -1e-7, 12345.678], [1e4 / 7, 3e-5, -2 / 3], [0.1, 0.2, 0.3]], np.float32)
    one = PlacedMesh("terrain", vertices, np.tile([0.0, 0.0, 1.0], (3, 1)), np.array([[0, 1, 2]]), np.eye(4)[None])
    WRITERS[suffix](tmp_path / f"a.{suffix}", [one], "frame")
    np.testing.assert_array_equal(read_mesh(tmp_path / f"a.{suffix}")[0].astype(np.float32), vertices)


def test_more_than_gltf_holds_is_refused(meshes, tmp_path, monkeypatch):
    monkeypatch.setattr(placed_meshes, "_MAX_GLTF_BYTES", 1000)
    with pytest.raises(IcyMoonError, match="export usd"):
        write_gltf(tmp_path / "a.glb", meshes, "")
    assert not list(tmp_path.iterdir())
