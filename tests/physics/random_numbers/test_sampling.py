"""Points in the unit cube: even where they must be, the same as other programs', drawn from the seed."""

from __future__ import annotations

import itertools
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.physics.random_numbers import sampling
from icymoon.physics.random_numbers.seeds import make_generator
from stand_ins import stand_in


def randoms(dimensions, seed=1):
    return [make_generator(seed, "plan", k) for k in range(dimensions)]


def in_each_part(values, parts):
    """How many values lie in each of so many equal parts of 0 to 1."""
    return np.bincount((values * parts).astype(int), minlength=parts)


@given(st.integers(1, 60), st.integers(1, 30), st.integers(0, 2**31 - 1))
def test_a_latin_hypercube_has_one_point_in_each_part_of_every_axis(count, dimensions, seed):
    points = sampling.draw_latin_hypercube(count, randoms(dimensions, seed))
    assert points.shape == (count, dimensions)
    for axis in points.T:
        assert (in_each_part(axis, count) == 1).all()


@given(st.integers(0, 8), st.integers(0, 2**31 - 1))
def test_sobol_points_have_one_in_each_part_of_every_axis(power, seed):
    points = sampling.draw_sobol(2**power, randoms(sampling.MAX_DIMENSIONS, seed))
    assert points.min() > 0
    assert points.max() < 1
    for axis in points.T:
        assert (in_each_part(axis, 2**power) == 1).all()


def test_the_first_two_axes_of_sobol_are_a_net():
    """Of 2^m points, one lies in each rectangle of area 2^-m whose sides are powers of two, however it is shaped:
    the first two dimensions are a (0, 2)-sequence in base 2 (Sobol 1967)."""
    points = sampling.draw_sobol(64, randoms(2))
    for power in range(7):
        cells = (points * [2**power, 2 ** (6 - power)]).astype(int)
        assert len({tuple(cell) for cell in cells}) == 64


def test_sobol_equals_another_program():
    torch = pytest.importorskip("torch")
    d = sampling.MAX_DIMENSIONS
    theirs = torch.quasirandom.SobolEngine(d, scramble=False).draw(2048, dtype=torch.float64).numpy()
    unshifted = stand_in(integers=lambda low, high: low)
    # Ours are in the middle of the 2^32 parts whose lower end theirs are.
    assert np.abs(sampling.draw_sobol(2048, [unshifted] * d) - theirs).max() < 2.0**-32


def test_more_axes_than_there_are_direction_numbers_are_refused():
    with pytest.raises(ValueError, match="axes"):
        sampling.draw_sobol(4, randoms(sampling.MAX_DIMENSIONS + 1))


@pytest.mark.parametrize("draw", [sampling.draw_sobol, sampling.draw_latin_hypercube, sampling.draw_independent])
def test_the_seed_decides_and_an_axis_does_not_hang_on_others(draw):
    one, other = draw(16, randoms(3)), draw(16, randoms(3, seed=2))
    assert np.array_equal(one, draw(16, randoms(3)))
    assert not np.isclose(one, other).any(axis=0).all()
    assert np.array_equal(one[:, :2], draw(16, randoms(2)))


SHARES = (np.arange(4000) + 0.5) / 4000


def test_uniform_and_log_uniform_are_even():
    assert np.histogram(sampling.to_uniform(SHARES, -3.0, 5.0), 8, (-3.0, 5.0))[0].tolist() == [500] * 8
    decades = np.log10(sampling.to_log_uniform(SHARES, 1e-3, 10.0))
    assert np.abs(np.histogram(decades, 4, (-3.0, 1.0))[0] - 1000).max() <= 1  # a share may fall on a border
    assert sampling.to_log_uniform(np.array([0.0, 1.0]), 0.1, 0.3).tolist() == pytest.approx([0.1, 0.3])


@pytest.mark.parametrize(
    ("mean", "deviation", "low", "high"),
    [
        (0.0, 1.0, -1.0, 2.0),
        (5.0, 2.0, -1e30, 1e30),
        (0.95, 0.02, 0.8, 1.0),
        (0.0, 1.0, 4.0, 6.0),
        (0.0, 1.0, -6.0, -4.0),
    ],
)
def test_the_truncated_normal_distribution_has_its_quantiles(mean, deviation, low, high):
    values = sampling.to_normal(SHARES, mean, deviation, low, high)
    assert (np.diff(values) > 0).all()
    assert values.min() >= low
    assert values.max() <= high
    # The share below a value, from the distribution function, by the tail that it is accurate in.
    law, side = NormalDist(mean, deviation), -1.0 if low > mean else 1.0
    ends = [law.cdf(mean + side * (end - mean)) for end in (low, high)]
    for share, value in list(zip(SHARES, values, strict=True))[::97]:
        below = (law.cdf(mean + side * (value - mean)) - ends[0]) / (ends[1] - ends[0])
        assert below == pytest.approx(share, abs=1e-9)


def test_a_normal_distribution_beyond_its_limits_is_refused():
    with pytest.raises(ValueError, match="nothing within"):
        sampling.to_normal(SHARES, 0.0, 1.0, 20.0, 21.0)


@given(st.integers(-5, 5), st.integers(0, 6))
def test_whole_numbers_come_equally_often(low, span):
    share = (np.arange(10 * (span + 1)) + 0.5) / (10 * (span + 1))
    values = sampling.to_whole_numbers(share, low, low + span)
    assert [(values == v).sum() for v in range(low, low + span + 1)] == [10] * (span + 1)
    assert sampling.to_whole_numbers(np.array([1.0]), low, low + span)[0] == low + span


def test_sobol_of_the_first_axes_is_even_in_every_plane():
    """Discrepancy of 256 points in every plane of the first eight axes: no plane is as uneven as random points are.

    The largest deviation over the 16 x 16 corner boxes is of the order 1/16 for 256 random points.
    """
    points = sampling.draw_sobol(256, randoms(8))
    corners = np.arange(1, 17) / 16
    for a, b in itertools.combinations(range(8), 2):
        inside = (points[:, a, None, None] < corners[:, None]) & (points[:, b, None, None] < corners)
        assert np.abs(inside.mean(axis=0) - corners[:, None] * corners).max() < 0.03
