"""Photons, lens, particles and brackets against what is known of them without the code."""

import math

import numpy as np
import pytest
from icymoon.physics.camera import exposure_brackets
from icymoon.physics.camera.particle_hits import draw_hits, expected_hit_count
from icymoon.physics.camera.point_spread import apply_point_spread, gaussian_kernel
from icymoon.physics.camera.sensor import (
    choose_exposure_s,
    collect_electrons,
    convert_to_digital,
    make_noise_generator,
    warn_on_exposure,
)
from icymoon.physics.light.photons import band_share, electron_rate, pixel_pitch_m, planck_radiance, total_radiance
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")


def settings(**sensor):
    described = defaults()
    described.sensor |= sensor
    return described.light, described.sensor


def random():
    return make_noise_generator(1, "pair", "left")


def test_a_black_body_radiates_what_stefan_and_wien_say():
    # 5772 K and the Sun's radius and distance give the solar constant (IAU 2015 nominal values, 1361 W/m²).
    assert total_radiance(5772.0) * math.pi * (6.957e8 / 1.495978707e11) ** 2 == pytest.approx(1361.0, rel=1e-3)
    wavelength = np.linspace(100e-9, 3e-6, 200001)
    assert wavelength[planck_radiance(wavelength, 5772.0).argmax()] == pytest.approx(2.897771955e-3 / 5772, rel=1e-4)
    whole = np.trapezoid if hasattr(np, "trapezoid") else np.trapz
    inside = (wavelength >= 500e-9) & (wavelength <= 700e-9)
    expected = whole(planck_radiance(wavelength[inside], 5772.0), wavelength[inside]) / total_radiance(5772.0)
    assert band_share(*settings(band_centre_nm=600.0, band_width_nm=200.0)) == pytest.approx(expected, rel=1e-3)
    assert 0.24 < expected < 0.26


def test_electrons_follow_aperture_band_and_pixel_area():
    light, sensor = settings(
        band_centre_nm=600.0, band_width_nm=1.0, f_number=4.0, transmission=0.8, quantum_efficiency=0.5
    )
    light["irradiance_band"] = "CAMERA"
    # By hand: 2 W/(m² sr) at 600 nm on a 10 µm pixel behind f/4.
    watts = math.pi * 0.8 * 2.0 / (1 + 4 * 16) * 1e-10
    photons = watts * 600e-9 / (6.62607015e-34 * 299792458)
    assert 2.0 * electron_rate(light, sensor, 10e-6) == pytest.approx(0.5 * photons, rel=1e-6)
    light["irradiance_band"] = "BOLOMETRIC"
    assert electron_rate(light, sensor, 10e-6) / (photons / 4) == pytest.approx(band_share(light, sensor), rel=1e-6)


def test_the_lens_keeps_an_even_image_and_the_total_of_a_point():
    _, sensor = settings(psf_sigma_px=1.3, veiling_glare=0.05)
    np.testing.assert_allclose(apply_point_spread(np.full((20, 30), 3.0), sensor), 3.0, rtol=1e-12)
    point = np.zeros((61, 61))
    point[30, 30] = 1.0
    image = apply_point_spread(point, sensor)
    assert image.sum() == pytest.approx(1.0, rel=1e-9)
    assert image[0, 0] == pytest.approx(0.05 / 61**2, rel=1e-6)
    sharp = apply_point_spread(point, sensor | {"veiling_glare": 0.0})
    offsets = np.arange(61) - 30.0
    # A pixel's own width adds its variance, 1/12, and the cut at four deviations takes 1e-3 of it.
    assert (sharp.sum(axis=0) * offsets**2).sum() == pytest.approx(1.3**2 + 1 / 12, rel=3e-3)
    assert gaussian_kernel(0.01).max() == pytest.approx(1.0)
    assert np.isfinite(apply_point_spread(np.full((3, 3), np.inf), sensor)).all()


def test_veiling_glare_is_its_index():
    _, sensor = settings(veiling_glare=0.03)
    image = np.ones((100, 100))
    image[50, 50] = 0.0  # a small black target in a bright surround
    assert apply_point_spread(image, sensor)[50, 50] == pytest.approx(0.03, rel=1e-3)


def test_particles_come_in_poisson_numbers_and_leave_their_ionisation():
    _, sensor = settings(radiation_flux_cm2_s=2000.0, radiation_depth_um=0.1, radiation_e_per_um=80.0)
    shape, pitch, seconds = (200, 300), 10e-6, 0.5
    mean = expected_hit_count(sensor, shape, pitch, seconds)
    assert mean == pytest.approx(2000 * 0.2 * 0.3 * 0.5)
    # So shallow that nearly every track lies in one pixel: pixels hit are hits.
    counts = [
        np.count_nonzero(draw_hits(sensor, shape, pitch, seconds, make_noise_generator(k, "p", "left")))
        for k in range(400)
    ]
    assert np.mean(counts) == pytest.approx(mean, abs=5 * math.sqrt(mean / 400) + 0.02 * mean)
    assert np.var(counts) == pytest.approx(mean, rel=0.4)
    image = draw_hits(sensor, shape, pitch, seconds, random())
    assert image[image > 0].min() == pytest.approx(8.0, rel=0.2)  # 0.1 µm straight through


def test_tracks_are_as_long_as_isotropic_particles_make_them():
    _, sensor = settings(radiation_flux_cm2_s=1.0e4, radiation_depth_um=50.0)
    image = draw_hits(sensor, (400, 400), 5e-6, 1.0, random())
    total = image.sum() / 80.0 / 50.0
    # Mean of 1 / cos θ with cos² θ even is 2; tracks over the border take some away.
    assert total == pytest.approx(2 * expected_hit_count(sensor, (400, 400), 5e-6, 1.0), rel=0.3)
    other = draw_hits(sensor, (400, 400), 5e-6, 1.0, make_noise_generator(1, "pair", "right"))
    assert not np.array_equal(image, other)


def test_electrons_are_those_of_a_photon_budget_by_hand():
    """Radiance x solid angle x pixel area x exposure x efficiency over the energy of a photon, in a narrow band."""
    light, sensor = settings(
        pixel_pitch_um=6.4,
        f_number=12.0,
        transmission=0.85,
        quantum_efficiency=0.45,
        band_centre_nm=600.0,
        band_width_nm=0.1,
    )
    light = light | {"irradiance_band": "CAMERA"}
    radiance, seconds = 12.5, 3e-3
    # A lens of f/N seen from its image fills sin² of half its angle = 1 / (1 + 4 N²): that times pi is its solid
    # angle, each direction weighted by its slant. Photons of 600 nm have hc/λ to (0.05 / 600)² within the band.
    solid_angle_sr = math.pi / (1 + 4 * 12.0**2)
    joules = radiance * 0.85 * solid_angle_sr * (6.4e-6) ** 2 * seconds
    by_hand = 0.45 * joules / (6.62607015e-34 * 299792458.0 / 600e-9)
    pitch_m = pixel_pitch_m(sensor, defaults().rig)
    assert electron_rate(light, sensor, pitch_m) * radiance * seconds == pytest.approx(by_hand, rel=1e-6)


def test_the_pixel_is_the_sensors_or_else_the_rigs():
    rig = defaults().rig
    assert pixel_pitch_m(settings()[1], rig) == pytest.approx(60e-3 / 640)
    assert pixel_pitch_m(settings(pixel_pitch_um=12.0)[1], rig) == pytest.approx(12e-6)


@pytest.mark.parametrize("name", ["mer_ccd", "mars2020_cmos", "europa_radiation"])
def test_real_pixels_expose_sunlit_europa_as_long_as_real_cameras_do(name):
    """Tens of milliseconds and more; the 94 µm that the paper's 60 mm make of 640 columns take a hundredth of it."""
    described = merged(defaults(), load_preset("rigs/guiss"), load_preset(f"sensors/{name}"))
    # Level Lambert ground of albedo 0.6 under the Sun of Europa, 30 degrees high.
    radiance = np.full((8, 8), 0.6 * 50.26 * 0.5 / math.pi)

    def auto(sensor):
        rate = electron_rate(described.light, sensor, pixel_pitch_m(sensor, described.rig))
        return choose_exposure_s(radiance, rate, sensor)

    real, wide = auto(described.sensor), auto(described.sensor | {"pixel_pitch_um": 0.0})
    assert 0.01 < real < 0.5
    assert wide / real == pytest.approx((described.sensor.pixel_pitch_um / 93.75) ** 2, rel=1e-6)
    assert not warn_on_exposure(auto(described.sensor), 0.0, described.sensor)


def test_particles_of_jupiters_belts_are_seen_in_an_exposure_of_sunlit_ice():
    """Flux x area x exposure by hand, at the flux of the preset. With auto exposure it is the same for pixels of any
    size, which gather light and particles alike, but tracks are longer than a small pixel."""
    described = merged(defaults(), load_preset("rigs/guiss"), load_preset("sensors/europa_radiation"))
    sensor = described.sensor
    pitch_m = pixel_pitch_m(sensor, described.rig)
    seconds = choose_exposure_s(
        np.full((8, 8), 0.6 * 50.26 * 0.5 / math.pi), electron_rate(described.light, sensor, pitch_m), sensor
    )
    by_hand = 1e5 * (640 * 6.5e-4) * (480 * 6.5e-4) * seconds
    assert expected_hit_count(sensor, (480, 640), pitch_m, seconds) == pytest.approx(by_hand, rel=1e-9)
    assert 10 < by_hand < 1000
    freed = draw_hits(sensor, (480, 640), pitch_m, seconds, random())
    assert freed.sum() > 0.9 * by_hand * 80 * 10  # each 80 e- per µm over 10 µm at least, less what leaves the image
    assert np.count_nonzero(freed > 5 * sensor.read_noise_e) > 1.5 * by_hand
    wide = draw_hits(sensor, (480, 640), 93.75e-6, seconds * (6.5 / 93.75) ** 2, random())
    assert np.count_nonzero(wide) < 1.3 * by_hand


@pytest.mark.parametrize(
    ("seconds", "saturated", "changes", "words"),
    [
        (1e-6, 0.0, {}, ["shortest time, 1e-06 s"]),
        (1e3, 0.0, {}, ["longest time"]),
        (0.01, 0.3, {}, ["More than 2% of the left", "sensor.auto_target"]),
        (0.01, 0.0199, {}, []),
        (1e-6, 0.5, {"auto_exposure": False}, ["More than 2% of the left", "sensor.exposure_s"]),
        (0.01, 0.0, {}, []),
    ],
    ids=str,
)
def test_an_exposure_at_its_end_or_too_long_is_said(seconds, saturated, changes, words):
    said = warn_on_exposure(seconds, saturated, settings(**changes)[1])
    assert len(said) == bool(words)
    assert all(word in " ".join(said) for word in words)


def test_a_flood_of_particles_is_refused_by_name_and_none_is_none():
    _, sensor = settings(radiation_flux_cm2_s=1.0e12)
    with pytest.raises(IcyMoonError, match=r"sensor\.radiation_flux_cm2_s"):
        draw_hits(sensor, (480, 640), 94e-6, 1.0, random())
    _, sensor = settings(radiation_flux_cm2_s=0.0)
    assert not draw_hits(sensor, (48, 64), 94e-6, 1.0, random()).any()


def test_brackets_widen_the_range_and_keep_the_light():
    _, sensor = settings(
        brackets=3, bracket_stops=3.0, bits=10, shot_noise=False, read_noise_e=0.0, dark_current_e_s=0.0
    )
    times = exposure_brackets.list_exposure_times(0.1, sensor)
    np.testing.assert_allclose(times, [0.8, 0.1, 0.0125])
    rate = np.geomspace(100.0, 1.5e6, 500)[None, :]  # electrons per second, from a full well's 1e-5 to 1
    numbers = [convert_to_digital(collect_electrons(rate, t, 1.0, sensor, random()), sensor) for t in times]
    merged = exposure_brackets.merge_exposures(numbers, times, sensor)
    # Half a number of each exposure that is not full, 20000 e- / 1023 / 2, over the time of all of them.
    usable = [rate * t < 19980 for t in times[:2]] + [np.ones_like(rate, bool)]
    step = 9.78 * sum(usable) / sum(u * t for u, t in zip(usable, times, strict=True))
    assert (np.abs(merged - rate) <= step).all()
    one = convert_to_digital(collect_electrons(rate, times[2], 1.0, sensor, random()), sensor)
    dim = rate < 1000
    error = np.abs(exposure_brackets.merge_exposures([one], times[2:], sensor) - rate)[dim].mean()
    assert np.abs(merged - rate)[dim].mean() < error / 20  # 64 times the exposure
    full = exposure_brackets.find_full_rate(merged, times[-1], sensor)
    assert full == 20000 / times[-1]  # the brightest pixels all but fill the shortest exposure
    final = exposure_brackets.quantise_merged(merged, full)
    assert final.dtype == np.uint16
    assert final[0, -1] == pytest.approx(65535 * 1.5e6 * 0.0125 / 20000, rel=1e-3)
    assert exposure_brackets.find_full_rate(merged / 10, times[-1], sensor) == pytest.approx(1.5e6 / 10 / 0.9, rel=0.02)
    assert not exposure_brackets.quantise_merged(
        merged * 0, exposure_brackets.find_full_rate(merged * 0, times[-1], sensor)
    ).any()


def test_merging_noisy_exposures_beats_the_longest_usable_one():
    _, sensor = settings(brackets=2, bracket_stops=1.0, bits=16)
    times = exposure_brackets.list_exposure_times(1.0, sensor)
    generator = random()
    numbers = [
        convert_to_digital(collect_electrons(np.full((300, 300), 5000.0), t, 1.0, sensor, generator), sensor)
        for t in times
    ]
    merged, longest = (
        exposure_brackets.merge_exposures(numbers, times, sensor),
        exposure_brackets.merge_exposures(numbers[:1], times[:1], sensor),
    )
    assert merged.mean() == pytest.approx(5000, rel=1e-3)
    # A full well that is read a little low must not pass for light.
    bright = [
        convert_to_digital(collect_electrons(np.full((300, 300), 30000.0), t, 1.0, sensor, generator), sensor)
        for t in (1.0, 0.1)
    ]
    assert exposure_brackets.merge_exposures(bright, (1.0, 0.1), sensor).min() > 27000
    # Shot noise of 1.5 times the light: a variance of 2/3, and read noise twice instead of once.
    assert merged.var() / longest.var() == pytest.approx(2 / 3, rel=0.05)
