"""Worlds that rays of falling grains are traced in: shapes from arrays, and a wall on level ground."""

from __future__ import annotations

import math

import numpy as np
from icymoon.rays.shapes import Placed, Shape, World
from icymoon.support.arrays import Array

#: Height in metres of a wall at x = 0 that runs north, on level ground.
WALL_M = 2.0


def make_shape(vertices: Array, triangles: Array) -> Shape:
    """The shape of triangles, without labels and smooth shading."""
    count = len(triangles)
    return Shape(
        vertices.astype(np.float32), triangles.astype(np.uint32), np.zeros(count, bool), np.zeros(count, np.uint8)
    )


def walled() -> World:
    """Level ground with a wall of ``WALL_M``."""
    far = 1000.0
    vertices = np.array(
        [
            *([-far, -far, 0], [far, -far, 0], [far, far, 0], [-far, far, 0]),
            *([0, -far, 0], [0, far, 0], [0, far, WALL_M], [0, -far, WALL_M]),
        ]
    )
    shape = make_shape(vertices, np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]))
    return World([Placed(shape, np.eye(4)[None], np.ones(1, np.int64))])


def from_west(tilt_deg: float) -> tuple[float, float, float]:
    """The direction toward grains that fall from the west."""
    return -math.sin(math.radians(tilt_deg)), 0.0, math.cos(math.radians(tilt_deg))
