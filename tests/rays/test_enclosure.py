"""Places inside rocks and under the ground."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.rays.embree import load_library
from icymoon.rays.enclosure import find_enclosure
from icymoon.rays.engine import open_tracer
from icymoon.rays.shapes import Placed, World
from icymoon.support.arrays import Array
from icymoon.support.labels import LANDER, ROCK, TERRAIN
from ray_worlds import BOX, shape

pytestmark = pytest.mark.skipif(load_library() is None, reason="there is no Embree; pip install embreex")

#: A sheet at z = 0 that faces up.
GROUND = shape([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2], [0, 2, 3]], label=TERRAIN)


def at(x: float, y: float, z: float, mirrored: bool = False) -> Array:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    matrix[0, 0] = -1.0 if mirrored else 1.0
    return matrix


def find(place: tuple[float, float, float], label: int = ROCK, mirrored: bool = False) -> int | None:
    """What encloses a place above, in or under ground with a box, the size of whose half is 1 m, at (4, 0, 0.5)."""
    rock = shape(BOX.vertices, BOX.triangles, label=label)
    world = World(
        [
            Placed(GROUND, np.eye(4)[None], np.array([0])),
            Placed(rock, np.array([at(4, 0, 0.5, mirrored), at(-4, 0, 0.5)]), np.array([1, 2])),
        ]
    )
    tracer = open_tracer(world)
    found = find_enclosure(world, tracer, np.array(place))
    tracer.close()
    return found


@pytest.mark.parametrize(
    ("place", "enclosure"),
    [
        ((0, 0, 1.5), None),
        ((0, 0, 0.01), None),
        ((2.9, 0, 0.3), None),
        ((4, 0, 0.5), ROCK),
        ((4, 0.9, 0.2), ROCK),
        ((0, 0, -0.5), TERRAIN),
        ((0, 0, 50), None),
    ],
)
def test_what_encloses_a_place(place, enclosure):
    assert find(place) == enclosure


def test_a_mirrored_rock_encloses_and_a_lander_does_not():
    assert find((4, 0, 0.5), mirrored=True) == ROCK
    assert find((2.9, 0, 0.3), mirrored=True) is None
    # A scanner in the housing of a lander's head is where it belongs.
    assert find((4, 0, 0.5), label=LANDER) is None


def test_an_empty_world_encloses_nothing():
    world = World([])
    tracer = open_tracer(world)
    assert find_enclosure(world, tracer, np.zeros(3)) is None
    tracer.close()
