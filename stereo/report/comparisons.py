"""Which of several methods differ: all pairs of methods by one metric, as one family of paired tests over scenes.

The family's error rate is held: if nothing differs, some pair of methods is called different in at most 5 % of data
sets. This is the step-down max-T test (Westfall and Young 1993) with sign flips: if two methods do not differ, the
difference in a scene is as likely to have the other sign. The signs of whole scenes are flipped, the same for all
pairs of methods, and the largest statistic of each flip is what an observed one is compared with. The test is exact for
symmetric differences, and so for exchangeable methods; no interval from a bootstrap is, with few scenes.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...physics.random_numbers.seeds import generator
from .scene_intervals import LEVEL, student_quantile

#: With fewer scenes no flip of signs is rarer than 5 %, so there is no verdict.
FEWEST_SCENES = 6
#: Up to so many scenes all flips are made, otherwise ``_FLIPS``, the observed signs among them.
_MOST_EXACT = 13
_FLIPS = 10_000
_AT_ONCE = 1000
#: How often the difference that ``Family.detectable`` gives would be found.
POWER = 0.8
#: Statistics that are equal but for rounding count as ties.
_TIE = 1 - 1e-9
#: The share of the squares that a mean may explain. Beyond it, statistics depend on rounding.
_MOST_EXPLAINED = 1 - 1e-6


@dataclass(frozen=True)
class Family:
    """The tests of one family, an array element per comparison.

    ``low`` and ``high`` are 95 % bounds of ``mean``: simultaneous ones if there is a ``p``, otherwise those of
    Student's t for this comparison alone, and NaN for a single scene. ``p`` is adjusted for the family and NaN without
    a verdict. ``detectable`` is the difference that would be found in ``POWER`` of such data sets.
    """

    scenes: np.ndarray
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray
    p: np.ndarray
    detectable: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """Boolean: where the two methods differ."""
        return self.p <= 1 - LEVEL + 1e-12


def compare(differences: np.ndarray, seed: int) -> Family:
    """Test whether the mean over scenes of each column of ``differences`` (scenes, comparisons) is zero.

    NaN is undefined. A column with fewer than ``FEWEST_SCENES`` scenes is outside the family. The same seed makes the
    same flips.
    """
    known = ~np.isnan(differences)
    scenes = known.sum(axis=0)
    values = np.where(known, differences, 0.0)
    mean = np.divide(values.sum(axis=0), scenes, out=np.full(len(scenes), np.nan), where=scenes > 0)
    spread = np.where(known, differences - mean, 0.0)
    error = np.full(len(scenes), np.nan)
    several = scenes > 1
    error[several] = np.sqrt((spread ** 2).sum(axis=0)[several] / (scenes * (scenes - 1))[several])
    half = error * [student_quantile(int(n) - 1) if n > 1 else math.nan for n in scenes]
    p, detectable = np.full(len(scenes), np.nan), np.full(len(scenes), np.nan)
    tested = scenes >= FEWEST_SCENES
    if tested.any():
        flipped = values[:, tested]
        p[tested], limit = _step_down(flipped[flipped.any(axis=1)], scenes[tested], seed)
        if tested.sum() > 1:
            half[tested] = limit * error[tested]
        needed = {int(n): _detectable(limit, int(n)) for n in np.unique(scenes[tested])}
        detectable[tested] = error[tested] * [needed[int(n)] for n in scenes[tested]]
    return Family(scenes, mean, mean - half, mean + half, p, detectable)


def _step_down(values: np.ndarray, scenes: np.ndarray, seed: int) -> tuple[np.ndarray, float]:
    """The adjusted p of each column of ``values`` (scenes, comparisons), 0 where undefined, and the 0.95 quantile of
    the largest statistic of a flip."""
    squares = (values ** 2).sum(axis=0)
    observed = _statistics(values.sum(axis=0), squares, scenes)
    order = np.argsort(-observed, kind="stable")
    reached, largest = np.zeros(len(order)), []
    signs = _signs(len(values), seed)
    for start in range(0, len(signs), _AT_ONCE):
        # From the smallest observed statistic on, the largest of those that are still in question.
        flipped = _statistics(signs[start:start + _AT_ONCE] @ values, squares, scenes)[:, order[::-1]]
        maxima = np.maximum.accumulate(flipped, axis=1)[:, ::-1]
        reached += (maxima >= observed[order] * _TIE).sum(axis=0)
        largest.append(maxima[:, 0])
    maxima = np.sort(np.concatenate(largest))
    adjusted = np.empty(len(order))
    adjusted[order] = np.maximum.accumulate(reached / len(maxima))
    return adjusted, float(maxima[math.ceil(LEVEL * len(maxima)) - 1])


@lru_cache(maxsize=1)
def _signs(scenes: int, seed: int) -> np.ndarray:
    """The signs of all flips, int8 (flips, scenes). The first scene keeps its sign, as the statistics do not change if
    all signs do."""
    if scenes <= _MOST_EXACT:
        flipped = np.arange(2 ** max(0, scenes - 1))[:, None] >> np.arange(scenes)[::-1] & 1
    else:
        flipped = generator(seed, "statistics").integers(0, 2, (_FLIPS, scenes), np.int8)
        flipped[0] = 0
    return (1 - 2 * flipped).astype(np.int8)


def _statistics(sums: np.ndarray, squares: np.ndarray, scenes: np.ndarray) -> np.ndarray:
    """|t| from the sum and the sum of squares over scenes; 0 if all differences are 0."""
    explained = np.divide(sums ** 2, scenes * squares, out=np.zeros(sums.shape), where=squares > 0)
    explained = np.minimum(explained, _MOST_EXPLAINED)
    return np.asarray(np.sqrt((scenes - 1) * explained / (1 - explained)))


def _detectable(limit: float, scenes: int) -> float:
    """The true mean, in standard errors, at which a t of ``scenes`` normal differences is above ``limit`` with
    probability ``POWER``."""
    freedom = scenes - 1
    spread = np.linspace(0, 1 + 8 / math.sqrt(2 * freedom), 101)[1:]  # of the estimated over the true standard error
    density = (freedom - 1) * np.log(spread) - freedom * spread ** 2 / 2
    weights = np.exp(density - density.max())
    weights /= weights.sum()
    low, high = 0.0, 10.0 * limit + 10.0
    for _ in range(30):
        middle = (low + high) / 2
        power = sum(w * 0.5 * math.erfc((limit * s - middle) / math.sqrt(2))
                    for w, s in zip(weights.tolist(), spread.tolist(), strict=True))
        low, high = (middle, high) if power < POWER else (low, middle)
    return high


def ranks(better: np.ndarray) -> list[tuple[int, int]]:
    """The best and the worst possible rank of each method, from a boolean (methods, methods): the row's method is
    significantly better than the column's.

    All these ranges hold at once with 95 % (Mogstad, Romano, Shaikh and Wilhelm 2024).
    """
    count = len(better)
    return [(1 + int(better[:, k].sum()), count - int(better[k].sum())) for k in range(count)]


def pairs_of(count: int) -> list[tuple[int, int]]:
    """The comparisons of so many methods."""
    return list(itertools.combinations(range(count), 2))
