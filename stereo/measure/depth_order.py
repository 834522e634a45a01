"""Depth order disagreement, exactly, over all pairs of pixels.

Two depths are ordered with a tolerance τ: ord(a, b) is +1 if a / b > 1 + τ, -1 if a / b < 1 - τ, else 0. The
disagreement is the share of the N (N - 1) ordered pairs (i, j), i ≠ j, for which ord(truth_i, truth_j) differs from
ord(prediction_i, prediction_j) (MegaDepth, Li and Snavely 2018). It is the DOD of the GUISS paper, which samples pairs.
Counting pairs one by one takes minutes for an image; the method here takes O(N log N):

For one i, the j with label +1 have less depth than a threshold, so they are a prefix of the pixels in the order of
their depth; those with label -1 are a suffix. So everything follows from the sizes of prefixes, and from the number of
pixels that are in a prefix of one order and a prefix of the other. A wavelet matrix (Claude, Navarro, Ordóñez 2015)
gives these two-dimensional counts for all i together, in one pass over the bits of the rank.

The thresholds come from the same divisions as the definition. These are monotone in floating point, so the result is
that of the double loop, also for ties and for ratios of exactly 1 + τ, which occur with quantised disparities
(6.3125 / 6.25).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

TOLERANCE = 0.01


def depth_order_disagreement(prediction: np.ndarray, truth: np.ndarray, tolerance: float = TOLERANCE,
                             antisymmetric: bool = False) -> float:
    """Share, 0 to 1, of ordered pixel pairs whose depth order the prediction gets wrong.

    Both arrays have the same shape and contain positive finite depths. NaN for fewer than two pixels. With
    ``antisymmetric``, ord(a, b) is -1 if b / a > 1 + τ, so that it is always -ord(b, a). By the definition above this
    does not hold for ratios between 1 + τ and 1 / (1 - τ).
    """
    count = truth.size
    if count < 2:
        return float("nan")
    true_depth, true_rank, true_size = np.unique(truth.ravel(), return_inverse=True, return_counts=True)
    depth, rank, size = np.unique(prediction.ravel(), return_inverse=True, return_counts=True)
    true_start, start = _starts(true_size), _starts(size)

    # Per pixel and order: how many ranks are nearer by more than the tolerance, and how many are not farther.
    order = np.argsort(true_rank, kind="stable")
    true_rank, rank = true_rank[order], rank[order]
    true_nearer, true_not_farther = _thresholds(true_depth, tolerance, antisymmetric)
    nearer, not_farther = _thresholds(depth, tolerance, antisymmetric)
    true_plus, true_upto = true_start[true_nearer][true_rank], true_start[true_not_farther][true_rank]
    plus_rank, upto_rank = nearer[rank], not_farther[rank]
    plus, upto = start[plus_rank], start[upto_rank]

    both_plus, upto_upto, true_plus_upto, true_upto_plus = np.split(_prefix_counts(
        rank, depth.size, np.concatenate([true_plus, true_upto, true_plus, true_upto]),
        np.concatenate([plus_rank, upto_rank, upto_rank, plus_rank])), 4)
    labelled = (true_plus + (count - true_upto) + plus + (count - upto)).sum()
    same_sign = both_plus.sum() + (count - true_upto - upto + upto_upto).sum()
    opposite_sign = (true_plus - true_plus_upto).sum() + (plus - true_upto_plus).sum()
    # ``labelled`` counts a pair twice if it has a label in both orders. With the same sign it agrees; with opposite
    # signs it disagrees once. A pixel paired with itself has label 0 in both, and never counts.
    return float(int(labelled) - 2 * int(same_sign) - int(opposite_sign)) / (count * (count - 1))


def _starts(sizes: np.ndarray) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(sizes)])


def _thresholds(depths: np.ndarray, tolerance: float, antisymmetric: bool) -> tuple[np.ndarray, np.ndarray]:
    """For each of the ascending distinct depths v, the number of depths x with ord(v, x) = 1, and of those with
    ord(v, x) not -1."""
    with np.errstate(over="ignore", under="ignore"):
        nearer = np.searchsorted(depths, depths / (1 + tolerance))
        nearer = _corrected(nearer, depths, lambda v, x: v / x > 1 + tolerance)
        if antisymmetric:
            guess = np.searchsorted(depths, depths * (1 + tolerance))
            return nearer, _corrected(guess, depths, lambda v, x: ~(x / v > 1 + tolerance))
        guess = np.searchsorted(depths, depths / (1 - tolerance))
        return nearer, _corrected(guess, depths, lambda v, x: ~(v / x < 1 - tolerance))


def _corrected(guess: np.ndarray, depths: np.ndarray,
               holds: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """Move each prefix length, which is right except for rounding, to where ``holds(v, x)`` ends."""
    last = depths.size - 1
    while True:
        too_long = (guess > 0) & ~holds(depths, depths[np.maximum(guess - 1, 0)])
        too_short = (guess <= last) & holds(depths, depths[np.minimum(guess, last)])
        if not (too_long.any() or too_short.any()):
            return guess
        guess = guess - too_long + too_short


def sampled_disagreement(prediction: np.ndarray, truth: np.ndarray, pairs: int, random: np.random.Generator,
                         tolerance: float = TOLERANCE) -> float:
    """The disagreement among ``pairs`` random ordered pairs of two different pixels: unbiased, and much faster.

    Its standard error is √(p (1 - p) / pairs). NaN for fewer than two pixels.
    """
    count = truth.size
    if count < 2:
        return float("nan")
    first = random.integers(0, count, pairs)
    second = (first + random.integers(1, count, pairs)) % count
    return pair_disagreement(prediction.ravel(), truth.ravel(), first, second, tolerance)


def pair_disagreement(prediction: np.ndarray, truth: np.ndarray, first: np.ndarray, second: np.ndarray,
                      tolerance: float = TOLERANCE) -> float:
    """Share of the pairs (first, second) of indices into flat arrays that disagree; NaN for no pair."""
    if not first.size:
        return float("nan")
    return float(np.mean(_order(prediction[first], prediction[second], tolerance)
                         != _order(truth[first], truth[second], tolerance)))


def _order(a: np.ndarray, b: np.ndarray, tolerance: float) -> np.ndarray:
    with np.errstate(over="ignore", under="ignore"):
        ratio = a / b
    return (ratio > 1 + tolerance).astype(np.int8) - (ratio < 1 - tolerance)


def _prefix_counts(values: np.ndarray, bound: int, prefixes: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """How many of ``values[:prefix]`` are less than ``limit``, for each prefix and limit.

    ``values`` are whole numbers from 0 to ``bound`` - 1, limits 0 to ``bound``.
    """
    # For prefix 0 the answer is 0, but the walk below gives the number of values in the branches before it. This
    # depends on the limit alone and is subtracted at the end.
    limits = np.concatenate([limits, np.arange(bound + 1)]).astype(np.int32)
    position = np.concatenate([prefixes, np.zeros(bound + 1, np.intp)]).astype(np.int32)
    found = np.zeros(limits.size, np.int64)
    values = values.astype(np.int32)
    for bit in reversed(range(bound.bit_length())):
        ones = (values >> bit & 1).astype(bool)
        zeros_before = np.concatenate([[0], np.cumsum(~ones)]).astype(np.int32)
        zeros = zeros_before[position]
        up = (limits >> bit & 1).astype(bool)
        np.add(found, zeros, out=found, where=up)
        position = np.where(up, zeros_before[-1] + position - zeros, zeros)
        values = np.concatenate([values[~ones], values[ones]])
    queries = prefixes.size
    return found[:queries] - found[queries:][limits[:queries]]
