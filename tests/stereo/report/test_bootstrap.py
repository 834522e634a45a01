"""Intervals: what they cover, what widens them, and that they are the same every time."""

import numpy as np
import pytest
from icymoon.stereo.report.bootstrap import clusters_of, intervals

pytestmark = pytest.mark.filterwarnings("error")


def test_they_cover_the_true_mean_as_often_as_they_say():
    """Of 300 samples of 40 scenes with 5 pairs each, about 95 % hold the mean 0: 94 % expected, since percentile
    intervals of 40 clusters are a little narrow, and three times the binomial spread of 1.4 % around."""
    random = np.random.default_rng(0)
    scenes = np.repeat(np.arange(40), 5)
    hits = 0
    for _ in range(300):
        values = random.normal(0, 1, 40)[scenes] + random.normal(0, 0.5, 200)
        low, high = intervals(values[:, None], scenes, seed=0, resamples=400)[0]
        hits += low <= 0 <= high
    assert 0.90 <= hits / 300 <= 0.98


def test_pairs_of_one_scene_are_no_new_evidence():
    """If all pairs of a scene agree, ten of them give the same interval as one."""
    values = np.random.default_rng(1).normal(0, 1, 30)
    one = intervals(values[:, None], np.arange(30), seed=3)
    ten = intervals(np.repeat(values, 10)[:, None], np.repeat(np.arange(30), 10), seed=3)
    np.testing.assert_allclose(ten, one)
    naive = intervals(np.repeat(values, 10)[:, None], np.arange(300), seed=3)
    assert np.ptp(naive) < 0.45 * np.ptp(one)  # 1 / √10 of it, falsely


def test_pairing_takes_out_what_both_share():
    random = np.random.default_rng(2)
    hard = random.exponential(1, 50)
    a, b = hard + random.normal(0.05, 0.02, 50), hard
    (low_a, high_a), (low_b, high_b), (low, high) = intervals(np.stack([a, b, a - b], axis=1), np.arange(50), seed=0)
    assert low_a < high_b  # apart, they cannot be told apart
    assert low_b < high_a
    assert 0 < low < 0.05 < high


def test_the_standard_error_of_a_mean_is_met():
    values = np.random.default_rng(3).normal(5, 2, 400)
    low, high = intervals(values[:, None], np.arange(400), seed=0)[0]
    assert high - low == pytest.approx(2 * 1.96 * values.std() / 20, rel=0.1)
    assert low < values.mean() < high


def test_the_same_seed_gives_the_same_interval():
    values = np.random.default_rng(4).normal(0, 1, (20, 2))
    clusters = np.arange(20)
    assert (intervals(values, clusters, 1) == intervals(values, clusters, 1)).all()
    assert (intervals(values, clusters, 1) != intervals(values, clusters, 2)).any()


def test_undefined_values_are_left_out_and_too_few_give_none():
    values = np.array([[1.0, np.nan], [3.0, np.nan], [np.nan, 2.0]])
    bounds = intervals(values, np.arange(3), seed=0)
    assert (bounds[0] == [1, 3]).all()
    assert np.isnan(bounds[1]).all()
    assert np.isnan(intervals(np.ones((3, 1)), np.zeros(3, int), seed=0)).all()
    assert np.isnan(intervals(np.ones((0, 2)), np.zeros(0, int), seed=0)).all()
    assert (intervals(np.ones((3, 1)), np.arange(3), seed=0) == 1).all()


def test_one_scene_is_split_into_its_pairs():
    assert clusters_of(np.array([7, 7, 7])).tolist() == [0, 1, 2]
    assert clusters_of(np.array([7, 2, 7])).tolist() == [1, 0, 1]
