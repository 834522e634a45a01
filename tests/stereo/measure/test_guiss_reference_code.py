"""The reference code's numbers, against what was published or measured of it."""

import math

import numpy as np
import pytest
from icymoon.stereo.measure.guiss_reference_code import (
    choose_lattice_pairs,
    compute_depth_map_metrics,
    compute_reference_metrics,
)
from icymoon.stereo.measure.metrics import compute_depth_metrics

pytestmark = pytest.mark.filterwarnings("error")


@pytest.mark.parametrize(
    ("pixels", "pairs"), [(0, 0), (10_100, 0), (10_200, 1), (182_400, 283_201), (245_760, 528_522)]
)
def test_the_lattice_has_as_many_pairs_as_the_reference_codes(pixels, pairs):
    first, second = choose_lattice_pairs(pixels)
    assert len(first) == pairs
    assert len(set(zip(first.tolist(), second.tolist(), strict=True))) == pairs
    assert (first < second).all()


def test_a_perfect_disparity_is_one_sixteenth_short():
    """Its 80 px·m for the paper's 85.333 alone makes an error of 6.25 % of the depth."""
    truth = np.random.default_rng(0).uniform(2, 6, (480, 640))
    result = compute_reference_metrics(640 * 32 / 60 * 0.25 / truth, truth, bm_min_disparity=4)
    kept = truth[48:432, 125:600]
    assert result["guiss_n"] == kept.size == 182_400
    assert result["guiss_l1_m"] == pytest.approx(0.0625 * kept.mean(), rel=1e-3)
    assert result["guiss_l1_rate_10"] == 1
    assert result["guiss_dod"] < 1e-4


def test_failed_matches_are_taken_for_a_far_surface():
    truth = np.full((480, 640), 5.0)
    disparity = np.full((480, 640), 16.0)  # 80 / 16 = 5 m, right by its constant
    disparity[:, 320:] = np.nan
    result = compute_reference_metrics(disparity, truth, bm_min_disparity=4)
    assert result["guiss_n"] == 384 * 475
    failed = (600 - 320) / 475
    assert result["guiss_l1_m"] == pytest.approx(failed * (80 / 3.0001 - 5), rel=1e-3)
    networks = compute_reference_metrics(disparity, truth)  # which never fail
    assert networks["guiss_n"] == 384 * 320
    assert networks["guiss_l1_m"] < 1e-4


def test_single_precision_loses_the_scale_invariant_error():
    # Seven times a float32 is rounded, twice it is not: so it is lost in numpy 1 and 2 alike.
    truth = np.random.default_rng(1).uniform(1, 20, (100, 100))
    lost = compute_depth_map_metrics(truth * 7, truth)["guiss_si_rmse"]
    assert math.isnan(lost) or lost > 1e-5
    assert compute_depth_metrics(truth * 7, truth)["si_rmse"] < 1e-13


def test_no_pixel_is_no_number():
    result = compute_depth_map_metrics(np.full((4, 4), np.nan), np.ones((4, 4)))
    assert result.pop("guiss_n") == 0
    assert all(math.isnan(value) for value in result.values())
    assert compute_reference_metrics(np.ones((1, 1)), np.ones((1, 1)), 4)["guiss_n"] == 0
