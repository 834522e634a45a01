"""Histograms of disparity errors and parts of a pixel, against counts made by hand and matchers made up."""

import numpy as np
import pytest
from icymoon.stereo.measure.disparity_histograms import (
    FRACTION_BINS,
    HISTOGRAM_LENGTHS,
    add_histograms,
    make_histograms,
)

pytestmark = pytest.mark.filterwarnings("error")


def smooth(count=160_000):
    return np.random.default_rng(0).uniform(10, 40, count)


def test_every_measured_pixel_is_counted_once():
    true = np.array([10.0, 10.5, 11.25, np.nan, 12.0, 13.0])
    found = make_histograms(np.array([10.03, 9.03, np.nan, 5.0, 99.0, 13.0 - 0.5]), true)
    assert {key: len(value) for key, value in found.items()} == HISTOGRAM_LENGTHS
    assert [sum(found[key]) for key in ("error", "part", "true_part", "fine")] == [4, 4, 4, 2]
    assert found["error"][-1] == 1  # 87 px too large
    assert found["error"][1 + 10] == 1  # -1.47 px, in the eleventh bin of 0.05 px from -2 px on
    assert found["true_part"][0] == 3
    assert found["true_part"][FRACTION_BINS // 2] == 1
    assert found["fine_error_px"][0] == pytest.approx(0.03 - 0.5)


def test_a_right_matcher_has_no_bias_and_no_preference():
    true = smooth()
    found = make_histograms(true + np.random.default_rng(1).normal(0, 0.2, true.size), true)
    assert np.array(found["part"]) / true.size == pytest.approx(1 / FRACTION_BINS, abs=0.003)
    assert np.divide(found["fine_error_px"], found["fine"]) == pytest.approx(0, abs=0.01)
    share = np.array(found["error"]) / true.size
    assert share[1:-1].argmax() in (39, 40)


def test_whole_pixels_show_as_pixel_locking():
    """A matcher pulls disparities half-way to whole pixels: more of them are there, and its error turns its sign."""
    true = smooth()
    found = make_histograms(np.round(true) + 0.5 * (true - np.round(true)), true)
    part = np.array(found["part"]) / true.size
    assert part[0] > 1.8 / FRACTION_BINS
    assert part[FRACTION_BINS // 2 - 2 : FRACTION_BINS // 2 + 3].sum() < 0.02
    bias = np.divide(found["fine_error_px"], found["fine"])
    assert bias[FRACTION_BINS // 4] == pytest.approx(-0.125, abs=0.01)
    assert bias[3 * FRACTION_BINS // 4] == pytest.approx(0.125, abs=0.01)


def test_sums_are_those_of_all_pixels():
    true = smooth(1000)
    measured = true + 0.1
    halves = [make_histograms(measured[part], true[part]) for part in (slice(0, 400), slice(400, None))]
    total = add_histograms(add_histograms(None, halves[0]), halves[1])
    whole = make_histograms(measured, true)
    assert total == {key: pytest.approx(value) for key, value in whole.items()}


def test_nothing_measured():
    assert {sum(counts) for counts in make_histograms(np.full(5, np.nan), np.ones(5)).values()} == {0}
