"""The camera's sensor against theory: EMVA 1288's chain, exposure, saturation, reproducibility."""

from typing import Any

import numpy as np
import pytest
from icymoon.physics.camera.sensor import (
    LONGEST_S,
    SHORTEST_S,
    capacity_e,
    choose_exposure_s,
    collect_electrons,
    convert_to_digital,
    dark_current_e_s,
    draw_pattern,
    gain_dn_per_e,
    make_noise_generator,
    spread_overflow,
    warn_on_exposure,
)
from icymoon.physics.light.photons import electron_rate
from icymoon.settings.description import defaults
from icymoon.settings.topics.camera import SensorSettings

pytestmark = pytest.mark.filterwarnings("error")

N = 200_000
QUIET = {"shot_noise": False, "read_noise_e": 0.0, "dark_current_e_s": 0.0}


def sensor(**changes: Any) -> SensorSettings:
    return defaults().sensor | {"dark_current_e_s": 0.0} | changes


def random():
    return make_noise_generator(1, "pair", "left")


def exposed(charge, settings, seconds=1.0, **more):
    """Electrons where light at 1 e-/s per unit frees a mean of ``charge``."""
    return collect_electrons(np.asarray(charge, float) / seconds, seconds, 1.0, settings, random(), **more)


@pytest.mark.parametrize("mean", [40.0, 1000.0, 8000.0])
def test_noise_has_the_mean_and_variance_of_poisson_plus_read_noise(mean):
    charge = exposed(np.full(N, mean), sensor(full_well_e=20000.0, read_noise_e=15.0))
    variance = mean + 15.0**2
    assert abs(charge.mean() - mean) < 5 * np.sqrt(variance / N)
    # The variance of the sample variance of near-Gaussian numbers is 2 σ⁴ / N.
    assert abs(charge.var() - variance) < 5 * variance * np.sqrt(2 / N)


def test_row_noise_is_shared_by_a_row_and_new_in_each_exposure():
    """Means of rows contain all of it, and of the other noise a part in 400 of the variance."""
    settings = sensor(**QUIET | {"read_noise_e": 3.0, "row_noise_e": 5.0})
    generator = random()
    one, two = (collect_electrons(np.zeros((3000, 400)), 1.0, 1.0, settings, generator) for _ in range(2))
    rows = one.mean(axis=1)
    expected = 25.0 + 9.0 / 400
    assert abs(rows.var(ddof=1) - expected) < 5 * expected * np.sqrt(2 / 3000)
    # Within a row there is only read noise, and the next exposure has other rows.
    assert abs((one - rows[:, None]).var() - 9.0) < 5 * 9.0 * np.sqrt(2 / one.size) + 9.0 / 400
    assert abs(np.corrcoef(rows, two.mean(axis=1))[0, 1]) < 5 / np.sqrt(3000)


def test_images_without_row_noise_stay_as_they_were():
    light = np.full((8, 9), 500.0)
    assert np.array_equal(exposed(light, sensor(row_noise_e=0.0)), exposed(light, sensor()))
    noisy = exposed(light, sensor(row_noise_e=4.0)) - exposed(light, sensor())
    assert np.allclose(noisy, noisy[:, :1])
    assert np.ptp(noisy[:, 0]) > 0


def test_photon_transfer_curve_gives_gain_read_noise_and_full_well_back():
    settings = sensor(bits=16, black_level=0.01, full_well_e=15000.0, read_noise_e=6.0, gain=1.0)
    levels = np.linspace(0, 20000, 60)
    means, variances = [], []
    generator = random()
    for level in levels:
        # EMVA 1288 measures temporal noise as half the variance of the difference of two images.
        one, two = (
            convert_to_digital(collect_electrons(np.full(N, level), 1.0, 1.0, settings, generator), settings).astype(
                float
            )
            for _ in "12"
        )
        means.append((one.mean() + two.mean()) / 2)
        variances.append((one - two).var() / 2)
    mean, variance = np.array(means), np.array(variances)
    signal = mean - mean[0]
    linear = signal < 0.7 * signal.max()
    # Weighted by what a sample variance is uncertain by, 40 levels of 2e5 pixels give the slope to 0.1 %.
    gain, _ = np.polyfit(signal[linear], variance[linear], 1, w=1 / variance[linear])
    read_noise = np.sqrt(variance[0] - 1 / 12) / gain  # without the converter's rounding
    saturation = levels[variance.argmax()]
    full_well = (mean.max() - mean[0]) / gain
    assert gain == pytest.approx(gain_dn_per_e(settings), rel=0.01)
    assert read_noise == pytest.approx(6.0, rel=0.01)
    assert full_well == pytest.approx(15000.0, rel=0.01)
    # The variance falls once shot noise is cut off, within three of its deviations below the full well.
    assert 15000 - 3 * np.sqrt(15000) - 340 < saturation <= 15000


def test_without_noise_the_response_is_linear_and_exact():
    light = np.array([0.0, 0.1, 0.5, 1.0])
    np.testing.assert_allclose(collect_electrons(light, 0.5, 4e4, sensor(**QUIET), random()), light * 20000)


def test_a_full_well_stays_full_however_much_light_there_is():
    charge = exposed([20000.0, 1e6, 1e30, np.inf], sensor(**QUIET))
    assert (charge == 20000.0).all()
    flooded = exposed(np.full(N, 1e6), sensor())
    assert abs(flooded.mean() - 20000) < 1
    assert abs(flooded.std() - 15) < 0.2  # read noise only


def test_offsets_of_pixels_stay_where_the_well_is_full():
    """They come with reading, behind the well, so that a flooded image shows them as a dark one does."""
    settings = sensor(dsnu_e=7.0, **QUIET)
    pattern = draw_pattern(3, "left", (50, 40), settings)
    dark, flooded = (exposed(np.full((50, 40), level), settings, pattern=pattern) for level in (0.0, 1e9))
    np.testing.assert_allclose(dark, pattern.offset_e)
    np.testing.assert_allclose(flooded - 20000.0, pattern.offset_e, atol=1e-9)


def test_defective_radiance_is_dark():
    assert (exposed([np.nan, -1.0], sensor(read_noise_e=0.0)) == 0).all()


def test_dark_current_doubles_with_temperature_and_has_shot_noise():
    settings = sensor(
        dark_current_e_s=100.0, temperature_k=301.0, dark_reference_k=293.0, dark_doubling_k=8.0, read_noise_e=0.0
    )
    assert dark_current_e_s(settings) == pytest.approx(200.0)
    charge = exposed(np.zeros(N), settings, seconds=10.0)
    assert abs(charge.mean() - 2000) < 5 * np.sqrt(2000 / N)
    assert abs(charge.var() - 2000) < 5 * 2000 * np.sqrt(2 / N)
    assert dark_current_e_s(settings | {"temperature_k": 0.0}) < 1e-8


def test_fixed_patterns_have_their_width_and_stay():
    settings = sensor(prnu=0.02, dsnu_e=7.0, **{"shot_noise": False, "read_noise_e": 0.0})
    shape = (500, 400)
    pattern = draw_pattern(3, "left", shape, settings)
    again, other = draw_pattern(3, "left", shape, settings), draw_pattern(3, "right", shape, settings)
    np.testing.assert_array_equal(pattern.response, again.response)
    assert abs(np.corrcoef(np.ravel(pattern.response), np.ravel(other.response))[0, 1]) < 5 / np.sqrt(N)
    dark, lit = (exposed(np.full(shape, level), settings, pattern=pattern) for level in (0.0, 10000.0))
    assert dark.std() == pytest.approx(7.0, rel=0.02)
    assert (lit - dark).std() == pytest.approx(200.0, rel=0.02)


def test_overflow_fills_the_column_and_is_kept_or_drained():
    charge = np.zeros((101, 3))
    charge[50, 1] = 9.0
    spilt = spread_overflow(charge, 2.0, 1.0)
    assert spilt[:, 1].sum() == pytest.approx(9.0)  # nothing left the image
    assert spilt[:, [0, 2]].sum() == 0
    np.testing.assert_allclose(spilt[47:54, 1], [0, 1.5, 2, 2, 2, 1.5, 0])
    assert spread_overflow(charge, 2.0, 0.5)[:, 1].sum() == pytest.approx(2 + 3.5)
    flooded = spread_overflow(np.full((4, 2), 1e9), 2.0, 1.0)
    assert (flooded == 2.0).all()


@pytest.mark.parametrize(("row", "filled"), [(0, [2, 2, 1.5, 0, 0]), (4, [0, 0, 1.5, 2, 2]), (2, [1.5, 2, 2, 2, 1.5])])
def test_half_of_an_overflow_runs_up_and_half_down_and_out_of_the_image(row, filled):
    charge = np.zeros((5, 1))
    charge[row] = 9.0
    np.testing.assert_allclose(spread_overflow(charge, 2.0, 1.0)[:, 0], filled)
    np.testing.assert_allclose(exposed(charge, sensor(**QUIET, full_well_e=2.0, blooming=1.0))[:, 0], filled)
    assert (exposed(charge, sensor(**QUIET, full_well_e=2.0))[:, 0] == np.minimum(charge[:, 0], 2.0)).all()


@pytest.mark.parametrize("auto", [True, False])
def test_what_is_wrong_with_an_exposure_is_told_with_what_to_change(auto):
    def told(seconds, saturated):
        return warn_on_exposure(seconds, saturated, sensor(auto_exposure=auto))

    assert told(0.1, 0.0) == told(0.1, 0.02) == []
    (much,) = told(0.1, 0.021)
    assert "More than 2%" in much
    assert ("sensor.auto_target" in much) == auto
    assert ("sensor.exposure_s" in much) != auto
    for seconds, end in ((SHORTEST_S, "shortest"), (LONGEST_S, "longest")):
        assert [end in line for line in told(seconds, 0.0)] == [True] * auto
        assert len(told(seconds, 0.5)) == 1 + auto


def test_the_noise_of_a_pair_is_that_of_the_first_release():
    """Or images would differ that are developed anew."""
    drawn = [
        make_noise_generator(1, "0123456789ab", eye, *index).integers(1 << 30)
        for eye in ("left", "right")
        for index in ((), (1,))
    ]
    assert drawn == [398687802, 777532168, 928075206, 716836773]


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_the_converter_is_linear_and_ends_at_both_ends(bits):
    top = 2**bits - 1
    numbers = convert_to_digital(np.array([-40.0, 0.0, 10100.0, 20000.0, 20040.0]), sensor(bits=bits))
    assert numbers.dtype == np.uint16
    assert numbers.tolist() == [0, 0, round(top * 0.505), top, top]
    raised = convert_to_digital(np.array([-1e9, 0.0, 20000.0]), sensor(bits=bits, black_level=0.1))
    assert raised.tolist() == [0, round(top / 10), top]


def test_gain_above_one_fills_the_converter_before_the_well():
    settings = sensor(gain=4.0, **{"shot_noise": False, "read_noise_e": 0.0})
    assert capacity_e(settings) == 5000
    assert convert_to_digital(np.array([5000.0, 2520.0]), settings).tolist() == [255, 129]
    assert choose_exposure_s(np.full(9, 2.0), 10.0, sensor(gain=4.0, auto_target=0.5)) == pytest.approx(5000 / 2 / 20)
    assert convert_to_digital(np.array([19900.0]), sensor(gain=0.5)).tolist() == [127]
    assert capacity_e(sensor(gain=0.5)) == capacity_e(sensor(gain=1.0)) == 20000


def test_auto_exposure_puts_the_percentile_at_the_target():
    light = np.linspace(0.0, 4.0, 1001)
    settings = sensor(auto_percentile=0.5, auto_target=0.25, **{"shot_noise": False, "read_noise_e": 0.0})
    seconds = choose_exposure_s(light, 1e6, settings)
    assert np.median(collect_electrons(light, seconds, 1e6, settings, random())) == pytest.approx(0.25 * 20000)


def test_a_fixed_exposure_ignores_the_image_and_auto_exposure_has_ends():
    assert choose_exposure_s(np.full(9, 123.0), 1e6, sensor(auto_exposure=False, exposure_s=0.5)) == 0.5
    assert choose_exposure_s(np.full(9, 1e-30), 1.0, sensor()) == LONGEST_S
    assert choose_exposure_s(np.full(9, 1e30), 1.0, sensor()) == SHORTEST_S


@pytest.mark.parametrize("image", [np.zeros(100), np.zeros(0), np.full(100, np.nan), np.full(100, -1.0)])
def test_an_image_without_light_can_be_exposed(image):
    settings = sensor()
    seconds = choose_exposure_s(image, 1e6, settings)
    assert seconds == settings["exposure_s"]
    assert (convert_to_digital(collect_electrons(image, seconds, 1e6, settings, random()), settings) <= 1).all()


def test_a_mostly_black_image_is_exposed_for_its_brightest_pixel():
    image = np.zeros(1000)
    image[0] = 3.0
    assert choose_exposure_s(image, 1e4, sensor(auto_target=0.5)) == pytest.approx(10000 / 3e4)


def test_noise_repeats_for_the_same_eye_and_is_independent_between_eyes_pairs_and_seeds():
    def draw(*key):
        return collect_electrons(np.full(N, 6000.0), 1.0, 1.0, sensor(), make_noise_generator(*key))

    first = draw(1, "abc", "left")
    np.testing.assert_array_equal(first, draw(1, "abc", "left"))
    for other in (draw(1, "abc", "right"), draw(1, "abd", "left"), draw(2, "abc", "left"), draw(1, "abc", "left", 1)):
        assert abs(np.corrcoef(first, other)[0, 1]) < 5 / np.sqrt(N)


_EXTREMES = [
    pytest.param(s.key, value, id=f"{s.key}-{value:g}")
    for s in SensorSettings.fields
    if s.kind in ("int", "float")
    for value in (s.minimum, s.maximum)
]


@pytest.mark.parametrize(("key", "value"), [*_EXTREMES, ("exposure_s", 1e-6), ("exposure_s", 1e3)])
@pytest.mark.parametrize("light", [0.0, 1e-12, 2.0, np.inf])
def test_no_extreme_of_the_sensor_makes_anything_but_numbers(key, value, light):
    kind = int if SensorSettings.topic[key].kind == "int" else float
    settings = defaults()
    settings.sensor |= {"auto_exposure": key.startswith("auto"), "blooming": 0.5, key: kind(value)}
    rate = electron_rate(settings.light, settings.sensor, 94e-6)
    assert np.isfinite(rate)
    image = np.full((12, 9), light)
    image[3, 3] = np.nan
    seconds = choose_exposure_s(image, rate, settings.sensor)
    charge = collect_electrons(
        image, seconds, rate, settings.sensor, random(), draw_pattern(1, "left", (12, 9), settings.sensor)
    )
    assert np.isfinite(charge).all()
    numbers = convert_to_digital(charge, settings.sensor)
    assert numbers.max() <= 2**settings.sensor.bits - 1


def test_a_well_of_one_electron_counts_photons():
    numbers = convert_to_digital(
        exposed(np.full(N, 0.1), sensor(full_well_e=1.0, read_noise_e=0.0)), sensor(full_well_e=1.0)
    )
    assert set(np.unique(numbers)) == {0, 255}
    expected = 1 - np.exp(-0.1)  # at least one photon
    assert np.mean(numbers == 255) == pytest.approx(expected, abs=5 * np.sqrt(expected / N))
