"""The exact depth order disagreement against the double loop of its definition."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from icymoon.stereo.dod import depth_order_disagreement

pytestmark = pytest.mark.filterwarnings("error")


def brute_force(prediction, truth, tolerance=0.01):
    def labels(depth):
        with np.errstate(over="ignore", under="ignore"):
            ratio = depth[:, None] / depth[None, :]
        return (ratio > 1 + tolerance).astype(int) - (ratio < 1 - tolerance)

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
    assert depth_order_disagreement(prediction, truth) == brute_force(prediction, truth)


def test_equals_the_double_loop_on_neighbouring_floats_around_the_threshold():
    near = [1.01]
    for _ in range(20):
        near.append(np.nextafter(near[-1], 2))
    truth = np.array([1.0, *near, *(1 / np.array(near))])
    prediction = truth[::-1].copy()
    assert depth_order_disagreement(prediction, truth) == brute_force(prediction, truth)


def test_by_hand():
    # Ratios: 1 and 2 differ, 2 and 2.01 do not. The prediction turns the first pair round and
    # tells the second one apart: 4 of the 6 ordered pairs of three pixels.
    truth = np.array([1.0, 2.0, 2.01])
    assert depth_order_disagreement(np.array([3.0, 2.0, 4.0]), truth) == pytest.approx(4 / 6)
    assert depth_order_disagreement(truth, truth) == 0
    assert depth_order_disagreement(truth[::-1].copy(), np.array([1.0, 2.0, 3.0])) == pytest.approx(6 / 6)


def test_scale_does_not_matter():
    random = np.random.default_rng(0)
    truth = random.uniform(1, 20, 3000)
    assert depth_order_disagreement(truth * 8, truth) == 0


@pytest.mark.parametrize("count", [0, 1])
def test_undefined_below_two_pixels(count):
    assert np.isnan(depth_order_disagreement(np.ones(count), np.ones(count)))


def test_a_whole_image_takes_seconds_not_minutes():
    random = np.random.default_rng(0)
    truth = random.uniform(1, 20, 640 * 480)
    prediction = truth * random.normal(1, 0.02, truth.size)
    sample = random.integers(0, truth.size, (2, 10**6))
    start = time.process_time()
    share = depth_order_disagreement(prediction, truth)
    assert time.process_time() - start < 5  # about 1 on the machine it was written on; brute force 300
    # The share in a million random pairs, four standard errors around.
    prediction_of, truth_of = prediction[sample], truth[sample]
    labels = [(r[0] / r[1] > 1.01) * 1 - (r[0] / r[1] < 0.99) * 1 for r in (prediction_of, truth_of)]
    assert share == pytest.approx(np.mean(labels[0] != labels[1]), abs=4 * np.sqrt(share / 1e6))
