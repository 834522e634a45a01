"""Finds the share of the grains falling on ground from one side that arrives at its vertices, past other ground and
rocks."""

from __future__ import annotations

import math

import numpy as np

from ..support.arrays import Array
from .shapes import World, normalize
from .shelter_bounds import find_uncertain
from .surface import Tracer

#: Directions from which grains come, if they come from a cone.
_DIRECTIONS = 16
#: Height above a vertex at which its rays start, m, and the share of its distance from the origin that is added because
#: of single precision.
_LIFT_M, _LIFT_SHARE = 1e-3, 1e-6
#: Number of vertices whose rays are traced at a time.
_VERTICES_AT_ONCE = 2**18
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


def list_directions(origin: tuple[float, float, float], spread_deg: float) -> Array:
    """List unit vectors (n, 3), equally dense over a cone of half the width ``spread_deg`` around the unit vector
    ``origin``. Vectors at or below the horizon are left out. Without a spread, ``origin`` is the only one."""
    if spread_deg == 0.0:
        return np.array([origin])
    step = np.arange(_DIRECTIONS) + 0.5
    along = 1.0 - step / _DIRECTIONS * (1.0 - math.cos(math.radians(spread_deg)))
    across, turn = np.sqrt(1.0 - along**2), step * _GOLDEN_ANGLE
    axis = np.array(origin)
    right = normalize(np.cross(axis, [0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [1.0, 0.0, 0.0])[None])[0]
    made = along[:, None] * axis + across[:, None] * (
        np.cos(turn)[:, None] * right + np.sin(turn)[:, None] * np.cross(axis, right)
    )
    return np.asarray(made[made[:, 2] > 0.0])


def find_exposed_share(world: World, tracer: Tracer, points: Array, directions: Array) -> Array:
    """Find the share (n,) of grains that arrives at points (n, 3) of the world, relative to level, open ground. The
    grains fall from ``directions`` (k, 3). Each direction is weighted by its upward component, because level ground
    receives in proportion to it. Rays are traced only from points that something may shelter.
    """
    weight = directions[:, 2] / directions[:, 2].sum()
    start_m = points.astype(np.float64)
    start_m[:, 2] += _LIFT_M + _LIFT_SHARE * np.abs(start_m).max(axis=1)
    uncertain = find_uncertain(world, start_m, directions)
    found = np.ones(len(points))
    found[uncertain] = 0.0
    for first in range(0, len(uncertain), _VERTICES_AT_ONCE):
        some = uncertain[first : first + _VERTICES_AT_ONCE]
        from_m = start_m[some]
        for direction, share in zip(directions, weight, strict=True):
            ahead = np.broadcast_to(direction, from_m.shape)
            found[some] += share * ~tracer.is_blocked(from_m, ahead, 0.0, np.full(len(from_m), np.inf))
    return found
