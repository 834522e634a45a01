"""Risks over simulated calibrations, the fewest grounds, and the tests' p-values by independent sums."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.stereo.inference.risk_control import (
    bound_risk,
    compare_with_grounds,
    compute_binomial_p,
    compute_share_p,
    count_fewest_grounds,
    count_fewest_on_average,
    find_average_threshold,
    find_confident_threshold,
    make_monotone,
)
from icymoon.support.errors import IcyMoonError

THRESHOLDS = np.linspace(1.0, 0.0, 21)
CALIBRATIONS, ALPHA, DELTA = 2000, 0.05, 0.05


def draw_losses(grounds, seed):
    """Losses (calibrations, grounds, thresholds) of a choice: a uniform score, unsafe with probability (1 - score)²."""
    random = np.random.default_rng(seed)
    score = random.random((CALIBRATIONS, grounds))
    unsafe = random.random(score.shape) < (1 - score) ** 2
    return ((score[..., None] >= THRESHOLDS) & unsafe[..., None]).astype(float)


def compute_risk(threshold):
    """The exact risk: the integral of (1 - s)² from the threshold to 1."""
    return (1 - threshold) ** 3 / 3


def test_with_the_stated_confidence_the_risk_is_below_alpha():
    found = [find_confident_threshold(losses, ALPHA, DELTA) for losses in draw_losses(100, 100)]
    risks = np.array([0.0 if k is None else compute_risk(THRESHOLDS[k]) for k in found])
    exceeded = (risks > ALPHA).mean()
    assert exceeded <= DELTA + 3 * math.sqrt(DELTA * (1 - DELTA) / CALIBRATIONS)
    assert exceeded > 0  # the test uses its delta
    assert np.mean([k is not None and THRESHOLDS[k] < 0.9 for k in found]) > 0.9


def test_conformal_risk_control_holds_on_average_alone():
    found = [find_average_threshold(losses, ALPHA) for losses in draw_losses(59, 7)]
    risks = np.array([0.0 if k is None else compute_risk(THRESHOLDS[k]) for k in found])
    assert risks.mean() <= ALPHA + 3 * risks.std() / math.sqrt(CALIBRATIONS)
    assert (risks > ALPHA).mean() > 0.15  # so it is no guarantee for one calibration


def test_shares_are_below_alpha_with_the_stated_confidence():
    """A share that is not monotone: beta losses whose mean falls again at permissive thresholds."""
    random = np.random.default_rng(3)
    mean = np.array([0.01, 0.03, 0.07, 0.02])
    losses = random.beta(0.5 * mean / (1 - mean), 0.5, (CALIBRATIONS, 120, 4))
    envelope = np.maximum.accumulate(losses, axis=2)
    risk = np.maximum.accumulate(random.beta(0.5 * mean / (1 - mean), 0.5, (50_000, 4)), axis=1).mean(axis=0)
    found = [find_confident_threshold(each, ALPHA, DELTA, shares=True) for each in envelope]
    exceeded = np.mean([k is not None and risk[k] > ALPHA for k in found])
    assert exceeded <= DELTA
    assert np.mean([k is not None for k in found]) > 0.5
    np.testing.assert_array_equal(make_monotone(losses[0]), envelope[0])


@pytest.mark.parametrize(
    ("alpha", "average", "at_90", "at_95"),
    [(0.05, (19, 39, 59), (45, 77, 105), (59, 93, 124)), (0.1, (9, 19, 29), (22, 38, 52), (29, 46, 61))],
)
def test_the_fewest_grounds(alpha, average, at_90, at_95):
    assert tuple(count_fewest_on_average(alpha, k) for k in range(3)) == average
    assert tuple(count_fewest_grounds(alpha, 0.1, k) for k in range(3)) == at_90
    assert tuple(count_fewest_grounds(alpha, 0.05, k) for k in range(3)) == at_95


def test_below_the_fewest_grounds_nothing_is_accepted():
    for grounds, accepted in ((59, True), (58, False), (0, False)):
        assert (find_confident_threshold(np.zeros((grounds, 3)), 0.05, 0.05) == 2) is accepted
    for grounds, accepted in ((19, True), (18, False), (0, False)):
        assert (find_average_threshold(np.zeros((grounds, 3)), 0.05) == 2) is accepted


def test_the_sequence_stops_at_the_first_threshold_that_fails():
    losses = np.zeros((60, 4))
    losses[:10, 2] = 1.0  # the last would be accepted again
    assert find_confident_threshold(losses, 0.05, 0.05) == 1
    losses[:10, 0] = 1.0
    assert find_confident_threshold(losses, 0.05, 0.05) is None


@pytest.mark.parametrize(
    ("loss", "shares", "shown"), [(math.nan, True, "nan"), (-1.0, True, "-1"), (2.0, True, "2"), (0.5, False, "0.5")]
)
def test_losses_that_are_no_risk_are_refused(loss, shares, shown):
    """An unknown or negative loss would make the risk look smaller."""
    losses = np.zeros((60, 3))
    losses[7, 1] = loss
    with pytest.raises(IcyMoonError, match=f"A loss of a ground is {shown}; give"):
        find_confident_threshold(losses, 0.05, 0.05, shares)
    if shares:
        with pytest.raises(IcyMoonError, match="A loss of a ground is"):
            find_average_threshold(losses, 0.05)


@pytest.mark.parametrize("wrong", [0.0, 1.0, math.nan])
def test_certainty_is_refused(wrong):
    with pytest.raises(IcyMoonError, match="alpha is"):
        find_average_threshold(np.zeros((60, 3)), wrong)
    for alpha, delta in ((wrong, 0.05), (0.05, wrong)):
        with pytest.raises(IcyMoonError, match="between 0 and 1"):
            find_confident_threshold(np.zeros((60, 3)), alpha, delta)


def test_the_test_of_shares_does_not_depend_on_the_losses():
    """Shares that happen to be 0 or 1 get the test of shares. With one failure, 93 grounds suffice for the binomial one
    alone.
    """
    losses = np.zeros((93, 1))
    losses[0] = 1.0
    assert find_confident_threshold(losses, 0.05, 0.05) == 0
    assert find_confident_threshold(losses, 0.05, 0.05, shares=True) is None


@pytest.mark.parametrize(("failing", "grounds", "alpha"), [(0, 59, 0.05), (2, 124, 0.05), (3, 40, 0.1), (7, 7, 0.3)])
def test_binomial_p_values_are_sums_of_whole_numbers(failing, grounds, alpha):
    by_hand = sum(math.comb(grounds, k) * alpha**k * (1 - alpha) ** (grounds - k) for k in range(failing + 1))
    assert compute_binomial_p(failing, grounds, alpha) == pytest.approx(by_hand)
    if failing < grounds:
        assert compute_binomial_p(failing, grounds, bound_risk(failing, grounds, 0.05)) == pytest.approx(0.05)
    else:
        assert bound_risk(failing, grounds, 0.05) == 1.0


def test_p_values_of_shares_have_the_bounds_of_hoeffding_and_bentkus():
    assert compute_share_p(0.0, 59, 0.05) == pytest.approx(0.95**59)  # Hoeffding's is exact where nothing fails
    assert compute_share_p(0.06, 1000, 0.05) == 1.0
    assert compute_share_p(0.02, 200, 0.05) < compute_share_p(0.03, 200, 0.05)
    assert compute_share_p(0.5, 10, 0.05) == 1.0


def test_like_grounds_have_uniform_p_values_and_others_small_ones():
    random = np.random.default_rng(5)
    values = random.gamma(2.0, 1.0, (500, 40, 3))
    p = np.array([compare_with_grounds(each[:-1], each[-1]).p for each in values])
    for limit in (0.05, 0.25, 0.5):
        assert (p <= limit).mean() <= limit + 3 * math.sqrt(limit * (1 - limit) / len(p))
    found = compare_with_grounds(values[0], np.array([2.0, 60.0, 2.0]))
    assert found.p == pytest.approx(1 / 41)
    assert found.feature == 1
    constant = np.ones((30, 1))
    assert compare_with_grounds(constant, np.array([1.0])).p == 1.0
    assert compare_with_grounds(constant, np.array([1.1])).p == pytest.approx(1 / 31)


def test_a_feature_that_most_grounds_share_hides_no_other():
    """A tenth of the grounds are partly dark, and all others are lit: a strange slope is still the strangest."""
    random = np.random.default_rng(8)
    features = np.stack([np.where(np.arange(60) < 6, 0.9, 1.0), random.normal(5.0, 1.0, 60)], axis=1)
    found = compare_with_grounds(features, np.array([1.0, 30.0]))
    assert (found.p, found.feature) == (pytest.approx(1 / 61), 1)
    assert compare_with_grounds(features, np.array([0.9, 5.0])).p > 0.05
    assert compare_with_grounds(features, np.array([0.2, 5.0])).p == pytest.approx(1 / 61)
