"""Points without rays: none of them is sheltered, and most of open ground is among them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from falling_grains import make_shape
from icymoon.physics.rocks.rock_shapes import make_icosphere
from icymoon.rays.engine import open_tracer
from icymoon.rays.exposure import find_exposed_share, list_directions
from icymoon.rays.shapes import Placed, Shape, World
from icymoon.rays.shelter_bounds import find_uncertain
from icymoon.support.arrays import Array

#: Rays start above the vertices.
LIFT = np.array([0.0, 0.0, 1e-3])


def grid(side_m: float, count: int, rough_m: float, seed: int, east_m: float = 0.0) -> Shape:
    """Ground of count² vertices with random heights, its middle ``east_m`` from the origin."""
    axis = np.linspace(-side_m / 2, side_m / 2, count)
    x, y = np.meshgrid(axis + east_m, axis)
    z = np.random.default_rng(seed).normal(0.0, rough_m, x.shape)
    k = np.arange(count - 1)[:, None] * count + np.arange(count - 1)
    a, b, c, d = (each.ravel() for each in (k, k + 1, k + 1 + count, k + count))
    return make_shape(
        np.stack([x, y, z], axis=-1).reshape(-1, 3),
        np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]),
    )


def world_of(ground: Shape, rocks: int, radii_m: Array, east_m: float = 0.0, seed: int = 5) -> World:
    random = np.random.default_rng(seed)
    places = np.tile(np.eye(4), (rocks, 1, 1))
    places[:, :3, :3] *= radii_m[:, None, None]
    places[:, :2, 3] = random.uniform(-8.0, 8.0, (rocks, 2)) + np.array([east_m, 0.0])
    rock = make_shape(*make_icosphere(1))
    placed = [Placed(ground, np.eye(4)[None], np.zeros(1, np.int64))]
    return World([*placed, *([Placed(rock, places, np.arange(rocks))] if rocks else [])])


def blocked_points(world: World, directions: Array) -> Array:
    points = world.placed[0].shape.vertices.astype(np.float64) + LIFT
    tracer = open_tracer(world)
    far = np.full(len(points), np.inf)
    return np.any([tracer.is_blocked(points, np.broadcast_to(d, points.shape), 0.0, far) for d in directions], axis=0)


@pytest.mark.parametrize("east_m", [0.0, 6.0, 300.0])
@pytest.mark.parametrize(
    ("tilt", "azimuth", "spread", "rough_m"),
    [(0.0, 0.0, 0.0, 0.02), (25.0, 290.0, 15.0, 0.08), (60.0, 30.0, 10.0, 0.15), (70.0, 120.0, 40.0, 0.05)],
)
def test_whatever_rays_find_sheltered_is_uncertain(tilt, azimuth, spread, rough_m, east_m):
    radii = np.random.default_rng(3).uniform(0.02, 1.0, 60) ** 2 + 0.02
    world = world_of(grid(20.0, 81, rough_m, 1, east_m), 60, radii, east_m)
    a, b = math.radians(tilt), math.radians(azimuth)
    directions = list_directions((math.sin(a) * math.sin(b), math.sin(a) * math.cos(b), math.cos(a)), spread)
    points = world.placed[0].shape.vertices.astype(np.float64) + LIFT
    blocked = np.flatnonzero(blocked_points(world, directions))
    assert len(blocked) > 50
    assert np.isin(blocked, find_uncertain(world, points, directions)).all()


def test_shares_are_those_of_all_rays():
    world = world_of(grid(20.0, 61, 0.1, 2), 40, np.full(40, 0.3))
    directions = list_directions((0.4, 0.2, math.sqrt(0.8)), 20.0)
    points = world.placed[0].shape.vertices
    lifted = points.astype(np.float64)
    lifted[:, 2] += 1e-3 + 1e-6 * np.abs(lifted).max(axis=1)
    tracer, far = open_tracer(world), np.full(len(points), np.inf)
    ahead = [tracer.is_blocked(lifted, np.broadcast_to(d, lifted.shape), 0.0, far) for d in directions]
    wanted = (directions[:, 2] / directions[:, 2].sum()) @ ~np.array(ahead)
    assert find_exposed_share(world, tracer, points, directions) == pytest.approx(wanted, abs=1e-12)


def test_open_ground_between_few_rocks_needs_no_rays():
    world = world_of(grid(20.0, 161, 0.002, 1), 12, np.full(12, 0.3))
    directions = list_directions((math.sin(0.4), 0.0, math.cos(0.4)), 15.0)
    points = world.placed[0].shape.vertices.astype(np.float64) + LIFT
    # Each rock covers 0.07 % of the ground; bounds mark at most some 20 times that.
    assert len(find_uncertain(world, points, directions)) < 12 * 0.0007 * 20 * len(points)
    assert not len(find_uncertain(world_of(grid(20.0, 161, 0.0, 1), 0, np.zeros(0)), points, directions))
