"""Sublimation pits: flat floors at one depth within steep walls that retreat sideways, without raised rims.

Ice that leaves as gas under a lag or over a harder layer takes such pits: they widen at one depth, so that neighbours
grow together and cusps of walls stand between arcs. Known at other scales and of other ices: the circular pits in a
layer of carbon dioxide ice about 8 m thick at Mars' south pole (Byrne and Ingersoll 2003, Science 299, 1051), whose
walls retreat by metres a year (from memory: Malin et al. 2001, Science 294, 2146), and pits of kilometres in the
nitrogen ice of Pluto (from memory: Moore et al. 2017, Icarus 287, 320). No image shows either moon at metres: that
they have such pits, their depth, width and number are guesses.

What falls off a wall and does not sublime lies at its foot as **talus**, at its angle of repose: in aprons of uneven
height, with the coarsest debris at the toe.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from ....settings.topics.landforms import PitsSettings
from ....support.arrays import Array, Numbers
from ..noise.lattice_noise import hash_lattice, to_uniform
from .landform import Crests, Landform, Walls, draw_key, evaluate_where, facet_heights, wander

#: Smallest and largest radius over the mean one; their mean square over the square of the mean.
_SMALLEST, _LARGEST = 0.5, 1.5
_MEAN_SQUARE = 1.0 + (_LARGEST - _SMALLEST) ** 2 / 12.0
#: How much better one pit in each square covers the ground than pits at random places; measured, c in ``make``.
_EVEN = 0.28
#: Bending of the walls in mean radii, and its wavelengths in mean radii.
_BEND, _BEND_LENGTHS = 0.22, (1.6, 0.55)
#: Blocks of the lag on the floor: width in mean radii, height as a share of the depth.
_LAG, _LAG_HEIGHT = 0.18, 0.12
#: Slope of the sides of the blocks; how much of each is buried.
_LAG_SIDE, _LAG_BURIED = 2.0, 0.35
#: Talus: its slope; by which share its height differs along a wall, and the wavelengths of that in depths of the pit.
_REPOSE, _UNEVEN, _APRONS = math.tan(math.radians(35.0)), 0.7, (2.4, 0.8)
#: Debris of talus: widths in depths of the pit, heights over their widths, slope of their sides, how much of each is
#: buried on the apron and at its toe, and how far beyond the toe in heights of the talus some lies.
_DEBRIS, _DEBRIS_HEIGHT, _DEBRIS_SIDE, _DEBRIS_BURIED, _BEYOND = (0.22, 0.09), 0.5, 2.2, (0.6, 0.3), 1.0


def _inside_round(u: Array, v: Array, square_m: float, radius_m: float, keys: Sequence[int]) -> Array:
    """Distance in metres to the rim of round pits, one in each square, positive in a pit; places are in squares."""
    column, row = (np.floor(a).astype(np.int64) for a in (u, v))
    deepest = np.full(u.shape, -np.inf)
    reach = math.ceil(_LARGEST * radius_m / square_m)
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            # Several random numbers from one hash: pits need few digits.
            h = hash_lattice(column + i, row + j, keys[2])
            east, north = (h & np.uint32(0xFFFF)) / 65536.0, (h >> np.uint32(16)) / 65536.0
            wide = _SMALLEST + (_LARGEST - _SMALLEST) * to_uniform(hash_lattice(column + i, row + j, keys[3]))
            away = square_m * np.hypot(column + i + east - u, row + j + north - v)
            np.maximum(deepest, radius_m * wide - away, out=deepest)
    return deepest


def _talus_height(
    amount: float, depth: float, keys: Sequence[int], x: Array, y: Array, from_wall: Array, bare: Array
) -> Array:
    """How much higher a place is by the talus on it; ``from_wall`` is its distance from the foot of the wall."""
    uneven = sum(wander(x / (length * depth), y / (length * depth), keys[5] ^ k) for k, length in enumerate(_APRONS))
    # Height of an apron over the floor at the foot of the wall.
    high = amount * depth * np.maximum(1.0 + _UNEVEN * uneven, 0.0)
    over = high - _REPOSE * from_wall
    apron = np.maximum(np.minimum(over - depth, 0.0), bare)
    # Debris on the apron, the less buried the nearer to the toe, and a little beyond it; none high on the wall.
    buried = np.interp(over / np.maximum(high, 1e-9), (0.0, 1.0), _DEBRIS_BURIED[::-1])
    fades = np.clip(1.0 + over / np.maximum(_BEYOND * high, 1e-9), 0.0, 1.0)
    fades *= np.clip(-2.0 * bare / depth - 0.4, 0.0, 1.0)
    debris = np.zeros(x.shape)
    for k, size in enumerate(width * depth for width in _DEBRIS):
        tops = facet_heights(x / size, y / size, _DEBRIS_SIDE, keys[6] ^ k)
        debris += _DEBRIS_HEIGHT * size * np.maximum(tops - buried, 0.0)
    return apron + fades * debris - bare


def make(settings: PitsSettings, random: np.random.Generator, size_m: float) -> Landform | None:
    """Pits ``depth_m`` deep on a share ``coverage`` of the ground, from rim to rim."""
    keys = [draw_key(random) for _ in range(7)]
    depth, radius = settings.depth_m, settings.diameter_m / 2
    if depth == 0.0 or settings.coverage == 0.0:
        return None
    # Discs at random places leave exp(-a) of the ground free, of a total area a; in squares, exp(-a - c a^2).
    total = (math.sqrt(1.0 - 4.0 * _EVEN * math.log(1.0 - settings.coverage)) - 1.0) / (2.0 * _EVEN)
    square = math.sqrt(math.pi * _MEAN_SQUARE / total) * radius
    wall = depth / math.tan(math.radians(settings.wall_deg))

    add_talus = partial(_talus_height, settings.talus, depth, keys)

    def inside_m(x_m: Array, y_m: Array) -> Array:
        """Distance to the rim, positive in a pit; exact near the rims of round pits."""
        x, y = np.broadcast_arrays(x_m, y_m)
        for k, length in enumerate(_BEND_LENGTHS):
            amount, u, v = _BEND * radius * length / _BEND_LENGTHS[0], x / (length * radius), y / (length * radius)
            x, y = x + amount * wander(u, v, keys[0] ^ k), y + amount * wander(u, v, keys[1] ^ k)
        return _inside_round(x / square, y / square, square, radius, keys)

    def heights(x_m: Array, y_m: Array, shortest_m: Numbers) -> Array:
        inside = inside_m(x_m, y_m)
        down = np.clip(inside / wall, 0.0, 1.0)
        x, y = np.broadcast_arrays(x_m, y_m)
        size = _LAG * radius
        lag = np.maximum(facet_heights(x / size, y / size, _LAG_SIDE, keys[4]) - _LAG_BURIED, 0.0)
        bare = -depth * down * (1.0 - _LAG_HEIGHT * lag * down)
        if settings.talus == 0.0:
            return bare
        reach = wall + (1.0 + _BEYOND) * (1.0 + 2.0 * _UNEVEN) * settings.talus * depth / _REPOSE
        return bare + evaluate_where((inside > 0.0) & (inside < reach), add_talus, x, y, inside - wall, bare)

    return Landform(wall, heights, Crests([inside_m], heights, settings.diameter_m), Walls(depth, keys[4]))
