"""Finds the methods that differ in the typical scene: all comparisons by one metric, as one family over scenes.

The typical difference is the pseudomedian of the scenes' differences, the median of the Walsh averages (Hodges and
Lehmann 1963). Its tests are Wilcoxon's signed ranks. Whole scenes get random signs, the same for all comparisons, and
an observed statistic is compared with the largest statistic of each flip (Westfall and Young 1993). The signs are those
of the differences *from the typical one*, so all results shift with the differences, and errors are equally rare where
methods differ much. A verdict means that an interval does not contain zero. A step-down procedure after the largest
difference would find a few more differences, but too many where methods are equal.

No test or interval of a *mean* can hold for every distribution (Bahadur and Savage 1956), so a mean gives no verdict.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist

import numpy as np

from ...physics.random_numbers.seeds import make_generator
from ...support.arrays import Array
from .walsh_averages import WalshSums, round_to_grid

#: Significance levels: the largest share of flips that may reach the statistic of a difference, for one comparison and
#: for several. Both are below the 5 % that the product states, because skewed differences have more errors, and the
#: largest of several statistics has even more; see ``docs/theory/inference.md``.
LIMIT_OF_ONE, LIMIT_OF_SEVERAL = 0.04, 0.028
#: Most scenes for which all flips are made. With more scenes, ``_FLIP_COUNT`` flips are drawn.
_MAX_EXACT_SCENES = 13
_FLIP_COUNT = 5000
_FLIPS_PER_STEP = 1000
#: Number of scenes below which sums of ranks, and their halves, are exact in single precision.
_MAX_SINGLE_PRECISION_SCENES = 4000
#: Probability with which the difference ``ComparisonFamily.detectable`` is found.
POWER = 0.8
#: Statistics whose ratio is above this differ by rounding and count as ties.
_TIE_RATIO = 1 - 1e-9
#: Relative difference of two numbers that counts as rounding.
_ROUNDING_SHARE = 1e-9


@dataclass(frozen=True)
class ComparisonFamily:
    """The comparisons of one family; arrays have one element per comparison.

    ``typical`` is the typical difference; ``low`` and ``high`` are its bounds. All bounds hold together in at least 93
    % of the data sets of ``docs/theory/inference.md``. ``p`` is adjusted for the family. Bounds and ``p`` are NaN with
    fewer than ``needed`` scenes, which a verdict takes. ``detectable`` is the difference that would be found in
    ``POWER`` of such data sets.
    """

    scenes: Array
    typical: Array
    low: Array
    high: Array
    p: Array
    detectable: Array
    needed: int

    @property
    def found(self) -> Array:
        """The comparisons, bool, in which the two methods differ."""
        return self.p <= find_limit(len(self.p)) + 1e-12


def find_limit(comparisons: int) -> float:
    """Return the significance level of a family of this size: the largest adjusted p of a verdict."""
    return LIMIT_OF_ONE if comparisons <= 1 else LIMIT_OF_SEVERAL


def count_scenes_needed(comparisons: int) -> int:
    """Return the smallest number of scenes with which this number of comparisons can have a verdict.

    With n scenes, two of 2^n choices of signs are as extreme as equal signs, and the signs may differ between
    comparisons. With fewer scenes no difference is large enough.
    """
    return math.ceil(math.log2(2 * max(comparisons, 1) / find_limit(comparisons)))


def count_scenes_for_methods(methods: int) -> int:
    """Return the smallest number of scenes with which this number of methods can have a verdict."""
    return count_scenes_needed(methods * (methods - 1) // 2)


def compare_in_typical_scene(differences: Array, seed: int) -> ComparisonFamily:
    """Find the columns of ``differences`` (scenes, comparisons) with a typical difference other than zero.

    NaN means undefined. A column with fewer than ``needed`` scenes is outside the family. The same seed makes the same
    flips.
    """
    columns = [_Differences(differences[~np.isnan(differences[:, k]), k]) for k in range(differences.shape[1])]
    scenes = np.array([len(column.sums.values) for column in columns], int)
    low, high, p, detectable = np.full((4, len(columns)), np.nan)
    found = ComparisonFamily(
        scenes,
        np.array([column.typical for column in columns], float),
        low,
        high,
        p,
        detectable,
        count_scenes_needed(len(columns)),
    )
    tested = np.flatnonzero(scenes >= found.needed)
    if not tested.size:
        return found
    norms = np.array([columns[k].norm for k in tested])
    maxima = (
        _flip_statistics(_rank_centred_differences(differences[:, tested], [columns[k] for k in tested]), seed) / norms
    )
    observed = np.array([columns[k].evidence for k in tested]) / norms
    largest = np.sort(maxima.max(axis=1))
    reached = len(largest) - np.searchsorted(largest, observed * _TIE_RATIO)
    p[tested] = np.maximum(reached, 1) / len(largest)
    limit = float(largest[math.ceil((1 - find_limit(len(columns))) * len(largest) - 1e-9) - 1])
    for place, k in enumerate(tested):
        low[k], high[k] = columns[k].bounds(limit * norms[place])
        detectable[k] = (high[k] - low[k]) / 2 * (1 + NormalDist().inv_cdf(POWER) / limit)
    return found


def find_differences(one: Array, other: Array, logarithmic: bool = False) -> Array:
    """Return the differences of two arrays, or of their logarithms; exactly 0 where they differ only by rounding."""
    alike = np.abs(one - other) <= _ROUNDING_SHARE * np.maximum(np.abs(one), np.abs(other))
    apart = np.log(one) - np.log(other) if logarithmic else one - other
    return np.where(alike, 0.0, apart)


class _Differences:
    """Differences of one comparison, finite (n,)."""

    def __init__(self, values: Array) -> None:
        ascending, self.unit = round_to_grid(values)
        self.sums = WalshSums(ascending)
        self.centre = self.sums.find_twice_median() if len(values) else 0  # four times the typical difference
        self.typical = self.centre * self.unit / 4 if len(values) else math.nan

    @property
    def norm(self) -> float:
        """Standard deviation of the signed-rank statistic of this number of values with random signs."""
        n = len(self.sums.values)
        return math.sqrt(n * (n + 1) * (2 * n + 1) / 6)

    @property
    def evidence(self) -> int:
        """Signed-rank statistic of the side with more ranks; averages of zero count for the other side."""
        return self.sums.count - 2 * min(self.sums.count_up_to(0), self.sums.count - self.sums.count_up_to(-1))

    def bounds(self, limit: float) -> tuple[float, float]:
        """Return the typical differences between which the signed-rank statistic is at most ``limit``."""
        outside = math.ceil((self.sums.count - limit) / 2 - 1e-6)
        if outside < 1:
            return -math.inf, math.inf
        return (self.sums.at(outside - 1) * self.unit / 2, self.sums.at(self.sums.count - outside) * self.unit / 2)


def _rank_centred_differences(differences: Array, columns: list[_Differences]) -> Array:
    """Return the signed ranks (scenes, comparisons) of the differences from the typical one, 0 where undefined."""
    units = np.array([column.unit for column in columns])
    known = ~np.isnan(differences)
    whole = np.rint(np.where(known, differences, 0.0) / units).astype(np.int64)
    apart = 4 * whole - np.array([column.centre for column in columns], np.int64)
    # The centre is a mean of two scenes, so both are always equally far from it. If they shared their ranks, and if a
    # scene at the centre had none, the statistic would vary less than Wilcoxon's, and too many differences would be
    # found.
    size = np.where(known, np.abs(apart), np.iinfo(np.int64).max)
    ranks = 1.0 + np.argsort(np.argsort(size, axis=0, kind="stable"), axis=0, kind="stable")
    return np.where(known, np.where(apart < 0, -ranks, ranks), 0.0)


def _flip_statistics(ranks: Array, seed: int) -> Array:
    """Compute the absolute statistics (flips, comparisons) of signed ranks with random signs of the scenes."""
    used, signs = (
        ranks.astype(np.float32 if len(ranks) < _MAX_SINGLE_PRECISION_SCENES else np.float64),
        _draw_signs(len(ranks), seed),
    )
    return np.concatenate(
        [
            np.abs(np.matmul(signs[start : start + _FLIPS_PER_STEP].astype(used.dtype), used))
            for start in range(0, len(signs), _FLIPS_PER_STEP)
        ]
    ).astype(np.float64)


@lru_cache(maxsize=1)
def _draw_signs(scenes: int, seed: int) -> Array:
    """Draw the signs of all flips, int8 (flips, scenes).

    With few scenes, these are all flips in which the first scene keeps its sign: the statistics do not change if all
    signs do.
    """
    if scenes <= _MAX_EXACT_SCENES:
        flipped = np.arange(2 ** max(0, scenes - 1))[:, None] >> np.arange(scenes)[::-1] & 1
    else:
        flipped = make_generator(seed, "statistics").integers(0, 2, (_FLIP_COUNT, scenes), np.int8)
    return (1 - 2 * flipped).astype(np.int8)


def find_rank_ranges(better: Array) -> list[tuple[int, int]]:
    """Return the best and the worst possible rank of each method.

    ``better`` (methods, methods), bool, states whether the row's method is significantly better than the column's. All
    these ranges hold together as often as the intervals (Mogstad, Romano, Shaikh and Wilhelm 2024).
    """
    count = len(better)
    return [(1 + int(better[:, k].sum()), count - int(better[k].sum())) for k in range(count)]


def list_method_pairs(count: int) -> list[tuple[int, int]]:
    """List the pairs of indices of ``count`` methods that are compared."""
    return list(itertools.combinations(range(count), 2))
