"""Each noise against the same noise written for one point at a time, and against known statistics."""

from __future__ import annotations

import math

import noise_reference as reference
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from icymoon.physics.terrain.noise import broken, lattice_noise, voronoi
from icymoon.physics.terrain.noise.bases_and_fractals import BASES
from icymoon.physics.terrain.roughness.structure_function import NOISE_DEVIATION, structure_function

COORDINATE = st.floats(-1e6, 1e6) | st.integers(-1000, 1000).map(float)
KEY = st.integers(0, 2**32 - 1)
SCALAR = {
    "GRADIENT": reference.gradient_noise,
    "CELLS": reference.cell_noise,
    "MIDPOINT": reference.value_noise,
    "VORONOI_F1": lambda x, y, key: 2 * reference.points_near(x, y, key)[0][0] - 1,
    "VORONOI_F2": lambda x, y, key: 2 * reference.points_near(x, y, key)[1][0] - 1,
    "VORONOI_F2_F1": lambda x, y, key: 2
    * (reference.points_near(x, y, key)[1][0] - reference.points_near(x, y, key)[0][0])
    - 1,
    "CRACKLE": lambda x, y, key: 2
    * min(10 * (reference.points_near(x, y, key)[1][0] - reference.points_near(x, y, key)[0][0]), 1.0)
    - 1,
    "BROKEN": lambda x, y, key: reference.broken_noise(x, y, key, broken._PLANES.tolist()),
}


@pytest.mark.parametrize("basis", BASES)
@settings(deadline=None)
@given(x=COORDINATE, y=COORDINATE, key=KEY)
def test_a_basis_is_the_one_point_formula(basis, x, y, key):
    made = BASES[basis](np.array([x]), np.array([y]), key)
    # At 1e6 a float64 has 1e-10 left behind the point; crackle is 20 times as steep as a distance.
    assert made[0] == pytest.approx(SCALAR[basis](x, y, key), abs=1e-8)


@pytest.mark.parametrize("basis", BASES)
def test_a_crowd_of_points_gets_the_one_point_formula_too(basis):
    x, y = np.random.default_rng(4).uniform(-3, 3, (2, 300))
    made = BASES[basis](x, y, 77)
    assert np.abs(made - [SCALAR[basis](a, b, 77) for a, b in zip(x, y, strict=True)]).max() < 1e-12


@pytest.mark.parametrize("basis", BASES)
def test_looking_cells_up_and_hashing_each_point_give_the_same_bits(basis, monkeypatch):
    x, y = np.random.default_rng(0).uniform(-40, 40, (2, 5000))
    made = []
    for per_point in (0, 10**9):
        monkeypatch.setattr(lattice_noise, "_TABLE_PER_POINT", per_point)
        cells = voronoi.find_voronoi_cells(x, y, 5)
        made.append((BASES[basis](x, y, 5), cells.f1, cells.edge_distance(3.0, 0.5), cells.random(1)))
    for hashed, looked_up in zip(*made, strict=True):
        assert np.array_equal(hashed, looked_up)


@settings(deadline=None)
@given(x=COORDINATE, y=COORDINATE, key=KEY)
def test_a_voronoi_cell_is_the_nearest_point_of_many(x, y, key):
    cells = voronoi.find_voronoi_cells(np.array([x]), np.array([y]), key)
    (f1, px, py, column, row), (f2, *_), *_ = reference.points_near(x, y, key)
    assert (cells.f1[0], cells.f2[0]) == pytest.approx((f1, f2), abs=1e-9)
    if f2 - f1 > 1e-9:
        assert (cells.x1[0] + x, cells.y1[0] + y) == pytest.approx((px, py), abs=1e-9)
        assert cells.random(9)[0] == reference.hashed(column, row, 9) / 2**32


@pytest.mark.parametrize("lengths", [(1.0, 1.0), (5.0, 0.5)])
def test_the_distance_to_the_edge_of_a_cell(lengths):
    x, y = np.random.default_rng(1).uniform(-20, 20, (2, 1500))
    made = voronoi.find_voronoi_cells(x, y, 3).edge_distance(*lengths)
    true = np.array([reference.edge_distance(a, b, 3, *lengths) for a, b in zip(x, y, strict=True)])
    near = true < 0.29 * min(lengths)
    assert near.sum() > 500
    assert np.abs(made - true)[near].max() < 1e-9
    assert (made >= true - 1e-9).all()


@pytest.mark.long
def test_the_distance_to_the_edge_has_no_steps_where_three_cells_meet():
    axis = np.linspace(0, 12, 1501)
    x, y = np.meshgrid(axis, axis)
    distance = voronoi.find_voronoi_cells(x, y, 8).edge_distance()
    # A distance changes by no more than one walks; the far places where the search ends are left out.
    near = distance < 0.25
    for step, both in (
        (np.diff(distance, axis=0), near[1:] & near[:-1]),
        (np.diff(distance, axis=1), near[:, 1:] & near[:, :-1]),
    ):
        assert np.abs(step[both]).max() <= axis[1] * (1 + 1e-9)


def test_noise_vanishes_on_the_lattice_and_is_bounded():
    lattice = np.arange(-50, 50, dtype=float)
    x, y = np.meshgrid(lattice, lattice)
    assert np.abs(lattice_noise.gradient_noise(x, y, 7)).max() == 0.0
    x, y = np.random.default_rng(0).uniform(-1000, 1000, (2, 200_000))
    values = lattice_noise.gradient_noise(x, y, 7)
    # Zero mean: the standard error of 2e5 values of deviation about 0.3, correlated or not, is below 1e-2.
    assert abs(values.mean()) < 1e-2
    assert np.abs(values).max() <= 1.0


def test_noise_is_smooth_across_lattice_lines():
    y = np.linspace(-3, 3, 301)
    for line in (-2.0, 0.0, 5.0):
        step = 1e-6
        left, right = (lattice_noise.gradient_noise(np.full_like(y, line + side * step), y, 3) for side in (-1, 1))
        # The slope is at most about 4 per unit, so a jump would stand out against 2 steps of 1e-6.
        assert np.abs(left - right).max() < 2e-5


def test_known_variances():
    """Uniform values have 1/3; bilinear weights have a mean square of 2/3 per axis, which leaves 4/27."""
    x, y = np.random.default_rng(3).uniform(-2000, 2000, (2, 300_000))
    for made, variance in (
        (lattice_noise.cell_noise(x, y, 1), 1 / 3),
        (lattice_noise.value_noise(x, y, 1), 4 / 27),
        (lattice_noise.gradient_noise(x, y, 1), NOISE_DEVIATION**2),
    ):
        # The standard error of a variance of 3e5 nearly independent values is 0.3 %.
        assert made.var() == pytest.approx(variance, rel=0.015)


@pytest.mark.parametrize("distance", [0.01, 0.1, 0.5, 1.0, 1.6, 5.0])
def test_the_closed_form_of_the_structure_function(distance):
    random = np.random.default_rng(5)
    x, y = random.uniform(-3000, 3000, (2, 300_000))
    angle = random.uniform(0, 2 * math.pi, x.size)
    there = lattice_noise.gradient_noise(x + distance * np.cos(angle), y + distance * np.sin(angle), 11)
    measured = np.mean((there - lattice_noise.gradient_noise(x, y, 11)) ** 2)
    # Five standard errors of a mean of 3e5 squares, and the table's interpolation.
    assert float(structure_function(np.array(distance))) == pytest.approx(measured, rel=0.015)


def test_hash_bits_are_even():
    ix, iy = np.meshgrid(np.arange(-256, 256), np.arange(-256, 256))
    bits = (lattice_noise.hash_lattice(ix, iy, 99)[..., None] >> np.arange(32, dtype=np.uint32)) & 1
    # 2^18 fair coins: standard deviation of the mean 0.001; five of them.
    assert np.abs(bits.reshape(-1, 32).mean(axis=0) - 0.5).max() < 0.005


def test_noise_in_space_is_bounded_smooth_and_zero_on_the_lattice():
    random = np.random.default_rng(6)
    points = random.uniform(-100, 100, (50_000, 3))
    values = lattice_noise.gradient_noise_3d(points, 4)
    # The largest value of 3-D gradient noise with gradients of length √2 is about 1.04.
    assert np.abs(values).max() < 1.04
    assert abs(values.mean()) < 0.01
    assert np.abs(lattice_noise.gradient_noise_3d(np.rint(points), 4)).max() == 0.0
    moved = lattice_noise.gradient_noise_3d(points + 1e-6, 4)
    assert np.abs(moved - values).max() < 2e-5


def test_pieces_of_broken_ice_have_plane_faces_and_no_steps():
    x, y = np.random.default_rng(2).uniform(-200, 200, (2, 100_000))
    step = 1e-3
    at = [broken.broken_noise(x + k * step, y + 0.7 * k * step, 9) for k in (-1, 0, 1)]
    # No steps, also between squares: a side falls by 6.6 per square, and a line is 1.22 steps long.
    slope = np.abs(at[2] - at[1]) / step
    assert slope.max() < 6.6 * math.hypot(1.0, 0.7) * (1 + 1e-6)
    # Plane but for the edges. A line of 2.4e-3 crosses one with a chance of 2 / pi times its length, for each square of
    # edges in a square; ten squares' lengths are more than nine pieces can show.
    bend = np.abs(at[0] - 2 * at[1] + at[2]) / step
    assert (bend > 1e-6).mean() < 2 / math.pi * 2.44e-3 * 10
    # Faces and not only floor.
    assert 0.05 < (at[1] == -1.0).mean() < 0.5
    assert (slope > 4.0).mean() > 0.1


def test_the_sides_of_a_piece_are_around_it_and_steep():
    planes = broken._PLANES
    tops, sides = planes[:, 0], planes[:, 1:]
    assert np.allclose(np.hypot(sides[..., 0], sides[..., 1]), 6.6, rtol=1e-6)
    assert np.hypot(tops[:, 0], tops[:, 1]).max() <= 1.35
    turn = np.sort(np.arctan2(sides[..., 1], sides[..., 0]), axis=1)
    gaps = np.diff(np.concatenate([turn, turn[:, :1] + 2 * np.pi], axis=1), axis=1)
    # The condition under which no piece reaches a square that is not next to its own.
    assert gaps.max() <= 2 * math.pi / 5 * 1.4 + 1e-6
