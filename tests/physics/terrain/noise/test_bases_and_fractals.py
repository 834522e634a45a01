"""The fractal sums against Musgrave's, and layers against the RMS height that they state."""

from __future__ import annotations

import math

import noise_reference as reference
import numpy as np
import pytest
from icymoon.physics.terrain.noise.bases_and_fractals import BASES, FRACTALS
from icymoon.physics.terrain.noise_layers import NoiseLayer, make_layer
from icymoon.physics.terrain.roughness.statistics import power_spectrum, rms_deviation
from icymoon.settings.topics.ground import TerrainLayer

DEFAULTS = TerrainLayer.from_values({setting.key: setting.default for setting in TerrainLayer.fields})


def _layer(seed: int = 0, **changes: object) -> NoiseLayer:
    made = make_layer(DEFAULTS | changes, np.random.default_rng(seed))
    assert made is not None
    return made


@pytest.mark.parametrize("fractal", FRACTALS)
def test_a_sum_is_musgraves(fractal):
    octaves = np.random.default_rng(1).uniform(-1, 1, (6, 200))
    made = FRACTALS[fractal].of(lambda k: FRACTALS[fractal].signal(octaves[k]), 6, 0.55)
    assert np.allclose(made, [reference.musgrave(fractal, list(column), 0.55) for column in octaves.T], rtol=1e-13)


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("fractal", FRACTALS)
def test_a_layer_has_the_stated_rms_height(basis, fractal):
    made = _layer(basis=basis, fractal=fractal, amplitude_m=0.4, scale_m=1.5, octaves=4)
    x, y = np.random.default_rng(7).uniform(-400, 400, (2, 30_000))
    heights = made.heights(x, y)
    # Centre and factor come from 8192 points over 64 wavelengths; products of octaves have long tails.
    assert heights.std() == pytest.approx(0.4, rel=0.1 if fractal == "MULTIFRACTAL" else 0.06)
    assert abs(heights.mean()) < 0.1 * 0.4


@pytest.mark.parametrize("hurst", [0.3, 0.6])
def test_midpoint_displacement_has_its_spectrum(hurst):
    """Octaves of ratio 2 with amplitudes 2^-H give a power spectrum of slope -(2H + 2)."""
    made = _layer(basis="MIDPOINT", scale_m=8.0, octaves=8, roughness=2.0**-hurst)
    axis = np.linspace(0, 32, 1024, endpoint=False)
    heights = made.heights(axis[None, :], axis[:, None], 2 * axis[1])
    waves, density = power_spectrum(heights, axis[1])
    inside = (waves > 1 / 4) & (waves < 1 / 0.25)
    slope = np.polyfit(np.log(waves[inside]), np.log(density[inside]), 1)[0]
    # Bilinear cells put ripples of 10 % on the octaves of the spectrum.
    assert slope == pytest.approx(-(2 * hurst + 2), abs=0.2)
    deviations = [rms_deviation(heights, lag) for lag in (8, 64)]
    assert math.log(deviations[1] / deviations[0]) / math.log(8) == pytest.approx(hurst, abs=0.1)


@pytest.mark.parametrize("basis", ["GRADIENT", "VORONOI_F2"])
@pytest.mark.parametrize("fractal", FRACTALS)
def test_octaves_that_a_mesh_cannot_carry_leave_the_mean_height_alone(basis, fractal):
    made = _layer(basis=basis, fractal=fractal, scale_m=2.0, octaves=6, amplitude_m=1.0)
    x, y = np.random.default_rng(2).uniform(-200, 200, (2, 20_000))
    means = [made.heights(x, y, shortest).mean() for shortest in (0.0, 0.15, 0.4, 1.5)]
    # In units of the layer's RMS height. Octaves of products are not independent of each other.
    assert np.abs(np.array(means) - means[0]).max() < 0.15
    assert np.ptp(made.heights(x, y, 2.1)) == 0.0


@pytest.mark.ci_takes(3)
@pytest.mark.parametrize("fractal", FRACTALS)
def test_a_layer_fades_without_steps_and_does_not_depend_on_its_neighbours(fractal):
    made = _layer(fractal=fractal, basis="VORONOI_F1", scale_m=2.0)
    x, y = np.random.default_rng(3).uniform(-10, 10, (2, 400))
    shortest = np.linspace(0.0, 2.5, 400)
    together = made.heights(x, y, shortest)
    alone = [float(made.heights(x[k : k + 1], y[k : k + 1], shortest[k : k + 1])[0]) for k in range(400)]
    assert np.array_equal(together, alone)
    finer, coarser = made.heights(x, y, shortest), made.heights(x, y, shortest + 1e-9)
    # An octave fades within half its wavelength, the finest here 0.03 m: 1e-9 m are 1e-7 of it.
    assert np.abs(finer - coarser).max() < 1e-4


def test_a_warp_moves_the_points_by_its_rms():
    made = _layer(warp_m=0.7, scale_m=2.0)
    x, y = np.random.default_rng(4).uniform(-500, 500, (2, 50_000))
    east, north = made._warp_points(x, y)
    for moved in (east - x, north - y):
        assert moved.std() == pytest.approx(0.7, rel=0.03)  # five standard errors of 5e4 values
    still = _layer(warp_m=0.0, scale_m=2.0)
    assert np.allclose(still.heights(x, y), made.heights(x, y)) is False


def test_the_seed_moves_a_layer_and_nothing_is_nothing():
    x, y = np.random.default_rng(5).uniform(-5, 5, (2, 100))
    assert np.array_equal(_layer(1).heights(x, y), _layer(1).heights(x, y))
    assert not np.array_equal(_layer(1).heights(x, y), _layer(2).heights(x, y))
    assert make_layer(DEFAULTS | {"amplitude_m": 0.0}, np.random.default_rng(0)) is None
