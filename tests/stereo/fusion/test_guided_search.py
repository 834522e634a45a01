"""A search about an expected disparity: the image is moved, and what is found is moved back."""

import numpy as np
from icymoon.stereo.fusion.guided_search import move_right, restore_disparity


def test_an_expected_match_is_at_the_margin_and_returns_exactly():
    expected = 9.0 + 0.05 * np.arange(80)[None, :] + np.zeros((5, 1))
    right = np.tile(np.linspace(0, 200, 80), (5, 1)).astype(np.uint8)
    moved = move_right(right, expected, 16)
    # The left pixel u matches the column u - 16, which shows the right column u - expected(u).
    left = np.interp(np.arange(30, 80) - expected[0, 30:], np.arange(80), right[0])
    np.testing.assert_allclose(moved[0, 14:64], left, atol=0.51)
    np.testing.assert_allclose(restore_disparity(np.full((5, 80), 16.0), expected, 16), expected)


def test_a_disparity_beside_the_expected_one_returns_exactly():
    columns = np.arange(80, dtype=float)
    expected = np.tile(9.0 + 0.05 * columns, (5, 1))
    true = expected + 2.5
    # The left pixel u sees the right column u - true(u), which the moved image has at x - 16 with x - 9 - 0.05 x.
    found = columns - ((columns - true + 9.0) / 0.95 - 16)
    back = restore_disparity(found, expected, 16)
    np.testing.assert_allclose(back[:, 20:70], true[:, 20:70], atol=1e-9)
    assert np.isnan(restore_disparity(np.full((5, 80), np.nan), expected, 16)).all()


def test_colour_keeps_its_bands():
    right = np.stack([np.full((4, 60), level, np.uint8) for level in (10, 20, 30)], axis=-1)
    moved = move_right(right, np.full((4, 60), 5.5), 16)
    assert moved.shape == right.shape
    assert (moved == [10, 20, 30]).all()
