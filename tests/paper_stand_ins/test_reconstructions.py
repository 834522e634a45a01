"""The stand-in meshes: irregular triangles over a ground, manifold, with the stated size, triangles and holes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.paper_stand_ins.periodic_fields import FieldGenerator
from icymoon.paper_stand_ins.reconstructions import reconstruct
from icymoon.paper_stand_ins.shown_items import MESH_IMAGE_SIDE_PX
from icymoon.paper_stand_ins.triangulation import triangulate
from icymoon.physics.mesh.mesh_faults import examine_mesh
from icymoon.physics.random_numbers.seeds import make_generator
from icymoon.settings.topics.stand_ins import MESHES, find_mesh_item
from marks import heavy_but


def test_there_are_the_papers_eleven():
    assert [item.number for item in MESHES] == list(range(1, 12))
    assert sum(len(item.sites) for item in MESHES[:7]) == 17
    assert [item.holes > 0 for item in MESHES] == [True] * 7 + [False] * 3 + [True]  # terrain of a program has no holes


KEYS = [item.key for item in MESHES]


@pytest.mark.long
@pytest.mark.parametrize("key", heavy_but(["ATHABASCA"], KEYS, set(KEYS) - {"ATHABASCA", "GAEA_RIDGY"}))
def test_a_mesh_is_as_stated(key):
    item, mesh = find_mesh_item(key), reconstruct(key)
    found = examine_mesh(mesh.positions.astype(float), mesh.faces)
    assert (found.parts, found.non_manifold_edges, found.inconsistent_edges) == (1, 0, 0)
    assert (found.degenerate_faces, found.duplicate_faces, found.non_finite_vertices) == (0, 0, 0)
    assert found.boundary_loops == item.holes + 1  # the rims of the holes, and the outer one
    assert found.facing_down == 0.0
    # No corner is shared by two fans: as many rim vertices as rim edges.
    begin, end = mesh.faces.ravel(), mesh.faces[:, [1, 2, 0]].ravel()
    key_of = np.minimum(begin, end).astype(np.int64) * len(mesh.positions) + np.maximum(begin, end)
    _, first, count = np.unique(key_of, return_index=True, return_counts=True)
    assert len(np.unique(begin[first[count == 1]])) == (count == 1).sum() == found.boundary_edges
    # The rim takes up to a quarter of a square of so many triangles.
    assert 0.7 * item.triangles < found.triangles <= 1.01 * item.triangles
    assert 0.88 * item.size_m < min(found.extents_m[:2]) <= max(found.extents_m[:2]) < 1.02 * item.size_m
    assert found.vertices == len(mesh.uv)
    assert mesh.image.shape == (MESH_IMAGE_SIDE_PX, MESH_IMAGE_SIDE_PX, 3)
    assert 0.0 <= mesh.image.min() <= mesh.image.max() <= 1.0
    assert mesh.image[..., 1].mean() == pytest.approx(0.5, abs=0.03)
    _check_uv(item, mesh)
    _check_sites(item, mesh)


def _check_uv(item, mesh):
    """The image is seen from above: coordinates are places, but for the warps of a few permille and the shift to the
    middle."""
    assert 0.0 <= mesh.uv.min() <= mesh.uv.max() <= 1.0
    apart = mesh.positions[:, :2] / item.size_m - mesh.uv
    assert np.abs(apart - np.median(apart, axis=0)).max() < 0.02


def _check_sites(item, mesh):
    """There is ground around every site, in an arm's length."""
    for site in item.sites:
        assert np.hypot(*(mesh.positions[:, :2] - site).T).min() < 0.05 * item.size_m


def test_triangles_are_irregular_and_dense_where_the_ground_is_rough():
    random = make_generator(0, "stand_ins", 8)
    rough = FieldGenerator(random, 256).waves(3.2, 1 / 60, 1 / 4) * 6.0
    rough[:, :128] = 0.0  # half is flat
    heights = np.pad(rough, ((0, 1), (0, 1)), mode="wrap")
    places, faces = triangulate(random, heights, 6000, 0.02)
    assert 5400 < len(faces) <= 6000
    a, b, c = (places[faces[:, k]] for k in range(3))
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    assert twice.min() > 0.0  # none is turned over
    assert twice.sum() / 2 == pytest.approx(256.0**2)  # and they cover the square once
    middle = places[faces].mean(axis=1)[:, 0]
    assert (middle > 128).sum() > 3 * (middle < 128).sum()
    # Edges point everywhere: no direction of the squares they were cut from stands out.
    edge = np.concatenate([b - a, c - b, a - c])
    inside = ((places > 1) & (places < 255)).all(axis=1)[faces].all(axis=1)
    edge = edge[np.tile(inside, 3)]
    counts, _ = np.histogram(np.arctan2(edge[:, 1], edge[:, 0]) % math.pi, 12)
    assert counts.max() < 1.5 * counts.mean()


def test_flips_leave_no_better_edge():
    """Delaunay: no vertex lies within the circle of a triangle beside it (checked for all, by the angles opposite)."""
    random = make_generator(0, "stand_ins", 7)
    heights = np.pad(FieldGenerator(random, 64).waves(3.0, 1 / 20, 1 / 2) * 4, ((0, 1), (0, 1)), mode="wrap")
    places, faces = triangulate(random, heights, 1200, 0.05)
    angle = {}
    for k in range(3):
        a, b, c = (places[faces[:, (k + j) % 3]] for j in range(3))
        u, v = a - c, b - c
        opposite = np.arctan2(np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]), (u * v).sum(axis=1))
        for face, value in zip(faces, opposite, strict=True):
            angle.setdefault(frozenset((int(face[k]), int(face[(k + 1) % 3]))), []).append(value)
    pairs = [sum(values) for values in angle.values() if len(values) == 2]
    assert max(pairs) < math.pi + 1e-6
    assert max(map(len, angle.values())) == 2
