"""Means over scenes: what their intervals cover, what widens them, and what they leave out."""

import math

import numpy as np
import pytest
from icymoon.stereo.inference.scene_means import (
    FEWEST_FOR_MEAN,
    average_by_scene,
    find_mean_intervals,
    find_simultaneous_intervals,
)

pytestmark = pytest.mark.filterwarnings("error")


def of_shares(values, scenes=None):
    return find_mean_intervals(
        values, np.arange(len(values)) if scenes is None else scenes, np.ones(values.shape[1], bool)
    )


def of_means(values, scenes=None):
    return find_mean_intervals(
        values, np.arange(len(values)) if scenes is None else scenes, np.zeros(values.shape[1], bool)
    )


def at_least(count, number, share):
    return sum(math.comb(number, k) * share**k * (1 - share) ** (number - k) for k in range(count, number + 1))


@pytest.mark.parametrize(("yes", "number"), [(0, 2), (0, 8), (3, 8), (8, 8), (1, 20), (10, 20)])
def test_outcomes_of_0_and_1_have_the_interval_of_clopper_and_pearson(yes, number):
    """Beyond its bounds so few or so many are rarer than 2.5 %; of 10 000 weights that is within 0.5 points."""
    low, high = of_shares((np.arange(number) < yes)[:, None] + 0.0)[0]
    assert (low == 0) if yes == 0 else at_least(yes, number, low) == pytest.approx(0.025, abs=0.005)
    assert (high == 1) if yes == number else 1 - at_least(yes + 1, number, high) == pytest.approx(0.025, abs=0.005)


@pytest.mark.ci_takes(3)
@pytest.mark.parametrize("scenes", [2, 6, 20])
@pytest.mark.parametrize("kind", ["skewed", "mostly zero", "yes or no"])
def test_intervals_of_shares_cover_with_any_number_of_scenes(scenes, kind):
    """In 400 data sets, but for 3 standard errors; Student's interval covers less than 93 % in each case."""
    random, shape = np.random.default_rng(scenes), (scenes, 400)
    values, mean = {
        "skewed": (random.beta(0.3, 5, shape), 0.3 / 5.3),
        "mostly zero": (random.beta(1, 3, shape) * (random.random(shape) < 0.2), 0.05),
        "yes or no": ((random.random(shape) < 0.05) + 0.0, 0.05),
    }[kind]
    low, high = of_shares(values).T
    assert (low >= 0).all() & (high <= 1).all()
    assert np.mean((low <= mean) & (mean <= high)) >= 0.95 - 3 * (0.05 * 0.95 / 400) ** 0.5
    student = {2: 12.706, 6: 2.571, 20: 2.093}[scenes] * values.std(axis=0, ddof=1) / scenes**0.5
    assert np.mean(np.abs(values.mean(axis=0) - mean) <= student) < 0.93


def test_pairs_of_one_scene_are_no_new_evidence():
    values = np.random.default_rng(2).beta(1, 4, (30, 1))
    for of in (of_shares, of_means):
        np.testing.assert_allclose(of(np.repeat(values, 10, axis=0), np.repeat(np.arange(30), 10)), of(values))


def test_a_scene_with_more_pairs_weighs_more():
    values = np.array([0.0] * 9 + [1.0])[:, None]
    few, many = of_shares(values, np.array([0] * 9 + [1])), of_shares(values, np.array([0] + [1] * 9))
    assert few[0, 1] == 1.0 or few[0, 1] > 0.5
    assert few[0].mean() < many[0].mean() + 0.5
    assert (few[:, 0] <= 0.1).all() & (few[:, 1] >= 0.1).all()


def test_undefined_values_are_left_out_and_one_scene_has_none():
    values = np.array([[0.1, np.nan], [0.3, np.nan], [np.nan, 0.2]])
    bounds = of_shares(values)
    assert bounds[0, 0] < 0.2 < bounds[0, 1]
    assert np.isnan(bounds[1]).all()
    assert np.isnan(of_shares(np.ones((3, 1)), np.zeros(3, int))).all()
    assert np.isnan(of_shares(np.ones((0, 2)))).all()
    assert np.isnan(average_by_scene(values, np.arange(3))[2, 0])
    holes = np.vstack([np.random.default_rng(0).exponential(1, (25, 1)), np.full((40, 1), np.nan)])
    np.testing.assert_allclose(of_means(holes), of_means(holes[:25]), rtol=0.1)


def test_few_scenes_have_no_interval_of_a_mean_that_is_no_share():
    values = np.random.default_rng(1).exponential(1, (FEWEST_FOR_MEAN, 1))
    assert np.isnan(of_means(values[1:])).all()
    assert np.isfinite(of_means(values)).all()
    assert np.isnan(find_simultaneous_intervals(values[1:], 0)).all()
    assert np.isfinite(find_simultaneous_intervals(values, 0)).all()


@pytest.mark.parametrize(("scenes", "least"), [(20, 0.90), (50, 0.93)])
def test_intervals_of_skewed_means_cover_more_than_students(scenes, least):
    """Lognormal errors, 1000 data sets: as the manual states, but for 3 standard errors. Student's miss that."""
    values = np.random.default_rng(scenes).lognormal(0, 1, (scenes, 1000))
    low, high = of_means(values).T
    true = math.exp(0.5)
    assert np.mean((low <= true) & (true <= high)) >= least - 3 * (least * (1 - least) / 1000) ** 0.5
    assert (low > 0).all()
    student = {20: 2.093, 50: 2.010}[scenes] * values.std(axis=0, ddof=1) / scenes**0.5
    assert np.mean(np.abs(values.mean(axis=0) - true) <= student) < np.mean((low <= true) & (true <= high)) - 0.01


def test_normal_means_have_students_interval():
    values = np.random.default_rng(3).normal(0, 1, (200, 40))
    half = 1.972 * values.std(axis=0, ddof=1) / 200**0.5
    low, high = of_means(values).T
    np.testing.assert_allclose((low + high) / 2, values.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose((high - low) / 2, half, rtol=0.12)  # of 2000 resamples


def test_the_unit_of_a_mean_changes_nothing():
    values = np.random.default_rng(4).exponential(1, (24, 2))
    for factor in (1e-9, 1e9):
        np.testing.assert_allclose(of_means(factor * values), factor * of_means(values))
        np.testing.assert_allclose(of_means(factor * (values - 1)), factor * of_means(values - 1))


def test_what_is_constant_or_zero_is_certain_and_what_is_mostly_zero_is_not():
    values = np.zeros((24, 3))
    values[:, 1], values[0, 2] = 7.0, 1.0
    bounds = of_means(values)
    np.testing.assert_allclose(bounds[:2], [[0, 0], [7, 7]])
    assert bounds[2, 0] == 0
    assert bounds[2, 1] > 1 / 24
    np.testing.assert_allclose(find_simultaneous_intervals(np.full((24, 1), -3.0), 0), [[-3, -3]])


def test_intervals_that_hold_at_once_are_wider():
    values = np.random.default_rng(5).normal(0, 1, (40, 6))
    joint, one = (
        find_simultaneous_intervals(values, 0),
        np.vstack([find_simultaneous_intervals(values[:, k : k + 1], 0) for k in range(6)]),
    )
    assert (np.diff(joint) > np.diff(one)).all()
    np.testing.assert_allclose(joint.mean(axis=1), values.mean(axis=0))
    np.testing.assert_array_equal(joint, find_simultaneous_intervals(values, 0))
