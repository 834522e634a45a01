"""Kendall's tau-b, the agreement of the orders of two lists of numbers (Kendall 1938)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np


def compute_kendall_tau_b(one: Sequence[float], other: Sequence[float]) -> float:
    """Return Kendall's tau-b of two lists: 1 in the same order, -1 in the opposite order.

    NaN if all numbers of a list are equal.
    """
    signs = np.array(
        [(np.sign(one[i] - one[k]), np.sign(other[i] - other[k])) for i, k in combinations(range(len(one)), 2)]
    ).reshape(-1, 2)
    untied = (signs != 0).sum(axis=0)
    return float((signs[:, 0] * signs[:, 1]).sum() / np.sqrt(untied[0] * untied[1])) if untied.all() else float("nan")
