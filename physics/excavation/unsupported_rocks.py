"""Rocks that lose their support when the ground under them is dug away, and where they come to rest.

The model is simple, without dynamics. A rock tips if its middle is outside the convex hull of the remaining ground
under it. It then moves down the slope under its footprint in steps of a quarter of its diameter, until the slope is
gentle, the ground stops falling, or another rock is in its way. There it turns with the slope and is lowered until it
touches the ground.

Seen from above, rocks collide as balls of their diameters; a rock passes over rocks of less than half its size. The
lowest rock moves first. Equal rocks and ground give equal results. Rocks are not part of the dug ground.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...support.arrays import Array
from ..rocks.place_rocks import HeightAt, Rocks, move_rocks
from ..rocks.rock_shapes import RockShape

#: Loss of height in metres that counts as dug away.
_DUG_AWAY_M = 2.0e-3
#: Radii of the rings of a footprint, as shares of the rock's diameter.
_RING_RADII = (0.15, 0.3, 0.45)
#: Number of points of a ring.
_POINTS_PER_RING = 16
#: Slope in degrees above which a rock rolls on.
_ROLLING_SLOPE_DEG = 20.0
#: Step of a rolling rock, over its diameter.
_ROLL_STEP = 0.25
#: Maximum number of steps.
_MAX_ROLL_STEPS = 60
#: Least size of a rock that blocks another, over the other's diameter.
_BLOCKING_SIZE = 0.5

ChangeAt = Callable[[Array, Array], Array]


def find_unsupported(rocks: Rocks, change_m: ChangeAt) -> Array:
    """Find the indices of the rocks whose middle is no longer above the remaining ground under them. ``change_m``
    returns the height of the ground above the untouched ground, at east and north coordinates.
    """
    turn = np.linspace(0.0, 2 * np.pi, _POINTS_PER_RING, endpoint=False)
    share = np.repeat(_RING_RADII, _POINTS_PER_RING)
    dx, dy = share * np.tile(np.cos(turn), len(_RING_RADII)), share * np.tile(np.sin(turn), len(_RING_RADII))
    size = rocks.diameter_m[:, None]
    lost = change_m(rocks.position_m[:, :1] + size * dx, rocks.position_m[:, 1:2] + size * dy) < -_DUG_AWAY_M
    touched = np.flatnonzero(lost.any(axis=1))
    left = ~lost[touched].reshape(-1, len(_RING_RADII), _POINTS_PER_RING)
    return touched[~_spans_middle(left.any(axis=1))]


def _spans_middle(left: Array) -> Array:
    """Return whether the middle lies in the convex hull of the points that are ``left`` (n, directions), at equal
    angles around it. It does unless half a turn or more has no points left.
    """
    half = left.shape[1] // 2
    gap = np.stack([np.roll(~left, -first, axis=1)[:, :half].all(axis=1) for first in range(left.shape[1])], axis=1)
    return np.asarray(~gap.any(axis=1))


def settle_rocks(
    rocks: Rocks, change_m: ChangeAt, surface: HeightAt, shapes: Sequence[Sequence[RockShape]]
) -> tuple[Rocks, int]:
    """Move rocks on untouched ground to rest on dug ground. Return all rocks, and the number that moved. ``surface``
    returns the height of the dug ground.
    """
    falls = find_unsupported(rocks, change_m)
    if not len(falls):
        return rocks, 0
    places = rocks.position_m[:, :2].copy()
    for k in falls[np.argsort(surface(*places[falls].T), kind="stable")]:
        places[k] = _roll_rock(places, int(k), rocks.diameter_m, surface)
    position, rotation = move_rocks(
        rocks, falls, places[falls], surface, lambda x, y: surface(x, y) - change_m(x, y), shapes
    )
    all_positions, all_rotations = rocks.position_m.copy(), rocks.rotation.copy()
    all_positions[falls], all_rotations[falls] = position, rotation
    return replace(rocks, position_m=all_positions, rotation=all_rotations), len(falls)


def _roll_rock(places: Array, rock: int, diameters: Array, surface: HeightAt) -> Array:
    """Find the east and north in metres of the place at which a rock comes to rest. ``places`` (n, 2) are all rocks'
    places.
    """
    place, diameter = places[rock], float(diameters[rock])
    touch = 0.5 * (diameters + diameter)
    near = (diameters >= _BLOCKING_SIZE * diameter) & (
        np.hypot(*(places - place).T) < _MAX_ROLL_STEPS * _ROLL_STEP * diameter + touch
    )
    near[rock] = False
    others, touch = places[near], touch[near]
    turn = np.linspace(0.0, 2 * np.pi, _POINTS_PER_RING, endpoint=False)
    dx, dy = 0.45 * diameter * np.cos(turn), 0.45 * diameter * np.sin(turn)

    def ground(at: Array) -> tuple[float, Array]:
        z = surface(at[0] + dx, at[1] + dy)
        # Least squares on a ring is a projection, as in ``place_rocks``.
        fall = -np.array([(z * dx).sum(), (z * dy).sum()]) / (_POINTS_PER_RING / 2 * (0.45 * diameter) ** 2)
        return float(z.mean()), fall

    at, (height, fall) = place.copy(), ground(place)
    for _ in range(_MAX_ROLL_STEPS):
        steep = float(np.hypot(*fall))
        if not steep > math.tan(math.radians(_ROLLING_SLOPE_DEG)):
            break
        following = at + _ROLL_STEP * diameter * fall / steep
        lower, next_fall = ground(following)
        apart = np.hypot(*(others - following).T)
        if not lower < height or ((apart < touch) & (apart < np.hypot(*(others - at).T))).any():
            break
        at, height, fall = following, lower, next_fall
    return at
