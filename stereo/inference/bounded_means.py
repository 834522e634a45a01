"""Intervals of means of bounded numbers that hold for any distribution and any number of scenes, by betting.

A gambler bets the share b of a capital on each number x in [0, 1], if the numbers have the mean m or less. The bet
multiplies the capital by 1 + b (x / m - 1), so the capital does not grow on average. The mean capital over many shares
b is above 1 / p with a probability of at most p (Ville), so a mean m that makes the capital exceed 1 / p is excluded at
p (Waudby-Smith and Ramdas 2023). Neither the order of the scenes nor the shape of their distribution matters. Where
most numbers are equal, as most decisions of two sensors are, such intervals are narrower than Hoeffding's.
"""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array

#: Shares of the capital. Any fixed shares are valid.
_SHARES = (np.arange(64) + 0.5) / 64
#: Width of the bracket of a bound.
_ROUNDING = 1e-9


def bound_mean(values: Array, doubt: float) -> tuple[float, float]:
    """Return a lower and an upper bound of the mean behind independent ``values`` (n,) from 0 to 1.

    Each bound is wrong with a probability of at most ``doubt``.
    """
    return _bound_below(values, doubt), 1.0 - _bound_below(1.0 - values, doubt)


def bound_mean_difference(one: Array, other: Array, doubt: float) -> tuple[float, float]:
    """Bound the mean of ``one`` minus the mean of ``other``, paired (n,), from 0 to 1 each, as ``bound_mean`` does."""
    low, high = bound_mean((1.0 + one - other) / 2, doubt)
    return 2 * low - 1, 2 * high - 1


def _bound_below(values: Array, doubt: float) -> float:
    """Return the least mean that the bets do not exclude. A larger mean makes all bets poorer."""
    low, high = 0.0, float(values.mean()) if len(values) else 0.0
    while high - low > _ROUNDING:
        middle = (low + high) / 2
        low, high = (middle, high) if _compute_log_capital(values, middle) > -math.log(doubt) else (low, middle)
    return low


def _compute_log_capital(values: Array, mean: float) -> float:
    """Compute the logarithm of the mean capital after bets that the mean of ``values`` is above ``mean``."""
    grown = np.log1p(_SHARES[:, None] * (values[None] / mean - 1.0)).sum(axis=1)
    most = float(grown.max())
    return most + math.log(float(np.exp(grown - most).mean()))
