"""Heights above the mean of the surroundings: of waves by their integral, and wherever points are dense."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.mesh.local_heights import measure_local_heights
from icymoon.support.arrays import Array


def square(count: int = 60_000, side_m: float = 12.0, seed: int = 1) -> tuple[Array, Array]:
    x, y = np.random.default_rng(seed).uniform(-side_m / 2, side_m / 2, (2, count))
    return x, y


@pytest.mark.parametrize("length_m", [0.5, 1.0, 3.0, 30.0])
def test_a_wave_keeps_the_share_that_its_mean_over_the_width_leaves(length_m):
    """The mean of a wave over a square of width w is the wave times sin(pi w / L) / (pi w / L)."""
    x, y = square()
    wave = np.cos(2 * np.pi * x / length_m)
    above, known = measure_local_heights(x, y, wave, 1.0)
    inside = known & (np.abs(x) < 5.0) & (np.abs(y) < 5.0)
    kept = 1.0 - math.sin(math.pi / length_m) / (math.pi / length_m)
    # With 3 points for each of 144 cells, 6 % of them are empty. The mean of the others has a standard deviation of
    # 0.7 (0.06 / 144)^0.5 = 0.014 for a wave that is much shorter than the width.
    assert np.abs(above - kept * wave)[inside].mean() < 0.014
    assert np.abs(above - kept * wave)[inside].max() < 6 * 0.014


def test_level_ground_is_nowhere_high_also_at_its_edge():
    x, y = square(2000)
    above, known = measure_local_heights(x, y, np.full(2000, 7.0), 2.0)
    assert known.all()
    assert above == pytest.approx(0.0, abs=1e-9)


def test_dense_points_count_no_more_than_others():
    """A pit whose floor has ten times the points is as deep as with as many points as elsewhere."""
    x, y = square()
    more = np.random.default_rng(2).uniform(-0.5, 0.5, (2, 20_000))
    every_x, every_y = np.concatenate([x, more[0]]), np.concatenate([y, more[1]])

    def pit(x: Array, y: Array) -> Array:
        return np.where((np.abs(x) < 0.5) & (np.abs(y) < 0.5), -1.0, 0.0)

    middle = np.hypot(x, y) < 0.1
    even, _ = measure_local_heights(x, y, pit(x, y), 4.0)
    denser, _ = measure_local_heights(every_x, every_y, pit(every_x, every_y), 4.0)
    assert even[middle] == pytest.approx(-1.0 + 1.0 / 16.0, abs=0.02)
    assert denser[: len(x)][middle] == pytest.approx(even[middle], abs=0.02)


@pytest.mark.parametrize("width_m", [30.0, 80.0, 100.0, 1e4])
def test_a_width_beyond_the_ground_compares_with_the_mean_of_all_of_it(width_m):
    x, y = square()
    bump = np.exp(-((x - 1) ** 2 + y**2) / 2) + 0.5 * x
    middle = np.hypot(x, y) < 0.5
    above, known = measure_local_heights(x, y, bump, width_m)
    assert known.all()
    # The outermost of 13 cells are half outside, but count in full: the mean is off by up to a tenth of its parts.
    assert (above - bump)[middle] == pytest.approx(-bump.mean(), abs=0.02)


def test_points_far_from_the_others_are_not_known():
    x, y = square(5000, 1.0)
    above, known = measure_local_heights(np.append(x, 1e6), np.append(y, 0.0), np.append(0 * x, 3.0), 0.1)
    assert not known[-1]
    assert known[:-1].all()
    assert above[-1] == 0.0
