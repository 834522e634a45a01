"""The hole for a patch: one loop round it, also across a seam between coarse and fine triangles."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.mesh.hole_for_trench import cut_hole


def grid(x, y):
    """Vertices (n, 3) and triangles (m, 3) of a level grid."""
    positions = np.array([(a, b, 0.0) for b in y for a in x])
    first = (np.arange(len(y) - 1)[:, None] * len(x) + np.arange(len(x) - 1)).ravel()
    corners = np.stack([first, first + 1, first + len(x) + 1, first + len(x)], axis=1)
    return positions, np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])


def with_seam():
    """A coarse grid north of y = 0, and one three times as fine south of it; each third vertex is of both."""
    coarse = grid(np.linspace(-3, 3, 7), np.linspace(0, 3, 4))
    fine = grid(np.linspace(-3, 3, 19), np.linspace(-3, 0, 10))
    positions = np.concatenate([coarse[0], fine[0]])
    faces = np.concatenate([coarse[1], fine[1] + len(coarse[0])])
    _, first, number = np.unique(positions.round(9), axis=0, return_index=True, return_inverse=True)
    return positions[first], number.reshape(-1)[faces]


def area_of(positions, faces):
    a, b, c = (positions[faces[:, k], :2] for k in range(3))
    ahead = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    return float(ahead.sum() / 2)


def enclosed(positions, loop):
    x, y = positions[loop, 0], positions[loop, 1]
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


def test_a_hole_across_a_seam_has_one_loop_that_encloses_what_went():
    positions, faces = with_seam()
    for west in np.linspace(-1.4, -0.2, 7):
        found = cut_hole(positions, faces, (west, -0.8, west + 1.3, 0.7), 0.01)
        assert found is not None
        kept, loop = found
        assert len(np.unique(loop)) == len(loop)
        assert np.isclose(enclosed(positions, loop), area_of(positions, faces[~kept]), rtol=1e-12)
        assert positions[loop, 0].min() <= west - 0.01
        assert positions[loop, 0].max() >= west + 1.31


@pytest.mark.parametrize("mirror", [False, True])
def test_the_hole_closes_wherever_its_ends_are_between_the_fine_vertices(mirror):
    """The middle one of three small triangles along a side may have no corner that a larger one has."""
    positions, faces = with_seam()
    if mirror:
        positions, faces = positions * (-1, 1, 1), faces[:, ::-1]
    for west in np.linspace(-1.9, -0.9, 11):
        for width in np.linspace(0.3, 1.9, 9):
            for south, north in ((-0.8, 0.7), (0.1, 0.7), (-0.8, -0.05), (-0.3, 0.05)):
                found = cut_hole(positions, faces, (west, south, west + width, north), 0.01)
                assert found is not None, (west, width, south)
                kept, loop = found
                assert np.isclose(enclosed(positions, loop), area_of(positions, faces[~kept]), rtol=1e-12)


def test_a_hole_that_meets_the_edge_of_the_mesh_is_none():
    positions, faces = with_seam()
    assert cut_hole(positions, faces, (2.0, -0.5, 2.999, 0.5), 0.01) is None
    assert cut_hole(positions, faces, (10.0, 10.0, 11.0, 11.0), 0.01) is None
