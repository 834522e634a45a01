"""Mesh files and what is wrong with meshes: known meshes, broken in known ways."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from icymoon.formats import mesh_file
from icymoon.physics.mesh.halve_edges import count_halvings, edge_length_m, halve_edges, vertex_normals
from icymoon.physics.mesh.heights_on_mesh import MeshGround
from icymoon.physics.mesh.mesh_faults import examine_mesh, face_normals, label_components, repair_mesh
from icymoon.support.errors import IcyMoonError
from sheets import sheet

CUBE = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
#: Outward triangles: bottom, top, front, back, left, right.
BOX = np.array(
    [
        (0, 2, 3),
        (0, 3, 1),
        (4, 5, 7),
        (4, 7, 6),
        (0, 1, 5),
        (0, 5, 4),
        (2, 6, 7),
        (2, 7, 3),
        (0, 4, 6),
        (0, 6, 2),
        (1, 3, 7),
        (1, 7, 5),
    ]
)


def test_components_are_those_of_a_plain_search():
    random = np.random.default_rng(0)
    for n, links in ((1, 0), (10, 4), (50, 30), (400, 350), (300, 2000)):
        a, b = random.integers(0, n, (2, links))
        label = list(range(n))
        for _ in range(n):
            for i, j in zip(a, b, strict=True):
                label[i] = label[j] = min(label[i], label[j])
        assert label_components(n, a, b).tolist() == label, n


def test_a_cube_is_in_order():
    report = examine_mesh(CUBE, BOX)
    assert (report.vertices, report.triangles, report.parts) == (8, 12, 1)
    assert report.boundary_edges == report.boundary_loops == 0
    assert report.non_manifold_edges == report.inconsistent_edges == report.duplicate_vertices == 0
    assert report.area_m2 == pytest.approx(6.0)
    assert report.extents_m == (1.0, 1.0, 1.0)
    assert report.facing_down == pytest.approx(1 / 6)
    assert len(report.lines()) == 2  # the size, and that a sixth faces down


def test_an_open_box_has_one_rim_and_two_holes_make_two_more():
    report = examine_mesh(CUBE, BOX[2:])
    assert (report.boundary_edges, report.boundary_loops) == (4, 1)
    positions, faces = sheet(9)
    k = [8 * 2 + 2, 8 * 5 + 5]
    holed = np.delete(faces, [*k, *(np.array(k) + 64)], axis=0)
    report = examine_mesh(positions, holed)
    assert report.boundary_loops == 3
    assert "2 holes beside the outer rim" in " ".join(report.lines())


def test_three_faces_on_an_edge_are_not_a_manifold():
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)], float)
    report = examine_mesh(positions, np.array([(0, 1, 2), (1, 0, 3), (0, 1, 4)]))
    assert report.non_manifold_edges == 1


def test_flipped_faces_are_counted_and_turned_back():
    positions, faces = sheet()
    flipped = faces.copy()
    flipped[[7, 20, 21, 40]] = flipped[[7, 20, 21, 40], ::-1]
    report = examine_mesh(positions, flipped)
    assert report.inconsistent_edges > 0
    assert report.facing_down > 0.05
    for broken in (flipped, flipped[:, ::-1], faces[:, ::-1]):
        positions_after, mended, _ = repair_mesh(positions, broken)
        assert (face_normals(positions_after, mended)[:, 2] > 0).all()
        assert examine_mesh(positions_after, mended).inconsistent_edges == 0


def test_a_closed_part_is_turned_outward_wherever_it_lies():
    positions, faces = sheet()
    both = np.concatenate([positions, CUBE + np.array([2, 2, 50])])
    inside_out = np.concatenate([faces, BOX[:, ::-1] + len(positions)])
    after, mended, _ = repair_mesh(both, inside_out)
    assert examine_mesh(after, mended).parts == 2
    normals = face_normals(after, mended)
    boulder = after[mended].mean(axis=1)[:, 2] > 10
    away = after[mended].mean(axis=1)[boulder] - (2.5, 2.5, 50.5)
    assert ((away * normals[boulder]).sum(axis=1) > 0).all()
    assert (normals[~boulder][:, 2] > 0).all()


def test_a_moebius_strip_is_left_as_it_is():
    n = 12
    turn, half = np.linspace(0, 2 * np.pi, n, endpoint=False), np.linspace(0, np.pi, n, endpoint=False)
    rim = [
        np.stack([(2 + w * np.cos(half)) * np.cos(turn), (2 + w * np.cos(half)) * np.sin(turn), w * np.sin(half)], 1)
        for w in (-0.5, 0.5)
    ]
    positions = np.concatenate(rim)
    faces = []
    for k in range(n):
        a, b, c, d = k, n + k, (k + 1) % n, n + (k + 1) % n
        if k == n - 1:
            c, d = d, c
        faces += [(a, b, d), (a, d, c)]
    report = examine_mesh(positions, np.array(faces))
    assert report.boundary_loops == 1
    assert report.inconsistent_edges == 1
    _, mended, _ = repair_mesh(positions, np.array(faces))
    assert len(mended) == 2 * n


def test_what_cannot_be_rendered_goes_and_the_rest_stays():
    positions, faces = sheet()
    positions = np.concatenate([positions, positions[:6], [(np.nan, 0, 0), (9, 9, np.inf), (7, 7, 7)]])
    faces = np.concatenate([faces, [(0, 1, 42), (1, 2, 43)], [(3, 3, 4), (0, 36, 1)], faces[:3][:, [1, 2, 0]]])
    faces[faces == 2] = 38
    report = examine_mesh(positions, faces)
    assert report.non_finite_vertices == 2
    assert report.degenerate_faces == 2
    assert report.duplicate_vertices == 6
    assert report.duplicate_faces == 3
    after, mended, _ = repair_mesh(positions, faces)
    assert (len(after), len(mended)) == (36, 50)
    again = examine_mesh(after, mended)
    assert again.area_m2 == pytest.approx(examine_mesh(*sheet()).area_m2)
    assert len(again.lines()) == 1


def test_nothing_left_is_a_report_too():
    one = np.array([(0, 1, 2)])
    for positions, faces in (
        (np.full((3, 3), np.nan), one),
        (np.zeros((3, 3)), one),
        (np.empty((0, 3)), np.empty((0, 3), int)),
    ):
        report = examine_mesh(positions, faces)
        assert report.area_m2 == 0.0
        assert len(repair_mesh(positions, faces)[1]) == 0


def test_the_axis_that_the_ground_faces_is_named():
    positions, faces = sheet()
    assert examine_mesh(positions, faces).up == "Z"
    assert examine_mesh(positions[:, [0, 2, 1]], faces).up == "Y"
    assert examine_mesh(positions[:, [2, 0, 1]], faces).up == "X"


def test_costs_come_from_the_header_or_the_size(tmp_path):
    ply = tmp_path / "a.ply"
    ply.write_bytes(b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nelement face 12345678\nend_header\n")
    cost = mesh_file.estimate_cost(ply)
    assert (cost.triangles, cost.exact, cost.is_high) == (12345678, True, True)
    assert "12 million triangles" in cost.sentence(ply)
    stl = tmp_path / "a.stl"
    stl.write_bytes(b"x" * 80 + struct.pack("<I", 2) + bytes(100))
    assert mesh_file.estimate_cost(stl).triangles == 2
    document = {
        "accessors": [{"count": 30}],
        "meshes": [{"primitives": [{"indices": 0}]}],
        "buffers": [{"uri": "a%20b.bin"}],
    }
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    assert mesh_file.estimate_cost(tmp_path / "a.gltf").triangles == 10
    assert mesh_file.find_geometry_files(tmp_path / "a.gltf") == [tmp_path / "a.gltf", tmp_path / "a b.bin"]
    (tmp_path / "a.obj").write_text("v 0 0 0\n" * 1000)
    assert not mesh_file.estimate_cost(tmp_path / "a.obj").exact


@pytest.mark.parametrize("suffix", sorted(mesh_file.FORMATS))
def test_files_that_are_not_what_they_say_are_sentences(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    with pytest.raises(IcyMoonError, match="cannot be read"):
        mesh_file.estimate_cost(path)
    path.write_bytes(b"")
    with pytest.raises(IcyMoonError, match="is empty"):
        mesh_file.estimate_cost(path)
    path.write_bytes(b"\xff\xd8\xff\xe0 a picture")
    with pytest.raises(IcyMoonError, match="although its name ends so"):
        mesh_file.estimate_cost(path)
    with pytest.raises(IcyMoonError, match="not a mesh"):
        mesh_file.detect_kind(path.with_suffix(".jpg"))


@pytest.mark.parametrize("text", ["{", "{]", '{"meshes": [{"primitives": [{"indices": 7}]}]}', '{"meshes": 3}'])
def test_a_malformed_gltf_is_a_sentence(tmp_path, text):
    path = tmp_path / "a.gltf"
    path.write_text(text)
    with pytest.raises(IcyMoonError, match=r"a\.gltf: is not a whole"):
        mesh_file.estimate_cost(path)
    path.write_text('{"buffers": 3}')
    with pytest.raises(IcyMoonError, match=r"a\.gltf: is not a whole"):
        mesh_file.find_geometry_files(path)


def test_a_gltf_that_is_nested_without_end_is_a_sentence(tmp_path):
    path = tmp_path / "a.gltf"
    path.write_text('{"a":' + "[" * 100000)
    with pytest.raises(IcyMoonError, match=r"a\.gltf: is not a whole"):
        mesh_file.find_geometry_files(path)


def test_the_height_of_a_mesh_is_that_of_its_highest_triangle():
    positions, faces = sheet()
    plane = np.column_stack([positions[:, :2], 0.3 * positions[:, 0] - 0.2 * positions[:, 1]])
    x, y = np.random.default_rng(0).uniform(0, 5, (2, 50))
    ground = MeshGround(plane, faces)
    assert np.allclose(ground.heights(x, y), 0.3 * x - 0.2 * y, atol=1e-12)
    corners = ground.heights(positions[:, 0], positions[:, 1])  # on vertices and edges too
    assert np.allclose(corners, plane[:, 2], atol=1e-12)
    assert np.isnan(ground.heights(np.array([-0.1, 2.0]), np.array([2.0, 5.1]))).all()
    assert ground.size_m == 10.0
    roofed = MeshGround(np.concatenate([plane, CUBE + np.array([2, 2, 7])]), np.concatenate([faces, BOX + len(plane)]))
    assert roofed.heights(2.5, 2.5) == pytest.approx(8.0)


def test_halving_keeps_the_shape_and_halves_the_edges():
    positions, faces = sheet()
    fine, cut = halve_edges(positions, faces)
    before, after = examine_mesh(positions, faces), examine_mesh(fine, cut)
    assert (after.triangles, after.inconsistent_edges, after.boundary_loops) == (4 * before.triangles, 0, 1)
    assert after.duplicate_vertices == 0
    assert after.area_m2 == pytest.approx(before.area_m2)
    assert edge_length_m(fine, cut) == pytest.approx(edge_length_m(positions, faces) / 2)
    assert np.allclose(np.linalg.norm(vertex_normals(fine, cut), axis=1), 1.0)
    assert (vertex_normals(fine, cut)[:, 2] > 0.9).all()


def test_how_often_to_halve():
    assert count_halvings(1.0, 0.1, 1000, 10**9) == 4
    assert count_halvings(1.0, 0.25, 1000, 10**9) == 2
    assert count_halvings(0.1, 1.0, 1000, 10**9) == 0
    assert count_halvings(1.0, 0.01, 1000, 70_000) == 3


def test_fine_triangles_of_a_wide_ground_stay():
    """A site of 1 cm triangles with ground out to a horizon at 60 km: 1 / 10^14 of the area of it all is 1 cm²."""
    positions, faces = sheet()
    fine = (positions - positions.mean(axis=0)) * 0.01
    far = np.array([(-6e4, -6e4, -9), (6e4, -6e4, -9), (0, 6e4, -9)])
    together = np.concatenate([fine, far]), np.concatenate([faces, [np.arange(3) + len(fine)]])
    assert examine_mesh(*together).degenerate_faces == 0
    assert len(repair_mesh(*together)[1]) == len(faces) + 1
