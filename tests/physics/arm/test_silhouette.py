"""Silhouettes held against shapes whose pixels are known."""

from __future__ import annotations

import numpy as np
from icymoon.physics.arm.silhouette import find_silhouette

MATRIX = np.array([[100.0, 0.0, 40.0], [0.0, 100.0, 30.0], [0.0, 0.0, 1.0]])
SQUARE = np.array([[-0.1, -0.1, 1.0], [0.1, -0.1, 1.0], [0.1, 0.1, 1.0], [-0.1, 0.1, 1.0]])
HALVES = np.array([[0, 1, 2], [0, 3, 2]])  # turned either way


def test_a_square_covers_the_pixels_whose_centres_are_in_it():
    wanted = np.zeros((60, 80), bool)
    wanted[20:40, 30:50] = True
    assert np.array_equal(find_silhouette(SQUARE, HALVES, MATRIX, (60, 80)), wanted)


def test_what_is_beside_the_image_or_behind_the_eye_covers_nothing():
    assert not find_silhouette(SQUARE + np.array([5.0, 0.0, 0.0]), HALVES, MATRIX, (60, 80)).any()
    assert not find_silhouette(SQUARE * np.array([1.0, 1.0, -1.0]), HALVES, MATRIX, (60, 80)).any()


def test_ground_that_passes_under_the_eye_covers_what_is_below_its_horizon():
    far = np.array([[-1e4, 1.0, -1e4], [1e4, 1.0, -1e4], [1e4, 1.0, 1e4], [-1e4, 1.0, 1e4]])
    mask = find_silhouette(far, np.array([[0, 1, 2], [0, 2, 3]]), MATRIX, (60, 80))
    wanted = np.zeros((60, 80), bool)
    wanted[30:] = True  # the rows below the principal point
    assert np.array_equal(mask, wanted)
