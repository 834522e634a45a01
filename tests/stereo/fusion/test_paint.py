"""Painted patterns: the same in both eyes at the point's disparity, and only where both eyes see it."""

import numpy as np
import pytest
from icymoon.stereo.fusion.paint import PAINT_SHARE, find_hidden, paint_points
from icymoon.stereo.fusion.range_points import RangePoints


def make_points(*places):
    column, row, disparity = np.array(places, float).T
    return RangePoints(column, row, disparity, np.zeros(len(column)))


@pytest.mark.parametrize("disparity", [8.0, 8.25, 8.75])
def test_both_eyes_see_one_pattern_at_the_disparity(disparity):
    grey = np.full((9, 40), 128, np.uint8)
    left, right = paint_points(grey, grey, make_points((20, 4, disparity)), 5, np.random.default_rng(0))
    assert (left != 128).sum() >= 20
    assert (left[:2] == 128).all()
    assert (left[:, :18] == 128).all()
    # A right column x sees the left column x + disparity; its ends have no second column to mix.
    columns = np.arange(int(np.ceil(18 - disparity)), int(np.floor(22 - disparity)) + 1)
    whole = np.floor(columns + disparity).astype(int)
    share = columns + disparity - whole
    expected = (1 - share) * left[:, whole] + share * left[:, np.minimum(whole + 1, 39)]
    np.testing.assert_allclose(right[:, columns], expected, atol=1.01)  # both images are rounded
    outside = np.delete(right, columns, axis=1)
    assert (outside == 128).all()


def test_the_image_stays_under_the_pattern():
    ramp = np.tile(np.arange(40, dtype=np.uint8) * 5, (9, 1))
    left, _ = paint_points(ramp, ramp, make_points((20, 4, 8.0)), 5, np.random.default_rng(0))
    least, most = (1 - PAINT_SHARE) * 18 * 5 - 0.5, (1 - PAINT_SHARE) * 22 * 5 + PAINT_SHARE * 255 + 0.5
    assert least <= left[2:7, 18:23].min()
    assert left[2:7, 18:23].max() <= most


def test_a_point_behind_a_nearer_one_is_not_painted():
    hidden = make_points((20, 4, 2.0), (32, 5, 14.0))  # both at the right column 18
    np.testing.assert_array_equal(find_hidden(hidden, 2), [True, False])
    np.testing.assert_array_equal(find_hidden(make_points((20, 4, 2.0), (40, 5, 14.0)), 2), [False, False])
    np.testing.assert_array_equal(find_hidden(make_points((20, 4, 2.0), (32, 9, 14.0)), 2), [False, False])
    np.testing.assert_array_equal(find_hidden(make_points((32, 5, 14.0), (20, 4, 2.0)), 2), [False, True])
    grey = np.full((12, 60), 128, np.uint8)
    left, _ = paint_points(grey, grey, hidden, 5, np.random.default_rng(0))
    assert (left[:, :25] == 128).all()
    assert (left[:, 30:35] != 128).any()


def test_colours_borders_and_seeds():
    grey = np.full((9, 40, 3), 128, np.uint8)
    points = make_points((0, 0, 1.5), (39, 8, 30.0), (20, 4, 6.0))
    once, again = (paint_points(grey, grey, points, 5, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(once, again)
    assert once[0].shape == grey.shape
    assert once[0].dtype == np.uint8
    assert (once[0][..., 0] == once[0][..., 2]).all()
