"""Metrics of confidence against closed forms, loops, and the laws they obey."""

import math

import numpy as np
import pytest
from icymoon.stereo.measure.confidence_metrics import (
    BAD_PX,
    CALIBRATION_CLASSES,
    CONFIDENCE_METRICS,
    CONFIDENCE_SHARES,
    add_calibration,
    compute_calibration_error,
    measure_confidence,
)
from icymoon.stereo.measure.metrics import BAD_RATES, KEPT_SHARES

pytestmark = pytest.mark.filterwarnings("error")

NAN = float("nan")
RANDOM = np.random.default_rng(0)


def measure(errors, confidence, more_true=0):
    """Of measurements with these errors, beside true pixels that were not measured."""
    errors = np.asarray(errors, float)
    missing = np.full(more_true, NAN)
    found = measure_confidence(
        np.concatenate([100 + errors, missing]),
        np.full(errors.size + more_true, 100.0),
        {"own": np.concatenate([confidence, np.zeros(more_true)])},
    )
    return found["own"]


def test_the_order_of_the_errors_is_ideal_and_every_other_order_is_worse():
    errors = RANDOM.exponential(1.0, 500)
    ideal = measure(errors, np.exp(-errors))
    assert ideal["ause"] == pytest.approx(0, abs=1e-6)  # confidences in single precision: errors may tie
    assert ideal["curve"] == pytest.approx(ideal["best"], rel=1e-6)
    reverse = measure(errors, 1 - np.exp(-errors))["ause"]
    assert reverse > measure(errors, RANDOM.random(500))["ause"] > 0.3


def test_ause_is_the_area_that_a_plain_loop_finds():
    errors, confidence = RANDOM.gamma(0.5, 1.0, 60), RANDOM.permutation(60) / 60
    falling = sorted(range(60), key=lambda k: -confidence[k])
    rising = sorted(errors)
    area = 0.0
    for kept in range(1, 61):
        mine = sum(errors[k] for k in falling[:kept]) / kept
        area += (mine - sum(rising[:kept]) / kept) / 60
    found = measure(errors, confidence)
    assert found["ause"] == pytest.approx(area / np.mean(errors), rel=1e-12)
    half = KEPT_SHARES.index(0.5)
    assert found["curve"][half] == pytest.approx(np.mean([errors[k] for k in falling[:30]]))


def test_a_constant_confidence_is_worth_the_mean_of_all_random_orders():
    """Errors spread evenly from 0 to 1: the best k of n have the mean k / 2n, and these have the mean (n + 1) / 4n."""
    errors = (np.arange(1000) + 0.5) / 1000
    constant = measure(errors, np.full(1000, 0.3))
    assert constant["ause"] == pytest.approx(1 - 1001 / 4000 / 0.5, abs=1e-12)
    assert constant["curve"] == pytest.approx([0.5] * len(KEPT_SHARES))
    shuffled = [measure(errors, RANDOM.random(1000))["ause"] for _ in range(30)]
    assert np.mean(shuffled) == pytest.approx(constant["ause"], abs=4 * np.std(shuffled) / math.sqrt(30))


def test_errors_of_two_sizes_have_the_ideal_area_of_hu_and_mordohai():
    """A share e of wrong pixels: the best order has the area e + (1 - e) ln(1 - e); 20,000 pixels are close to it."""
    share, count = 0.2, 20000
    errors = (np.arange(count) < share * count).astype(float)
    ideal = share + (1 - share) * math.log(1 - share)
    assert measure(errors, np.ones(count))["ause"] == pytest.approx(1 - ideal / share, abs=5 / count)


@pytest.mark.parametrize("turn", [np.sqrt, lambda c: c**4, lambda c: 0.1 + 0.2 * c])
def test_a_monotone_change_of_the_confidence_changes_nothing_but_the_calibration(turn):
    errors, confidence = RANDOM.exponential(1.0, 300), RANDOM.permutation(300) / 300
    before, after = measure(errors, confidence, 20), measure(errors, turn(confidence), 20)
    assert after["ece"] != before["ece"]
    for key in ("ause", "coverage_at_bad_2", "bad_2_at_90", "curve"):
        assert after[key] == before[key]


def test_nothing_depends_on_the_order_of_the_image():
    errors, confidence = RANDOM.exponential(2.0, 200), RANDOM.integers(0, 4, 200) / 3
    order = RANDOM.permutation(200)
    before, after = measure(errors, confidence, 10), measure(errors[order], confidence[order], 10)
    for key in (*CONFIDENCE_METRICS, "curve", "best"):
        assert after[key] == pytest.approx(before[key], rel=1e-12)


def test_coverage_at_a_stated_error_cuts_between_confidences_only():
    """96 right and 4 bad: all may stay only if 3 % are bad at most. Ties are kept or dropped together."""
    errors = np.concatenate([np.zeros(96), np.full(4, BAD_PX + 1)])
    sure = np.concatenate([np.ones(96), np.full(4, 0.5)])
    assert measure(errors, sure, 100)["coverage_at_bad_2"] == 96 / 200
    assert measure(errors, np.ones(100), 100)["coverage_at_bad_2"] == 0.0
    steps = np.concatenate([np.ones(96), [0.9, 0.8, 0.7, 0.6]])
    assert measure(errors, steps, 100)["coverage_at_bad_2"] == 98 / 200  # 2 of 98 is under 3 %, 3 of 99 is not
    assert measure(np.full(5, BAD_PX), np.ones(5))["coverage_at_bad_2"] == 1.0  # exactly 2 px is not bad


def test_the_error_at_a_stated_coverage_is_of_true_pixels():
    errors = np.concatenate([np.zeros(80), np.full(20, 9.0)])
    confidence = np.arange(100, 0, -1) / 100
    assert measure(errors, confidence)["bad_2_at_90"] == pytest.approx(10 / 90)
    assert measure(errors, confidence, 10)["bad_2_at_90"] == pytest.approx(19 / 99)  # 90 % of 110
    assert measure(errors, np.ones(100))["bad_2_at_90"] == pytest.approx(0.2)
    assert math.isnan(measure(errors, confidence, 12)["bad_2_at_90"])  # 101 of 112 pixels are not measured


def test_a_confidence_that_is_the_chance_of_being_right_is_calibrated():
    chance = (RANDOM.integers(0, CALIBRATION_CLASSES, 40000) + 0.5) / CALIBRATION_CLASSES
    right = RANDOM.random(40000) < chance
    found = measure(np.where(right, 0.5, 1.5), chance)
    # The mean of |binomial error| of 15 classes of 2667 pixels is below sqrt(0.25 / 2667).
    assert found["ece"] < 0.01
    assert measure(np.where(right, 0.5, 1.5), np.ones(40000))["ece"] == pytest.approx(1 - right.mean())
    sums = found["calibration"]
    assert sum(sums["n"]) == 40000
    assert sum(sums["right"]) == right.sum()
    both = add_calibration(add_calibration(None, sums), sums)
    assert both["n"] == [2 * n for n in sums["n"]]
    assert compute_calibration_error(both) == pytest.approx(found["ece"])


def test_confidences_of_0_and_1_have_classes():
    found = measure([0.0, 0.0, 3.0], [1.0, 0.0, 0.0])
    assert found["calibration"]["n"] == [2.0, *[0.0] * (CALIBRATION_CLASSES - 2), 1.0]
    assert found["ece"] == pytest.approx(1 / 3)  # two of confidence 0, one of which is right


def test_what_is_undefined_is_no_number():
    nothing = measure([], [], 5)
    assert all(math.isnan(nothing[key]) for key in ("ause", "ece", "bad_2_at_90"))
    assert nothing["coverage_at_bad_2"] == 0.0  # nothing of five pixels
    assert (nothing["curve"], nothing["best"]) == ([], [])
    assert math.isnan(measure([0.0, 0.0], [0.5, 1.0])["ause"])  # no error, so no order of errors
    no_truth = measure_confidence(np.ones(3), np.full(3, NAN), {"own": np.ones(3)})["own"]
    assert all(math.isnan(no_truth[key]) for key in CONFIDENCE_METRICS)


def test_names_state_their_limits():
    assert BAD_RATES["bad_2"] == BAD_PX
    assert set(CONFIDENCE_SHARES) < set(CONFIDENCE_METRICS)
