"""How images of two renderers are compared, by images that are known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from icymoon.formats.ply import read_triangles, write_triangles
from icymoon.support.errors import IcyMoonError
from icymoon.validation.ball import make_ball_mesh
from icymoon.validation.second_renderer import (
    SCENES,
    _compare_regions,
    average_regions,
    draw_twins,
    measure_edge_shift_px,
    write_facets,
)


def test_the_largest_difference_is_found_where_it_is():
    theirs = np.full((120, 160), 2.0)
    ours = theirs.copy()
    ours[15:30, 140:160] *= 0.97  # the region of row 2, column 8
    assert average_regions(ours)[1, 7] == pytest.approx(1.94)
    rms, largest, where = _compare_regions(ours, theirs)
    assert (rms, largest) == pytest.approx((0.03 / 8, -0.03))
    assert where.endswith("row 2, column 8")


def test_dark_regions_are_compared_with_a_share_of_the_mean():
    theirs = np.full((120, 160), 1.0)
    theirs[:15, :20] = 0.0
    ours = theirs.copy()
    ours[:15, :20] = 0.002
    assert _compare_regions(ours, theirs)[1] == pytest.approx(0.002 / (0.02 * 63 / 64))


def test_an_edge_that_moved_by_half_a_pixel():
    one, other = np.zeros((40, 40), bool), np.zeros((40, 40), bool)
    one[:, :20] = True
    other[:, :20] = True
    other[::2, 20] = True  # every other row a pixel further
    assert measure_edge_shift_px(one, one) == 0
    assert measure_edge_shift_px(one, other) == 0.5


def test_a_picture_of_twins_is_grey_where_they_are_equal():
    theirs = np.linspace(0.5, 1.0, 120 * 160).reshape(120, 160)
    ours = theirs.copy()
    ours[:60] *= 1.2
    picture = draw_twins(ours, theirs)
    assert picture.shape == (120, 480, 3)
    assert (picture[60:, :160] == picture[60:, 160:320]).all()
    assert (picture[60:, 320:] == 128).all()
    assert (picture[:60, 320:] == (255, 0, 0)).all()


def test_facets_share_no_vertex_and_are_the_same_ground(tmp_path):
    vertices, triangles = make_ball_mesh(24)
    write_triangles(tmp_path / "ball.ply", vertices, triangles, vertices)
    assert all(map(np.allclose, read_triangles(tmp_path / "ball.ply"), (vertices, triangles)))
    write_facets(tmp_path / "ball.ply", tmp_path / "facets.ply")
    found, faces = read_triangles(tmp_path / "facets.ply")
    assert len(np.unique(found, axis=0)) == 3 * len(triangles) == faces.size
    # A thousandth of the largest distance from the middle of a triangle to its corner.
    assert np.abs(found[faces] - vertices[triangles]).max() < 1e-3 * 0.2
    (tmp_path / "other.ply").write_bytes(b"ply\nend_header\nmore")
    with pytest.raises(IcyMoonError, match="is not a PLY file of ours"):
        read_triangles(tmp_path / "other.ply")


def test_flat_scenes_follow_the_scene_whose_ground_they_have():
    assert not SCENES[0].flat
    for before, scene in pairwise(SCENES):
        if scene.flat:
            assert not before.flat
            assert (before.changes, before.bounces) == (scene.changes, scene.bounces)
            assert before.why  # what they are there to explain
