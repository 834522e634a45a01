"""Rocks that a wall shelters from falling grains: all, none, and the lower part."""

from __future__ import annotations

import math

import numpy as np
import pytest
from falling_grains import WALL_M, from_west, make_shape, walled
from icymoon.physics.rocks.rock_shapes import make_icosphere
from icymoon.rays.engine import open_tracer
from icymoon.rays.exposure import list_directions
from icymoon.rays.rock_exposure import RockShelter, find_rock_shelter
from icymoon.rays.shapes import Placed, World
from icymoon.support.arrays import Array

RADIUS_M = 0.4


def shelter_of(east_m: list[float], subdivisions: int, tilt_deg: float = 45.0) -> RockShelter:
    """The shelter of balls that lie on level ground east of the wall, from grains of the west."""
    shape = make_shape(*make_icosphere(subdivisions))
    places = np.tile(np.eye(4), (len(east_m), 1, 1))
    places[:, :3, :3] *= RADIUS_M
    places[:, 0, 3], places[:, 2, 3] = east_m, RADIUS_M
    rocks = [Placed(shape, places, np.arange(len(east_m), dtype=np.int64))]
    world = World([*walled().placed, *rocks])
    return find_rock_shelter(world, open_tracer(world), rocks, len(east_m), list_directions(from_west(tilt_deg), 0.0))


def value_at(shelter: RockShelter, rock: int, point: Array) -> float:
    return float(np.clip(shelter.level[rock] + shelter.slope[rock] @ point, 0.0, 1.0))


@pytest.mark.parametrize("subdivisions", [1, 4])
def test_behind_a_wall_a_rock_gets_nothing_and_beyond_its_shadow_all(subdivisions):
    # Shadows at 45° end WALL_M behind the wall at the ground. Paths to the ball pass within its radius, times sqrt 2.
    shelter = shelter_of([0.5, WALL_M + 2.0], subdivisions)
    for east, rock, wanted in ((0.5, 0, 1.0), (WALL_M + 2.0, 1, 0.0)):
        for up in (0.0, RADIUS_M, 2 * RADIUS_M):
            assert value_at(shelter, rock, np.array([east, 0.0, up])) == pytest.approx(wanted, abs=1e-6)


def test_at_the_edge_of_a_shadow_the_lower_part_of_a_rock_is_sheltered():
    middle = WALL_M - RADIUS_M  # the path over the wall at 45° meets the ball's middle here
    shelter = shelter_of([middle], 4)
    # Across the path, up and away from the wall, the share falls; along the path it stays.
    across, along = np.array([1.0, 0.0, 1.0]) / math.sqrt(2), np.array([-1.0, 0.0, 1.0]) / math.sqrt(2)
    assert shelter.slope[0] @ across * RADIUS_M < -0.4
    assert abs(shelter.slope[0] @ along) < 0.3 * abs(shelter.slope[0] @ across)
    centre = np.array([middle, 0.0, RADIUS_M])
    assert value_at(shelter, 0, centre) == pytest.approx(0.5, abs=0.2)
    assert value_at(shelter, 0, centre + 0.8 * RADIUS_M * across) < 0.2
    assert value_at(shelter, 0, centre - 0.8 * RADIUS_M * across) > 0.8


def test_the_ball_itself_and_its_place_in_the_list_do_not_count():
    alone, both = shelter_of([WALL_M + 1.0], 4), shelter_of([0.5, WALL_M + 1.0], 4)
    assert both.level[1] == pytest.approx(alone.level[0], abs=1e-9)
    assert np.abs(alone.slope).max() < 1e-9
