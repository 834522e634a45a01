"""The share of falling grains that arrives: behind a wall, by trigonometry, and from a cone of directions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from falling_grains import WALL_M, from_west, walled
from icymoon.rays.engine import open_tracer
from icymoon.rays.exposure import find_exposed_share, list_directions
from icymoon.support.arrays import Array


def behind(x_m: Array) -> Array:
    return np.stack([x_m, np.zeros_like(x_m), np.zeros_like(x_m)], axis=1)


@pytest.mark.parametrize("tilt", [10.0, 45.0, 70.0])
def test_on_parallel_paths_a_wall_shelters_its_height_times_the_tangent(tilt):
    world = walled()
    tracer = open_tracer(world)
    end = WALL_M * math.tan(math.radians(tilt))
    x = end * np.array([0.05, 0.5, 0.99, 1.01, 2.0])
    shares = find_exposed_share(world, tracer, behind(x), list_directions(from_west(tilt), 0.0))
    assert shares.tolist() == [0.0, 0.0, 0.0, 1.0, 1.0]
    assert (find_exposed_share(world, tracer, behind(-x), list_directions(from_west(tilt), 0.0)) == 1.0).all()


@pytest.mark.parametrize(("tilt", "spread"), [(30.0, 15.0), (50.0, 30.0), (0.0, 40.0)])
def test_from_a_cone_the_directions_above_the_wall_arrive(tilt, spread):
    world, directions = walled(), list_directions(from_west(tilt), spread)
    x = np.linspace(0.05, 10.0, 60)
    shares = find_exposed_share(world, open_tracer(world), behind(x), directions)
    # A direction is blocked if it rises by less than the wall on its way to it.
    rise = directions[:, 2] * x[:, None] / np.maximum(-directions[:, 0], 1e-9)
    over = (rise > WALL_M) | (directions[:, 0] >= 0.0)
    assert shares == pytest.approx(over @ (directions[:, 2] / directions[:, 2].sum()), abs=1e-12)
    assert (np.diff(shares) >= -1e-12).all()
    assert shares[-1] == pytest.approx(1.0)


@pytest.mark.parametrize("origin", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.0, 0.96, 0.28)])
def test_directions_fill_their_cone_evenly(origin):
    made = list_directions(origin, 12.0)
    assert np.linalg.norm(made, axis=1) == pytest.approx(1.0)
    along, edge = made @ np.array(origin), math.cos(math.radians(12.0))
    assert (along >= edge - 1e-12).all()
    assert along.mean() == pytest.approx((1.0 + edge) / 2)  # as of an even cap
    middle = made.mean(axis=0)
    assert middle / np.linalg.norm(middle) == pytest.approx(origin, abs=0.01)


def test_nothing_comes_from_below_the_horizon():
    made = list_directions(from_west(80.0), 60.0)
    assert (made[:, 2] > 0.0).all()
    assert 4 < len(made) < 16
