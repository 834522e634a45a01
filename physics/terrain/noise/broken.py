"""Broken ice: convex pieces with tilted tops and steep sides, one per lattice square, of which the highest is seen.

Plane faces that meet at edges are what fracture leaves. Summed over octaves, each piece has smaller ones on its faces,
so the ground has facets at every scale, where sums of smooth noise look melted. The pieces are a guess for ice: no
image shows either moon at metres.

A piece is the lowest of six planes, so it is continuous; around it is a floor at -1. Its sides are so near that it does
not reach beyond a distance of one lattice square, so only the pieces of the 3 x 3 squares around a position are needed.
"""

from __future__ import annotations

import math

import numpy as np

from ....support.arrays import Array
from .lattice_noise import LatticeCells

#: Number of kinds of pieces, of heights of each kind, and of sides of a piece.
_KINDS, _HEIGHTS, _SIDES = 64, 64, 5
#: Slopes of the sides, and of the steepest tops, in units of height per lattice square.
_SIDE_SLOPE, _TOP_SLOPE = 6.6, 1.35
#: Height of the highest middle of a top above the floor.
_HIGHEST = 1.5
#: Largest deviation of the direction of a side, over the angle between two sides.
_JITTER = 0.2
#: Least distance of a side over the largest possible one.
_NEAREST = 0.4


def _make_planes() -> Array:
    """Slopes east and north (kinds, 1 + sides, 2) of the top and the sides of each kind of piece, and the distance of
    each side (kinds, sides) over the largest possible one."""
    random = np.random.default_rng(5)
    around = np.arange(_SIDES) + random.uniform(-_JITTER, _JITTER, (_KINDS, _SIDES)) + random.random((_KINDS, 1))
    side, nearness = 2 * math.pi / _SIDES * around, random.uniform(_NEAREST, 1.0, (_KINDS, _SIDES))
    dip, steepness = random.uniform(0, 2 * math.pi, (_KINDS, 1)), _TOP_SLOPE * np.sqrt(random.random((_KINDS, 1)))
    angle = np.concatenate([dip, side], axis=1)
    slope = np.concatenate([steepness, np.full(side.shape, -_SIDE_SLOPE)], axis=1)
    planes = np.stack([slope * np.cos(angle), slope * np.sin(angle), np.pad(nearness, ((0, 0), (1, 0)))], axis=2)
    # Sines differ between machines in the last bit of a double; rounded values do not.
    return planes.astype(np.float32).astype(np.float64)


_PLANES = _make_planes()
#: Least cosine between any direction and the nearest side of a piece.
_MIN_COSINE = math.cos(math.pi / _SIDES * (1.0 + 2.0 * _JITTER))
#: Heights of the middles of tops (heights,), and of the sides at the middles (kinds, sides, heights).
_MIDDLES = np.arange(_HEIGHTS) * (_HIGHEST / _HEIGHTS)
_SIDE_HEIGHTS = _MIDDLES + _PLANES[:, 1:, 2, None] * (_SIDE_SLOPE * _MIN_COSINE - _MIDDLES)


def _measure_reaches() -> Array:
    """Squared distances (kinds · heights,) from the middle beyond which a piece is below the floor."""
    away = _SIDE_HEIGHTS / _SIDE_SLOPE
    turn = np.arctan2(-_PLANES[:, 1:, 1], -_PLANES[:, 1:, 0])[..., None]
    # The corner of two sides, from their distances and the angle between them.
    following, angle = np.roll(away, -1, axis=1), np.roll(turn, -1, axis=1) - turn
    corner = (away**2 + following**2 - 2.0 * away * following * np.cos(angle)) / np.sin(angle) ** 2
    return np.asarray(corner.max(axis=1).ravel() * (1.0 + 1e-6))


_REACHES = _measure_reaches()


def _find_pieces(h: Array) -> tuple[Array, ...]:
    """The middle of the piece of a square east and north of its corner, and the number of the piece, from the hash of
    the square: its kind times the number of heights, plus its height."""
    x, y = ((h >> np.uint32(shift) & np.uint32(1023)) * (1.0 / 1024) for shift in (0, 10))
    return x, y, (h >> np.uint32(20)).astype(np.intp)


def _compute_heights(east: Array, north: Array, piece: Array) -> Array:
    """Compute the heights (n,) of numbered pieces above the floor, at offsets (n,) from their middles; negative outside
    the piece.
    """
    kind, height = np.divmod(piece, _HEIGHTS)
    lowest = _MIDDLES.take(height)
    lowest += _PLANES[:, 0, 0].take(kind) * east
    lowest += _PLANES[:, 0, 1].take(kind) * north
    for k in range(_SIDES):
        side = _SIDE_HEIGHTS[:, k].take(piece)
        side += _PLANES[:, 1 + k, 0].take(kind) * east
        side += _PLANES[:, 1 + k, 1].take(kind) * north
        np.minimum(lowest, side, out=lowest)
    return lowest


def broken_noise(x: Array, y: Array, key: int) -> Array:
    """Pieces of unit spacing, from -1, the floor, to about 1.

    ``x`` and ``y`` are float64 arrays of one shape in lattice units; the result has that shape. Continuous, and plane
    between edges.
    """
    cells = LatticeCells.of(np.asarray(x), np.asarray(y), key, reach=1)
    read, shape = cells.make_corner_reader(_find_pieces), np.shape(cells.dx)
    highest = np.zeros(cells.dx.size)
    for j in (-1, 0, 1):
        for i in (-1, 0, 1):
            middle_x, middle_y, piece = (each.ravel() for each in read(i, j))
            east, north = cells.dx.ravel() - i - middle_x, cells.dy.ravel() - j - middle_y
            near = np.flatnonzero(east * east + north * north < _REACHES.take(piece))
            heights = _compute_heights(east[near], north[near], piece[near])
            highest[near] = np.maximum(highest[near], heights)
    return highest.reshape(shape) - 1.0
