"""Bounds of means by betting: how often they are wrong, their closed form in a simple case, and how narrow they are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.stereo.inference.bounded_means import bound_mean, bound_mean_difference


@pytest.mark.left_to_ci
@pytest.mark.parametrize(("chance", "grounds"), [(0.05, 20), (0.3, 60)])
def test_each_bound_is_wrong_as_rarely_as_stated(chance, grounds):
    """At a doubt of 10 %, 400 data sets have more than 57 wrong bounds with a probability below 0.3 %."""
    random = np.random.default_rng(5)
    values = np.where(
        random.random((400, grounds)) < chance, 1.0, np.where(random.random((400, grounds)) < 0.2, 0.2, 0)
    )
    truth = chance + (1 - chance) * 0.2 * 0.2
    bounds = np.array([bound_mean(own, 0.1) for own in values])
    assert (bounds[:, 0] > truth).sum() <= 57
    assert (bounds[:, 1] < truth).sum() <= 57


def test_equal_numbers_have_the_bound_of_a_sum():
    """For n zeros the capital at the mean m is the mean of (1 + b m / (1 - m)) ** n over the shares b."""
    grounds, doubt = 40, 0.01
    low, high = bound_mean(np.zeros(grounds), doubt)
    shares = (np.arange(64) + 0.5) / 64
    assert low == 0
    capital = np.mean((1 + shares * high / (1 - high)) ** grounds)
    assert math.log(capital) == pytest.approx(-math.log(doubt), abs=1e-5)
    # Not narrower than the exact bound of 0 failures, which is the best possible.
    assert high >= 1 - doubt ** (1 / grounds)


def test_bounds_of_a_difference_turn_with_it_and_do_not_depend_on_the_order():
    random = np.random.default_rng(2)
    one, other = random.random(30), random.random(30) / 2
    low, high = bound_mean_difference(one, other, 0.01)
    assert low < (one - other).mean() < high
    assert bound_mean_difference(other, one, 0.01) == pytest.approx((-high, -low), abs=1e-7)
    turned = random.permutation(30)
    assert bound_mean_difference(one[turned], other[turned], 0.01) == pytest.approx((low, high), abs=1e-7)


def test_rare_differences_to_one_side_are_noticed_where_hoeffding_notices_none():
    """15 of 60 grounds differ. Hoeffding's bound of the mean is 2 sqrt(ln(1 / p) / 2n) below it, which is below 0."""
    one, other, doubt = np.where(np.arange(60) < 15, 1.0, 0.0), np.zeros(60), 0.01
    assert bound_mean_difference(one, other, doubt)[0] > 0
    assert 15 / 60 - 2 * math.sqrt(math.log(1 / doubt) / 120) < 0
    assert bound_mean_difference(one, one, doubt)[0] < 0 < bound_mean_difference(one, one, doubt)[1]
