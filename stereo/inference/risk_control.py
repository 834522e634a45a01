"""Thresholds of a score that keep a risk below a limit, from losses on calibration grounds. Works on arrays only.

A ground has **one** loss from 0 to 1 at each threshold, because its pairs, Suns, cells and pixels are not independent.
Thresholds are fixed before the grounds are seen and go from the strictest to the most permissive.

* **Learn-then-Test** (Angelopoulos et al. 2021, arXiv 2110.01052) tests "the risk is above alpha" at one threshold
  after another, from the strictest, and stops at the first that cannot be rejected at delta. With the probability
  1 - delta over calibrations, the risk of the found threshold is at most alpha. The p-value is the exact binomial one
  for losses of 0 or 1, and Hoeffding's and Bentkus's (Bates et al. 2021, arXiv 2101.02703) for shares.
* **Conformal risk control** (Angelopoulos et al. 2022, arXiv 2208.02814) is weaker: the risk is at most alpha on
  average over calibrations. A third of the calibrations may exceed it. Its losses must not fall towards permissive
  thresholds.

Both hold for grounds of the same kind as the calibration grounds, and for others not at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError

#: Ratio of the standard deviation of a normal distribution to its median absolute deviation.
_DEVIATION_OF_MEDIAN = 1.4826
#: Ratio of the standard deviation of a normal distribution to its mean absolute deviation.
_DEVIATION_OF_MEAN = math.sqrt(math.pi / 2)
#: Rounding of sums of losses.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Likeness:
    """Comparison of a new ground with the calibration grounds: a p-value, and the index of the feature that differs
    most.
    """

    p: float
    feature: int


@lru_cache(maxsize=4096)
def compute_binomial_p(failing: int, grounds: int, alpha: float) -> float:
    """Return the probability of at most ``failing`` failures of ``grounds`` if each fails with the probability
    ``alpha``.
    """
    if failing >= grounds:
        return 1.0
    terms = (
        math.lgamma(grounds + 1)
        - math.lgamma(k + 1)
        - math.lgamma(grounds - k + 1)
        + k * math.log(alpha)
        + (grounds - k) * math.log1p(-alpha)
        for k in range(failing + 1)
    )
    return min(1.0, math.fsum(map(math.exp, terms)))


def compute_share_p(mean: float, grounds: int, alpha: float) -> float:
    """Return the p-value of a mean of losses from 0 to 1 against a risk above ``alpha``, by Hoeffding and Bentkus."""
    low = min(mean, alpha)
    divergence = (low * math.log(low / alpha) if low > 0 else 0.0) + (1 - low) * math.log((1 - low) / (1 - alpha))
    failing = math.ceil(grounds * mean - _ROUNDING)
    return min(1.0, math.exp(-grounds * divergence), math.e * compute_binomial_p(failing, grounds, alpha))


def make_monotone(losses: Array) -> Array:
    """Replace each loss (grounds, thresholds) by the largest loss at that threshold or a stricter one.

    The share of unsafe cells can fall as a more permissive threshold accepts more cells, but a test from the strictest
    threshold on needs a loss that never falls.
    """
    return np.asarray(np.maximum.accumulate(losses, axis=1))


def find_confident_threshold(losses: Array, alpha: float, delta: float, shares: bool = False) -> int | None:
    """Return the index of the most permissive threshold by Learn-then-Test; None if the strictest cannot be accepted.

    ``losses`` (grounds, thresholds) are from the strictest threshold on. They are 0 or 1, for the exact binomial test,
    or with ``shares`` from 0 to 1, for the test of Hoeffding and Bentkus. The caller states the test, because it must
    be fixed before the losses are known. Raises IcyMoonError for other losses, and for a risk or doubt not between 0
    and 1.
    """
    _check_losses(losses, alpha, shares)
    if not 0 < delta < 1:
        raise IcyMoonError(f"The doubt delta is {delta:g}; give a number between 0 and 1.")
    grounds = len(losses)
    found = None
    for k, total in enumerate(losses.sum(axis=0)):
        p = (
            compute_share_p(float(total) / max(grounds, 1), grounds, alpha)
            if shares
            else compute_binomial_p(round(float(total)), grounds, alpha)
        )
        if not grounds or p > delta:
            return found
        found = k
    return found


def find_average_threshold(losses: Array, alpha: float) -> int | None:
    """Return the index of the most permissive threshold by conformal risk control; None if the strictest cannot be
    accepted.

    ``losses`` (grounds, thresholds) from 0 to 1, from the strictest threshold on, are made monotone first. Raises
    IcyMoonError for other losses, and for a risk not between 0 and 1.
    """
    _check_losses(losses, alpha, shares=True)
    bounds = (make_monotone(losses).sum(axis=0) + 1) / (len(losses) + 1)
    return int((bounds <= alpha + _ROUNDING).sum()) - 1 if bounds.size and bounds[0] <= alpha + _ROUNDING else None


def _check_losses(losses: Array, alpha: float, shares: bool) -> None:
    """Raise IcyMoonError if a loss is unknown or out of range. An unknown loss would count as no loss."""
    if not 0 < alpha < 1:
        raise IcyMoonError(f"The risk alpha is {alpha:g}; give a number between 0 and 1.")
    good = (losses >= 0) & (losses <= 1) if shares else (losses == 0) | (losses == 1)
    if not good.all():
        raise IcyMoonError(
            f"A loss of a ground is {losses[~good].flat[0]:g}; give {'numbers from 0 to 1' if shares else '0 or 1'}, "
            "and leave out grounds that cannot be judged."
        )


def count_fewest_grounds(alpha: float, delta: float, failing: int = 0) -> int:
    """Return the fewest grounds from which Learn-then-Test accepts a threshold with this number of failing grounds."""
    grounds = failing + 1
    while compute_binomial_p(failing, grounds, alpha) > delta:
        grounds += 1
    return grounds


def count_fewest_on_average(alpha: float, failing: int = 0) -> int:
    """Return the fewest grounds from which conformal risk control accepts a threshold with this number of failures."""
    return math.ceil((failing + 1) / alpha - 1 - _ROUNDING)


def bound_risk(failing: int, grounds: int, delta: float) -> float:
    """Return the largest risk that this number of failures does not reject at ``delta``: Clopper and Pearson (1934).

    It describes a test on grounds that no calibration used.
    """
    if failing >= grounds:
        return 1.0
    low, high = 0.0, 1.0
    while high - low > _ROUNDING:
        middle = (low + high) / 2
        low, high = (middle, high) if compute_binomial_p(failing, grounds, middle) > delta else (low, middle)
    return high


def compare_with_grounds(features: Array, new: Array) -> Likeness:
    """Test by a conformal test whether a ground is like the calibration grounds.

    ``features`` (grounds, K) and ``new`` (K,) are numbers of each ground. The score of a ground is its largest distance
    from the median of a feature, in median absolute deviations, or in mean ones if more than half of the grounds have
    the median. Medians and deviations include the new ground, so that all grounds have equal parts and the p-value is
    exact: of like grounds, a share of at most p has a p-value of at most p. A small p shows that the ground differs. A
    large p shows nothing, because the ground may differ in a property that no feature measures.
    """
    pooled = np.concatenate([features, new[None]])
    middle = np.median(pooled, axis=0)
    off = np.abs(pooled - middle)
    spread = _DEVIATION_OF_MEDIAN * np.median(off, axis=0)
    # A unit of 0 would put the few grounds off the median farther away than any ground by another feature.
    spread = np.where(spread > 0, spread, _DEVIATION_OF_MEAN * off.mean(axis=0))
    scaled = np.divide(off, spread, out=np.zeros_like(off), where=spread > 0)
    score = scaled.max(axis=1)
    return Likeness(float((score >= score[-1]).mean()), int(scaled[-1].argmax()))
