"""Depth and disparity metrics against hand computation and the laws they obey."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from icymoon.stereo.metrics import (
    DEPTH_METRICS,
    DISPARITY_METRICS,
    ERROR_STEPS_M,
    depth_metrics,
    disparity_metrics,
    error_curve,
)

pytestmark = pytest.mark.filterwarnings("error")

NAN = float("nan")
TRUTH = np.array([[1.0, 2.0, 4.0], [NAN, 3.0, 5.0]])
PREDICTION = np.array([[1.05, 2.5, 4.0], [1.0, NAN, 6.5]])


def test_by_hand():
    result = depth_metrics(PREDICTION, TRUTH)
    assert set(result) == set(DEPTH_METRICS)
    assert result["n"] == 4
    assert result["coverage"] == 4 / 5  # of five true pixels; the prediction without truth does not count
    assert result["l1_m"] == pytest.approx((0.05 + 0.5 + 0 + 1.5) / 4)
    assert result["median_m"] == pytest.approx((0.05 + 0.5) / 2)
    assert result["bias_m"] == pytest.approx((0.05 + 0.5 + 0 + 1.5) / 4)
    assert result["rmse_m"] == pytest.approx(math.sqrt((0.05**2 + 0.5**2 + 1.5**2) / 4))
    assert result["abs_rel"] == pytest.approx((0.05 + 0.25 + 0 + 0.3) / 4)
    assert (result["l1_rate_10"], result["l1_rate_30"], result["l1_rate_100"]) == (0.5, 0.5, 0.25)
    d = [math.log(1.05), math.log(1.25), 0.0, math.log(1.3)]
    paper = sum(x * x for x in d) / 4 - (sum(d) / 4) ** 2
    assert result["si_mse"] == pytest.approx(paper, rel=1e-12)
    assert result["si_rmse"] == pytest.approx(math.sqrt(paper), rel=1e-12)
    assert result["dod"] == 0  # 1.05 < 2.5 < 4 < 6.5 as 1 < 2 < 4 < 5


def test_disparity_by_hand():
    result = disparity_metrics(np.array([10.0, 11.5, NAN, 20.0, 5.0]), np.array([10.5, 10.0, 7.0, 16.0, NAN]))
    assert set(result) == set(DISPARITY_METRICS)
    assert result["epe_px"] == pytest.approx((0.5 + 1.5 + 4) / 3)
    assert result["bad_1"] == pytest.approx(2 / 3)
    assert result["bad_2"] == result["bad_3"] == pytest.approx(1 / 3)


def test_a_perfect_prediction():
    result = depth_metrics(TRUTH, TRUTH)
    assert result["coverage"] == 1
    for key in ("l1_m", "l1_rate_10", "si_mse", "si_rmse", "dod", "rmse_m", "bias_m"):
        assert result[key] == 0


positive = arrays(np.float64, st.integers(2, 40), elements=st.floats(0.05, 1000.0))


@settings(deadline=None)
@given(positive, st.floats(1e-3, 1e3), st.integers(0, 2**32 - 1))
def test_scale_invariant_metrics_do_not_see_the_scale(truth, scale, seed):
    assert depth_metrics(truth * scale, truth)["si_rmse"] < 1e-13  # and not NaN, as in float32 without two passes
    prediction = truth * np.random.default_rng(seed).uniform(0.8, 1.25, truth.size)
    one, other = depth_metrics(prediction, truth), depth_metrics(prediction * 1024, truth)
    assert other["si_mse"] == pytest.approx(one["si_mse"], rel=1e-9, abs=1e-25)
    assert other["dod"] == one["dod"]


@settings(deadline=None)
@given(positive, st.integers(0, 2**32 - 1))
def test_an_invalid_measurement_is_never_a_depth(truth, seed):
    """Whatever marks it, an invalid pixel changes coverage and nothing else."""
    random = np.random.default_rng(seed)
    prediction = truth * random.uniform(0.5, 2, truth.size)
    marks = np.array([NAN, 0.0, -1.0, np.inf, -np.inf])
    padded = depth_metrics(np.concatenate([prediction, marks]), np.concatenate([truth, np.ones(5)]))
    plain = depth_metrics(prediction, truth)
    assert padded.pop("coverage") == pytest.approx(truth.size / (truth.size + 5))
    plain.pop("coverage")
    assert padded == plain


def test_without_any_pixel_nothing_is_claimed():
    result = depth_metrics(np.full(4, NAN), np.ones(4))
    assert (result["n"], result["coverage"]) == (0, 0)
    assert all(math.isnan(value) for key, value in result.items() if key not in ("n", "coverage"))
    assert math.isnan(depth_metrics(np.ones(4), np.full(4, NAN))["coverage"])
    assert depth_metrics(np.ones(0), np.ones(0))["n"] == 0
    assert all(math.isnan(value) for value in disparity_metrics(np.full(2, NAN), np.ones(2)).values())


def test_one_pixel_has_no_order_and_no_scale_error():
    result = depth_metrics(np.array([2.0]), np.array([1.0]))
    assert (result["si_mse"], result["l1_m"]) == (0, 1)
    assert math.isnan(result["dod"])


def test_single_precision_and_whole_numbers_are_measured_in_double():
    truth = np.linspace(1, 9, 5000).astype(np.float32)
    assert depth_metrics(truth * np.float32(4), truth)["si_rmse"] < 1e-13
    assert depth_metrics(np.array([3, 4]), np.array([3, 5]))["l1_m"] == 0.5


def test_absurd_depths_warn_nobody():
    result = depth_metrics(np.array([1e200, 1e-200]), np.array([1.0, 1.0]))
    assert result["rmse_m"] == math.inf
    assert result["dod"] == 1


def test_error_curve_counts_missing_measurements_as_not_within():
    curve = error_curve(np.array([1.0, 2.05, NAN, 3.0]), np.array([1.0, 2.0, 2.0, NAN]))
    shares = dict(zip(ERROR_STEPS_M, curve, strict=True))
    assert shares[0.01] == pytest.approx(1 / 3)
    assert shares[0.1] == shares[10.0] == pytest.approx(2 / 3)
    assert curve == sorted(curve)
