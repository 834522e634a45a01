"""Planes under footprints, against planes and numpy's least squares."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.stereo.decisions.footprints import (
    average_under_footprint,
    fit_planes,
    make_disc,
    measure_distance_to_nearest_m,
)

CELL = 0.02


def ramp(a, b, size=60):
    row, column = np.mgrid[:size, :size] * CELL
    return 100.0 + a * column + b * row


@pytest.mark.parametrize(("a", "b"), [(0.0, 0.0), (0.3, 0.0), (0.0, -1.2), (0.5, 0.7), (3.0, -4.0)])
def test_the_slope_of_a_plane_is_exact_up_to_its_border(a, b):
    found = fit_planes(ramp(a, b), CELL, 0.3)
    # Heights of 100 m in double precision: 1e-12 of a slope, with room for the sums of 200 cells.
    np.testing.assert_allclose(found.slope_deg, np.degrees(np.arctan(np.hypot(a, b))), atol=1e-7)
    # A difference of squares of up to 10 m: the root of 1e-16 of 100 m², which OpenCV's versions round differently.
    assert found.roughness_m.max() < 1e-6
    np.testing.assert_allclose(found.middle_m, ramp(a, b), atol=1e-9)


def test_planes_are_those_of_least_squares_with_holes():
    random = np.random.default_rng(4)
    height = ramp(0.2, -0.1) + random.normal(0, 0.01, (60, 60))
    height[random.random(height.shape) < 0.3] = np.nan
    found, shape = fit_planes(height, CELL, 0.3), make_disc(0.3, CELL) > 0
    for row, column in ((30, 30), (20, 41), (7, 52)):
        part = height[row - 7 : row + 8, column - 7 : column + 8]
        known = shape & np.isfinite(part)
        v, u = np.nonzero(known)
        matrix = np.stack([u * CELL, v * CELL, np.ones(len(u))], axis=1)
        solution, _, _, _ = np.linalg.lstsq(matrix, part[known], rcond=None)
        assert found.slope_deg[row, column] == pytest.approx(np.degrees(np.arctan(np.hypot(*solution[:2]))), abs=1e-8)
        rms = np.sqrt(((part[known] - matrix @ solution) ** 2).mean())
        assert found.roughness_m[row, column] == pytest.approx(rms, abs=1e-9)


def test_no_plane_through_a_line_or_too_few_cells():
    height = np.full((30, 30), np.nan)
    height[15, :] = 1.0
    height[2, 2] = height[2, 3] = height[3, 2] = 0.0
    assert np.isnan(fit_planes(height, CELL, 0.2).slope_deg).all()


def test_a_disc_and_its_shares():
    assert make_disc(0.3, CELL).shape == (15, 15)
    assert make_disc(0.001, CELL).sum() == 1
    assert make_disc(2.0, 0.01).sum() * 0.01**2 == pytest.approx(np.pi, rel=0.01)
    half = np.zeros((40, 41), bool)
    half[:, :20] = True
    share = average_under_footprint(half, CELL, 0.3)
    assert share[20, 8] == pytest.approx(1.0)
    assert average_under_footprint(~half, CELL, 0.3)[20, 30] == pytest.approx(1.0)
    # The column in the middle of the disc is neither's, by 15 of 177 cells.
    assert share[20, 20] == pytest.approx(0.5 - 15 / make_disc(0.3, CELL).sum() / 2)
    among = np.zeros(half.shape, bool)
    among[20, 20] = True
    assert average_under_footprint(half, CELL, 0.3, among)[20, 22] == 0.0
    assert np.isnan(average_under_footprint(half, CELL, 0.3, among)[0, 0])


def test_distances_are_euclidean():
    mask = np.zeros((50, 50), bool)
    mask[10, 20] = True
    row, column = np.mgrid[:50, :50]
    np.testing.assert_allclose(
        measure_distance_to_nearest_m(mask, CELL), CELL * np.hypot(row - 10, column - 20), rtol=1e-5
    )
    assert np.isinf(measure_distance_to_nearest_m(np.zeros((3, 3), bool), CELL)).all()
