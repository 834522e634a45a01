"""Depth order disagreement, exact, over all pairs of pixels.

Two depths are ordered with a tolerance τ: ord(a, b) is +1 if a / b > 1 + τ, -1 if a / b < 1 - τ, else 0. The
disagreement is the share of the N (N - 1) ordered pairs (i, j), i ≠ j, for which ord(truth_i, truth_j) differs from
ord(prediction_i, prediction_j) (MegaDepth, Li and Snavely 2018). It is the DOD of the GUISS paper, which samples pairs.
Counting pairs one by one takes minutes for an image; the method here takes O(N log N):

For one i, the j with label +1 have less depth than a threshold, so they are a prefix of the pixels in the order of
their depth; the j with label -1 are a suffix. So everything follows from the sizes of prefixes, and from the number of
pixels that are in a prefix of one order and a prefix of the other. With P for the j of label +1 and U for the j of
label +1 or 0, i disagrees with |U| + |U'| + |P ∩ U'| + |U ∩ P'| - 2 |P ∩ P'| - 2 |U ∩ U'| pixels, where ' marks the
prediction. ``_PrefixCounts`` counts the pixels that two prefixes share.

The thresholds come from the same divisions as the definition. These are monotone in floating point, so the result
equals the double loop's. This holds also for ties and for ratios of exactly 1 + τ, which occur with quantised
disparities (6.3125 / 6.25).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array

DEPTH_TOLERANCE_SHARE = 0.01
#: Base-2 logarithm of the values per row of a table of counts, one for each bit of a word; and most entries of a table.
_GROUP_BITS, _MAX_ENTRIES = 6, 2**23
_GROUP_SIZE = 2**_GROUP_BITS
#: Pixels whose counts are looked up at once, so that the intermediate results stay in the processor's cache.
_PIXELS_PER_STEP = 2**13


def measure_depth_order_disagreement(
    prediction: Array, truth: Array, tolerance: float = DEPTH_TOLERANCE_SHARE, antisymmetric: bool = False
) -> float:
    """Measure the share, 0 to 1, of ordered pixel pairs whose depth order is wrong in the prediction.

    Both arrays have the same shape and contain positive finite depths. NaN for fewer than two pixels. With
    ``antisymmetric``, ord(a, b) is -1 if b / a > 1 + τ, so that it is always -ord(b, a). By the definition above this
    does not hold for ratios between 1 + τ and 1 / (1 - τ).
    """
    return TrueOrder(truth.ravel(), tolerance, antisymmetric).disagreements(
        prediction.ravel(), np.ones(truth.size, bool)
    )[0]


class TrueOrder:
    """The order of the true depths of an image, with which the orders of predictions are compared."""

    def __init__(self, truth: Array, tolerance: float = DEPTH_TOLERANCE_SHARE, antisymmetric: bool = False) -> None:
        """Sort the true depths (pixels,), which are positive and finite."""
        self._rule = tolerance, antisymmetric
        self._order = np.argsort(truth)
        depth, rank, size = _rank_depths(truth[self._order])
        start = _make_prefix_sums(size)
        # For each pixel in the order of depth, the numbers of pixels that are nearer by more than the tolerance, and
        # that are not farther.
        self._nearer, self._not_farther = (start[ends][rank] for ends in _find_thresholds(depth, *self._rule))

    def disagreements(self, prediction: Array, measured: Array, *regions: Array) -> list[float]:
        """Return the disagreement of depth order of the ``measured`` pixels, then of the measured pixels in each
        region.

        ``prediction`` (pixels,) is a positive finite depth where ``measured``; masks are Boolean (pixels,).
        """
        counted = measured[self._order]
        pixels, before = self._order[counted], _make_prefix_sums(counted)
        nearer, not_farther = before.take(self._nearer[counted]), before.take(self._not_farther[counted])
        predicted = prediction.take(pixels)
        order = np.argsort(predicted)
        depth, ascending, size = _rank_depths(predicted.take(order))
        rank = np.empty_like(ascending)
        rank[order] = ascending
        plus, upto = (ends.take(rank) for ends in _find_thresholds(depth, *self._rule))
        members = [region[pixels] for region in regions]
        counts = _PrefixCounts(rank, size, members)
        counted_in = [np.ones(pixels.size, bool), *members]
        in_true = [_make_prefix_sums(own) for own in counted_in]
        in_predicted = [_make_prefix_sums(np.bincount(rank[own], minlength=depth.size)) for own in counted_in]
        totals = [0] * len(counted_in)
        for start in range(0, pixels.size, _PIXELS_PER_STEP):
            some = slice(start, start + _PIXELS_PER_STEP)
            first, last, low, high = nearer[some], not_farther[some], plus[some], upto[some]
            found = [counts.below(*prefixes) for prefixes in ((first, high), (last, low), (first, low), (last, high))]
            for k, own in enumerate(counted_in):
                disagreeing = (
                    in_true[k].take(last)
                    + in_predicted[k].take(high)
                    + found[0][k]
                    + found[1][k]
                    - 2 * (found[2][k] + found[3][k])
                )
                totals[k] += int(disagreeing[own[some]].sum())
        sizes = [int(starts[-1]) for starts in in_true]
        return [
            float(total) / (count * (count - 1)) if count > 1 else float("nan")
            for total, count in zip(totals, sizes, strict=True)
        ]


def _make_prefix_sums(sizes: Array) -> Array:
    return np.concatenate([[0], np.cumsum(sizes)])


def _rank_depths(ascending: Array) -> tuple[Array, Array, Array]:
    """Rank sorted depths: return the distinct depths, the index of each depth among them, and how often each occurs."""
    first = np.ones(ascending.size, bool)
    np.not_equal(ascending[1:], ascending[:-1], out=first[1:])
    return ascending[first], np.cumsum(first) - 1, np.diff(np.append(np.flatnonzero(first), ascending.size))


def _find_thresholds(depths: Array, tolerance: float, antisymmetric: bool) -> tuple[Array, Array]:
    """Return, for each of the ascending distinct depths v, the number of depths x with ord(v, x) = 1, and the number
    with ord(v, x) not -1.
    """
    with np.errstate(over="ignore", under="ignore"):
        nearer = np.searchsorted(depths, depths / (1 + tolerance))
        nearer = _correct_rounding(nearer, depths, lambda v, x: v / x > 1 + tolerance)
        if antisymmetric:
            guess = np.searchsorted(depths, depths * (1 + tolerance))
            return nearer, _correct_rounding(guess, depths, lambda v, x: ~(x / v > 1 + tolerance))
        guess = np.searchsorted(depths, depths / (1 - tolerance))
        return nearer, _correct_rounding(guess, depths, lambda v, x: ~(v / x < 1 - tolerance))


def _correct_rounding(guess: Array, depths: Array, holds: Callable[[Array, Array], Array]) -> Array:
    """Correct the rounding of each prefix length: move it to the end of the range where ``holds(v, x)``."""
    last = depths.size - 1
    while True:
        too_long = (guess > 0) & ~holds(depths, depths.take(guess - 1, mode="clip"))
        too_short = (guess <= last) & holds(depths, depths.take(guess, mode="clip"))
        if not (too_long.any() or too_short.any()):
            return guess
        guess = guess - too_long + too_short


def sample_disagreement(
    prediction: Array, truth: Array, pairs: int, random: np.random.Generator, tolerance: float = DEPTH_TOLERANCE_SHARE
) -> float:
    """Sample the disagreement among ``pairs`` random ordered pairs of two different pixels. It is unbiased, and much
    faster.

    Its standard error is √(p (1 - p) / pairs). NaN for fewer than two pixels.
    """
    count = truth.size
    if count < 2:
        return float("nan")
    first = random.integers(0, count, pairs)
    second = (first + random.integers(1, count, pairs)) % count
    return measure_pair_disagreement(prediction.ravel(), truth.ravel(), first, second, tolerance)


def measure_pair_disagreement(
    prediction: Array, truth: Array, first: Array, second: Array, tolerance: float = DEPTH_TOLERANCE_SHARE
) -> float:
    """Measure the share of the pairs (first, second) of indices into flat arrays that disagree; NaN for no pair."""
    if not first.size:
        return float("nan")
    return float(
        np.mean(
            _find_order_labels(prediction[first], prediction[second], tolerance)
            != _find_order_labels(truth[first], truth[second], tolerance)
        )
    )


def _find_order_labels(a: Array, b: Array, tolerance: float) -> Array:
    with np.errstate(over="ignore", under="ignore"):
        ratio = a / b
    return (ratio > 1 + tolerance).astype(np.int8) - (ratio < 1 - tolerance)


@dataclass(frozen=True)
class _Level:
    """One digit of the values of ``_PrefixCounts``, which are sorted by their higher digits. Its tables hold, for every
    limit from 0 on, the numbers that follow from the limit alone.
    """

    counts: _DigitCounts
    digits: Array  # the digit of each limit
    begins: Array  # index of the first value with the same higher digits as a limit
    before: list[Array]  # the counts at ``begins``
    equal: Array  # number of values before ``begins`` that have the digit of a limit


class _PrefixCounts:
    """Counts the ``values[:prefix]`` that are less than a limit, over all values and over each region.

    ``values`` are whole numbers from 0 on; the number k occurs ``sizes[k]`` times. If few are different, a single table
    has the answer. Otherwise they are counted digit by digit, in a base that keeps the tables small. After sorting by
    the higher digits, the values that agree with the limit in these digits are next to each other, and a prefix of them
    is counted by the next digit (a wavelet tree with many branches).
    """

    def __init__(self, values: Array, sizes: Array, regions: Sequence[Array]) -> None:
        starts, limits = _make_prefix_sums(sizes), np.arange(sizes.size + 1)
        most = max(2, _MAX_ENTRIES // (values.size // _GROUP_SIZE + 1))
        levels = next(count for count in range(1, 64) if most**count > sizes.size)
        base = next(base for base in range(int(sizes.size ** (1 / levels)), most + 1) if base**levels > sizes.size)
        self._levels = []
        for level in reversed(range(levels)):
            step = base**level
            counts, digits = _DigitCounts(values // step % base, base, regions), limits // step % base
            begins = starts[limits // (step * base) * (step * base)]
            before = counts.below(begins, digits)
            self._levels.append(_Level(counts, digits, begins, before, counts.below(begins, digits + 1)[0] - before[0]))
            if level:
                order = np.argsort(values // step, kind="stable")
                values, regions = values[order], [region[order] for region in regions]

    def below(self, prefixes: Array, limits: Array) -> list[Array]:
        """Count, for each k, the first ``prefixes[k]`` values that are below ``limits[k]``: of all values, then of the
        values of each region.
        """
        totals: list[Array] = []
        for level, lower in zip(self._levels, (*self._levels[1:], None), strict=True):
            digits = level.digits.take(limits)
            found = level.counts.below(prefixes, digits)
            part = [counts - before.take(limits) for counts, before in zip(found, level.before, strict=True)]
            totals = [a + b for a, b in zip(totals, part, strict=True)] if totals else part
            if lower:
                equal = level.counts.below(prefixes, digits + 1)[0] - found[0] - level.equal.take(limits)
                prefixes = lower.begins.take(limits) + equal
        return totals


class _DigitCounts:
    """The number of ``digits[:prefix]``, each from 0 to ``base`` - 1, that are less than a limit of 0 to ``base``.

    A table has the counts for prefixes of whole groups. Within a group, words of 64 bits mark its lowest 0, 1, ..., 64
    digits; the number of digits below the limit follows from two rows of the table.
    """

    def __init__(self, digits: Array, base: int, regions: Sequence[Array]) -> None:
        groups = digits.size // _GROUP_SIZE + 1
        self._columns = base + 2
        place = np.arange(_GROUP_SIZE, dtype=np.int64)
        ascending = np.sort(_pad_into_groups(digits, groups, base) * _GROUP_SIZE + place, axis=1)
        place = ascending % _GROUP_SIZE
        self._words = np.zeros((groups, _GROUP_SIZE + 1), np.uint64)
        np.cumsum(np.uint64(1) << place.astype(np.uint64), axis=1, out=self._words[:, 1:])
        row = np.arange(groups)[:, None]
        cells = (row * (base + 1) + ascending // _GROUP_SIZE).ravel()
        first = np.flatnonzero(np.diff(cells, prepend=-1))
        where = (row * _GROUP_SIZE + place).ravel()
        inside = [_pad_into_groups(region, groups, False) for region in regions]
        members = [np.ones(cells.size, np.uint8), *(each.ravel()[where].astype(np.uint8) for each in inside)]
        self._tables = [self._table(groups, cells[first], np.add.reduceat(each, first)) for each in members]
        self._regions = [
            (each.astype(np.uint64) << np.arange(_GROUP_SIZE, dtype=np.uint64)).sum(axis=1) for each in inside
        ]

    def _table(self, groups: int, cells: Array, counts: Array) -> Array:
        """Make a table that has, for each group and digit, the count of all smaller digits in all earlier groups."""
        # Imported here, because Blender has no OpenCV, and uses other functions of these modules to paint errors.
        import cv2

        table = np.zeros((groups, self._columns - 1), np.uint8)
        table.ravel()[cells] = counts
        return np.asarray(cv2.integral(table, sdepth=cv2.CV_32S)).ravel()

    def below(self, prefixes: Array, limits: Array) -> list[Array]:
        """Count the smaller digits for pairs of a prefix and a limit: of all digits, then of the digits in each
        region.
        """
        group, rest = prefixes >> _GROUP_BITS, prefixes & _GROUP_SIZE - 1  # far faster than to divide
        cell = group * self._columns + limits
        before = self._tables[0].take(cell)
        rank = self._tables[0].take(cell + self._columns) - before
        words = self._words.ravel().take(group * (_GROUP_SIZE + 1) + rank) & _LOWEST_BITS.take(rest)
        return [
            before + _count_ones(words),
            *(
                table.take(cell) + _count_ones(words & members.take(group))
                for table, members in zip(self._tables[1:], self._regions, strict=True)
            ),
        ]


#: Words with the lowest 0, 1, ..., 63 bits.
_LOWEST_BITS = (np.uint64(1) << np.arange(_GROUP_SIZE, dtype=np.uint64)) - np.uint64(1)


def _pad_into_groups(values: Array, groups: int, rest: int) -> Array:
    """Pad values to an array (groups, 64), with ``rest`` after the last value."""
    padded = np.full(groups * _GROUP_SIZE, rest, values.dtype)
    padded[: values.size] = values
    return padded.reshape(groups, _GROUP_SIZE)


def _add_up_bits(words: Array) -> Array:
    """Count the set bits of each word, by sums over pairs of bits, fours, bytes, and the whole word."""
    ones, twos, fours, bytes_ = (np.uint64(0x0101010101010101 * k) for k in (0x55, 0x33, 0x0F, 0x01))
    words = words - (words >> np.uint64(1) & ones)
    words = (words & twos) + (words >> np.uint64(2) & twos)
    return (words + (words >> np.uint64(4)) & fours) * bytes_ >> np.uint64(56)


def _count_ones(words: Array) -> Array:
    return np.asarray(_BITWISE_COUNT(words)).astype(np.int32)


_BITWISE_COUNT = getattr(np, "bitwise_count", _add_up_bits)  # numpy has it from 2.0 on
