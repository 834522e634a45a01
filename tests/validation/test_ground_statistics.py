"""Statistics of grounds and rocks: the estimators against known truth, and rows that fail where a ground is wrong."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from icymoon.commands.cli import main
from icymoon.physics.rocks.size_laws import PowerLaw
from icymoon.physics.terrain.roughness.statistics import measure_roughness, power_spectrum
from icymoon.physics.terrain.roughness.structure_function import structure_function
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset
from icymoon.validation import ground_hill_rows as hill_rows
from icymoon.validation.comparison import FAILS, PASSES
from icymoon.validation.ground import published, relief
from icymoon.validation.ground.block_laws import fit_exponential_cover, fit_power_index
from icymoon.validation.ground_relief_rows import (
    MARGIN,
    POINTS,
    SPACING_M,
    make_patch_rows,
    make_shadow_rows,
    read_preset,
    sample_square,
)
from icymoon.validation.ground_rock_rows import (
    PlacedRocks,
    list_rock_presets,
    make_exponential_rows,
    make_power_rows,
    place_rocks,
)

MIN_M, MAX_M = 0.05, 1.0


def _draw_power_law(random, index, n, most_m=math.inf):
    """Independent diameters by inversion of N(>D) ~ D^-index."""
    end = (MIN_M / most_m) ** index
    return MIN_M * (random.random(n) * (1 - end) + end) ** (-1 / index)


def _synthesise(hurst, seed, n=1024, shortest=0.0, longest=math.inf):
    """Heights (n/2, n/2) of half of a periodic Gaussian ground whose spectrum falls as k^-(2 + 2 H)."""
    k = np.hypot(np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)[None, :])
    k[0, 0] = 1.0  # only to divide by; the mean height is no relief
    random = np.random.default_rng(seed)
    noise = random.standard_normal((2, *k.shape))
    amplitude = np.where((k * shortest < 1) & (k * longest > 1), k ** -(1 + hurst), 0.0)
    amplitude[0, 0] = 0.0
    return np.fft.irfft2((noise[0] + 1j * noise[1]) * amplitude, (n, n))[: n // 2, : n // 2]


@pytest.mark.parametrize("most_m", [math.inf, MAX_M])
@pytest.mark.parametrize("index", [1.5, 2.0, 3.0])
def test_an_index_is_found_with_the_error_that_it_states(index, most_m):
    random = np.random.default_rng(1)
    found = [fit_power_index(_draw_power_law(random, index, 400, most_m), MIN_M, most_m) for _ in range(200)]
    values, error = np.array([each.value for each in found]), np.mean([each.error for each in found])
    # The mean of 200 has a fourteenth of the error, and their deviation is known to 5 %; bias is below 1 / 400.
    assert values.mean() == pytest.approx(index, abs=4 * error / math.sqrt(200) + index / 200)
    assert values.std(ddof=1) == pytest.approx(error, rel=0.2)


def test_rocks_that_are_missing_below_the_completeness_limit_change_nothing():
    random = np.random.default_rng(2)
    whole = _draw_power_law(random, 3.0, 20000)
    seen = whole[random.random(len(whole)) < np.minimum(1.0, whole / 0.1) ** 2]
    assert fit_power_index(seen, 0.1).value == pytest.approx(3.0, abs=4 * fit_power_index(seen, 0.1).error)
    assert fit_power_index(seen, MIN_M).value < 2.7
    assert math.isnan(fit_power_index(whole, 1e9).value)


def test_abundance_and_decay_are_found():
    random = np.random.default_rng(3)
    q, k = 3.0, 0.1
    candidates = MIN_M + random.exponential(1 / q, 400_000)  # diameters per area
    kept = candidates[random.random(len(candidates)) < (MIN_M / candidates) ** 2]  # diameters per rock
    area = float((math.pi / 4 * kept**2).sum()) / (k * math.exp(-q * MIN_M))
    found = fit_exponential_cover(kept, area, MIN_M, 10.0)
    assert found.q_per_m.value == pytest.approx(q, abs=3 * found.q_per_m.error)
    assert found.k.value == pytest.approx(k, abs=3 * found.k.error)
    assert found.q_per_m.error < 0.1 * q


def test_the_shadow_of_a_wall_has_its_length():
    """A wall of 1 m across the light shades 1 / tan of its foreground, from two of the four Suns."""
    heights = np.zeros((300, 300))
    heights[:, 150] = 1.0
    found = relief.measure_shadow_share(heights, 0.1, 20.0, 50)
    length = round(1 / math.tan(math.radians(20.0)) / 0.1)
    assert found == pytest.approx(2 * length / 200 / 4, rel=0.04)
    assert relief.measure_shadow_share(np.zeros((30, 30)), 0.1, 1.0, 5) == 0.0


@pytest.mark.parametrize("slope", [0.1, 0.2, 0.3, 0.5, 0.7])
@pytest.mark.parametrize("shortest", [4.0, 20.0])
def test_the_closed_form_is_off_on_gaussian_ground_by_what_the_page_states(slope, shortest):
    """At most 0.06 for Suns of 20 and 8 degrees, 0.01 for 60; and the ground has more shadow, as rays correlate."""
    heights = _synthesise(0.8, 1, 2048, shortest, 300.0)
    heights *= slope / relief.measure_point_slope(heights, 1.0)
    for sun, most in ((60.0, 0.01), (20.0, 0.06), (8.0, 0.06)):
        made = relief.measure_shadow_share(heights, 1.0, sun, 256)
        closed = relief.predict_shadow_share(sun, slope)
        assert -0.01 < made - closed < most


def test_the_closed_form_is_dark_under_a_low_sun_and_bright_under_a_high_one():
    shares = [relief.predict_shadow_share(sun, 0.3) for sun in (0.1, 8.0, 20.0, 60.0, 89.0)]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] > 0.98
    assert shares[-1] < 1e-9


def test_a_gaussian_surface_has_the_deviations_of_its_octaves():
    surface = make_terrain(read_preset("terrains/rough").settings, 1).base
    surface = replace(surface, multifractality=0.0)
    squares = []
    lags = [10, 25, 50]
    for seed in range(4):
        made = relief.draw_gaussian_surface(surface, 1024, SPACING_M, np.random.default_rng(seed))
        squares.append(
            [
                (np.mean((made - np.roll(made, k, 0)) ** 2) + np.mean((made - np.roll(made, k, 1)) ** 2)) / 2
                for k in lags
            ]
        )
    distance = np.array(lags)[:, None] * SPACING_M / surface.wavelength_m
    carried = np.array([relief.resolved_share(float(w), 2 * SPACING_M) for w in surface.wavelength_m])
    expected = structure_function(distance) @ (surface.amplitude_m * carried) ** 2
    # Differences along the axes are a few per cent from the mean over directions; four patches scatter by as much.
    assert np.mean(squares, axis=0) == pytest.approx(expected, rel=0.12)


def test_curvature_of_gaussian_ground_and_of_facets():
    assert relief.measure_curvature_kurtosis(_synthesise(0.8, 3)) == pytest.approx(3.0, abs=0.2)
    axis = np.abs((np.arange(400) % 50) - 25.0)
    assert relief.measure_curvature_kurtosis(np.maximum(axis[:, None], axis[None, :])) > 6.0


def test_multifractality_raises_the_kurtosis_as_the_note_states():
    normal = np.random.default_rng(4).standard_normal(200_000)
    for mixing, stated in ((0.5, 3.3), (0.7, 3.7)):
        weight = 1 - mixing + mixing * np.clip(0.5 + normal / 4, 0, 1)
        assert 3 * np.mean(weight**4) / np.mean(weight**2) ** 2 == pytest.approx(stated, abs=0.06)


@pytest.mark.parametrize("hurst", [0.6, 0.8])
def test_the_exponent_of_a_spectrum_is_that_of_the_ground(hurst):
    found = [
        relief.measure_spectral_slope(*power_spectrum(_synthesise(hurst, seed), SPACING_M), 3.0, 0.3)
        for seed in range(4)
    ]
    # One patch has a deviation of 0.1, so the mean of four 0.05.
    assert np.mean(found) == pytest.approx(-2 * (1 + hurst), abs=0.15)


def _verdicts(rows):
    return {row.quantity.split(": ")[1]: row.verdict for row in rows}


def test_ground_as_stated_passes_and_changed_ground_fails():
    preset = read_preset("terrains/rough")
    patch = sample_square(make_terrain(preset.settings, 4), POINTS)
    assert set(_verdicts(make_patch_rows(preset, [patch])).values()) == {PASSES}
    steep = _verdicts(make_patch_rows(preset, [1.2 * patch]))
    assert steep["RMS slope at 1 m"] == steep["RMS slope at 0.25 m"] == FAILS
    assert steep["Hurst exponent"] == PASSES
    other = 2.0 * _synthesise(0.4, 1)[:POINTS, :POINTS]
    rough = _verdicts(make_patch_rows(preset, [other * patch.std() / other.std()]))
    assert rough["Hurst exponent"] == rough["exponent of the power spectrum, 0.3 to 3 m"] == FAILS
    steps = _verdicts(make_patch_rows(preset, [np.round(patch / 0.3) * 0.3]))
    assert steps["kurtosis of curvature"] == FAILS


def test_a_preset_states_the_slope_of_its_whole_ground():
    chaos = read_preset("terrains/chaos")
    patch = sample_square(make_terrain(chaos.settings, 4), POINTS)
    assert set(_verdicts(make_patch_rows(chaos, [patch])).values()) == {PASSES}
    unmended = replace(chaos, stated_slope_deg=float(chaos.settings.terrain.rms_slope_deg))
    assert _verdicts(make_patch_rows(unmended, [patch]))["RMS slope at 1 m"] == FAILS
    smooth = sample_square(make_terrain(read_preset("terrains/rough").settings, 4), POINTS)
    assert _verdicts(make_patch_rows(chaos, [smooth]))["logarithm of the kurtosis of curvature"] == FAILS


def test_shadows_of_random_ground_are_those_of_its_spectrum_and_those_of_plates_are_not():
    preset = read_preset("terrains/rough")
    grounds = [make_terrain(preset.settings, 4)]
    rows = make_shadow_rows(preset, grounds, (4,))
    assert {row.verdict for row in rows if row.quantity.endswith("same spectrum")} == {PASSES}
    plates = replace(grounds[0], landforms=make_terrain(read_preset("terrains/chaos").settings, 4).landforms)
    changed = _verdicts(make_shadow_rows(preset, [plates], (4,)))
    assert changed["share in shadow, Sun at 20°, closed form"] == FAILS
    assert changed["share in shadow, Sun at 60°, same spectrum"] == FAILS


def test_placed_rocks_have_the_asked_law_and_others_fail():
    rocks = list_rock_presets()["sparse"]
    placed = place_rocks(rocks, (4,))
    assert {row.verdict for row in make_power_rows("sparse", rocks, placed)} == {PASSES}
    law = PowerLaw(rocks.coverage, rocks.smallest_m, rocks.largest_m, 4.5)
    chances = np.random.default_rng(1).random(len(placed.diameters_m))
    wrong = PlacedRocks(law.diameter_m(chances * law.total_per_m2), placed.area_m2, placed.smallest_m)
    assert [row.verdict for row in make_power_rows("sparse", rocks, wrong)] == [FAILS, FAILS]
    mars = list_rock_presets()["golombek_20"]
    found = place_rocks(mars, (4,))
    assert {row.verdict for row in make_exponential_rows("golombek_20", mars, found)} == {PASSES}
    fewer = replace(found, diameters_m=found.diameters_m[::2])
    asked, decay, sites = make_exponential_rows("golombek_20", mars, fewer)
    assert (asked.verdict, decay.verdict, sites.verdict) == (FAILS, PASSES, FAILS)
    larger = replace(found, diameters_m=np.minimum(1.5 * found.diameters_m, mars.largest_m))
    assert make_exponential_rows("golombek_20", mars, larger)[1].verdict == FAILS


def test_hills_have_the_asked_slope_and_steeper_ones_fail():
    hills = merged(defaults(), load_preset("scenes/europa_rough_ice")).hills
    square = hill_rows.sample_far_ground("europa_rough_ice", 4)
    near, far = (
        hill_rows.make_far_rows("a", hills, [factor * square], published.EUROPA_ROUGH) for factor in (1.0, 1.5)
    )
    assert _verdicts(near)["RMS slope at 30 m, asked"] == _verdicts(near)["RMS slope at 10 m, Europa"] == PASSES
    assert _verdicts(far)["RMS slope at 30 m, asked"] == _verdicts(far)["RMS slope at 10 m, Europa"] == FAILS
    assert _verdicts(near)["Hurst exponent, 30 to 300 m, asked"] == PASSES
    white = np.random.default_rng(1).standard_normal(square.shape)
    wrong = hill_rows.make_far_rows("a", hills, [white], published.EUROPA_ROUGH)
    assert _verdicts(wrong)["Hurst exponent, 30 to 300 m, asked"] == FAILS


def _light(name, sun_deg):
    """A picture from above by Lambert's law under a Sun in the west, with shadows, and the share of lit ground."""
    heights = sample_square(make_terrain(read_preset(f"terrains/{name}").settings, 1), POINTS + 2 * MARGIN)
    east, north = (np.diff(heights, axis=axis, prepend=0.0) / SPACING_M for axis in (1, 0))
    sun = math.radians(sun_deg)
    cosine = (math.sin(sun) + math.cos(sun) * east) / np.sqrt(1 + east**2 + north**2)
    level = heights + np.arange(heights.shape[1]) * SPACING_M * math.tan(sun)
    lit = level >= np.maximum.accumulate(level, axis=1)
    inner = (slice(MARGIN, -MARGIN),) * 2
    return (np.maximum(cosine, 0.0) * lit)[inner], float(lit[inner].mean())


def test_pictures_with_hardly_any_light_have_a_flat_spectrum():
    """As the page states: exponents of pictures are low where single crests are lit, not where shadows have edges."""
    half, share = _light("rough", 8.0)
    fall = -relief.measure_spectral_slope(*power_spectrum(half, SPACING_M), 3.0, 0.3)
    assert 0.15 < share < 0.35
    assert 1.5 < fall < 2.3
    dark, share = _light("tiger_stripe_flank", 8.0)
    assert share < 0.01
    assert -relief.measure_spectral_slope(*power_spectrum(dark, SPACING_M), 3.0, 0.3) < 1.0
    bright, share = _light("tiger_stripe_flank", 60.0)
    assert share > 0.8
    assert -relief.measure_spectral_slope(*power_spectrum(bright, SPACING_M), 3.0, 0.3) > 1.5


def test_a_slope_of_known_ground_is_found():
    east = np.arange(200)[None, :] * np.ones((200, 1))
    assert relief.measure_point_slope(0.3 * east * SPACING_M, SPACING_M) == pytest.approx(0.3 / math.sqrt(2))
    heights = _synthesise(0.7, 5)
    rise = math.sqrt(
        (np.mean((heights[25:] - heights[:-25]) ** 2) + np.mean((heights[:, 25:] - heights[:, :-25]) ** 2)) / 2
    )
    found = measure_roughness(heights, SPACING_M, 1.0)
    assert found.slope_deg == pytest.approx(math.degrees(math.atan(rise)), rel=0.05)


def test_the_command_judges_grounds_without_a_blender(tmp_path, monkeypatch):
    made = "icymoon.validation.ground_statistics"
    monkeypatch.setattr(f"{made}.make_relief_rows", lambda seeds: [])
    monkeypatch.setattr(f"{made}.make_hill_rows", lambda seeds: [])
    command = ["validate", "--only", "ground", "--quick", "--blender", "/no/blender", "--out", str(tmp_path), "--json"]
    assert main(command) == 0
    report = json.loads((tmp_path / "validation.json").read_text(encoding="utf-8"))
    assert [each["name"] for each in report["comparisons"]] == ["ground"]
    assert {row["verdict"] for row in report["comparisons"][0]["rows"]} == {PASSES}
