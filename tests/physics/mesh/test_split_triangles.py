"""Triangles cut into equal parts: area and orientation stay, and no edge is open but the mesh's own."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.mesh.split_triangles import split_triangles
from icymoon.physics.mesh.vertex_rings import VertexRings

RINGS = VertexRings.of(np.arange(1.0, 9.0), np.full(8, 1.0))


def places():
    return np.stack(RINGS.map_positions(), axis=1)


def doubled_areas(at, faces):
    a, b, c = at[faces].transpose(1, 2, 0)
    return (b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]


def edges(faces):
    ends = np.sort(np.stack([faces, faces[:, [1, 2, 0]]], axis=2).reshape(-1, 2), axis=1)
    return np.unique(ends, axis=0, return_counts=True)


@pytest.mark.parametrize("parts", [2, 3, 5])
def test_the_cut_mesh_covers_the_same_ground_once(parts):
    at, faces = places(), RINGS.faces()
    which = at[faces].mean(axis=1)[:, 0] > 1.0
    split = split_triangles(faces, which, len(at), parts)
    now = split.spread(at)
    assert doubled_areas(now, split.faces).min() > 0
    assert doubled_areas(now, split.faces).sum() == pytest.approx(doubled_areas(at, faces).sum(), rel=1e-12)
    assert len(split.faces) == np.sum(~which) + parts**2 * np.sum(which)
    np.testing.assert_allclose(doubled_areas(now, split.faces[split.cut]).sum(), doubled_areas(at, faces[which]).sum())
    np.testing.assert_array_equal(split.faces[~split.cut], faces[~which])
    assert len(np.unique(now.round(9), axis=0)) == len(now)  # no vertex is there twice


def test_inside_what_is_cut_each_edge_has_two_triangles():
    at, faces = places(), RINGS.faces()
    split = split_triangles(faces, np.ones(len(faces), bool), len(at), 3)
    ends, uses = edges(split.faces)
    outer = np.hypot(*split.spread(at)[ends].mean(axis=1).T) > 7.5
    assert set(uses[~outer]) == {2}
    assert not split.bordering[:1].any()


def test_vertices_on_the_border_are_on_edges_of_whole_triangles():
    at, faces = places(), RINGS.faces()
    which = np.hypot(*at[faces].mean(axis=1).T) < 4.2
    split = split_triangles(faces, which, len(at), 3)
    now, added = split.spread(at), np.arange(len(split.bordering)) >= len(at)
    border = np.flatnonzero(split.bordering & added)
    ends, _ = edges(faces[~which])
    begin, end = now[ends[:, 0]], now[ends[:, 1]]
    for point in now[border]:
        off = np.abs((end - begin)[:, 0] * (point - begin)[:, 1] - (end - begin)[:, 1] * (point - begin)[:, 0])
        inside = np.linalg.norm(point - (begin + end) / 2, axis=1) < np.linalg.norm(end - begin, axis=1) / 2
        assert off[inside].min() < 1e-9
    np.testing.assert_array_equal(np.flatnonzero(split.bordering & ~added), np.unique(faces[~which]))


def test_nothing_chosen_changes_nothing():
    faces = RINGS.faces()
    split = split_triangles(faces, np.zeros(len(faces), bool), RINGS.vertices, 3)
    np.testing.assert_array_equal(split.faces, faces)
    assert len(split.parents) == 0
    assert not split.cut.any()
