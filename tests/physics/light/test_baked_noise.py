"""Noise of baked light, against light whose noise is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.light.baked_noise import largest_share, noise_of, samples_needed

#: Relative noise of one sample, and vertices: their noise is then known within 1/sqrt(2 * 60000) = 0.3 %, five of them.
SIGMA, VERTICES, WITHIN = 1.0, 20000, 0.015
#: Each vertex in one triangle.
TRIANGLES = np.arange(VERTICES - VERTICES % 3).reshape(-1, 3)


def halves(count: int, seed: int = 1) -> list[np.ndarray]:
    random = np.random.default_rng(seed)
    return [0.3 * (1.0 + SIGMA / math.sqrt(count) * random.standard_normal((VERTICES, 3))) for _ in range(2)]


@pytest.mark.parametrize("count", [4, 64])
def test_the_difference_of_two_halves_is_the_noise_of_their_mean_within_triangles(count):
    random = np.random.default_rng(2)
    weights = random.dirichlet((1.0, 1.0, 1.0), 100_000)  # even over a triangle
    seen = (weights * random.standard_normal((100_000, 3))).sum(axis=1).std()
    assert noise_of(halves(count), TRIANGLES) == pytest.approx(seen * SIGMA / math.sqrt(2 * count), rel=WITHIN)


def test_noise_that_neighbours_have_in_common_is_not_interpolated_away():
    same = [each[np.repeat(np.arange(VERTICES), 3)[:VERTICES]] for each in halves(16)]
    assert noise_of(same, TRIANGLES) == pytest.approx(SIGMA / math.sqrt(32), rel=2 * WITHIN)


def test_as_many_samples_are_asked_for_as_reach_the_limit():
    noise, share, limit = noise_of(halves(8), TRIANGLES), 0.3, 0.01
    count = samples_needed(noise, share, 8, limit, 10**6)
    assert noise_of(halves(count, 3), TRIANGLES) * share == pytest.approx(limit, rel=2 * WITHIN)
    assert samples_needed(noise, share, 8, limit, 20) == 20
    assert samples_needed(noise, share, 8, 0.5, 10**6) == 8  # they are there already
    assert samples_needed(noise, share, 8, 0.0, 99) == 99


def test_the_share_of_flat_ground_is_the_same_from_all_sides():
    direct, indirect = np.array([[1.0, 2.0, 3.0], [3.0, 2.0, 1.0]]), np.full((2, 3), 0.5)
    assert largest_share(direct, indirect, np.array([[0.0, 0.0, 1.0]] * 2)) == pytest.approx(0.2)


def test_the_largest_share_is_that_from_the_side_of_the_shadow():
    # A ridge of 45°: one side is lit, the other only by what comes from elsewhere. An eye 14° high sees a side by the
    # sum of cosine and sine of that, and the other not.
    normals = np.array([[1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]]) / math.sqrt(2)
    direct, indirect = np.array([[4.0] * 3, [0.0] * 3]), np.array([[1.0] * 3, [1.0] * 3])
    assert largest_share(direct, indirect, normals) == pytest.approx(1.0)
    # Of 11°, both sides are seen from each, by 0.43 and 0.05.
    slope, up = math.radians(11.0), math.radians(14.0)
    normals = np.array([[math.sin(slope), 0.0, math.cos(slope)], [-math.sin(slope), 0.0, math.cos(slope)]])
    near, far = math.sin(up + slope), math.sin(up - slope)
    assert largest_share(direct, indirect, normals) == pytest.approx((near + far) / (near + 5 * far))


def test_without_light_there_is_nothing_to_do():
    dark = [np.zeros((5, 3))] * 2
    assert noise_of(dark, np.array([[0, 1, 2]])) == 0.0
    assert largest_share(dark[0], dark[1], np.array([[0.0, 0.0, 1.0]] * 5)) == 0.0
    assert samples_needed(0.0, 0.0, 8, 0.01, 99) == 8 == samples_needed(0.2, 0.0, 8, 0.0, 99)
