"""The random surface: its RMS deviation, power spectrum and cut-offs are what the settings state."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import pytest
from icymoon.physics.terrain.roughness.roughness import fit_amplitudes, list_stated_statistics, octave_wavelengths_m
from icymoon.physics.terrain.roughness.statistics import (
    list_lags,
    measure_roughness,
    power_spectrum,
    remove_plane,
    rms_deviation,
)
from icymoon.physics.terrain.roughness.structure_function import structure_function
from icymoon.physics.terrain.terrain import advise_on_terrain, law_range_m, make_terrain
from icymoon.settings.description import defaults, merged
from icymoon.settings.topics.ground import TerrainSettings
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from marks import heavy_but

SIZE, N = 20.0, 1025
SPACING = SIZE / (N - 1)
#: Waves of three vertex spacings are whole on the mesh; the law is asked for over a decade and a half.
LAW: dict[str, Any] = {"outer_scale_m": 16.0, "inner_scale_m": 0.0625}
SHORTEST, LONGEST = 6 * SPACING, 32 * 6 * SPACING


def _built(seed: int, n: int = N, **changes: Any) -> Array:
    """Heights as a mesh has them: on its grid, in float32."""
    settings = merged(defaults(), {"terrain": {"size_m": SIZE, **LAW, **changes}})
    axis = np.linspace(-SIZE / 2, SIZE / 2, n)
    heights = make_terrain(settings, seed).heights(axis[None, :], axis[:, None], 2 * SIZE / (n - 1))
    return heights.astype(np.float32).astype(np.float64)


def _holds(seed: int, hurst: float, multifractality: float) -> None:
    heights = _built(seed, hurst=hurst, multifractality=multifractality)
    found = measure_roughness(heights, SPACING, 1.0, (0.999 * SHORTEST, 1.001 * LONGEST))
    inside = (found.lag_m > 0.999 * SHORTEST) & (found.lag_m < 1.001 * LONGEST)
    asked = math.tan(math.radians(12.0)) * found.lag_m**hurst
    assert found.lag_m[inside][-1] / found.lag_m[inside][0] > 25
    assert np.abs(found.deviation_m / asked - 1)[inside].max() < 0.10
    assert found.slope_deg == pytest.approx(12.0, rel=0.03)
    # What the longest waves do by chance at the longest lags, a few per cent, over a decade and a half.
    assert found.hurst == pytest.approx(hurst, abs=0.03)
    waves, density = power_spectrum(heights, SPACING)
    # Between the octaves at the ends, which also stand for the waves missing beyond them.
    band = (waves > 1 / 4.0) & (waves < 1 / 0.25)
    slope = np.polyfit(np.log(waves[band]), np.log(density[band]), 1)[0]
    # Few long waves fix the low end: 25 waves per patch at 4 m scatter by 20 %, over a factor of 16 in wavelength. Near
    # H = 1 long waves make up the deviation at all distances, and making up for their chance moves the spectrum more.
    assert slope == pytest.approx(-(2 * hurst + 2), abs=0.3 if hurst < 0.85 else 0.5)


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize(
    ("hurst", "multifractality"),
    heavy_but([(0.3, 1.0), (0.8, 0.0), (0.95, 0.5)], product([0.3, 0.5, 0.8, 0.95], [0.0, 0.5, 1.0])),
)
def test_the_deviation_and_the_spectrum_are_as_stated(hurst, multifractality):
    _holds(round(100 * hurst + 10 * multifractality), hurst, multifractality)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("multifractality", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("hurst", [0.3, 0.4, 0.6, 0.7, 0.9, 0.95])
def test_the_deviation_and_the_spectrum_are_as_stated_for_every_seed(hurst, multifractality, seed):
    _holds(seed, hurst, multifractality)


@pytest.mark.parametrize("lacunarity", [1.4, 2.0, 2.5])
@pytest.mark.parametrize("hurst", [0.2, 0.5, 0.8, 0.95])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_independent_octaves_sum_to_the_law(hurst, lacunarity, dimensions):
    wavelength = 10.0 / lacunarity ** np.arange(round(math.log(1000) / math.log(lacunarity)))
    unit = fit_amplitudes(wavelength, hurst, dimensions)
    lag = np.geomspace(wavelength[-1], 0.25 * wavelength[0], 60)
    deviation = np.sqrt(structure_function(lag[:, None] / wavelength, dimensions) @ unit**2)
    assert np.abs(deviation / lag**hurst - 1).max() < 0.07
    # A pure power of the wavelength between the ends, which is the slope of the spectrum.
    inner = unit[2:-1] / wavelength[2:-1] ** hurst
    assert np.ptp(inner) < 1e-9 * inner[0]


@pytest.mark.ci_takes(4)
@pytest.mark.parametrize(
    ("baseline", "slope"),
    heavy_but([(0.5, 60.0), (1.0, 12.0), (2.0, 2.0)], product([0.5, 1.0, 2.0], [2.0, 12.0, 35.0, 60.0])),
)
def test_the_patch_has_the_stated_slope_at_its_baseline(slope, baseline):
    for seed in (1, 2):
        heights = _built(seed, 513, rms_slope_deg=slope, slope_baseline_m=baseline, inner_scale_m=0.12)
        found = measure_roughness(heights, SIZE / 512, baseline)
        assert math.tan(math.radians(found.slope_deg)) == pytest.approx(math.tan(math.radians(slope)), rel=0.04)


def test_nothing_is_longer_than_the_outer_cut_off_nor_shorter_than_the_inner():
    heights = _built(2, multifractality=0.0, outer_scale_m=1.0, inner_scale_m=0.25)
    waves, density = power_spectrum(heights, SPACING)
    power = density * waves**2  # per octave
    # The longest octave, which stands for all beyond it; gradient noise of a wavelength peaks at 0.7 waves in it.
    assert waves[np.argmax(power)] == pytest.approx(0.7, rel=0.3)
    # The law would leave more at 4 m than at 1 m. The density of gradient noise starts as k², power per octave as k⁴.
    assert power[waves < 1 / 4].max() < 0.1 * power.max()
    # The law would leave 1/17^1.6 = 1 % at 0.06 m.
    assert power[waves > 1 / 0.06].max() < 1e-5 * power.max()
    flat = rms_deviation(heights, 1) / rms_deviation(heights, 2)
    assert flat == pytest.approx(0.5, rel=0.02)  # smooth: a plane at a tenth of the shortest wave


def test_a_surface_is_smooth_below_and_level_above_its_cut_offs():
    heights = _built(3, multifractality=0.0, outer_scale_m=1.0, inner_scale_m=0.25)
    saturated = [rms_deviation(heights, round(lag / SPACING)) for lag in (1.5, 3.0, 5.0)]
    # Independent heights differ by √2 times their RMS whatever their distance; 400 waves leave 5 % to chance.
    assert np.allclose(saturated, math.sqrt(2) * remove_plane(heights).std(), rtol=0.08)


def test_multifractal_ground_is_smooth_in_hollows():
    def roughness_ratio(multifractality: float) -> float:
        heights = _built(3, 401, multifractality=multifractality, outer_scale_m=8.0)
        curvature = np.abs(np.diff(heights, 2, axis=1))
        middle = heights[:, 1:-1]
        low, high = middle < np.quantile(middle, 0.2), middle > np.quantile(middle, 0.8)
        return float(curvature[high].mean() / curvature[low].mean())

    assert roughness_ratio(0.0) == pytest.approx(1.0, abs=0.25)
    assert roughness_ratio(1.0) > 2.0


def test_an_exponent_under_a_half_is_warned_of_where_it_is_absurd():
    def notes(shortest_m: float = 0.04, **changes: Any) -> list[str]:
        return advise_on_terrain(merged(defaults(), {"terrain": changes}), shortest_m)

    (steep, _) = notes(hurst=0.3)
    # tan 12° (0.04)^(0.3 - 1) = 2.02: 64 degrees, as in the field's own examples.
    assert "64 degrees at 0.04 m" in steep
    assert "terrain.inner_scale_m" in steep
    assert notes(hurst=0.3, inner_scale_m=0.5) == []
    assert notes(hurst=0.8) == []


def test_a_mesh_that_loses_the_law_says_so():
    def lost(hurst: float, **changes: Any) -> list[str]:
        settings = merged(defaults(), {"terrain": {"hurst": hurst, "rms_slope_deg": 5.0, **changes}})
        return [note for note in advise_on_terrain(settings, 2 * SPACING) if "smoother" in note]

    (note,) = lost(0.3)
    share = int(note.split("%")[0].split()[-1])
    settings: dict[str, Any] = {"hurst": 0.3, "rms_slope_deg": 5.0, "inner_scale_m": 0.02}
    heights = _built(1, multifractality=0.0, **settings)
    asked = math.tan(math.radians(5.0)) * SHORTEST**0.3
    # The law is met by the whole surface within 10 %.
    assert 1 - share / 100 == pytest.approx(rms_deviation(remove_plane(heights), 6) / asked, abs=0.05)
    assert lost(0.8) == []
    assert lost(0.3, inner_scale_m=0.0625) == []


@pytest.mark.parametrize("lacunarity", [1.3, 2.0, 3.7])
@pytest.mark.parametrize("inner", [0.02, 0.3, 7.9, 8.0])
def test_octaves_go_from_one_cut_off_to_the_other(inner, lacunarity):
    wavelength = octave_wavelengths_m(TerrainSettings(outer_scale_m=8.0, inner_scale_m=inner, lacunarity=lacunarity))
    assert (wavelength[0], wavelength[-1]) == pytest.approx((8.0, inner))
    ratios = wavelength[:-1] / wavelength[1:]
    assert np.ptp(ratios) < 1e-6 if len(ratios) else inner == 8.0
    assert (ratios <= lacunarity * (1 + 1e-6)).all()


def test_cut_offs_that_make_no_sense():
    for changes, word in (
        ({"outer_scale_m": 0.5, "inner_scale_m": 1.0}, "longer than"),
        ({"outer_scale_m": 1e5, "inner_scale_m": 1e-4, "lacunarity": 1.2}, "octaves"),
    ):
        with pytest.raises(IcyMoonError, match=word):
            octave_wavelengths_m(merged(defaults(), {"terrain": changes}).terrain)
    assert law_range_m(defaults().terrain) == pytest.approx((0.01, 2.4))


def test_the_measures_on_surfaces_that_are_known():
    axis = np.arange(400.0)
    wave = 2.0 * np.sin(2 * math.pi * axis / 40.0)[None, :] * np.ones((400, 1))
    # <(z(x + d) - z(x))²> of a sine of amplitude 2 is 4 (1 - cos kd) along it and 0 across it.
    for lag in (5, 10, 20):
        assert rms_deviation(wave, lag) == pytest.approx(
            math.sqrt(4 * (1 - math.cos(2 * math.pi * lag / 40)) / 2), rel=0.01
        )
    plane = 0.2 * axis[None, :] - 0.1 * axis[:, None] + 7.0
    assert np.abs(remove_plane(plane)).max() < 1e-10
    white = np.random.default_rng(0).normal(size=(512, 512))
    waves, density = power_spectrum(white, 0.5)
    # White noise: variance 1 spread over the square of Nyquist wave numbers, side 1/spacing.
    assert np.average(density, weights=waves) == pytest.approx(0.25, rel=0.02)
    assert list_lags(256)[0] == 1
    assert list_lags(256)[-1] == 256
    assert math.isnan(rms_deviation(plane, 400))
    found = measure_roughness(plane, 1.0, 10.0)
    assert found.slope_deg == pytest.approx(0.0, abs=1e-6)
    numbers = measure_roughness(white, 0.5, 10.0).numbers()
    assert numbers["rms_slope_deg"] == pytest.approx(math.degrees(math.atan(math.sqrt(2) / 10.0)), rel=0.01)
    assert numbers["rms_height_m"] == pytest.approx(1.0, rel=0.01)
    assert measure_roughness(white, 0.5, 1000.0).numbers()["rms_slope_deg"] is None


@pytest.mark.parametrize("hurst", [0.5, 0.9])
def test_the_statistics_that_are_asked_are_those_of_a_patch_of_many_waves(hurst):
    """On 20 m with waves up to 2 m, chance hardly counts."""
    terrain = defaults().terrain | TerrainSettings(outer_scale_m=2.0, hurst=hurst, slope_baseline_m=0.5)
    heights = _built(1, 513, outer_scale_m=2.0, hurst=hurst, slope_baseline_m=0.5)
    asked, made = list_stated_statistics(terrain), measure_roughness(heights, SIZE / 512, 0.5).numbers()
    assert asked["rms_slope_deg"] == 12.0
    assert made["rms_slope_deg"] == pytest.approx(12.0, rel=0.05)
    assert made["rms_height_m"] == pytest.approx(asked["rms_height_m"], rel=0.1)
