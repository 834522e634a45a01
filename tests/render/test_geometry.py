"""Geometry written for other renderers is what Cycles sees."""

from __future__ import annotations

import json

import bpy
import numpy as np
import pytest
from icymoon.formats.ply import read_properties
from icymoon.nodes.build_scene import build_scene
from icymoon.render.geometry_worker import read_mesh_triangles, run_job, write_geometry
from icymoon.render.render_pair import open_render_scene
from icymoon.support.errors import IcyMoonError
from rendering import SMALL, complete, empty_scene


def read_mesh(path):
    """Positions, normals and triangles of a file that ``write_triangles`` wrote."""
    table = read_properties(path, "x", "y", "z", "nx", "ny", "nz")
    data = path.read_bytes()
    count = int(data.split(b"element face ")[1].split(b"\n")[0])
    faces = np.frombuffer(data[-13 * count :], np.dtype([("n", "u1"), ("v", "<i4", 3)]))["v"]
    return table[:, :3], table[:, 3:], faces


def test_ground_and_rocks_are_written_in_the_world(tmp_path):
    sent = []
    run_job(
        {
            "settings": {
                **SMALL,
                "terrain": {"resolution": 33, "size_m": 8.0, "rms_slope_deg": 5.0},
                "rocks": {"coverage": 0.1},
                "surface": {"grain_amplitude_m": 0.01},
            }
        },
        tmp_path,
        lambda kind, **facts: sent.append((kind, facts)),
    )
    assert sent[-1][0] == "done"
    (folder,) = tmp_path.iterdir()
    facts = json.loads((folder / "geometry.json").read_text(encoding="utf-8"))
    assert set(facts["meshes"]) == {"terrain", "rock"}
    assert "grain_amplitude_m" in facts["left_out"][0]
    ground, normals, faces = read_mesh(folder / "terrain.ply")
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-5)
    assert (normals[:, 2] > 0.5).all()
    corners = ground[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert area[:, 2].sum() / 2 == pytest.approx(64.0, rel=1e-4)  # upward, and over the whole patch
    rocks, outward, faces = read_mesh(folder / "rock.ply")
    corners = rocks[faces]
    facing = np.einsum(
        "ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), outward[faces].mean(axis=1)
    )
    assert (facing > 0).mean() > 0.99
    assert np.abs(rocks[:, :2]).max() < 6.0
    assert rocks[:, 2].max() > ground[:, 2].min()


def test_rocks_that_are_hidden_in_renders_are_not_written(tmp_path):
    settings = complete({"terrain": {"resolution": 33, "size_m": 8.0}, "rocks": {"coverage": 0.1}})
    built = build_scene(empty_scene(), settings)
    built.rocks.hide_render = True
    with open_render_scene(built, 1) as scene:
        facts = write_geometry(built, scene, tmp_path)
    assert set(facts["meshes"]) == {"terrain"}


def test_flat_faces_keep_their_normals_and_smooth_ones_share_vertices():
    empty_scene()
    bpy.ops.mesh.primitive_cube_add()
    mesh = bpy.context.object.data
    vertices, normals, triangles = read_mesh_triangles(mesh)
    assert (len(vertices), len(triangles)) == (36, 12)
    assert np.sort(np.abs(normals), axis=1) == pytest.approx(np.tile([0.0, 0.0, 1.0], (36, 1)))
    mesh.shade_smooth()
    vertices, normals, triangles = read_mesh_triangles(mesh)
    assert (len(vertices), len(triangles)) == (8, 12)
    assert normals == pytest.approx(vertices / np.sqrt(3.0), abs=1e-5)


def test_a_blend_file_is_refused(tmp_path):
    with pytest.raises(IcyMoonError, match="settings or pairs"):
        run_job({"blend": "a.blend"}, tmp_path, lambda *a, **k: None)
