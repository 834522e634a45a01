"""Intervals over scenes: what they cover, what widens them, and what they leave out."""

import numpy as np
import pytest
from icymoon.stereo.report.scene_intervals import (
    intervals,
    scene_means,
    student_quantile,
    wilson_interval,
    within_range,
)

pytestmark = pytest.mark.filterwarnings("error")


@pytest.mark.parametrize(("freedom", "quantile"), [  # of a printed table
    (1, 12.706), (2, 4.303), (3, 3.182), (4, 2.776), (5, 2.571), (9, 2.262), (10, 2.228), (29, 2.045), (100, 1.984)])
def test_quantiles_are_those_of_the_tables(freedom, quantile):
    assert student_quantile(freedom) == pytest.approx(quantile, abs=6e-4)


@pytest.mark.parametrize("count", [2, 3, 6, 20])
def test_they_cover_the_true_mean_as_often_as_they_say(count):
    """In 2000 samples, with 3 standard errors of 0.5 %, also with few scenes and with different numbers of pairs."""
    random = np.random.default_rng(count)
    scenes = np.repeat(np.arange(count), 4)[:-1]
    values = random.normal(0, 1, (count, 2000))[scenes] + random.normal(0, 0.5, (len(scenes), 2000))
    bounds = intervals(values, scenes)
    assert np.mean((bounds[:, 0] <= 0) & (bounds[:, 1] >= 0)) == pytest.approx(0.95, abs=0.02)


def test_with_equal_numbers_of_pairs_it_is_students_interval_of_the_scene_means():
    values = np.random.default_rng(1).normal(3, 1, (12, 1))
    scenes = np.arange(12) // 3
    means = scene_means(values, scenes)[:, 0]
    np.testing.assert_allclose(means, values.reshape(4, 3).mean(axis=1))
    half = student_quantile(3) * means.std(ddof=1) / 2
    np.testing.assert_allclose(intervals(values, scenes)[0], [means.mean() - half, means.mean() + half])


def test_pairs_of_one_scene_are_no_new_evidence():
    values = np.random.default_rng(2).normal(0, 1, 30)
    one = intervals(values[:, None], np.arange(30))
    ten = intervals(np.repeat(values, 10)[:, None], np.repeat(np.arange(30), 10))
    np.testing.assert_allclose(ten, one)


def test_undefined_values_are_left_out_and_one_scene_has_none():
    values = np.array([[1.0, np.nan], [3.0, np.nan], [np.nan, 2.0]])
    bounds = intervals(values, np.arange(3))
    np.testing.assert_allclose(bounds[0], intervals(values[:2, :1], np.arange(2))[0])
    assert np.isnan(bounds[1]).all()
    assert np.isnan(intervals(np.ones((3, 1)), np.zeros(3, int))).all()
    assert np.isnan(intervals(np.ones((0, 2)), np.zeros(0, int))).all()
    np.testing.assert_allclose(intervals(np.ones((3, 1)), np.arange(3)), 1)
    assert np.isnan(scene_means(values, np.arange(3))[2, 0])


@pytest.mark.parametrize(("share", "number"), [(0.0, 8), (1.0, 8), (0.5, 8), (0.25, 20), (0.0, 2)])
def test_wilsons_bounds_are_where_the_share_is_as_far_off_as_its_own_error(share, number):
    low, high = wilson_interval(share, number)
    assert 0 <= low <= share <= high <= 1
    for bound in {low, high} - {share}:
        assert abs(share - bound) == pytest.approx(1.959964 * np.sqrt(bound * (1 - bound) / number), rel=1e-6)


def test_bounds_end_where_their_numbers_do():
    bounds = np.array([[-0.2, 1.3], [-0.2, 1.3], [-0.2, 1.3], [np.nan, np.nan]])
    found = within_range(bounds, np.array([True, False, False, False]), np.array([False, False, True, True]))
    np.testing.assert_array_equal(found, [[-0.2, 1.3], [0.0, 1.3], [0.0, 1.0], [np.nan, np.nan]])
