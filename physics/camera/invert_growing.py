"""Numerical inverses of functions that grow from 0 up to a fold."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ...support.arrays import Array

#: Number of bisections of an interval of a few rad until its ends are neighbouring floats.
_BISECTIONS = 60


def invert(function: Callable[[Array], Array], values: Array, limit: float) -> Array:
    """Find the arguments in [0, limit] at which a growing function takes ``values`` (any shape), to rounding; NaN for
    values outside its range.
    """
    low, high = np.zeros_like(values), np.full_like(values, limit)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        short = function(middle) < values
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    with np.errstate(invalid="ignore"):
        return np.where((values >= 0) & (values <= function(np.full_like(values, limit))), (low + high) / 2, np.nan)


def find_positive_roots(polynomial: Sequence[float] | Array) -> Array:
    """Find the positive roots of a polynomial, whose highest power comes first, in ascending order."""
    roots = np.roots(polynomial)
    return np.sort(roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)])


def find_smallest_positive_root(polynomial: Sequence[float] | Array) -> float:
    """Find the smallest positive root of a polynomial, whose highest power comes first; infinite without a root."""
    return float(min(find_positive_roots(polynomial), default=math.inf))
