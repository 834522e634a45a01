"""Walls of jointed ice: plane faces that meet at corners, with pieces spalled off their rims.

Brittle ice breaks along planes: joints that were there before, and flakes that come off the free corner of a rim. Walls
of icebergs and of floes that broke are of such faces, at angles to each other and one behind the other. Sizes, shares
and angles are guesses from them; no image shows either moon at metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ....support.arrays import Array
from ..noise.voronoi import find_voronoi_cells
from .landform import evaluate_where

#: How far faces stand behind the straight edge, as a share of their width: in the mean, and at most.
_SETBACK, _DEEPEST_SETBACK = 0.3, 0.45
#: Largest slope on the map of a face against the straight edge, toward either axis. Both together stay below 1, so that
#: no part of a wall stands free before another.
_TURN = 0.5
#: Share of the places on a rim where a piece has spalled off.
_SPALLED = 0.45
#: Width of a spall on the ground behind the rim, as a share of its length: smallest and largest.
_SPALL_WIDTHS = (0.1, 0.4)
#: Slopes of the faces that spalls leave: 40 to 65 degrees.
_SPALL_SLOPES = (0.84, 2.14)
#: Largest sideways tilt of such a face, as a share of its slope.
_SPALL_TILT = 0.5


@dataclass(frozen=True)
class JointedWall:
    """A wall from the distance ``foot`` to ``foot + width``, ``height`` high, with faces ``faces`` wide and spalls as
    long as each of ``spalls``. All lengths have one unit."""

    foot: float
    width: float
    height: float
    faces: float
    spalls: Sequence[float]

    def step(self, distance: Array, u: Array, v: Array, keys: Sequence[int]) -> Array:
        """A step from 0 at the foot to 1 at the rim at distances from the middle of a gap, at the places ``u``, ``v``.
        No part of the wall stands before the straight edge; faces and spalls lie behind it. ``keys`` has one key for
        the faces and one for each length of spalls."""
        reach = _DEEPEST_SETBACK * self.faces
        reach += _SPALL_WIDTHS[1] * (1.0 + 4.0 * _SPALL_TILT) * max(self.spalls)
        whole = distance >= self.foot + self.width + reach

        def broken(distance: Array, u: Array, v: Array) -> Array:
            setback = _find_setback(u / self.faces, v / self.faces, keys[0])
            behind = distance - self.foot - self.faces * setback
            up = behind / self.width
            for size, key in zip(self.spalls, keys[1:], strict=True):
                lost = size * _find_spall(u / size, v / size, (behind - self.width) / size, key)
                up = np.minimum(up, 1.0 - lost / self.height)
            return np.clip(up, 0.0, 1.0)

        return whole + evaluate_where((distance > self.foot) & ~whole, broken, distance, u, v)


def _find_setback(u: Array, v: Array, key: int) -> Array:
    """How far faces of width 1 stand behind the straight edge: one plane in each Voronoi cell, with steps between."""
    cells = find_voronoi_cells(u, v, key)
    turn_u, turn_v = (_TURN * (2.0 * cells.random(key ^ k) - 1.0) for k in (1, 2))
    plane = 2.0 * _SETBACK * cells.random(key ^ 3) - turn_u * cells.x1 - turn_v * cells.y1
    return np.clip(plane, 0.0, _DEEPEST_SETBACK)


def _find_spall(u: Array, v: Array, behind: Array, key: int) -> Array:
    """Height that spalls of length 1 take off at places a distance ``behind`` a rim: planes that cut its corner."""
    cells = find_voronoi_cells(u, v, key)
    chance = cells.random(key ^ 1) / _SPALLED
    few, most = _SPALL_WIDTHS
    wide = np.where(chance < 1.0, few + (most - few) * chance, -np.inf)
    tilt_u, tilt_v = (_SPALL_TILT * (2.0 * cells.random(key ^ k) - 1.0) for k in (2, 3))
    gentle, steep = _SPALL_SLOPES
    slope = gentle + (steep - gentle) * cells.random(key ^ 4)
    return slope * np.maximum(wide - tilt_u * cells.x1 - tilt_v * cells.y1 - behind, 0.0)
