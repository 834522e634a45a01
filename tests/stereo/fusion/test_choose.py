"""The choice between stereo and the interpolation, from errors at the points alone."""

import numpy as np
import pytest
from icymoon.stereo.fusion.choose import choose_disparity
from icymoon.stereo.fusion.interpolate import interpolate
from icymoon.stereo.fusion.range_points import RangePoints

SHAPE = (60, 80)


def make_case(truth, stereo, count, seed=0, noise=0.0):
    random = np.random.default_rng(seed)
    row, column = np.divmod(random.permutation(truth.size)[:count], truth.shape[1])
    disparity = truth[row, column] + noise * random.standard_normal(count)
    points = RangePoints(column.astype(float), row.astype(float), disparity, np.full(count, noise))
    interpolation = interpolate(points.column, points.row, points.disparity)
    expected = interpolation.fill(truth.shape)
    return choose_disparity(stereo, interpolation, expected, points), expected


def count_wrong(disparity, truth):
    return float(np.mean(~(np.abs(disparity - truth) <= 1)))


def bumpy(size=6.0):
    row, column = np.indices(SHAPE)
    return 20 + size * np.sin(row / 3.0) * np.cos(column / 3.0)


def break_some(truth, share, seed=1):
    random = np.random.default_rng(seed)
    return np.where(random.uniform(size=SHAPE) < share, random.uniform(2, 60, SHAPE), truth)


@pytest.mark.parametrize("count", [10, 100])
def test_perfect_stereo_on_relief_stays(count):
    truth = bumpy()
    found, expected = make_case(truth, truth, count)
    assert count_wrong(expected, truth) > 0.5
    assert count_wrong(found, truth) < 0.01


def test_missing_stereo_is_interpolated():
    truth = bumpy()
    found, expected = make_case(truth, np.full(SHAPE, np.nan), 50)
    np.testing.assert_array_equal(found, expected)
    stereo = np.where(np.arange(80) < 40, truth, np.nan)
    found, expected = make_case(truth, stereo, 50)
    np.testing.assert_array_equal(found[:, 40:], expected[:, 40:])


@pytest.mark.parametrize("count", [10, 30, 300])
def test_wrong_stereo_on_a_plane_is_replaced(count):
    row, column = np.indices(SHAPE)
    truth = 20 + 0.1 * row - 0.05 * column
    found, _ = make_case(truth, break_some(truth, 0.5), count)
    assert count_wrong(found, truth) < 0.01


@pytest.mark.parametrize(("size", "share"), [(0.0, 0.1), (0.0, 0.9), (1.0, 0.5), (3.0, 0.1), (6.0, 0.5), (6.0, 0.9)])
@pytest.mark.parametrize("count", [30, 300])
def test_it_is_never_worse_than_the_better_one(size, share, count):
    truth = bumpy(size)
    stereo = break_some(truth, share)
    found, expected = make_case(truth, stereo, count)
    # With few points the better source is not known for certain: 3 points of these 4800 pixels at most.
    allowed = 0.03 if count < 100 else 0.01
    assert count_wrong(found, truth) <= min(count_wrong(stereo, truth), count_wrong(expected, truth)) + allowed


def test_points_in_a_corner_say_nothing_of_the_rest():
    truth = bumpy()
    row, column = (grid[:12, :12].ravel().astype(float) for grid in np.indices(SHAPE))
    disparity = truth[:12, :12].ravel()
    points = RangePoints(column, row, disparity, np.zeros(144))
    interpolation = interpolate(column, row, disparity)
    found = choose_disparity(break_some(truth, 0.05), interpolation, interpolation.fill(SHAPE), points)
    # Stereo is wrong at 5 %, and the interpolation nearly everywhere beside the corner. A ring around it may be lost.
    assert count_wrong(interpolation.fill(SHAPE), truth) > 0.6
    assert count_wrong(found, truth) < 0.07


def test_noise_of_the_points_is_not_held_against_stereo():
    truth = bumpy()
    found, expected = make_case(truth, truth, 300, noise=1.0)
    assert count_wrong(expected, truth) > 0.3 > 0.05 > count_wrong(found, truth)


def test_the_same_points_give_the_same_choice():
    truth = bumpy()
    once, again = (make_case(truth, break_some(truth, 0.3), 100)[0] for _ in range(2))
    np.testing.assert_array_equal(once, again)
