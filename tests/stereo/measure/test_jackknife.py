"""The standard error of a number from one image: what holds for tiles with and without content."""

import numpy as np
import pytest
from icymoon.stereo.measure.jackknife import TILES_ACROSS, TILES_DOWN, jackknife, sum_over_tiles


def mean(sums):
    return sums[..., :1] / sums[..., 1:]


def test_tiles_without_content_change_neither_the_number_nor_its_error():
    """A map that covers part of the image has empty tiles. They are no observations, so they give no confidence."""
    random = np.random.default_rng(3)
    held = random.random(TILES_DOWN * TILES_ACROSS) < 0.3
    counts = np.where(held, random.integers(50, 100, held.size), 0)
    sums = np.stack([counts * random.normal(3.0, 1.0, held.size), counts], axis=-1)
    assert 2 < held.sum() < held.size
    for number, alone in zip(jackknife(mean, sums), jackknife(mean, sums[held]), strict=True):
        np.testing.assert_allclose(number, alone, rtol=1e-12)


def test_numbers_of_several_images_at_once_are_those_of_each_alone():
    sums = np.random.default_rng(5).random((4, TILES_DOWN * TILES_ACROSS, 3))

    def shares(total):
        return total[..., :2] / total[..., 2:]

    for numbers, alone in zip(
        jackknife(shares, sums), zip(*(jackknife(shares, each) for each in sums), strict=True), strict=True
    ):
        np.testing.assert_allclose(numbers, alone, rtol=1e-12)


def test_a_tile_that_one_of_two_images_lacks_is_left_out_of_both():
    """Of the difference of two means: each image has tiles that the other lacks, and all of them are observations."""
    random = np.random.default_rng(4)
    first, second = (np.stack([random.normal(size=6), np.ones(6)], axis=-1) for _ in range(2))
    first[0], second[5] = 0.0, 0.0
    without = [(np.delete(first, k, axis=0).sum(axis=0), np.delete(second, k, axis=0).sum(axis=0)) for k in range(6)]
    differences = np.array([a[0] / a[1] - b[0] / b[1] for a, b in without])
    _, error = jackknife(lambda a, b: mean(a) - mean(b), first, second)
    assert error[0] == pytest.approx(np.sqrt(5 / 6 * ((differences - differences.mean()) ** 2).sum()))


@pytest.mark.parametrize("tiles", [0, 1, 2])
def test_the_error_is_unknown_until_two_tiles_contain_something(tiles):
    sums = np.zeros((TILES_DOWN * TILES_ACROSS, 2))
    sums[:tiles] = np.array([[5.0, 2.0], [9.0, 3.0]])[:tiles]
    number, error = jackknife(mean, sums)
    assert np.isnan(number[0]) == (tiles == 0)
    assert np.isnan(error[0]) == (tiles < 2)
    # A total is defined without any tile too. Without one or the other of two it is 9 or 5.
    total, doubt = jackknife(lambda sums: sums[..., :1], sums)
    assert total[0] == [0.0, 5.0, 14.0][tiles]
    assert np.isnan(doubt[0]) if tiles < 2 else doubt[0] == pytest.approx(np.sqrt(1 / 2 * (2**2 + 2**2)))


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.uint8, bool])
@pytest.mark.parametrize("shape", [(TILES_DOWN, TILES_ACROSS), (37, 53), (3, 5)])
def test_each_pixel_is_in_one_tile_and_tiles_are_alike(shape, kind):
    sums = sum_over_tiles(np.ones(shape, kind))[:, 0]
    assert sums.sum() == shape[0] * shape[1]
    rows, columns = (
        np.bincount(np.arange(size) * count // size, minlength=count)
        for size, count in zip(shape, (TILES_DOWN, TILES_ACROSS), strict=True)
    )
    np.testing.assert_array_equal(sums.reshape(TILES_DOWN, TILES_ACROSS), np.outer(rows, columns))
    assert np.ptp(rows) <= 1 >= np.ptp(columns)
