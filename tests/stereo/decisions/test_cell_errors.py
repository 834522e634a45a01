"""Filled gaps and debiased roughness, beside exact grounds: by Monte Carlo, with tolerances from its error."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from icymoon.stereo.decisions.cell_errors import (
    average_square_coordinate,
    debias_planes,
    fill_gaps,
    measure_sampling_variance,
    state_errors,
)
from icymoon.stereo.decisions.dem import Dem, Grid
from icymoon.stereo.decisions.footprints import fit_planes, make_disc

CELL, DISC, SIDE = 0.02, 0.3, 90
GRID = Grid(CELL, SIDE, SIDE, 0.0, SIDE * CELL)
INNER = (slice(10, -10), slice(10, -10))
MOST = 0.015


def make_model(height):
    return Dem(GRID, height, np.isfinite(height).astype(int))


def make_ground(seed=0, rms_m=0.006):
    """Rough ground with features of some cells."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal((SIDE, SIDE)), (0, 0), 2.0)
    return rms_m * noise / noise.std()


def debias(ground, error, variance, shared=1.0, share=1.0):
    """True, measured and debiased planes of a ground with errors of the heights."""
    dem = make_model(ground + error)
    errors = state_errors(dem, np.full(ground.shape, variance), np.full(ground.shape, shared))
    measured = fit_planes(dem.height_m, CELL, DISC)
    return fit_planes(ground, CELL, DISC), measured, debias_planes(measured, dem, errors, DISC, share)


def test_roughness_and_slope_without_the_bias_of_independent_errors():
    sigma, biases = 0.004, []
    for seed in range(6):
        ground = make_ground(seed)
        error = sigma * np.random.default_rng(100 + seed).standard_normal(ground.shape)
        true, measured, found = debias(ground, error, sigma**2)
        biases.append(
            [np.mean((each.roughness_m**2 - true.roughness_m**2)[INNER]) for each in (measured, found)]
            + [np.mean((np.tan(np.radians(each.slope_deg)) ** 2)[INNER]) for each in (true, measured, found)]
        )
    before, after, true2, measured2, found2 = np.mean(biases, axis=0)
    cells = make_disc(DISC, CELL).sum()
    assert before == pytest.approx(sigma**2 * (1 - 3 / cells), rel=0.05)
    assert abs(after) < 0.05 * sigma**2
    assert measured2 - true2 == pytest.approx(2 * sigma**2 / cells / average_square_coordinate(DISC, CELL), rel=0.5)
    assert abs(found2 - true2) < 0.5 * (measured2 - true2)


def test_errors_that_neighbours_share_count_as_fewer():
    side, sigma = 3, 0.004
    after, naive = [], []
    for seed in range(8):
        ground = make_ground(seed)
        blocks = sigma * np.random.default_rng(200 + seed).standard_normal((SIDE // side, SIDE // side))
        error = np.kron(blocks, np.ones((side, side)))
        true, _, found = debias(ground, error, sigma**2, shared=side**2)
        _, _, wrong = debias(ground, error, sigma**2)
        after.append(np.mean((found.roughness_m**2 - true.roughness_m**2)[INNER]))
        naive.append(np.mean((wrong.roughness_m**2 - true.roughness_m**2)[INNER]))
    assert abs(np.mean(after)) < 0.05 * sigma**2
    assert np.mean(naive) < -0.08 * sigma**2  # 3 of 14 errors' worth went into the plane


def test_part_of_the_bias_can_be_kept_and_never_makes_roughness_imaginary():
    ground = make_ground()
    _, measured, kept = debias(ground, 0.0, 1e-6, share=0.0)
    np.testing.assert_allclose(kept.roughness_m, measured.roughness_m)
    _, _, none = debias(ground, 0.0, 1.0)
    assert (none.roughness_m == 0).all()
    assert (none.slope_deg == 0).all()


def make_holes(height, share=0.04, seed=5):
    holes = np.random.default_rng(seed).random(height.shape) < share
    holes = cv2.dilate(holes.astype(np.uint8), np.ones((2, 2), np.uint8)) > 0
    return np.where(holes, np.nan, height), holes


def test_filled_heights_err_as_much_as_is_stated():
    scores, filled = [], []
    for seed in range(4):
        ground = make_ground(seed)
        dem = make_model(make_holes(ground, seed=seed)[0])
        model, errors = fill_gaps(dem, state_errors(dem, np.zeros(ground.shape)), 0.04, DISC, MOST)
        error = (model.height_m - ground)[errors.filled]
        scores.append(error / np.sqrt(errors.filled_variance_m2[errors.filled]))
        filled.append(errors.filled.sum() / (~dem.known).sum())
        np.testing.assert_array_equal(model.height_m[dem.known], dem.height_m[dem.known])
    z = np.concatenate(scores)
    assert np.mean(filled) > 0.9
    assert 0.75 < np.sqrt(np.mean(z**2)) < 1.1  # the ring's own roughness makes it cautious
    assert 0.62 < np.mean(np.abs(z) < 1) < 0.85


def test_filled_cells_get_back_the_roughness_that_a_plane_smooths():
    lost, found = [], []
    for seed in range(6):
        ground = make_ground(seed)
        dem = make_model(make_holes(ground, 0.08, seed)[0])
        model, errors = fill_gaps(dem, state_errors(dem, np.zeros(ground.shape)), 0.04, DISC, MOST)
        smooth = fit_planes(model.height_m, CELL, DISC)
        true = fit_planes(np.where(model.known, ground, np.nan), CELL, DISC)
        whole = debias_planes(smooth, model, errors, DISC)
        lost.append(np.mean((smooth.roughness_m**2 - true.roughness_m**2)[INNER]) / np.mean(true.roughness_m**2))
        found.append(np.mean((whole.roughness_m**2 - true.roughness_m**2)[INNER]) / np.mean(true.roughness_m**2))
    assert np.mean(lost) < -0.1
    assert 0 <= np.mean(found) < 0.3 * -np.mean(lost)  # cautious: the ground is not called smoother than it is


def test_wide_gaps_steps_and_borders_stay_unknown():
    height = make_ground()
    height[20:30, 20:30] = np.nan  # 20 cm
    height[50, 50:52] = np.nan
    height[:2] = np.nan
    height[60:, 45:] += 0.5
    height[60:, 44] = np.nan  # in a step of 50 cm
    dem = make_model(height)
    _, errors = fill_gaps(dem, state_errors(dem, np.zeros(height.shape)), 0.04, DISC, MOST)
    assert errors.filled[50, 50:52].all()
    assert not errors.filled[20:30, 20:30].any()
    assert not errors.filled[:2].any()
    assert not errors.filled[64:, 44].any()
    none, same = fill_gaps(dem, state_errors(dem, np.zeros(height.shape)), 0.0, DISC, MOST)
    assert none is dem
    assert not same.filled.any()


def test_few_pixels_of_a_slope_err_as_much_as_is_stated():
    """Regular pixels at any phase, 1 to 9 a cell on average, on a tilted plane, against the middle's height."""
    slope, errors, stated = 0.3, [], []
    for seed, across in enumerate(np.linspace(1.02, 3.0, 12)):
        step = CELL / across
        ticks = np.arange(0, SIDE * CELL, step)
        phase = np.random.default_rng(seed).uniform(0, step, 2)
        east, north = (each.ravel() for each in np.meshgrid(ticks + phase[0], ticks + phase[1]))
        points = np.stack([east, north, slope * east], axis=1)
        cell = GRID.find_cells(points)
        points, cell = points[cell >= 0], cell[cell >= 0]
        count = np.bincount(cell, minlength=SIDE * SIDE)
        mean = np.bincount(cell, points[:, 2], SIDE * SIDE) / np.maximum(count, 1)
        off = np.where(count > 0, mean, np.nan).reshape(SIDE, SIDE) - slope * GRID.centres()[0]
        errors.append(np.nanmean(off[INNER] ** 2) * across**2)
        stated.append(np.nanmean(measure_sampling_variance(points, GRID, DISC)[INNER]) * across**2)
    # On average over the numbers of pixels a cell; w² is pooled from few points, which costs a quarter.
    assert np.mean(stated) == pytest.approx(np.mean(errors), rel=0.25)


def test_errors_are_known_only_where_a_height_is():
    dem = make_model(np.full((SIDE, SIDE), np.nan))
    errors = state_errors(replace(dem), np.ones((SIDE, SIDE)))
    assert np.isnan(errors.variance_m2).all()
