"""Disparities of one view under several Suns, joined."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.stereo.fusion.suns import join_disparities

NONE = np.nan


@pytest.mark.parametrize(
    ("column", "joined"),
    [
        ((10.0,), 10.0),
        ((NONE,), NONE),
        ((10.0, 10.5), 10.25),
        ((10.0, 12.0), NONE),
        ((10.0, NONE), NONE),
        ((NONE, NONE, NONE), NONE),
        ((10.0, 10.4, 60.0), 10.2),
        ((60.0, 10.0, NONE, 10.4, 3.0), 10.2),
        ((10.0, 10.2, 10.4, 60.0, NONE), 10.2),
        ((10.0, 11.0, 20.0), 10.5),
    ],
)
def test_a_pixel_is_the_mean_of_the_matches_that_agree(column, joined):
    found = join_disparities(np.array(column, float).reshape(-1, 1, 1))
    np.testing.assert_allclose(found, [[joined]], rtol=1e-12)


def test_false_matches_of_a_minority_change_nothing():
    """Four maps with noise of 0.1 px, each with its own false matches, err by 0.1 / sqrt(3) px or less."""
    random = np.random.default_rng(0)
    true = random.uniform(20, 40, (60, 60))
    maps = true + 0.1 * random.standard_normal((4, 60, 60))
    false = random.integers(0, 4, true.shape)  # the map that errs at each pixel
    np.put_along_axis(maps, false[None], random.uniform(60, 80, (1, 60, 60)), axis=0)
    off = join_disparities(maps) - true
    assert np.abs(off).max() < 0.5
    assert off.std() == pytest.approx(0.1 / np.sqrt(3), rel=0.06)  # 4 standard errors of 3600 pixels


def test_the_order_of_the_maps_does_not_matter():
    random = np.random.default_rng(1)
    maps = random.choice([10.0, 10.6, 11.2, 30.0, np.nan], (5, 40, 40))
    np.testing.assert_allclose(join_disparities(maps), join_disparities(maps[::-1]), rtol=1e-12)
