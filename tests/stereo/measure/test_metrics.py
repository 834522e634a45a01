"""Depth and disparity metrics against hand computation and the laws they obey."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from icymoon.stereo.measure import metrics
from icymoon.stereo.measure.metrics import (
    DEPTH_METRICS,
    DISPARITY_METRICS,
    ERROR_STEPS_M,
    KEPT_SHARES,
    TOTAL_METRICS,
    compute_depth_metrics,
    compute_disparity_metrics,
    compute_error_curve,
    compute_sparsification,
    compute_total_metrics,
    find_wrong_share,
    sort_by_confidence,
)

pytestmark = pytest.mark.filterwarnings("error")

NAN = float("nan")
TRUTH = np.array([[1.0, 2.0, 4.0], [NAN, 3.0, 5.0]])
PREDICTION = np.array([[1.05, 2.5, 4.0], [1.0, NAN, 6.5]])


def test_numbers_by_hand():
    result = compute_depth_metrics(PREDICTION, TRUTH)
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


@pytest.mark.parametrize("n", [1, 2, 9, 10])
def test_the_median_is_that_of_the_sorted_errors(n):
    errors = np.random.default_rng(n).permutation(2.0 ** np.arange(n))  # no two have the mean of two others
    assert compute_depth_metrics(1000 + errors, np.full(n, 1000.0))["median_m"] == np.median(errors)


def test_disparity_by_hand():
    result = compute_disparity_metrics(np.array([10.0, 11.5, NAN, 20.0, 5.0]), np.array([10.5, 10.0, 7.0, 16.0, NAN]))
    assert set(result) == set(DISPARITY_METRICS)
    assert result["epe_px"] == pytest.approx((0.5 + 1.5 + 4) / 3)
    assert result["bad_0_5"] == result["bad_1"] == pytest.approx(2 / 3)  # an error of exactly 0.5 px is none
    assert result["bad_2"] == result["bad_3"] == pytest.approx(1 / 3)
    assert result["d1"] == pytest.approx(1 / 3)
    assert (result["a50_px"], result["a90_px"], result["a99_px"]) == (1.5, 4, 4)


def test_d1_forgives_what_is_small_for_its_disparity():
    result = compute_disparity_metrics(np.array([104.0, 106.0, 13.5]), np.array([100.0, 100.0, 10.0]))
    assert result["bad_3"] == 1
    assert result["d1"] == pytest.approx(2 / 3)  # 4 px of 100 are within 5 %


def test_quantiles_are_the_errors_that_so_many_pixels_do_not_exceed():
    errors = np.random.default_rng(0).permutation(np.arange(1.0, 101.0))
    result = compute_disparity_metrics(errors + 500, np.full(100, 500.0))
    assert [result[key] for key in ("a50_px", "a90_px", "a95_px", "a99_px")] == [50, 90, 95, 99]


def test_a_perfect_prediction():
    result = compute_depth_metrics(TRUTH, TRUTH)
    assert result["coverage"] == 1
    for key in ("l1_m", "l1_rate_10", "si_mse", "si_rmse", "dod", "rmse_m", "bias_m"):
        assert result[key] == 0


positive = arrays(np.float64, st.integers(2, 40), elements=st.floats(0.05, 1000.0))


@settings(deadline=None)
@given(positive, st.floats(1e-3, 1e3), st.integers(0, 2**32 - 1))
def test_scale_invariant_metrics_do_not_see_the_scale(truth, scale, seed):
    assert (
        compute_depth_metrics(truth * scale, truth)["si_rmse"] < 1e-13
    )  # and not NaN, as in float32 without two passes
    prediction = truth * np.random.default_rng(seed).uniform(0.8, 1.25, truth.size)
    one, other = compute_depth_metrics(prediction, truth), compute_depth_metrics(prediction * 1024, truth)
    assert other["si_mse"] == pytest.approx(one["si_mse"], rel=1e-9, abs=1e-25)
    assert other["dod"] == one["dod"]


@settings(deadline=None)
@given(positive, st.integers(0, 2**32 - 1))
def test_an_invalid_measurement_is_never_a_depth(truth, seed):
    """An invalid pixel, however it is marked, changes coverage and nothing else."""
    random = np.random.default_rng(seed)
    prediction = truth * random.uniform(0.5, 2, truth.size)
    marks = np.array([NAN, 0.0, -1.0, np.inf, -np.inf])
    padded = compute_depth_metrics(np.concatenate([prediction, marks]), np.concatenate([truth, np.ones(5)]))
    plain = compute_depth_metrics(prediction, truth)
    assert padded.pop("coverage") == pytest.approx(truth.size / (truth.size + 5))
    plain.pop("coverage")
    assert padded == plain


def test_without_any_pixel_nothing_is_claimed():
    result = compute_depth_metrics(np.full(4, NAN), np.ones(4))
    assert (result["n"], result["coverage"]) == (0, 0)
    assert all(math.isnan(value) for key, value in result.items() if key not in ("n", "coverage"))
    assert math.isnan(compute_depth_metrics(np.ones(4), np.full(4, NAN))["coverage"])
    assert compute_depth_metrics(np.ones(0), np.ones(0))["n"] == 0
    assert all(math.isnan(value) for value in compute_disparity_metrics(np.full(2, NAN), np.ones(2)).values())


def test_one_pixel_has_no_order_and_no_scale_error():
    result = compute_depth_metrics(np.array([2.0]), np.array([1.0]))
    assert (result["si_mse"], result["l1_m"]) == (0, 1)
    assert math.isnan(result["dod"])


def test_single_precision_and_whole_numbers_are_measured_in_double():
    truth = np.linspace(1, 9, 5000).astype(np.float32)
    assert compute_depth_metrics(truth * np.float32(4), truth)["si_rmse"] < 1e-13
    assert compute_depth_metrics(np.array([3, 4]), np.array([3, 5]))["l1_m"] == 0.5


def test_absurd_depths_give_no_warning():
    result = compute_depth_metrics(np.array([1e200, 1e-200]), np.array([1.0, 1.0]))
    assert result["rmse_m"] == math.inf
    assert result["dod"] == 1


def test_error_curve_counts_missing_measurements_as_not_within():
    curve = compute_error_curve(np.array([1.0, 2.05, NAN, 3.0]), np.array([1.0, 2.0, 2.0, NAN]))
    shares = dict(zip(ERROR_STEPS_M, curve, strict=True))
    assert shares[0.01] == pytest.approx(1 / 3)
    assert shares[0.1] == shares[10.0] == pytest.approx(2 / 3)
    assert curve == sorted(curve)


def total(prediction, truth, focal_baseline=10.0):
    with np.errstate(divide="ignore"):
        disparity, true = focal_baseline / prediction, focal_baseline / truth
    return compute_total_metrics(prediction, truth, disparity, true, compute_depth_metrics(prediction, truth)["dod"])


def test_missing_counted_as_wrong_by_hand():
    truth, prediction = np.array([1.0, 2.0, 4.0, 5.0, NAN]), np.array([1.0, 2.5, NAN, -1.0, 3.0])
    result = total(prediction, truth)
    assert set(result) == set(TOTAL_METRICS)
    assert result["l1_rate_10"] == pytest.approx(3 / 4)  # one off by 0.5 m, two missing
    assert result["l1_rate_100"] == pytest.approx(2 / 4)
    assert result["bad_0_5"] == pytest.approx(3 / 4)  # disparities 10, 4 of 10, 5
    assert result["bad_1"] == pytest.approx(2 / 4)
    assert result["median_m"] == 0.5
    assert result["a90_px"] == math.inf
    assert result["dod"] == pytest.approx(1 - 2 / 12)  # of the ordered pairs of four pixels those of two agree


@settings(deadline=None)
@given(positive, st.data())
def test_leaving_measurements_out_never_helps_when_missing_is_wrong(truth, data):
    """Over its own pixels a matcher may look better if it gives up; over all true pixels it cannot."""
    random = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    prediction = truth * random.uniform(0.7, 1.4, truth.size)
    fewer = np.where(random.random(truth.size) < 0.4, NAN, prediction)
    with_all, with_fewer = total(prediction, truth), total(fewer, truth)
    for key in TOTAL_METRICS:
        assert with_fewer[key] >= with_all[key] - 1e-12
    complete = compute_depth_metrics(prediction, truth)
    for key in ("l1_rate_10", "l1_rate_30", "l1_rate_100", "dod"):
        assert with_all[key] == pytest.approx(complete[key], abs=1e-12)


@settings(deadline=None)
@given(positive, st.floats(1.01, 3.0), st.integers(0, 2**32 - 1))
def test_a_larger_error_is_never_a_better_number(truth, factor, seed):
    error = truth * np.random.default_rng(seed).uniform(-0.3, 0.3, truth.size)
    one, more = compute_depth_metrics(truth + error, truth), compute_depth_metrics(truth + error * factor, truth)
    for key in ("l1_m", "median_m", "rmse_m", "abs_rel", "l1_rate_10", "l1_rate_30", "l1_rate_100"):
        assert more[key] >= one[key] or np.isnan(more[key]) or more["n"] < one["n"]
    near, far = (
        compute_disparity_metrics(truth + error, truth),
        compute_disparity_metrics(truth + error * factor, truth),
    )
    if more["n"] == one["n"]:
        assert all(far[key] >= near[key] for key in DISPARITY_METRICS)


@settings(deadline=None)
@given(positive, st.integers(0, 2**32 - 1))
def test_the_order_of_pixels_does_not_matter(truth, seed):
    random = np.random.default_rng(seed)
    prediction, order = truth * random.uniform(0.5, 2, truth.size), random.permutation(truth.size)
    one, other = compute_depth_metrics(prediction, truth), compute_depth_metrics(prediction[order], truth[order])
    assert one == pytest.approx(other, rel=1e-9, abs=1e-15, nan_ok=True)  # sums in another order round otherwise


@pytest.mark.parametrize("depth_m", [1e-3, 1e10])
def test_depths_from_a_millimetre_to_the_far_end(depth_m):
    truth = depth_m * np.random.default_rng(0).uniform(1, 2, 1000)
    result = compute_depth_metrics(truth * 1.25, truth)
    assert result["abs_rel"] == pytest.approx(0.25)
    assert result["si_rmse"] < 1e-13
    assert result["l1_m"] == pytest.approx(0.25 * truth.mean())
    assert compute_disparity_metrics(85.3 / (truth * 1.25), 85.3 / truth)["epe_px"] == pytest.approx(
        np.mean(85.3 / truth) * 0.2
    )


def test_without_a_true_pixel_nothing_is_wrong_either():
    assert all(math.isnan(value) for value in total(np.ones(3), np.full(3, NAN)).values())
    alone = total(np.array([1.0]), np.array([1.0]))
    assert (alone["bad_1"], alone["median_m"]) == (0, 0)
    assert math.isnan(alone["dod"])
    nothing = total(np.full(3, NAN), np.ones(3))
    assert (nothing["bad_1"], nothing["dod"], nothing["median_m"]) == (1, 1, math.inf)


def test_sparsification_drops_the_least_confident_first():
    errors = np.arange(1.0, 21.0)
    falling = compute_sparsification(errors[sort_by_confidence(-errors)])
    assert falling == [pytest.approx(np.mean(errors[: round(20 * share)])) for share in KEPT_SHARES]
    rising = compute_sparsification(errors[sort_by_confidence(errors)])
    assert rising[0] == 20
    assert rising[-1] == falling[-1] == pytest.approx(errors.mean())
    assert all(math.isnan(value) for value in compute_sparsification(np.full(3, NAN)))
    assert compute_sparsification(np.array([NAN, 2.0])) == [2.0] * len(KEPT_SHARES)
    assert sort_by_confidence(np.array([[1.0, 3.0], [3.0, 2.0]])).tolist() == [1, 2, 3, 0]


def test_confidences_of_any_sign_and_size_are_sorted_as_numbers_are():
    values = np.concatenate([[0.0, -0.0, -1.0, 0.0], np.random.default_rng(0).standard_cauchy(1000)]).astype(np.float32)
    assert sort_by_confidence(values).tolist() == np.argsort(-values, kind="stable").tolist()


def test_an_error_of_exactly_a_limit_is_within_it():
    """Limits that binary numbers hold: one metre, whole pixels, 5 % of 80 and of 160 px."""
    assert compute_depth_metrics(np.array([3.0, 3.0]), np.array([2.0, 1.875]))["l1_rate_100"] == 0.5
    true = np.array([80.0, 80.0, 160.0, 40.0, 40.0, 40.0])
    found = np.array([84.0, 84.5, 168.0, 43.0, 43.5, 42.0])
    rates = compute_disparity_metrics(found, true)
    assert [rates[key] * 6 for key in ("bad_0_5", "bad_1", "bad_2", "bad_3", "d1")] == pytest.approx([6, 6, 5, 4, 2])
    total = compute_total_metrics(1 / true, 1 / true, found, true, 0.0)
    assert [total[key] * 6 for key in ("bad_2", "bad_3", "d1")] == pytest.approx([5, 4, 2])


def test_each_rate_counts_beyond_the_limit_in_its_name():
    for key, limit in metrics.BAD_RATES.items():
        assert limit == float(key.removeprefix("bad_").replace("_", "."))
    for key, limit in metrics.L1_RATES.items():
        assert limit == float(key.removeprefix("l1_rate_")) / 100
    for key, share in metrics.ERROR_QUANTILES.items():
        assert share == float(key[1:3]) / 100


def test_without_truth_there_is_a_curve_of_no_numbers():
    nothing = np.full((2, 3), np.nan)
    assert np.isnan(compute_error_curve(np.ones((2, 3)), nothing)).tolist() == [True] * len(metrics.ERROR_STEPS_M)
    assert np.isnan(compute_sparsification(nothing.ravel())).tolist() == [True] * len(metrics.KEPT_SHARES)


def test_missing_and_wrong_disparities_are_one_share_of_what_is_judged():
    truth = np.array([[10.0, 10.0, 10.0, 10.0, 10.0]])
    found = np.array([[10.9, 11.1, np.nan, 10.0, 99.0]])
    judged = np.array([[True, True, True, True, False]])
    assert find_wrong_share(found, truth, judged) == 0.5
    assert find_wrong_share(found, truth, judged, most_px=2.0) == 0.25
    assert math.isnan(find_wrong_share(found, truth, np.zeros_like(judged)))
