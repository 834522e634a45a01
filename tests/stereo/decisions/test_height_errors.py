"""Standard deviations of maps: units by Monte Carlo with errors of known size, scales, and shares on other grounds."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.stereo.decisions.cell_errors import state_errors
from icymoon.stereo.decisions.dem import Dem, Grid
from icymoon.stereo.decisions.footprints import fit_planes
from icymoon.stereo.decisions.height_errors import (
    NORMAL_SHARES,
    QUANTITIES,
    RATIOS,
    check_scale,
    count_errors,
    fit_scales,
    make_check_sentence,
    state_shape,
)

CELL, DISC, SIDE, SIGMA = 0.02, 0.3, 60, 0.004
STEP = RATIOS[1] / RATIOS[0]
EVERYWHERE = np.ones((SIDE, SIDE), bool)
INNER = np.pad(np.ones((SIDE - 20, SIDE - 20), bool), 10)


def decide(seed, stated=SIGMA, draw=None):
    """The numbers of a tilted plane with errors of the heights of ``SIGMA``, for which ``stated`` is stated."""
    random = np.random.default_rng(seed)
    grid = Grid(CELL, SIDE, SIDE, 0.0, 1.0)
    plane = 0.2 * grid.centres()[0]
    height = plane + SIGMA * (draw or random.standard_normal)((SIDE, SIDE))
    dem = Dem(grid, height, np.ones(height.shape, int))
    planes, true = fit_planes(height, CELL, DISC), fit_planes(plane, CELL, DISC)
    shape = state_shape(dem, state_errors(dem, np.full(height.shape, stated**2)), planes.slope_deg, DISC)
    return {
        "errors": {
            "height": count_errors(height - plane, shape.height, EVERYWHERE),
            "slope": count_errors(planes.slope_deg - true.slope_deg, shape.slope, INNER),
            "roughness": count_errors(planes.roughness_m - true.roughness_m, shape.roughness, INNER),
        }
    }


@pytest.fixture(scope="module")
def grounds():
    return [[decide(seed)] for seed in range(30)]


def test_errors_that_are_stated_exactly_have_the_scale_1(grounds):
    """30 x 3600 heights are independent, so their scale errs by less than 1 %; 30 maps of slopes have some 10
    footprints each, so the scale of slopes errs by 5 %. Roughness errs by all of σ here, on a plane.
    """
    scales = fit_scales(grounds)
    assert scales["height"] == pytest.approx(1.0, rel=0.01)
    assert scales["slope"] == pytest.approx(1.0, rel=0.15)
    assert scales["roughness"] == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize("name", QUANTITIES)
def test_errors_that_are_stated_as_half_have_twice_the_scale(grounds, name):
    half = fit_scales([[decide(seed, SIGMA / 2)] for seed in range(30)])
    assert half[name] == pytest.approx(2 * fit_scales(grounds)[name], rel=0.01)


def test_normal_errors_are_normal_on_other_grounds(grounds):
    """10 grounds of 3600 independent heights: a share errs by 0.0025, and the scale by less than 1 %."""
    other = [[decide(seed)] for seed in range(100, 110)]
    found = check_scale(other, "height", fit_scales(grounds)["height"])
    assert found["within"] == pytest.approx(NORMAL_SHARES, abs=0.012)
    for share, (low, high) in zip(found["within"], found["bounds"], strict=True):
        assert low < share < high
    assert check_scale(other, "height", 1.0)["within"] == pytest.approx(NORMAL_SHARES, abs=0.008)
    assert check_scale(other[:1], "height", 1.0)["bounds"] == [[None, None], [None, None]]


def test_outliers_are_shared_between_one_and_two_standard_deviations():
    """Student's t with 1.5 degrees of freedom: the scale leaves too many errors within one and too few within two."""
    random = np.random.default_rng(5)
    made = [[decide(seed, draw=lambda size: random.standard_t(1.5, size))] for seed in range(20)]
    share = check_scale(made[10:], "height", fit_scales(made[:10])["height"])["within"]
    off = np.array(share) / NORMAL_SHARES - 1
    assert off[1] < -0.03
    assert off[0] == pytest.approx(-off[1], abs=0.02)  # four shares, each of which errs by some 0.004
    sentence = make_check_sentence(
        "height", "SGBM", {"grounds": 10, "within": share, "bounds": [[None] * 2, [0.8, 0.9]]}
    )
    assert f"two in {100 * share[1]:.0f} % (80 to 90); normal errors have 68 % and 95 % (10 grounds)." in sentence


def test_each_ground_counts_once():
    """A ground with a hundred times as many cells, or with several pairs, has the weight of one."""

    def make(ratio, cells, pairs=1):
        one = count_errors(np.full(cells, ratio), np.ones(cells), np.ones(cells, bool))
        return [{"errors": dict.fromkeys(QUANTITIES, one)}] * pairs

    small, large = make(1.0, 10), make(5.0, 1000, pairs=4)
    assert check_scale([small, large], "height", 2.0)["within"] == [0.5, 0.5]
    # With all cells alike, one standard deviation would have to be 5; now the large ground is within two.
    assert fit_scales([small, small, small, large])["slope"] == pytest.approx(2.5, rel=STEP - 1)


def test_unknown_errors_count_nowhere():
    error = np.array([np.nan, 0.5, 0.5, 0.5])
    counted = count_errors(error, np.array([1.0, np.nan, 1.0, 1.0]), np.array([True, True, True, False]))
    assert counted["cells"] == 1
    nothing = count_errors(error[:1], np.ones(1), np.ones(1, bool))
    rows = [[{"errors": dict.fromkeys(QUANTITIES, nothing)}]]
    assert fit_scales(rows) == fit_scales([]) == dict.fromkeys(QUANTITIES)
    assert check_scale(rows, "height", 1.0) is None
    huge = count_errors(np.ones(3), np.full(3, 1e-6), np.ones(3, bool))
    assert fit_scales([[{"errors": dict.fromkeys(QUANTITIES, huge)}]])["height"] is None  # beyond all ratios
