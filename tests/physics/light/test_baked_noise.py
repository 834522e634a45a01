"""Noise of baked light, against light whose noise is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.light.baked_noise import noise_of, samples_needed

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
    first, direct, limit = halves(8), 0.7, 0.01
    count = samples_needed(first, TRIANGLES, direct, 8, limit, 10**6)
    reached = noise_of(halves(count, 3), TRIANGLES) * 0.3 / (0.3 + direct)
    assert reached == pytest.approx(limit, rel=2 * WITHIN)
    assert samples_needed(first, TRIANGLES, direct, 8, limit, 20) == 20
    assert samples_needed(first, TRIANGLES, direct, 8, 0.5, 10**6) == 8  # they are there already
    assert samples_needed(first, TRIANGLES, direct, 8, 0.0, 99) == 99


def test_without_light_there_is_nothing_to_do():
    dark = [np.zeros((5, 3))] * 2
    assert noise_of(dark, np.array([[0, 1, 2]])) == 0.0
    assert samples_needed(dark, np.array([[0, 1, 2]]), 0.0, 8, 0.01, 99) == 8
