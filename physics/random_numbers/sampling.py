"""Points that fill the unit cube, and their transformation to distributions.

Blender's Python has no SciPy, and a plan must give the same pairs everywhere, so these few functions are written here.
They agree with ``scipy.stats.qmc`` and ``torch.quasirandom``.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import NormalDist

import numpy as np

from ...support.arrays import Array

_SOBOL_BITS = 32
#: For each dimension after the first: the primitive polynomial modulo 2 as a binary number, and the initial
#: direction numbers m. Joe and Kuo 2008, SIAM J. Sci. Comput. 30, 2635: file new-joe-kuo-6.21201.
_JOE_KUO: tuple[tuple[int, tuple[int, ...]], ...] = (
    (3, (1,)),
    (7, (1, 3)),
    (11, (1, 3, 1)),
    (13, (1, 1, 1)),
    (19, (1, 1, 3, 3)),
    (25, (1, 3, 5, 13)),
    (37, (1, 1, 5, 5, 17)),
    (41, (1, 1, 5, 5, 5)),
    (47, (1, 1, 7, 11, 19)),
    (55, (1, 1, 5, 1, 1)),
    (59, (1, 1, 1, 3, 11)),
    (61, (1, 3, 5, 5, 31)),
    (67, (1, 3, 3, 9, 7, 49)),
    (91, (1, 1, 1, 15, 21, 21)),
    (97, (1, 3, 1, 13, 27, 49)),
    (103, (1, 1, 1, 15, 7, 5)),
    (109, (1, 3, 1, 15, 13, 25)),
    (115, (1, 1, 5, 5, 19, 61)),
    (131, (1, 3, 7, 11, 23, 15, 103)),
    (137, (1, 3, 7, 13, 13, 15, 69)),
    (143, (1, 1, 3, 13, 7, 35, 63)),
    (145, (1, 3, 5, 9, 1, 25, 53)),
    (157, (1, 3, 1, 13, 9, 35, 107)),
)
#: Largest number of dimensions of ``draw_sobol``.
MAX_DIMENSIONS = 1 + len(_JOE_KUO)


def _direction_numbers(dimension: int) -> Array:
    """Compute the direction numbers (32,) uint64 of a dimension: the binary fractions that the bits of an index add,
    modulo 2.
    """
    if dimension == 0:
        return np.array([1 << (_SOBOL_BITS - 1 - k) for k in range(_SOBOL_BITS)], np.uint64)
    polynomial, m = _JOE_KUO[dimension - 1]
    degree = polynomial.bit_length() - 1
    v = [number << (_SOBOL_BITS - 1 - k) for k, number in enumerate(m)]
    while len(v) < _SOBOL_BITS:
        new = v[-degree] ^ (v[-degree] >> degree)
        for k in range(1, degree):
            if polynomial >> (degree - k) & 1:
                new ^= v[-k]
        v.append(new)
    return np.array(v, np.uint64)


def draw_sobol(count: int, randoms: Sequence[np.random.Generator]) -> Array:
    """Draw the first ``count`` points (count, d) of Sobol's sequence in (0, 1); each of d axes has a random shift.

    The order is by Antonov and Saleev (1979). A digital shift (exclusive or with a random number) keeps a property of
    the sequence: each of 2^m equal parts of every axis contains one of the first 2^m points. Raises ValueError for more
    than ``MAX_DIMENSIONS`` axes.
    """
    if len(randoms) > MAX_DIMENSIONS:
        raise ValueError(f"{len(randoms)} axes, Sobol's sequence has {MAX_DIMENSIONS} here")
    index = np.arange(count, dtype=np.uint64)
    gray = index ^ (index >> np.uint64(1))
    columns = []
    for dimension, random in enumerate(randoms):
        bits = np.zeros(count, np.uint64)
        for k, number in enumerate(_direction_numbers(dimension)):
            bits ^= np.where(gray >> np.uint64(k) & np.uint64(1), number, np.uint64(0))
        shift = np.uint64(random.integers(0, 1 << _SOBOL_BITS))
        columns.append(((bits ^ shift).astype(np.float64) + 0.5) / (1 << _SOBOL_BITS))
    return np.stack(columns, axis=1)


def draw_latin_hypercube(count: int, randoms: Sequence[np.random.Generator]) -> Array:
    """Draw ``count`` points (count, d) in [0, 1), one at random in each of ``count`` equal parts of every axis. Each
    axis has its own generator in ``randoms``.

    Source: McKay, Beckman and Conover 1979, Technometrics 21, 239.
    """
    return np.stack([(random.permutation(count) + random.random(count)) / count for random in randoms], axis=1)


def draw_independent(count: int, randoms: Sequence[np.random.Generator]) -> Array:
    """Draw ``count`` independent, uniform points (count, d) in [0, 1); each axis has its own generator in
    ``randoms``.
    """
    return np.stack([random.random(count) for random in randoms], axis=1)


def to_uniform(share: Array, low: float, high: float) -> Array:
    """Compute the quantiles of the uniform distribution from ``low`` to ``high`` at shares from 0 to 1."""
    return low + share * (high - low)


def to_log_uniform(share: Array, low: float, high: float) -> Array:
    """Compute the quantiles of the distribution whose logarithm is uniform from ``low`` to ``high``, both above 0."""
    return np.clip(np.exp(to_uniform(share, np.log(low), np.log(high))), low, high)


def to_normal(share: Array, mean: float, deviation: float, low: float, high: float) -> Array:
    """Compute the quantiles of a normal distribution that is cut off at ``low`` and ``high`` and renormalised. Raises
    ValueError if less than 1e-12 of the distribution lies between them.

    If the mean is below ``low``, the tail is mirrored to the side on which the distribution function is accurate.
    """
    law = NormalDist(0.0, 1.0)
    ends = [(end - mean) / deviation for end in (low, high)]
    mirror = -1.0 if ends[0] > 0.0 else 1.0  # the distribution function is accurate in the lower tail
    ends = sorted(mirror * end for end in ends)
    first, last = (law.cdf(end) for end in ends)
    if last - first < 1e-12:
        raise ValueError("the normal distribution has almost nothing within its limits")
    turned = share if mirror > 0 else 1.0 - share
    inside = np.clip(first + turned * (last - first), 1e-300, 1.0 - 2.0**-53)
    return np.clip(mean + deviation * mirror * np.array([law.inv_cdf(p) for p in inside.tolist()]), low, high)


def to_whole_numbers(share: Array, low: int, high: int) -> Array:
    """Compute whole numbers from ``low`` to ``high``, both included, with equal probability."""
    return low + np.minimum((share * (high - low + 1)).astype(np.int64), high - low)
