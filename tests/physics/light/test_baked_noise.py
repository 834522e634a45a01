"""Noise of baked light, against light whose noise is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.light.baked_noise import count_samples_needed, find_largest_share, measure_bake_noise
from icymoon.support.arrays import Array

#: Relative noise of one sample, and vertices: their noise is then known within 1/sqrt(2 * 60000) = 0.3 %, five of them.
SIGMA, VERTICES, WITHIN = 1.0, 20000, 0.015
#: Each vertex in one triangle.
TRIANGLES = np.arange(VERTICES - VERTICES % 3).reshape(-1, 3)


def halves(count: int, seed: int = 1) -> list[Array]:
    random = np.random.default_rng(seed)
    return [0.3 * (1.0 + SIGMA / math.sqrt(count) * random.standard_normal((VERTICES, 3))) for _ in range(2)]


@pytest.mark.parametrize("count", [4, 64])
def test_the_difference_of_two_halves_is_the_noise_of_their_mean_within_triangles(count):
    random = np.random.default_rng(2)
    weights = random.dirichlet((1.0, 1.0, 1.0), 100_000)  # even over a triangle
    seen = (weights * random.standard_normal((100_000, 3))).sum(axis=1).std()
    assert measure_bake_noise(halves(count), TRIANGLES) == pytest.approx(
        seen * SIGMA / math.sqrt(2 * count), rel=WITHIN
    )


def test_noise_that_neighbours_have_in_common_is_not_interpolated_away():
    same = [each[np.repeat(np.arange(VERTICES), 3)[:VERTICES]] for each in halves(16)]
    assert measure_bake_noise(same, TRIANGLES) == pytest.approx(SIGMA / math.sqrt(32), rel=2 * WITHIN)


def test_as_many_samples_are_asked_for_as_reach_the_limit():
    noise, share, limit = measure_bake_noise(halves(8), TRIANGLES), 0.3, 0.01
    count = count_samples_needed(noise, share, 8, limit, 10**6)
    assert measure_bake_noise(halves(count, 3), TRIANGLES) * share == pytest.approx(limit, rel=2 * WITHIN)
    assert count_samples_needed(noise, share, 8, limit, 20) == 20
    assert count_samples_needed(noise, share, 8, 0.5, 10**6) == 8  # they are there already
    assert count_samples_needed(noise, share, 8, 0.0, 99) == 99


def ground(height):
    """Vertices of a grid of 20 m and 0.25 m spacing, and their triangles, upward."""
    x, y = np.meshgrid(np.arange(-10.0, 10.01, 0.25), np.arange(-10.0, 10.01, 0.25))
    index = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    positions = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    return positions, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


EYE = np.array([0.0, 0.0, 1.5])


def test_the_share_of_even_light_is_the_same_in_all_directions():
    positions, triangles = ground(lambda x, y: 0.2 * np.sin(x + y))
    direct, indirect = np.full((len(positions), 3), 2.0), np.full((len(positions), 3), 0.5)
    assert find_largest_share(direct, indirect, positions, triangles, EYE) == pytest.approx(0.2)


def test_the_largest_share_is_that_of_where_shadow_fills_the_view():
    positions, triangles = ground(lambda x, y: 0.0 * x)
    indirect = np.full((len(positions), 3), 1.0)
    azimuth = np.arctan2(positions[:, 1], positions[:, 0])
    dark = np.where(np.abs(azimuth - math.pi / 3) < math.radians(45.0), 0.0, 4.0)[:, None] * np.ones(3)
    assert find_largest_share(dark, indirect, positions, triangles, EYE) == pytest.approx(1.0)
    # Half of a view of 60 degrees: 2 x 1 of 2 x 1 + 4, by area on the image.
    narrow = np.where(np.abs(azimuth - math.pi / 3) < math.radians(15.0), 0.0, 4.0)[:, None] * np.ones(3)
    assert find_largest_share(narrow, indirect, positions, triangles, EYE) == pytest.approx(2 / 6, rel=0.05)


def test_far_shadow_counts_by_how_large_it_looks_and_ground_that_faces_away_not():
    # All of the share is beyond 5 m: of the solid angle of flat ground from 0.87 m (60 degrees) to 10 m away.
    positions, triangles = ground(lambda x, y: 0.0 * x)
    far = np.hypot(positions[:, 0], positions[:, 1]) > 5.0
    direct, indirect = np.where(far, 0.0, 1.0)[:, None] * np.ones(3), np.where(far, 1.0, 0.0)[:, None] * np.ones(3)

    def down_to(r):
        return 1 - 1.5 / math.hypot(r, 1.5)

    low, edge = down_to(1.5 / math.tan(math.radians(60.0))), down_to(5.0)
    found = find_largest_share(direct, indirect, positions, triangles, EYE)
    ends = down_to(10.0), down_to(10.0 * math.sqrt(2))  # of a square
    assert (ends[0] - edge) / (ends[0] - low) * 0.95 < found < (ends[1] - edge) / (ends[1] - low) * 1.05
    assert find_largest_share(direct, indirect, positions, triangles[:, ::-1], EYE) == 0.0


def test_without_light_there_is_nothing_to_do():
    dark = [np.zeros((5, 3))] * 2
    assert measure_bake_noise(dark, np.array([[0, 1, 2]])) == 0.0
    assert find_largest_share(dark[0], dark[1], np.eye(5, 3), np.array([[0, 1, 2]]), EYE) == 0.0
    assert count_samples_needed(0.0, 0.0, 8, 0.01, 99) == 8 == count_samples_needed(0.2, 0.0, 8, 0.0, 99)
