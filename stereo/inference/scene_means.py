"""Means over scenes, and confidence intervals of these means, with the stated coverage.

Scenes are independent. Pairs of one scene share its ground, so they are not independent, and pixels even less. A mean
over pairs is a ratio of sums over scenes (Cochran 1977, section 6.3), so scenes may have different numbers of pairs.
NaN means undefined.

* **Shares** are bounded, so their intervals hold for any number of scenes. Scenes get random weights, uniform among all
  that sum to 1, as in the Bayesian bootstrap (Rubin 1981). One more scene is added, which is all 0 for the lower bound
  and all 1 for the upper one. If each scene is 0 or 1, these are the bounds of Clopper and Pearson (1934).
* **Other means** can depend on a few large values that the scenes do not contain. So there is an interval only from
  ``FEWEST_FOR_MEAN`` scenes on, by the bootstrap-t (Efron and Tibshirani 1993), and below ``FEWEST_EXACT`` it is
  approximate. For quantities that are never negative, the interval is for the logarithm of the mean.

An interval does not hold for scenes of another kind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...physics.random_numbers.seeds import make_generator
from ...support.arrays import Array

COVERAGE = 0.95
#: Fewest scenes for an interval of a mean that is not a share, and fewest for the stated coverage.
FEWEST_FOR_MEAN, FEWEST_EXACT = 20, 50
#: Numbers of random weights (for shares) and of resamples (for other means), most elements of their arrays, and fewest
#: draws.
_WEIGHTS, _RESAMPLES, _MAX_ELEMENTS, _FEWEST_DRAWS = 10_000, 2000, 4_000_000, 1000
#: Relative error of a mean that counts as rounding.
_ROUNDING_SHARE = 1e-12


def average_by_scene(values: Array, scenes: Array) -> Array:
    """Return the mean (scenes, K) over the pairs of each scene, of each column of ``values`` (pairs, K).

    ``scenes`` is a whole number per pair. NaN means undefined.
    """
    sums, counts = _sum_by_scene(values, scenes)
    return np.divide(sums, counts, out=np.full(sums.shape, np.nan), where=counts > 0)


def find_mean_intervals(values: Array, scenes: Array, shares: Array) -> Array:
    """Find the lower and upper 95 % bound (K, 2) of the mean over pairs of each column of ``values`` (pairs, K).

    Columns where ``shares`` (K,) is true are from 0 to 1. A bound is NaN with too few scenes: fewer than two for
    shares, fewer than ``FEWEST_FOR_MEAN`` for other means.
    """
    sums, counts = _sum_by_scene(values, scenes)
    number = (counts > 0).sum(axis=0)
    bounds = np.full((values.shape[1], 2), np.nan)
    if (bounded := shares & (number >= 2)).any():
        bounds[bounded] = _bound_shares(sums[:, bounded], counts[:, bounded])
    signed = (sums < 0).any(axis=0)
    for positive in (True, False):
        those = ~shares & (number >= FEWEST_FOR_MEAN) & (signed != positive)
        if those.any():
            sample = _make_bootstrap_t(sums[:, those], counts[:, those], 0, positive)
            bounds[those] = sample.bounds(_find_quantile_of_resamples(sample.t))
    return bounds


def find_simultaneous_intervals(values: Array, seed: int) -> Array:
    """Find bounds (K, 2) of the means over scenes of the columns of ``values`` (scenes, K), by the largest |t| of a
    resample.

    All of them hold simultaneously in about 95 % of data sets. NaN for columns with fewer than ``FEWEST_FOR_MEAN``
    scenes.
    """
    known = ~np.isnan(values)
    told = known.sum(axis=0) >= FEWEST_FOR_MEAN
    bounds = np.full((values.shape[1], 2), np.nan)
    if told.any():
        sample = _make_bootstrap_t(np.where(known, values, 0.0)[:, told], known[:, told].astype(float), seed, False)
        bounds[told] = sample.bounds(
            np.full(told.sum(), _find_quantile_of_resamples(sample.t.max(axis=1, keepdims=True))[0])
        )
    return bounds


def _sum_by_scene(values: Array, scenes: Array) -> tuple[Array, Array]:
    """Return the sums and numbers (scenes, K) of the defined values of each scene."""
    label, scene = np.unique(scenes, return_inverse=True)
    defined = ~np.isnan(values)
    sums, counts = np.zeros((len(label), values.shape[1])), np.zeros((len(label), values.shape[1]))
    np.add.at(sums, scene, np.where(defined, values, 0.0))
    np.add.at(counts, scene, defined)
    return sums, counts


def _choose_draw_count(most: int, scenes: int) -> int:
    return max(_FEWEST_DRAWS, min(most, _MAX_ELEMENTS // scenes))


@lru_cache(maxsize=1)
def _draw_weights(scenes: int) -> Array:
    """Draw random weights (draws, 1 + scenes), without division by their sum; the first is the weight of the added
    scene.
    """
    return make_generator(0, "statistics", 1).standard_exponential((_choose_draw_count(_WEIGHTS, scenes), 1 + scenes))


@lru_cache(maxsize=1)
def _draw_resamples(scenes: int, seed: int) -> Array:
    """Draw the number of times that each resample contains each scene (draws, scenes)."""
    random = make_generator(seed, "statistics", 2)
    return np.stack(
        [
            np.bincount(random.integers(0, scenes, scenes), minlength=scenes)
            for _ in range(_choose_draw_count(_RESAMPLES, scenes))
        ]
    ).astype(float)


def _bound_shares(sums: Array, counts: Array) -> Array:
    weights = _draw_weights(len(sums))
    own, number = weights[:, 1:] @ sums, weights[:, 1:] @ counts
    added = weights[:, :1] * counts.max(axis=0)
    outside = (1 - COVERAGE) / 2
    return np.stack(
        [
            np.quantile(own / (number + added), outside, axis=0),
            np.quantile((own + added) / (number + added), 1 - outside, axis=0),
        ],
        axis=1,
    )


@dataclass(frozen=True)
class _Bootstrap:
    """Means (K,), their standard errors, and |t| (resamples, K).

    With ``logarithmic``, |t| is of the mean's logarithm.
    """

    mean: Array
    error: Array
    t: Array
    logarithmic: bool

    def bounds(self, limit: Array) -> Array:
        """Return the lower and upper bound (K, 2), ``limit`` (K,) standard errors below and above the mean."""
        half = np.where(self.error > 0, limit, 0.0) * self.error
        if not self.logarithmic:
            return np.stack([self.mean - half, self.mean + half], axis=1)
        with np.errstate(over="ignore"):
            factor = np.exp(np.divide(half, self.mean, out=np.zeros_like(half), where=self.mean > 0))
        return np.stack([self.mean / factor, self.mean * factor], axis=1)


def _make_bootstrap_t(sums: Array, counts: Array, seed: int, logarithmic: bool) -> _Bootstrap:
    """Make the bootstrap-t over scenes of the ratios of ``sums`` to ``counts`` (scenes, K).

    Sums are scaled to about 1, so that all columns have similar rounding errors.
    """
    size = np.abs(sums).max(axis=0)
    sums = sums / np.where(size > 0, size, 1.0)
    resamples = _draw_resamples(len(sums), seed)
    mean, error = _resample_ratios(np.ones((1, len(sums))), sums, counts)
    means, errors = _resample_ratios(resamples, sums, counts)
    error = np.where(error > _ROUNDING_SHARE, error, 0.0)
    if logarithmic:
        with np.errstate(divide="ignore", invalid="ignore"):
            apart = np.abs(np.log(np.where(mean > 0, means / np.where(mean > 0, mean, 1.0), 1.0))) * means
    else:
        apart = np.abs(means - mean)
    apart = np.where(np.isnan(apart), np.inf, apart)  # a resample of zeros, whose logarithm is infinite
    t = np.divide(apart, errors, out=np.where(apart > _ROUNDING_SHARE, np.inf, 0.0), where=errors > _ROUNDING_SHARE)
    return _Bootstrap(mean[0] * size, error[0] * size, t, logarithmic)


def _resample_ratios(times: Array, sums: Array, counts: Array) -> tuple[Array, Array]:
    """Return the ratio of sums over scenes (resamples, K), and its standard error.

    ``times`` (resamples, scenes) states how often a resample contains each scene.
    """
    told, alike = (counts > 0).sum(axis=0), bool((counts == counts[:1]).all())
    total, scenes = times @ sums, times.sum(axis=1, keepdims=True)
    number = scenes * counts[0] if alike else times @ counts
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = total / number
        mixed, squares = (
            (total * counts[0], number * counts[0]) if alike else (times @ (sums * counts), times @ counts**2)
        )
        square = times @ sums**2 - 2 * mean * mixed + mean**2 * squares
        return mean, np.sqrt(np.maximum(square, 0.0) * told / (told - 1)) / number


def _find_quantile_of_resamples(t: Array) -> Array:
    """Find the quantile COVERAGE of |t| (K,) over the resamples (resamples, K); missing values count as infinite."""
    ascending = np.sort(np.where(np.isnan(t), np.inf, t), axis=0)
    return np.asarray(ascending[math.ceil(COVERAGE * len(t)) - 1])
