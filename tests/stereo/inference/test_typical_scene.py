"""Verdicts on the typical scene: their laws, how often they are wrong, what they find, and what they leave open."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from icymoon.stereo.inference import typical_scene
from icymoon.stereo.inference.typical_scene import (
    compare_in_typical_scene,
    count_scenes_for_methods,
    count_scenes_needed,
    find_differences,
    find_limit,
    find_rank_ranges,
    list_method_pairs,
)

pytestmark = pytest.mark.filterwarnings("error")

DOCS = Path(__file__).parents[3] / "docs"
WORDS = {9: "nine", 10: "ten", 11: "eleven"}


def differences_of(errors):
    return np.stack([errors[:, a] - errors[:, b] for a, b in list_method_pairs(errors.shape[1])], axis=1)


def wilcoxon_p(values):
    """The share of signs by which the signed ranks are as far from 0, by listing all; no ties."""
    places = np.argsort(np.argsort(np.abs(values))) + 1
    all_signs = np.array(list(itertools.product((1, -1), repeat=len(values))))
    return np.mean(np.abs(all_signs @ places) >= abs(np.sign(values) @ places))


@pytest.mark.parametrize("scenes", [6, 7, 9, 12])
def test_one_comparison_is_wilcoxons_test(scenes):
    for seed in range(5):
        values = np.random.default_rng(seed).normal(0.6, 1, scenes)
        assert compare_in_typical_scene(values[:, None], 0).p[0] == pytest.approx(wilcoxon_p(values), abs=1e-12)


@pytest.mark.parametrize("scenes", [6, 7, 10, 20, 300])
def test_the_interval_is_what_the_test_does_not_refuse(scenes):
    values = np.random.default_rng(scenes).exponential(1, (scenes, 1))
    family = compare_in_typical_scene(values, 0)
    one, other = np.triu_indices(scenes)
    assert family.typical[0] == pytest.approx(np.median(values[one, 0] + values[other, 0]) / 2, rel=1e-9)
    for bound, outward in ((family.low[0], -1), (family.high[0], 1)):
        assert compare_in_typical_scene(values - (bound + 1e-6 * outward), 0).found[0]
        assert not compare_in_typical_scene(values - (bound - 1e-6 * outward), 0).found[0]


def test_a_shift_of_all_scenes_shifts_what_is_said_of_them():
    """So one rate of errors is that of methods that differ by any amount."""
    values = differences_of(np.random.default_rng(1).lognormal(0, 1, (11, 3)))
    shift = np.array([128.0, -64.0, -192.0])
    family, shifted = compare_in_typical_scene(values, 0), compare_in_typical_scene(values + shift, 0)
    np.testing.assert_allclose(shifted.typical - shift, family.typical, atol=1e-7)
    np.testing.assert_allclose(shifted.low - shift, family.low, atol=1e-7)
    np.testing.assert_allclose(shifted.high - shift, family.high, atol=1e-7)
    assert shifted.found.all()


def test_methods_in_another_order_and_scenes_in_another_order_say_the_same():
    values = differences_of(np.random.default_rng(7).normal([0.5, 0, 0], 1, (9, 3)))
    family = compare_in_typical_scene(values, 0)
    turned, mixed = (
        compare_in_typical_scene(-values, 0),
        compare_in_typical_scene(values[[4, 0, 8, 3, 1, 7, 2, 6, 5]], 0),
    )
    np.testing.assert_allclose(turned.low, -family.high)
    np.testing.assert_array_equal(turned.p, family.p)
    np.testing.assert_allclose(mixed.low, family.low)
    np.testing.assert_allclose(mixed.p, family.p, atol=0.01)  # equal ranks are in the order of scenes


@pytest.mark.parametrize(("methods", "scenes"), [(2, 6), (3, 8), (4, 9), (5, 10), (6, 11)])
def test_so_many_scenes_can_have_a_verdict_and_fewer_cannot(methods, scenes):
    """Two of 2^n choices of signs are as extreme as equal signs, for each comparison."""
    count = methods * (methods - 1) // 2
    assert count_scenes_for_methods(methods) == count_scenes_needed(count) == scenes
    assert 2 * count / 2**scenes <= find_limit(count) < 2 * count / 2 ** (scenes - 1)
    values = differences_of(100.0 * np.arange(methods) + np.random.default_rng(0).normal(0, 1, (scenes, methods)))
    assert compare_in_typical_scene(values, 0).found.all()
    few = compare_in_typical_scene(values[1:], 0)
    assert not few.found.any()
    assert np.isnan([few.p, few.low, few.high, few.detectable]).all()
    assert few.needed == scenes
    np.testing.assert_allclose(few.typical, values.mean(axis=0), atol=3)


def test_a_verdict_is_that_an_interval_does_not_contain_zero():
    for seed in range(60):
        family = compare_in_typical_scene(
            differences_of(np.random.default_rng(seed).normal([0, 0.4, 0.8, 1.6], 1, (12, 4))), 0
        )
        np.testing.assert_array_equal((family.low > 0) | (family.high < 0), family.found)
        assert ((family.low <= family.typical) & (family.typical <= family.high)).all()


def test_zeros_ties_and_rounding_are_no_evidence():
    none = compare_in_typical_scene(np.zeros((8, 3)), 0)
    assert none.p.tolist() == [1, 1, 1]
    assert (none.low == 0).all() & (none.high == 0).all()
    assert compare_in_typical_scene(np.full((6, 1), 0.1), 0).p.tolist() == [1 / 32]
    assert compare_in_typical_scene(np.full((20, 1), -0.1), 0).found.all()
    for different in range(9):  # the typical scene of 20 has no difference, so there is none to find
        values = np.zeros((20, 1))
        values[:different] = 1.0
        family = compare_in_typical_scene(values, 0)
        assert not family.found[0]
        assert family.low[0] == 0
    assert compare_in_typical_scene(np.zeros((0, 2)), 0).scenes.tolist() == [0, 0]
    assert np.isnan(compare_in_typical_scene(np.ones((1, 2)), 0).low).all()


def test_methods_that_differ_by_rounding_do_not_differ():
    errors = np.random.default_rng(0).lognormal(0, 1, 30)
    for logarithmic in (False, True):
        apart = find_differences(errors * (1 + 1e-13), errors, logarithmic)
        assert not apart.any()
        assert not compare_in_typical_scene(apart[:, None], 0).found[0]
    apart = find_differences(errors * 1.001, errors, True)
    assert compare_in_typical_scene(apart[:, None], 0).typical[0] == pytest.approx(math.log(1.001))
    assert np.isnan(find_differences(np.array([np.nan]), np.array([1.0]))).all()


def test_undefined_scenes_are_left_out_of_their_own_comparison_only():
    values = np.random.default_rng(5).normal(2.0, 1, (12, 2))
    with_holes = np.column_stack([values, np.full(12, np.nan)])
    with_holes[:4, 2] = 5.0, 5.0, 5.0, 5.1
    three = compare_in_typical_scene(with_holes, 0)
    assert three.scenes.tolist() == [12, 12, 4]
    assert three.found.tolist() == [True, True, False]
    np.testing.assert_allclose(three.low[:2], compare_in_typical_scene(values, 0).low)
    assert np.isnan(three.low[2])
    assert three.typical[2] == 5.0
    some = values.copy()
    some[3, 1] = np.nan
    alone = compare_in_typical_scene(np.delete(values[:, 1:], 3, axis=0), 0)
    assert compare_in_typical_scene(some[:, 1:], 0).p == alone.p
    assert compare_in_typical_scene(some[:, 1:], 0).high == alone.high


def test_the_same_seed_makes_the_same_flips():
    values = np.random.default_rng(6).normal(0.5, 1, (20, 3))
    np.testing.assert_array_equal(compare_in_typical_scene(values, 1).p, compare_in_typical_scene(values, 1).p)
    assert (compare_in_typical_scene(values, 1).p != compare_in_typical_scene(values, 2).p).any()
    np.testing.assert_array_equal(
        compare_in_typical_scene(values[:10], 1).p, compare_in_typical_scene(values[:10], 2).p
    )  # all flips, no chance


def test_one_difference_among_many_is_found_and_bounded():
    random = np.random.default_rng(2)
    family = compare_in_typical_scene(differences_of(random.normal([0, 0, 0, 1], 0.2, (12, 4))), 0)
    assert family.found.tolist() == [b == 3 for _, b in list_method_pairs(4)]
    assert (family.high[family.found] < 0).all()
    assert (family.low[~family.found] < 0).all()
    assert (family.high[~family.found] > 0).all()


def test_the_detectable_difference_is_found_as_often_as_it_says():
    """Two methods, 10 scenes, normal differences; of 600 data sets with that difference 80 % show it, but for 3
    standard errors of 1.6 % and the spread of the differences it is estimated from."""
    random = np.random.default_rng(4)
    stated = np.median([compare_in_typical_scene(random.normal(0, 1, (10, 1)), 0).detectable for _ in range(200)])
    found = np.mean([compare_in_typical_scene(random.normal(stated, 1, (10, 1)), 0).found[0] for _ in range(600)])
    assert found == pytest.approx(typical_scene.POWER, abs=0.07)


def test_many_scenes_take_little_memory():
    """Of 4200 scenes there are 9 million Walsh averages; sums of their ranks are beyond single precision."""
    values = np.random.default_rng(8).normal(0.02, 1, (4200, 1))
    family = compare_in_typical_scene(values, 0)
    assert family.typical[0] == pytest.approx(values.mean(), abs=0.02)
    half = 2.054 * (math.pi / 3) ** 0.5 / 4200**0.5  # of Wilcoxon's interval at 96 % with normal errors
    assert family.high[0] - family.low[0] == pytest.approx(2 * half, rel=0.05)


def test_ranks_are_bounded_by_the_verdicts():
    better = np.zeros((4, 4), bool)
    assert find_rank_ranges(better) == [(1, 4)] * 4
    better[0, 2] = better[0, 3] = better[1, 3] = True
    assert find_rank_ranges(better) == [(1, 2), (1, 3), (2, 4), (3, 4)]


def test_the_manual_states_these_numbers_of_scenes():
    needed = {methods: count_scenes_for_methods(methods) for methods in range(2, 9)}
    assert needed[6] == needed[7] == needed[8]  # which share a column
    metrics, tutorial = (
        (DOCS / page).read_text(encoding="utf-8") for page in ("theory/metrics.md", "tutorial/decisions.md")
    )
    assert f"| scenes that a verdict takes | {' | '.join(str(needed[methods]) for methods in range(2, 7))} |" in metrics
    assert f"no verdict on four matchers; {WORDS[needed[4]]} scenes would." in " ".join(tutorial.split())
