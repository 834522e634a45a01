"""Scores of maps: a perfect one, a coin, an inverted one, and counts by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from icymoon.stereo.decisions.safe_sites import SAFE, SiteLayers, Sites
from icymoon.stereo.decisions.scores import THRESHOLDS, rank_scores, score_sites

ALL = np.ones((40, 50), bool)
NONE = SiteLayers(*([np.zeros(ALL.shape)] * 6))


def sites(margin):
    return Sites(margin, np.where(margin >= 0, SAFE, 2).astype(np.uint8), NONE)


def random_map(seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, ALL.shape)


def test_the_truth_itself_is_perfect():
    truth = sites(random_map())
    found = score_sites(truth, truth, ALL)
    assert found["precision"] == found["recall"] == found["average_precision"] == found["roc_area"] == 1.0
    assert found["false_safe"] == found["safe_lost"] == found["regret"] == found["unsafe_choice"] == 0.0


def test_a_coin_has_the_base_rate_and_half_the_area():
    truth = sites(random_map() - 0.4)
    found = [score_sites(sites(random_map(seed)), truth, ALL) for seed in range(1, 21)]
    # 2000 cells, 20 coins: three standard errors.
    assert np.mean([each["average_precision"] for each in found]) == pytest.approx(found[0]["base_rate"], abs=0.02)
    assert np.mean([each["roc_area"] for each in found]) == pytest.approx(0.5, abs=0.01)


def test_the_inverse_is_as_wrong_as_can_be():
    truth = sites(random_map())
    found = score_sites(sites(-truth.margin), truth, ALL)
    assert found["roc_area"] == pytest.approx(0.0)
    assert found["precision"] == 0.0
    assert found["regret"] == 1.0
    assert found["unsafe_choice"] == 1.0


def test_counts_by_hand():
    truth = sites(np.where(np.arange(2000).reshape(40, 50) < 500, 0.5, -0.5))
    margin = np.full(ALL.shape, -0.2)
    margin.ravel()[400:900] = 0.3
    found = score_sites(sites(margin), truth, ALL)
    assert found["cells"] == [2000, 500, 500, 100]
    assert (found["base_rate"], found["taken"], found["precision"], found["recall"]) == (0.25, 0.25, 0.2, 0.2)
    assert (found["false_safe"], found["safe_lost"]) == (0.8, 0.8)
    margin.ravel()[850:900] = 0.7  # of unsafe cells
    found = score_sites(sites(margin), truth, ALL)
    for threshold, taken, unsafe in (
        (1.0, 0, 0),
        (0.71, 0, 0),
        (0.7, 50, 50),
        (0.31, 50, 50),
        (0.3, 500, 400),
        (0, 500, 400),
    ):
        at = THRESHOLDS.index(threshold)
        assert (found["taken_from"][at], found["unsafe_from"][at]) == (taken, unsafe)


def test_equal_scores_are_one_step():
    found = rank_scores(np.zeros(100), np.arange(100) < 30)
    assert found["average_precision"] == pytest.approx(0.3)
    assert found["roc_area"] == pytest.approx(0.5)


def test_ranks_are_those_of_counting():
    random = np.random.default_rng(7)
    score, positive = random.integers(0, 20, 300).astype(float), random.random(300) < 0.3
    inside, outside = score[positive], score[~positive]
    wins = (inside[:, None] > outside).mean() + 0.5 * (inside[:, None] == outside).mean()  # Mann and Whitney
    assert rank_scores(score, positive)["roc_area"] == pytest.approx(wins)
    steps = [(positive[score >= s].sum(), (score >= s).sum()) for s in np.unique(score)[::-1]]
    hits = np.array([0, *(hit for hit, _ in steps)])
    by_hand = sum((b - a) / positive.sum() * hit / n for a, b, (hit, n) in zip(hits, hits[1:], steps, strict=False))
    assert rank_scores(score, positive)["average_precision"] == pytest.approx(by_hand)


def test_what_is_undefined_is_none():
    empty, full = sites(np.full(ALL.shape, -1.0)), sites(np.full(ALL.shape, 0.5))
    assert score_sites(empty, full, ALL)["precision"] is None
    assert score_sites(empty, full, ALL)["no_site"] == 1.0
    nothing = score_sites(full, empty, ALL)
    assert nothing["recall"] is nothing["roc"] is nothing["regret"] is None
    assert nothing["unsafe_choice"] == 1.0
    assert score_sites(empty, empty, ALL)["unsafe_choice"] is None


def test_regret_is_the_margin_that_is_given_away():
    truth, margin = sites(np.full(ALL.shape, 0.2)), np.full(ALL.shape, 0.1)
    truth.margin[3, 4], margin[20, 20] = 0.7, 0.4
    found = score_sites(sites(margin), truth, ALL)
    assert found["chosen"] == [20, 20]
    assert found["regret"] == pytest.approx(0.5)
    assert score_sites(replace(sites(margin)), truth, ~ALL)["regret"] is None


def test_the_truth_forbids_no_site_that_a_lander_may_choose():
    """A site that only looks in reach is an unsafe choice, and an unsafe cell of the map."""
    truth, margin = sites(np.full(ALL.shape, 0.2)), np.full(ALL.shape, 0.1)
    margin[0] = 0.5
    truth.margin[0], truth.failed[0] = -np.inf, 5
    among = truth.safe
    assert score_sites(sites(margin), truth, among)["unsafe_choice"] == 0.0
    found = score_sites(sites(margin), truth, among, offered=ALL)
    assert (found["chosen"], found["unsafe_choice"], found["regret"]) == ([0, 24], 1.0, 1.0)
    at = THRESHOLDS.index(0.3)
    assert (found["taken_from"][at], found["unsafe_from"][at], found["offered"]) == (50, 50, 2000)
    assert found["false_safe"] == 0.0  # over the cells in reach


def test_marginal_sites_are_apart_from_dangerous_ones():
    truth, margin = sites(np.full(ALL.shape, 0.2)), np.full(ALL.shape, -0.2)
    margin[:4] = 0.3  # 200 cells are taken
    truth = sites(np.where(np.arange(2000).reshape(40, 50) < 100, -0.1, truth.margin))
    truth.margin[2, :10] = truth.margin[2, :10] * 0 - 0.11
    truth.failed[2, :10] = 2
    found = score_sites(sites(margin), truth, ALL, tolerance=0.1)
    assert (found["false_safe"], found["dangerous"]) == (110 / 200, 10 / 200)
    assert found["chosen"] == [3, 24]
    margin[0, 7] = 0.5
    found = score_sites(sites(margin), truth, ALL, tolerance=0.1)
    assert (found["unsafe_choice"], found["dangerous_choice"]) == (1.0, 0.0)
    assert (found["chosen_margin"], found["chosen_true_margin"]) == (0.5, pytest.approx(-0.1))
    assert score_sites(sites(margin), truth, ALL)["dangerous_choice"] == 1.0  # without a tolerance
    assert found["lost_by"] == {"slope": found["safe_lost"]}  # code 2
    assert found["refused_by"] == {"slope": pytest.approx(1 - found["taken"])}


def test_an_unknown_truth_is_dangerous_and_not_infinite_in_files():
    truth = sites(np.full(ALL.shape, -np.inf))
    found = score_sites(sites(np.full(ALL.shape, 0.1)), truth, ALL, tolerance=0.1)
    assert found["dangerous_choice"] == found["dangerous"] == 1.0
    assert found["chosen_true_margin"] is None
