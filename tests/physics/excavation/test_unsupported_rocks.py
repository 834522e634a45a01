"""Rocks over a trench against statics: the middle over what supports it, and rest on the ground."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.excavation.unsupported_rocks import find_unsupported, settle_rocks
from icymoon.physics.rocks.place_rocks import Rocks, euler_matrices
from icymoon.physics.rocks.rock_shapes import make_rock_shapes

SHAPES = make_rock_shapes("FRAGMENTS", 0.8, 1)
DEEP = 0.1


def rocks_at(*places, diameter=0.1):
    n = len(places)
    return Rocks(
        np.array([(x, y, 0.02) for x, y in places]),
        np.zeros((n, 3)),
        np.full((n, 3), diameter),
        np.full(n, 2),
        np.zeros(n, int),
        np.full(n, diameter),
        np.full(n, diameter),
    )


def trench(half_width):
    """The change of level ground by a trench along the north, with upright walls."""
    return lambda x, y: np.where(np.abs(x) <= half_width, -DEEP, 0.0) + 0.0 * y


def test_a_rock_stays_while_its_middle_is_over_what_is_left():
    # Beside the trench's wall at x = 0.2: half of it is over the trench at 0.2, less at more.
    places = [(0.0, 0.0), (0.18, 0.0), (0.22, 0.0), (0.4, 0.0)]
    np.testing.assert_array_equal(find_unsupported(rocks_at(*places), trench(0.2)), [0, 1])


def test_a_rock_across_a_narrow_trench_bridges_it():
    assert not len(find_unsupported(rocks_at((0.0, 0.0), (0.01, 0.3)), trench(0.02)))


def test_a_rock_is_lowered_until_it_touches_and_no_deeper():
    def surface(x, y):
        return trench(0.3)(x, y)

    before = rocks_at((0.0, 0.0), (0.05, 0.4), (0.6, 0.0))
    after, moved = settle_rocks(before, trench(0.3), surface, SHAPES)
    assert moved == 2
    np.testing.assert_array_equal(after.position_m[2], before.position_m[2])
    np.testing.assert_array_equal(after.position_m[:, :2], before.position_m[:, :2])  # the floor is level
    for k in (0, 1):
        shape = SHAPES[after.level[k]][after.shape[k]]
        turned = euler_matrices(after.rotation[k : k + 1])[0]
        points = (shape.vertices * after.scale_m[k]) @ turned.T + after.position_m[k]
        gap = points[:, 2] - surface(points[:, 0], points[:, 1])
        assert gap.min() == pytest.approx(0.0, abs=1e-12)


def test_a_rock_at_a_wall_rolls_into_the_trench_and_turns():
    # A slope of 38 degrees from x = 0 down to the floor at x = 0.4 m.
    steep = np.tan(np.radians(38.0))

    def surface(x, y):
        return -np.clip(x * steep, 0.0, 0.4 * steep) + 0.0 * y

    before = rocks_at((0.1, 0.0))
    after, moved = settle_rocks(before, surface, surface, SHAPES)  # the ground was level at 0
    assert moved == 1
    assert after.position_m[0, 0] > 0.3
    assert after.position_m[0, 1] == pytest.approx(0.0, abs=1e-9)
    again, _ = settle_rocks(before, surface, surface, SHAPES)
    np.testing.assert_array_equal(after.position_m, again.position_m)
    np.testing.assert_array_equal(after.rotation, again.rotation)


def test_without_a_trench_nothing_moves():
    before = rocks_at((0.0, 0.0), (0.1, 0.2))
    after, moved = settle_rocks(before, lambda x, y: 0.01 + 0.0 * x * y, lambda x, y: 0.0 * x * y, SHAPES)
    assert moved == 0
    assert after is before


def test_rocks_that_roll_meet_and_do_not_overlap():
    # Two slopes of 38 degrees that meet in a line: what rolls comes to it from both sides.
    steep = np.tan(np.radians(38.0))

    def surface(x, y):
        return -np.maximum(0.4 - np.abs(x), 0.0) * steep + 0.0 * y

    random = np.random.default_rng(4)
    east, north = np.meshgrid(np.linspace(-0.35, 0.35, 6), np.linspace(0.0, 0.5, 5))
    before = rocks_at(*zip(east.ravel(), (north + random.uniform(-0.02, 0.02, north.shape)).ravel(), strict=True))
    after, moved = settle_rocks(before, surface, surface, SHAPES)
    assert moved == len(before.diameter_m)
    apart, were = (
        np.hypot(*(each.position_m[:, None, :2] - each.position_m[None, :, :2]).transpose(2, 0, 1))
        for each in (after, before)
    )
    other = ~np.eye(moved, dtype=bool)
    assert (apart >= np.minimum(were, 0.1))[other].all()
    assert np.abs(after.position_m[:, 0]).max() < np.abs(before.position_m[:, 0]).max()  # they did roll
    # One alone goes to the line, to a quarter of its diameter.
    alone, _ = settle_rocks(rocks_at((0.35, 0.0)), surface, surface, SHAPES)
    assert abs(alone.position_m[0, 0]) < 0.025


def test_a_rock_goes_over_pebbles_but_not_over_its_like():
    steep = np.tan(np.radians(38.0))

    def surface(x, y):
        return -np.clip(x * steep, 0.0, 0.4 * steep) + 0.0 * y

    ends = []
    for size in (0.04, 0.06):
        rocks = rocks_at((0.05, 0.0), (0.3, 0.0))
        rocks.diameter_m[1] = size
        after, _ = settle_rocks(rocks, lambda x, y: np.where(x < 0.2, surface(x, y), 0.0), surface, SHAPES)
        ends.append(after.position_m[0, 0])
    assert ends[0] > 0.35
    assert 0.195 < ends[1] <= 0.22  # 8 cm from middle to middle, and a step before that
