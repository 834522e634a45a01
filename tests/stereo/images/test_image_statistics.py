"""Statistics of images, on images whose statistics are known."""

import math

import numpy as np
import pytest
from icymoon.stereo.images.image_statistics import (
    find_largest_square,
    measure_shares,
    measure_spectral_slope,
    measure_spectrum,
)
from icymoon.stereo.images.image_values import find_white, stretch_to_8_bit


def random_image(slope, n, seed):
    """An image (n, n) with a power spectrum of f^-slope and random phases, cut out of one that is twice as large."""
    random = np.random.default_rng(seed)
    frequency = np.hypot(*np.meshgrid(*[np.fft.fftfreq(2 * n)] * 2))
    frequency[0, 0] = np.inf
    spectrum = np.fft.fft2(random.normal(size=(2 * n, 2 * n))) * frequency ** (-slope / 2)
    return np.fft.ifft2(spectrum).real[:n, :n]


@pytest.mark.parametrize("slope", [1.6, 2.0, 2.4, 3.0])
@pytest.mark.parametrize("n", [64, 192])
def test_the_slope_of_a_random_image_is_found_at_any_brightness(slope, n):
    found = [measure_spectral_slope(5 + 0.3 * random_image(slope, n, seed)) for seed in range(8)]
    # One image of 64 pixels scatters by 0.1; the window leaks some of the long waves of steep spectra.
    assert np.mean(found) == pytest.approx(slope, abs=0.12)
    image = random_image(slope, n, 1)
    assert measure_spectral_slope(1000 * image) == pytest.approx(measure_spectral_slope(image))


def test_white_noise_is_flat_and_a_blur_is_steep():
    random = np.random.default_rng(2)
    noise = random.normal(size=(128, 128))
    assert measure_spectral_slope(noise) == pytest.approx(0, abs=0.1)
    blurred = np.sum([np.roll(noise, (i, j), (0, 1)) for i in range(4) for j in range(4)], axis=0)
    assert measure_spectral_slope(blurred) > 1


def test_an_image_without_contrast_or_too_small_has_no_slope():
    assert math.isnan(measure_spectral_slope(np.ones((64, 64))))
    assert math.isnan(measure_spectral_slope(np.random.default_rng(1).normal(size=(31, 31))))
    with pytest.raises(ValueError, match="is not a square"):
        measure_spectral_slope(np.ones((64, 32)))


def test_the_largest_square_is_the_one_that_trying_all_finds():
    random = np.random.default_rng(3)
    for density in (0.5, 0.9, 0.97):
        mask = random.random((24, 31)) < density
        rows, columns = find_largest_square(mask)
        found = rows.stop - rows.start
        assert columns.stop - columns.start == found
        assert mask[rows, columns].all()
        tried = max(
            (k for k in range(1, 25) for i in range(25 - k) for j in range(32 - k) if mask[i : i + k, j : j + k].all()),
            default=0,
        )
        assert found == tried
    rows, columns = find_largest_square(np.zeros((5, 5), bool))
    assert rows.stop == rows.start


def test_shares_are_of_the_ground_alone():
    level = np.array([[0.0, 0.01, 0.5, 1.0], [1.0, 0.02, 0.3, 0.0]])
    ground = np.array([[True, True, True, True], [False, True, True, False]])
    assert measure_shares(level, ground) == pytest.approx((1 / 6, 2 / 6))
    assert all(map(math.isnan, measure_shares(level, np.zeros_like(ground))))


def test_the_rings_of_a_wave_show_its_frequency():
    """A single wave of 16 cycles per image has nearly all of its power in the ring around 16."""
    light = 5 + np.sin(2 * np.pi * 16 * np.arange(128) / 128) + np.zeros((128, 1))
    cycles, power = measure_spectrum(light)
    assert len(cycles) == len(power) > 8
    assert np.all(np.diff(cycles) > 0)
    assert cycles[power.argmax()] == pytest.approx(16, rel=0.2)
    assert measure_spectrum(np.ones((64, 64)))[0].size == 0


def test_an_image_is_stretched_to_its_white():
    levels = np.linspace(0, 100, 1000)[None]
    white = find_white(levels)
    assert white == pytest.approx(99.5, abs=0.1)
    shown = stretch_to_8_bit(levels, white)
    assert shown.dtype == np.uint8
    assert np.array_equal(shown, stretch_to_8_bit(3 * levels, find_white(3 * levels))), "the exposure does not count"
    assert (shown == 255).mean() == pytest.approx(0.005, abs=0.002)
    with_hole = np.where(levels > 50, np.nan, levels)
    assert find_white(with_hole) == pytest.approx(49.75, abs=0.1)
    assert stretch_to_8_bit(with_hole, 50.0)[0, -1] == 0
