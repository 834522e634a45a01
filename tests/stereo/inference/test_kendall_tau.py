"""Kendall's tau, from its definition and from laws."""

from __future__ import annotations

import math

import numpy as np
from icymoon.stereo.inference.kendall_tau import compute_kendall_tau_b


def test_one_order_its_opposite_and_one_swap():
    assert compute_kendall_tau_b([1, 2, 3, 4], [0.1, 0.2, 5.0, 9.0]) == 1
    assert compute_kendall_tau_b([1, 2, 3, 4], [9, 5, 2, 1]) == -1
    # 5 of the 6 pairs agree and 1 does not.
    assert compute_kendall_tau_b([1, 2, 3, 4], [1, 3, 2, 4]) == (5 - 1) / 6


def test_ties_of_one_list_count_as_in_tau_b():
    # 5 pairs are untied on the left and 6 on the right; all 5 agree.
    assert math.isclose(compute_kendall_tau_b([1, 1, 2, 3], [1, 2, 3, 4]), 5 / math.sqrt(5 * 6))


def test_lists_without_an_order_have_no_tau():
    assert math.isnan(compute_kendall_tau_b([1, 1, 1], [1, 2, 3]))
    assert math.isnan(compute_kendall_tau_b([], []))
    assert math.isnan(compute_kendall_tau_b([1], [2]))


def test_it_depends_on_order_alone():
    random = np.random.default_rng(3)
    one, other = random.normal(size=(2, 12))
    assert compute_kendall_tau_b(one, other) == compute_kendall_tau_b(np.exp(one), other**3)
    assert compute_kendall_tau_b(one, other) == -compute_kendall_tau_b(-one, other)
