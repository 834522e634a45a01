"""The exact depth order disagreement against the double loop of its definition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from icymoon.stereo.measure import depth_order
from icymoon.stereo.measure.depth_order import measure_depth_order_disagreement, sample_disagreement

pytestmark = pytest.mark.filterwarnings("error")


def brute_force(prediction, truth, tolerance=0.01, antisymmetric=False):
    def labels(depth):
        with np.errstate(over="ignore", under="ignore"):
            ratio, inverse = depth[:, None] / depth[None, :], depth[None, :] / depth[:, None]
        farther = inverse > 1 + tolerance if antisymmetric else ratio < 1 - tolerance
        return (ratio > 1 + tolerance).astype(int) - farther

    n = len(truth)
    return int((labels(prediction) != labels(truth)).sum()) / (n * (n - 1))


#: Depths that tie, that lie in ratios of exactly 1.01, and that come from quantised disparities.
depths = st.one_of(
    st.sampled_from([1.0, 1.01, 1.01 * 1.01, 0.99, 2.0, 6.25, 6.3125, 1 / 1.01, 1 / 0.99]),
    st.integers(90, 110).map(lambda steps: 85.25 / (steps / 16)),
    st.floats(0.5, 2.0),
    st.floats(5e-324, 1e308),
)


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(depths, depths), min_size=2, max_size=60))
def test_equals_the_double_loop_bit_for_bit(pairs):
    prediction, truth = np.array(pairs).T
    assert measure_depth_order_disagreement(prediction, truth) == brute_force(prediction, truth)
    assert measure_depth_order_disagreement(prediction, truth, antisymmetric=True) == brute_force(
        prediction, truth, antisymmetric=True
    )


@pytest.mark.parametrize("entries", [depth_order._MAX_ENTRIES, 300, 20], ids=["one digit", "some", "many"])
@pytest.mark.parametrize("pixels", [0, 1, 2, 63, 64, 65, 400])
def test_regions_are_counted_as_if_alone_in_tables_of_any_size(monkeypatch, pixels, entries):
    monkeypatch.setattr(depth_order, "_MAX_ENTRIES", entries)
    random = np.random.default_rng(pixels)
    truth = random.uniform(1, 2, pixels)
    measured, region = random.random((2, pixels)) < 0.7
    for prediction in (np.round(truth, 1), truth * random.normal(1, 0.02, pixels)):
        found = depth_order.TrueOrder(truth).disagreements(np.where(measured, prediction, np.nan), measured, region)
        for share, where in zip(found, (measured, measured & region), strict=True):
            few = where.sum() < 2
            assert np.isnan(share) if few else share == brute_force(prediction[where], truth[where])


def test_bits_are_counted_without_numpys_own_function():
    words = np.random.default_rng(0).integers(0, 2**64, 1000, np.uint64)
    assert depth_order._add_up_bits(words).tolist() == [word.bit_count() for word in words.tolist()]


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(depths, depths), min_size=2, max_size=40))
def test_laws(pairs):
    prediction, truth = np.array(pairs).T
    share = measure_depth_order_disagreement(prediction, truth)
    assert 0 <= share <= 1
    assert measure_depth_order_disagreement(truth, prediction) == share  # it compares, it does not blame
    order = np.argsort(prediction, kind="stable")
    assert measure_depth_order_disagreement(prediction[order], truth[order]) == share
    assert measure_depth_order_disagreement(truth, truth) == 0


def test_equals_the_double_loop_on_neighbouring_floats_around_the_threshold():
    near = [1.01]
    for _ in range(20):
        near.append(np.nextafter(near[-1], 2))
    truth = np.array([1.0, *near, *(1 / np.array(near))])
    prediction = truth[::-1].copy()
    assert measure_depth_order_disagreement(prediction, truth) == brute_force(prediction, truth)


def test_numbers_by_hand():
    # Ratios: 1 and 2 differ, 2 and 2.01 do not. The prediction turns the first pair round and
    # tells the second one apart: 4 of the 6 ordered pairs of three pixels.
    truth = np.array([1.0, 2.0, 2.01])
    assert measure_depth_order_disagreement(np.array([3.0, 2.0, 4.0]), truth) == pytest.approx(4 / 6)
    assert measure_depth_order_disagreement(truth, truth) == 0
    assert measure_depth_order_disagreement(truth[::-1].copy(), np.array([1.0, 2.0, 3.0])) == pytest.approx(6 / 6)


def test_scale_does_not_matter():
    random = np.random.default_rng(0)
    truth = random.uniform(1, 20, 3000)
    assert measure_depth_order_disagreement(truth * 8, truth) == 0


@pytest.mark.parametrize("count", [0, 1])
def test_undefined_below_two_pixels(count):
    assert np.isnan(measure_depth_order_disagreement(np.ones(count), np.ones(count)))


def test_by_the_antisymmetric_order_a_ratio_is_an_order_both_ways_or_not_at_all():
    # 1.01005 > 1.01, but 1 / 1.01005 = 0.99005 > 0.99: by the paper's definition far one way round only.
    truth, prediction = np.array([1.0, 1.01005]), np.array([1.0, 1.0])
    assert measure_depth_order_disagreement(prediction, truth) == 0.5
    assert measure_depth_order_disagreement(prediction, truth, antisymmetric=True) == 1
    # And 1 / 1.0095 = 0.99059 > 0.99, 1.0095 < 1.01: no order either way.
    assert measure_depth_order_disagreement(prediction, np.array([1.0, 1.0095]), antisymmetric=True) == 0


def test_a_whole_image_and_a_sample_of_it():
    random = np.random.default_rng(0)
    truth = random.uniform(1, 20, 640 * 480)
    prediction = truth * random.normal(1, 0.02, truth.size)
    share = measure_depth_order_disagreement(prediction, truth)
    sampled = sample_disagreement(prediction, truth, 10**6, random)
    assert sampled == pytest.approx(share, abs=4 * np.sqrt(share / 1e6))  # four standard errors


def test_a_sample_is_of_unlike_pixels_and_repeatable():
    two = np.array([1.0, 2.0])
    assert sample_disagreement(two[::-1], two, 1000, np.random.default_rng(0)) == 1
    random = np.random.default_rng(1)
    truth, prediction = random.uniform(1, 9, (2, 500))
    draws = [sample_disagreement(prediction, truth, 1000, np.random.default_rng(5)) for _ in range(2)]
    assert draws[0] == draws[1]
    assert np.isnan(sample_disagreement(np.ones(1), np.ones(1), 10, random))


@settings(max_examples=200, deadline=None)
@given(st.lists(depths, min_size=1, max_size=30), st.randoms(use_true_random=False), st.booleans())
def test_a_threshold_is_found_from_any_guess(values, random, farther):
    """Rounding may put a guess beside the place, and one that is far off only takes longer."""
    distinct = np.unique(values)

    def holds(v, x):
        with np.errstate(over="ignore", under="ignore"):
            return ~(v / x < 0.99) if farther else v / x > 1.01

    guess = np.array([random.randint(0, distinct.size) for _ in distinct])
    wanted = [int(holds(v, distinct).sum()) for v in distinct]
    assert depth_order._correct_rounding(guess, distinct, holds).tolist() == wanted
