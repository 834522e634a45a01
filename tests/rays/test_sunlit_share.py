"""The lit share of a view, against the length of a wall's shadow, which trigonometry gives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.light.directions import camera_axes, direction_toward
from icymoon.rays.embree import EmbreeTracer, load_library
from icymoon.rays.shapes import Placed, Shape, World
from icymoon.rays.stereo_truth import Eye
from icymoon.rays.sunlit_share import measure_sunlit_shares

LIBRARY = load_library()
pytestmark = pytest.mark.skipif(LIBRARY is None, reason="there is no Embree; pip install embreex")
#: A wall 2 m high along y = 0 on level ground.
WALL_M = 2.0


def make_world(side_m: float = 500.0, wall_m: float = WALL_M) -> World:
    corners = [(-side_m, -side_m, 0), (side_m, -side_m, 0), (side_m, side_m, 0), (-side_m, side_m, 0)]
    wall = [(-side_m, 0, 0), (side_m, 0, 0), (side_m, 0, wall_m), (-side_m, 0, wall_m)]
    faces = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)], np.uint32)
    vertices = np.array(corners + wall, np.float32)
    shape = Shape(vertices, faces, np.zeros(4, bool), np.ones(4, np.uint8))
    return World([Placed(shape, np.eye(4)[None], np.array([1]))])


def look_down(x_m: float, y_m: float, height_m: float = 10.0, size: int = 100) -> Eye:
    """An eye that sees level ground as a square of 10 m around (x, y), 0.1 m a pixel."""
    return Eye(
        size, size, size * height_m / 10.0, size / 2, size / 2, camera_axes(0, 90), np.array([x_m, y_m, height_m])
    )


def measure(world: World, eye: Eye, suns: np.ndarray) -> np.ndarray:
    assert LIBRARY is not None
    tracer = EmbreeTracer(LIBRARY, world)
    try:
        return measure_sunlit_shares(world, tracer, eye, suns, 1e-3)
    finally:
        tracer.close()


def test_the_shadow_of_a_wall_is_as_long_as_trigonometry_says():
    """The square is from 0 to 10 m south of the wall, the Sun in the north."""
    elevations = (80.0, 45.0, 30.0, 20.0, 8.0)
    suns = np.array([direction_toward(0.0, each) for each in elevations])
    expected = [max(0.0, 1 - WALL_M / math.tan(math.radians(each)) / 10.0) for each in elevations]
    shares = measure(make_world(), look_down(0.0, -5.001), suns)
    assert shares == pytest.approx(expected, abs=0.011)  # a row of pixels
    assert shares[-1] == 0.0


def test_ground_before_the_wall_is_lit_and_a_sun_that_has_set_lights_nothing():
    suns = np.array([direction_toward(180.0, 8.0), direction_toward(180.0, -1.0)])
    assert measure(make_world(), look_down(0.0, -5.001), suns) == pytest.approx([1.0, 0.0])


def test_without_ground_in_view_nothing_is_known():
    eye = Eye(8, 8, 8.0, 4.0, 4.0, camera_axes(0, -45), np.array([0.0, -5.0, 1.0]))
    assert np.isnan(measure(make_world(), eye, np.array([direction_toward(0.0, 45.0)]))).all()
