"""Noise of baked light, against light whose noise is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.light.baked_noise import noise_of, noise_seen, samples_needed

#: Relative noise of one sample, and vertices: their noise is then known within 1/sqrt(2 * 60000) = 0.3 %, five of them.
SIGMA, VERTICES, WITHIN = 1.0, 20000, 0.015


def halves(count: int, seed: int = 1) -> list[np.ndarray]:
    random = np.random.default_rng(seed)
    return [0.3 * (1.0 + SIGMA / math.sqrt(count) * random.standard_normal((VERTICES, 3))) for _ in range(2)]


@pytest.mark.parametrize("count", [4, 64])
def test_the_difference_of_two_halves_is_the_noise_of_their_mean(count):
    assert noise_of(halves(count)) == pytest.approx(SIGMA / math.sqrt(2 * count), rel=WITHIN)


def test_interpolation_within_a_triangle_halves_the_variance():
    random = np.random.default_rng(2)
    weights = random.dirichlet((1.0, 1.0, 1.0), 100_000)  # even over a triangle
    seen = (weights * random.standard_normal((100_000, 3))).sum(axis=1)
    assert noise_seen(1.0) == pytest.approx(seen.std(), rel=WITHIN)


def test_as_many_samples_are_asked_for_as_reach_the_limit():
    first, direct, limit = halves(8), 0.7, 0.01
    count = samples_needed(first, direct, 8, limit, 10**6)
    reached = noise_seen(noise_of(halves(count, 3))) * 0.3 / (0.3 + direct)
    assert reached == pytest.approx(limit, rel=2 * WITHIN)
    assert samples_needed(first, direct, 8, limit, 20) == 20
    assert samples_needed(first, direct, 8, 0.5, 10**6) == 8  # they are there already
    assert samples_needed(first, direct, 8, 0.0, 99) == 99


def test_without_light_there_is_nothing_to_do():
    dark = [np.zeros((5, 3))] * 2
    assert noise_of(dark) == 0.0
    assert samples_needed(dark, 0.0, 8, 0.01, 99) == 8
