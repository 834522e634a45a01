"""Volumes of prisms and cones between elevation models, and what noise leaves of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.stereo.decisions.dem import Grid
from icymoon.stereo.decisions.dug_volume import (
    FEWEST_NULL_PAIRS,
    detect_change,
    find_detection_level,
    find_region_cells,
    find_volume_noise,
    measure_change,
    measure_local_sigma,
)

GRID = Grid(0.01, 100, 120, -0.6, 0.5)
EAST, NORTH = GRID.centres()
FLAT = 0.1 * EAST - 0.2 * NORTH
ALL = np.ones(FLAT.shape, bool)


def test_a_prism_between_cells_is_exact():
    cut = (np.abs(EAST) < 0.15) & (np.abs(NORTH) < 0.04)
    found = measure_change(FLAT, FLAT - 0.07 * cut, find_region_cells(GRID, (-0.2, -0.1, 0.2, 0.1)), 0.01)
    assert found.volume_m3 == pytest.approx(0.30 * 0.08 * 0.07, rel=1e-12)
    assert found.depth_m == pytest.approx(0.07)


def test_a_cone_is_a_third_of_its_cylinder():
    depth = np.maximum(0.1 * (1 - np.hypot(EAST, NORTH) / 0.3), 0.0)
    found = measure_change(FLAT, FLAT - depth, ALL, 0.01)
    # Midpoints of 1 cm: a smooth surface errs by the square of the cell over the size.
    assert found.volume_m3 == pytest.approx(math.pi * 0.3**2 * 0.1 / 3, rel=2e-3)


def test_spoil_is_a_negative_volume_and_both_cancel():
    found = measure_change(FLAT, FLAT + 0.02 * (EAST > 0.3) - 0.02 * (EAST < -0.3), ALL, 0.01)
    assert found.volume_m3 == pytest.approx(0.0, abs=1e-15)


def test_unknown_cells_count_as_the_others_and_too_many_as_nothing():
    after = FLAT - 0.05
    after[::3] = np.nan
    assert measure_change(FLAT, after, ALL, 0.01).volume_m3 == pytest.approx(1.2 * 1.0 * 0.05)
    after[::2] = np.nan
    assert measure_change(FLAT, after, ALL, 0.01) is None
    assert measure_change(FLAT, FLAT, find_region_cells(GRID, (5, 5, 6, 6)), 0.01) is None


@pytest.mark.parametrize("correlation_m", [0.03, 0.06])
def test_the_error_of_a_volume_follows_the_correlation_of_heights(correlation_m):
    random = np.random.default_rng(1)
    size, cell, sigma = 256, 0.01, 0.004
    frequency = np.hypot(*np.meshgrid(*2 * [np.fft.fftfreq(size, cell)]))
    # White noise through exp(-π²f²L²) has the correlation exp(-r²/2L²) and, scaled, this standard deviation.
    spectrum = np.exp(-((math.pi * frequency * correlation_m) ** 2))
    spectrum *= sigma / math.sqrt((spectrum**2).mean())
    volumes = []
    for _ in range(200):
        noise = np.fft.ifft2(np.fft.fft2(random.standard_normal((size, size))) * spectrum).real
        volumes.append(measure_change(noise, np.zeros((size, size)), np.ones((size, size), bool), cell).volume_m3)
    # As good as A / (2πL²) independent differences (Wheaton et al. 2010). 200 draws: three standard errors of a
    # standard deviation.
    expected = sigma * math.sqrt(2 * math.pi * (size * cell * correlation_m) ** 2)
    assert np.std(volumes) == pytest.approx(expected, rel=0.15)


def test_the_smallest_volume_is_noticed_in_95_of_100():
    random = np.random.default_rng(2)
    common = random.normal(0, 1e-4)
    noise = find_volume_noise((random.normal(0, 1e-4, 4000) - common).tolist())
    assert noise.sigma_m3 == pytest.approx(math.sqrt(2) * 1e-4, rel=0.04)
    trials = random.normal(noise.smallest_m3, noise.sigma_m3, 20000)
    assert (trials > noise.smallest_m3 / 2).mean() == pytest.approx(0.95, abs=0.005)
    assert (random.normal(0.0, noise.sigma_m3, 20000) > noise.smallest_m3 / 2).mean() == pytest.approx(0.05, abs=0.005)
    assert find_volume_noise([1.0] * (FEWEST_NULL_PAIRS - 1)) is None


@pytest.mark.parametrize("pairs", [5, 8])
def test_the_bounds_of_the_smallest_volume_hold_the_true_one_in_95_of_100(pairs):
    random = np.random.default_rng(pairs)
    held = 0
    for _ in range(2000):
        low, high = find_volume_noise(random.normal(0, 1e-4, pairs).tolist()).bounds_m3
        held += low < 3.29 * math.sqrt(2) * 1e-4 < high
    # Three standard errors of a share of 95 % of 2000 are 1.5 %.
    assert held / 2000 == pytest.approx(0.95, abs=0.015)


def test_the_level_of_detection_is_lanes():
    np.testing.assert_allclose(find_detection_level(np.array([0.003]), np.array([0.004])), 1.96 * 0.005)


def test_the_error_around_a_cell_is_that_of_the_known_ones():
    error = np.full((40, 50), 0.004)
    error[:, 25:] = np.nan
    found = measure_local_sigma(error, 0.01, 0.1)
    np.testing.assert_allclose(found[:, :29], 0.004, rtol=1e-6)  # a disc of 10 cm reaches 5 cells
    assert np.isnan(found[:, 31:]).all()


def test_five_of_a_hundred_cells_that_stay_are_beyond_their_level_and_a_deep_cut_is_found():
    random = np.random.default_rng(4)
    noise = [random.normal(0, sigma, FLAT.shape) for sigma in (0.003, 0.004)]
    after = FLAT - 0.05 * ((np.abs(EAST) < 0.1) & (np.abs(NORTH) < 0.1))
    found = detect_change(FLAT + noise[0], after + noise[1], FLAT, after, 0.01, 0.3)
    scores = found.score(FLAT - after)
    assert scores["level_m"] == pytest.approx(1.96 * 0.005, rel=0.02)
    # 11600 cells: three standard errors of 5 % are 0.6 %; the level is within 3 %, which is as much again.
    assert scores["false_alarm"] == pytest.approx(0.05, abs=0.012)
    assert scores["noticed"] == 1.0
    unknown = detect_change(np.full(FLAT.shape, np.nan), after, FLAT, after, 0.01, 0.3)
    assert unknown.score(FLAT - after) == {"level_m": None, "noticed": None, "false_alarm": None}
    assert not unknown.significant.any()
