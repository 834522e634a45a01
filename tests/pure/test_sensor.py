"""The camera's sensor against theory: exposure, Poisson and read noise, saturation, reproducibility."""

import numpy as np
import pytest
from icymoon.physics.sensor import digital_numbers, electrons, noise_generator, saturation_radiance
from icymoon.settings import defaults

pytestmark = pytest.mark.filterwarnings("error")

N = 200_000


def sensor(**changes):
    return defaults()["sensor"] | changes


def random():
    return noise_generator(1, "pair", "left")


@pytest.mark.parametrize("level", [0.002, 0.05, 0.4])
def test_noise_has_the_mean_and_variance_of_poisson_plus_read_noise(level):
    settings = sensor(full_well_e=20000.0, read_noise_e=15.0)
    charge = electrons(np.full(N, level), 1.0, settings, random())
    mean, variance = level * 20000, level * 20000 + 15.0**2
    assert abs(charge.mean() - mean) < 5 * np.sqrt(variance / N)
    # The variance of the sample variance of near-Gaussian numbers is 2 σ⁴ / N.
    assert abs(charge.var() - variance) < 5 * variance * np.sqrt(2 / N)


def test_without_noise_the_response_is_linear_and_exact():
    quiet = sensor(shot_noise=False, read_noise_e=0.0)
    light = np.array([0.0, 0.1, 0.5, 1.0])
    np.testing.assert_allclose(electrons(light, 2.0, quiet, random()), light / 2 * quiet["full_well_e"])


def test_a_full_well_stays_full_however_much_light_there_is():
    charge = electrons(np.array([1.0, 7.0, 1e30, np.inf]), 1.0, sensor(shot_noise=False, read_noise_e=0.0), random())
    assert (charge == 20000.0).all()
    flooded = electrons(np.full(N, 50.0), 1.0, sensor(), random())
    assert abs(flooded.mean() - 20000) < 1
    assert abs(flooded.std() - 15) < 0.2  # read noise only


def test_defective_radiance_is_dark():
    assert (electrons(np.array([np.nan, -1.0]), 1.0, sensor(read_noise_e=0.0), random()) == 0).all()


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_the_converter_is_linear_and_ends_at_both_ends(bits):
    top = 2**bits - 1
    numbers = digital_numbers(np.array([-40.0, 0.0, 10000.0, 20000.0, 20040.0]), sensor(bits=bits))
    assert numbers.dtype == np.uint16
    assert numbers.tolist() == [0, 0, round(top / 2), top, top]


def test_auto_exposure_puts_the_percentile_at_the_target():
    light = np.linspace(0.0, 4.0, 1001)
    full = saturation_radiance(light, sensor(auto_percentile=0.5, auto_target=0.25))
    assert full == pytest.approx(2.0 / 0.25)
    quiet = sensor(auto_percentile=0.5, auto_target=0.25, shot_noise=False, read_noise_e=0.0)
    assert np.median(electrons(light, full, quiet, random())) == pytest.approx(0.25 * 20000)


def test_a_fixed_exposure_ignores_the_image():
    assert saturation_radiance(np.full(9, 123.0), sensor(auto_exposure=False, saturation_radiance=7.0)) == 7.0


@pytest.mark.parametrize("image", [np.zeros(100), np.zeros(0), np.full(100, np.nan), np.full(100, -1.0)])
def test_an_image_without_light_can_be_exposed(image):
    settings = sensor()
    full = saturation_radiance(image, settings)
    assert full == settings["saturation_radiance"]
    numbers = digital_numbers(electrons(image, full, settings, random()), settings)
    assert (numbers <= 1).all()


def test_a_mostly_black_image_is_exposed_for_its_brightest_pixel():
    image = np.zeros(1000)
    image[0] = 3.0
    assert saturation_radiance(image, sensor(auto_target=0.5)) == pytest.approx(6.0)


def test_noise_repeats_for_the_same_eye_and_is_independent_between_eyes_pairs_and_seeds():
    def draw(*key):
        return electrons(np.full(N, 0.3), 1.0, sensor(), noise_generator(*key))

    first = draw(1, "abc", "left")
    np.testing.assert_array_equal(first, draw(1, "abc", "left"))
    for other in (draw(1, "abc", "right"), draw(1, "abd", "left"), draw(2, "abc", "left")):
        assert abs(np.corrcoef(first, other)[0, 1]) < 5 / np.sqrt(N)
