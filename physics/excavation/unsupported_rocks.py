"""Rocks that lose their support when the ground under them is dug away, and where they come to rest.

A simplification, without dynamics: a rock tips where its middle is no longer over the convex hull of the ground that
is left under it. It then moves down the slope under its footprint by quarters of its diameter, until the slope is
gentle, the ground falls no more, or another rock is in its way. There it turns with the slope and is lowered until it
touches the ground. Rocks meet as balls of their diameters, seen from above; a rock passes over rocks of less than half
its size. The lowest move first. The same rocks and ground give the same result. Rocks are not part of the dug ground.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...support.arrays import Array
from ..rocks.place_rocks import HeightAt, Rocks, lay_rocks_again
from ..rocks.rock_shapes import RockShape

#: Loss of height in metres that counts as dug away.
_LOST_M = 2.0e-3
#: Points of a footprint: rings of 16 at these shares of the rock's diameter.
_RINGS, _ROUND = (0.15, 0.3, 0.45), 16
#: A rock rolls on while the ground is steeper than this; its step as a share of its diameter; maximum number of steps.
_ROLLS_DEG, _STEP, _MOST_STEPS = 20.0, 0.25, 60
#: Share of a rock's diameter from which on another rock is in its way.
_IN_THE_WAY = 0.5

ChangeAt = Callable[[Array, Array], Array]


def find_unsupported(rocks: Rocks, change_m: ChangeAt) -> Array:
    """Numbers of the rocks whose middle is not over the ground that is left under them.

    ``change_m`` gives the height of the ground over the untouched ground, at east and north.
    """
    turn = np.linspace(0.0, 2 * np.pi, _ROUND, endpoint=False)
    share = np.repeat(_RINGS, _ROUND)
    dx, dy = share * np.tile(np.cos(turn), len(_RINGS)), share * np.tile(np.sin(turn), len(_RINGS))
    size = rocks.diameter_m[:, None]
    lost = change_m(rocks.position_m[:, :1] + size * dx, rocks.position_m[:, 1:2] + size * dy) < -_LOST_M
    touched = np.flatnonzero(lost.any(axis=1))
    left = ~lost[touched].reshape(-1, len(_RINGS), _ROUND)
    return touched[~_spans_middle(left.any(axis=1))]


def _spans_middle(left: Array) -> Array:
    """Whether the middle is in the convex hull of points in some of equal directions (n, directions) around it.

    It is unless they leave out more than half a turn.
    """
    half = left.shape[1] // 2
    gap = np.stack([np.roll(~left, -first, axis=1)[:, :half].all(axis=1) for first in range(left.shape[1])], axis=1)
    return np.asarray(~gap.any(axis=1))


def settle_rocks(
    rocks: Rocks, change_m: ChangeAt, surface: HeightAt, shapes: Sequence[Sequence[RockShape]]
) -> tuple[Rocks, int]:
    """Rocks at rest on dug ground, from the same rocks on untouched ground, and how many of them moved.

    ``surface`` is the height of the dug ground.
    """
    falls = find_unsupported(rocks, change_m)
    if not len(falls):
        return rocks, 0
    places = rocks.position_m[:, :2].copy()
    for k in falls[np.argsort(surface(*places[falls].T), kind="stable")]:
        places[k] = _roll_rock(places, int(k), rocks.diameter_m, surface)
    position, rotation = lay_rocks_again(
        rocks, falls, places[falls], surface, lambda x, y: surface(x, y) - change_m(x, y), shapes
    )
    all_positions, all_rotations = rocks.position_m.copy(), rocks.rotation.copy()
    all_positions[falls], all_rotations[falls] = position, rotation
    return replace(rocks, position_m=all_positions, rotation=all_rotations), len(falls)


def _roll_rock(places: Array, rock: int, diameters: Array, surface: HeightAt) -> Array:
    """Where a rock comes to rest, from where all rocks are (n, 2): east and north in metres."""
    place, diameter = places[rock], float(diameters[rock])
    touch = 0.5 * (diameters + diameter)
    near = (diameters >= _IN_THE_WAY * diameter) & (
        np.hypot(*(places - place).T) < _MOST_STEPS * _STEP * diameter + touch
    )
    near[rock] = False
    others, touch = places[near], touch[near]
    turn = np.linspace(0.0, 2 * np.pi, _ROUND, endpoint=False)
    dx, dy = 0.45 * diameter * np.cos(turn), 0.45 * diameter * np.sin(turn)

    def ground(at: Array) -> tuple[float, Array]:
        z = surface(at[0] + dx, at[1] + dy)
        # Least squares on a ring is a projection, as in ``rocks.py``.
        fall = -np.array([(z * dx).sum(), (z * dy).sum()]) / (_ROUND / 2 * (0.45 * diameter) ** 2)
        return float(z.mean()), fall

    at, (height, fall) = place.copy(), ground(place)
    for _ in range(_MOST_STEPS):
        steep = float(np.hypot(*fall))
        if not steep > math.tan(math.radians(_ROLLS_DEG)):
            break
        following = at + _STEP * diameter * fall / steep
        lower, next_fall = ground(following)
        apart = np.hypot(*(others - following).T)
        if not lower < height or ((apart < touch) & (apart < np.hypot(*(others - at).T))).any():
            break
        at, height, fall = following, lower, next_fall
    return at
