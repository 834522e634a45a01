"""Cubic splines between pixels, against what defines them."""

import numpy as np
import pytest
from icymoon.stereo.images.spline import sample

RANDOM = np.random.default_rng(5)


def grid(height, width):
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (2, 2), (4, 3), (7, 90), (60, 40)])
def test_at_pixels_it_is_the_image(shape):
    image = RANDOM.normal(size=shape)
    np.testing.assert_allclose(sample(image, grid(*shape)), image, atol=1e-12)


def test_between_pixels_it_is_a_parabola_if_the_image_is_one():
    """Far from the borders, where the image goes on as its mirror image."""
    x, y = grid(100, 120).transpose(2, 0, 1)
    places = RANDOM.uniform(45, 55, (50, 2))
    u, v = places.T
    found = sample(3 + 0.2 * x - 0.1 * y + 0.01 * x * y + 0.02 * x**2 - 0.03 * y**2, places)
    np.testing.assert_allclose(found, 3 + 0.2 * u - 0.1 * v + 0.01 * u * v + 0.02 * u**2 - 0.03 * v**2, atol=1e-9)


def test_it_is_smooth_over_the_pixels_and_mirrored_at_the_borders():
    image = RANDOM.normal(size=(1, 12))
    near = 1e-5 * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    for column in range(1, 11):
        values = sample(image, np.stack([column + near, 0 * near], axis=-1))
        slopes = np.diff(values) / 1e-5
        assert np.abs(np.diff(slopes)).max() < 1e-3  # of slopes of about 1, over 1e-5 px
    start = sample(image, np.array([[0.0, 0.0], [1e-4, 0.0]]))
    assert abs(start[1] - start[0]) < 1e-6  # level at the mirror


def test_beyond_the_outermost_pixels_and_nowhere_there_is_nothing():
    places = np.array([[-0.01, 0.0], [3.01, 0.0], [0.0, 2.01], [np.nan, 0.0], [3.0, 2.0]])
    found = sample(np.ones((3, 4)), places)
    assert np.isnan(found[:4]).all()
    assert found[4] == pytest.approx(1.0)
