"""Terrain, noise and directions against laws and independent arithmetic."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.physics.directions import camera_axes, toward
from icymoon.physics.noise import gradient_noise, hashed
from icymoon.physics.seeds import STREAMS, generator, stream
from icymoon.physics.statistics import rms_deviation
from icymoon.physics.terrain import terrain
from icymoon.settings import defaults, merged


def _terrain(seed: int = 1, **changes):
    return terrain(merged(defaults(), {"terrain": changes}), seed)


def _grid(ground, n: int = 401):
    axis = np.linspace(-ground.size_m / 2, ground.size_m / 2, n)
    return ground.heights(axis[None, :], axis[:, None]), axis[1] - axis[0]


def test_noise_vanishes_on_the_lattice_and_is_bounded():
    lattice = np.arange(-50, 50, dtype=float)
    x, y = np.meshgrid(lattice, lattice)
    assert np.abs(gradient_noise(x, y, 7)).max() == 0.0
    x, y = np.random.default_rng(0).uniform(-1000, 1000, (2, 200_000))
    values = gradient_noise(x, y, 7)
    # Zero mean: the standard error of 2e5 values of deviation about 0.3, correlated or not, is below 1e-2.
    assert abs(values.mean()) < 1e-2
    assert np.abs(values).max() <= 1.0


def test_noise_is_smooth_across_lattice_lines():
    y = np.linspace(-3, 3, 301)
    for line in (-2.0, 0.0, 5.0):
        step = 1e-6
        left, right = (gradient_noise(np.full_like(y, line + side * step), y, 3) for side in (-1, 1))
        # The slope is at most about 4 per unit, so a jump would stand out against 2 steps of 1e-6.
        assert np.abs(left - right).max() < 2e-5


def test_hash_bits_are_even():
    ix, iy = np.meshgrid(np.arange(-256, 256), np.arange(-256, 256))
    bits = (hashed(ix, iy, 99)[..., None] >> np.arange(32, dtype=np.uint32)) & 1
    # 2^18 fair coins: standard deviation of the mean 0.001; five of them.
    assert np.abs(bits.reshape(-1, 32).mean(axis=0) - 0.5).max() < 0.005


def test_heights_are_a_function_of_position():
    ground = _terrain()
    x, y = np.random.default_rng(1).uniform(-10, 10, (2, 5000))
    together = ground.heights(x, y)
    order = np.random.default_rng(2).permutation(5000)
    assert np.array_equal(ground.heights(x[order], y[order]), together[order])
    assert float(ground.heights(x[17], y[17])) == together[17]


@pytest.mark.parametrize("slope", [2.0, 12.0, 35.0])
@pytest.mark.parametrize("multifractality", [0.0, 1.0])
def test_the_patch_has_the_stated_slope(slope, multifractality):
    for seed in range(3):
        ground = _terrain(seed, rms_slope_deg=slope, multifractality=multifractality)
        heights, spacing = _grid(ground)
        lag = round(1.0 / spacing)
        measured = math.degrees(math.atan(rms_deviation(heights, lag) / (lag * spacing)))
        # Scaled on 16384 random pairs in all directions, measured along two axes: a few per cent.
        assert measured == pytest.approx(slope, rel=0.08)


def test_the_hurst_exponent_steepens_small_scales():
    ratio = {}
    for hurst in (0.5, 0.9):
        deviations = []
        for seed in range(4):
            heights, _ = _grid(_terrain(seed, hurst=hurst, multifractality=0.0, outer_scale_m=16.0))
            deviations.append([rms_deviation(heights, 4), rms_deviation(heights, 32)])
        small, large = np.sqrt(np.mean(np.square(deviations), axis=0))
        ratio[hurst] = math.log(large / small) / math.log(8)
        # Noise octaves give the exponent within 0.15 (they are not a pure power law).
        assert ratio[hurst] == pytest.approx(hurst, abs=0.15)
    assert ratio[0.9] > ratio[0.5] + 0.2


def test_multifractal_ground_is_smooth_in_hollows():
    def roughness_ratio(multifractality: float) -> float:
        heights, _ = _grid(_terrain(3, multifractality=multifractality))
        curvature = np.abs(np.diff(heights, 2, axis=1))
        middle = heights[:, 1:-1]
        low, high = middle < np.quantile(middle, 0.2), middle > np.quantile(middle, 0.8)
        return float(curvature[high].mean() / curvature[low].mean())

    assert roughness_ratio(1.0) > 1.5 * roughness_ratio(0.0)


def test_seeds_and_flat_ground():
    assert not np.array_equal(_grid(_terrain(1), 65)[0], _grid(_terrain(2), 65)[0])
    assert np.array_equal(_grid(_terrain(1), 65)[0], _grid(_terrain(1), 65)[0])
    assert np.all(_grid(_terrain(1, rms_slope_deg=0.0), 65)[0] == 0.0)


def test_streams_are_the_spawned_children_of_the_seed():
    children = np.random.SeedSequence(42).spawn(len(STREAMS))
    for name, child in zip(STREAMS, children, strict=True):
        assert np.array_equal(stream(42, name).generate_state(4), child.generate_state(4))
    assert generator(42, "rocks").random() != generator(42, "terrain").random()


@given(st.floats(-360, 360), st.floats(-90, 90))
def test_camera_axes_are_a_rotation_that_looks_where_it_is_told(heading, pitch):
    axes = camera_axes(heading, pitch)
    assert np.allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert np.allclose(axes[:, 2], toward(heading, -pitch))
    assert axes[2, 0] == 0.0  # x right is level
    assert axes[2, 1] <= 1e-12  # y down is down


def test_directions_by_the_compass():
    assert np.allclose(toward(0, 0), [0, 1, 0])
    assert np.allclose(toward(90, 0), [1, 0, 0])
    assert np.allclose(toward(123, 90), [0, 0, 1])
