"""Sublimation pits: flat floors at one depth within steep walls that retreat sideways, without raised rims.

Ice that sublimes under a lag or over a harder layer leaves such pits: they widen at one depth, so that neighbours grow
together and cusps of walls stand between arcs. Known at other scales and of other ices: the circular pits in a layer of
carbon dioxide ice about 8 m thick at Mars' south pole (Byrne and Ingersoll 2003, Science 299, 1051), whose walls
retreat by metres a year (from memory: Malin et al. 2001, Science 294, 2146), and pits of kilometres in the nitrogen ice
of Pluto (from memory: Moore et al. 2017, Icarus 287, 320). No image shows either moon at metres: that they have such
pits, their depth, width and number are guesses.

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
from .landform import Crests, Landform, Walls, draw_key, evaluate_where, facet_heights, sample_shifted_noise

#: Smallest radius over the mean radius.
_SMALLEST_RADIUS = 0.5
#: Largest radius over the mean radius.
_LARGEST_RADIUS = 1.5
#: Mean square radius over the square of the mean radius.
_MEAN_SQUARE_RADIUS = 1.0 + (_LARGEST_RADIUS - _SMALLEST_RADIUS) ** 2 / 12.0
#: Constant c in ``make``, measured: the gain in covered ground of one pit in each square over pits at random places.
_EVENNESS_GAIN = 0.28
#: Bending of the walls, in mean radii.
_BEND_SIZE = 0.22
#: Wavelengths of the bending, in mean radii.
_BEND_WAVELENGTHS = (1.6, 0.55)
#: Width of the blocks of lag on the floor, in mean radii.
_BLOCK_WIDTH = 0.18
#: Their height, as a share of the depth.
_BLOCK_HEIGHT = 0.12
#: Slope of the sides of the blocks.
_BLOCK_SLOPE = 2.0
#: Buried part of each block.
_BLOCK_BURIED = 0.35
#: Slope of talus.
_TALUS_SLOPE = math.tan(math.radians(35.0))
#: Share by which the height of talus varies along a wall.
_TALUS_VARIATION = 0.7
#: Wavelengths of that variation, in depths of the pit.
_APRON_WAVELENGTHS = (2.4, 0.8)
#: Widths of the debris of talus, in depths of the pit.
_DEBRIS_WIDTHS = (0.22, 0.09)
#: Height of debris over its width.
_DEBRIS_HEIGHT = 0.5
#: Slope of its sides.
_DEBRIS_SLOPE = 2.2
#: Buried part of debris on the apron and at its toe.
_DEBRIS_BURIED = (0.6, 0.3)
#: Distance beyond the toe to which debris lies, in heights of the talus.
_DEBRIS_BEYOND_TOE = 1.0


def _measure_distance_inside(u: Array, v: Array, square_m: float, radius_m: float, keys: Sequence[int]) -> Array:
    """Measure the distance in metres to the rim of round pits, one in each square, positive in a pit; ``u`` and ``v``
    are in squares.
    """
    column, row = (np.floor(a).astype(np.int64) for a in (u, v))
    deepest = np.full(u.shape, -np.inf)
    reach = math.ceil(_LARGEST_RADIUS * radius_m / square_m)
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            # Several random numbers from one hash: pits need few digits.
            h = hash_lattice(column + i, row + j, keys[2])
            east, north = (h & np.uint32(0xFFFF)) / 65536.0, (h >> np.uint32(16)) / 65536.0
            wide = _SMALLEST_RADIUS + (_LARGEST_RADIUS - _SMALLEST_RADIUS) * to_uniform(
                hash_lattice(column + i, row + j, keys[3])
            )
            away = square_m * np.hypot(column + i + east - u, row + j + north - v)
            np.maximum(deepest, radius_m * wide - away, out=deepest)
    return deepest


def _talus_height(
    amount: float, depth: float, keys: Sequence[int], x: Array, y: Array, from_wall: Array, bare: Array
) -> Array:
    """Compute the height in metres of the talus at a place, above the ``bare`` ground; ``from_wall`` is the distance
    from the foot of the wall.
    """
    uneven = sum(
        sample_shifted_noise(x / (length * depth), y / (length * depth), keys[5] ^ k)
        for k, length in enumerate(_APRON_WAVELENGTHS)
    )
    # Height of an apron over the floor at the foot of the wall.
    high = amount * depth * np.maximum(1.0 + _TALUS_VARIATION * uneven, 0.0)
    over = high - _TALUS_SLOPE * from_wall
    apron = np.maximum(np.minimum(over - depth, 0.0), bare)
    # Debris lies on the apron, less buried near the toe, and a little beyond it; none lies high on the wall.
    buried = np.interp(over / np.maximum(high, 1e-9), (0.0, 1.0), _DEBRIS_BURIED[::-1])
    fades = np.clip(1.0 + over / np.maximum(_DEBRIS_BEYOND_TOE * high, 1e-9), 0.0, 1.0)
    fades *= np.clip(-2.0 * bare / depth - 0.4, 0.0, 1.0)
    debris = np.zeros(x.shape)
    for k, size in enumerate(width * depth for width in _DEBRIS_WIDTHS):
        tops = facet_heights(x / size, y / size, _DEBRIS_SLOPE, keys[6] ^ k)
        debris += _DEBRIS_HEIGHT * size * np.maximum(tops - buried, 0.0)
    return apron + fades * debris - bare


def make(settings: PitsSettings, random: np.random.Generator, size_m: float) -> Landform | None:
    """Make pits ``depth_m`` deep on a share ``coverage`` of the ground, from rim to rim; None without depth or
    coverage.
    """
    keys = [draw_key(random) for _ in range(7)]
    depth, radius = settings.depth_m, settings.diameter_m / 2
    if depth == 0.0 or settings.coverage == 0.0:
        return None
    # Discs at random places leave exp(-a) of the ground free, of a total area a; in squares, exp(-a - c a^2).
    total = (math.sqrt(1.0 - 4.0 * _EVENNESS_GAIN * math.log(1.0 - settings.coverage)) - 1.0) / (2.0 * _EVENNESS_GAIN)
    square = math.sqrt(math.pi * _MEAN_SQUARE_RADIUS / total) * radius
    wall = depth / math.tan(math.radians(settings.wall_deg))
    add_talus = partial(_talus_height, settings.talus, depth, keys)

    def inside_m(x_m: Array, y_m: Array) -> Array:
        """Compute the distance to the rim in metres, positive in a pit; exact near the rims of round pits."""
        x, y = np.broadcast_arrays(x_m, y_m)
        for k, length in enumerate(_BEND_WAVELENGTHS):
            amount = _BEND_SIZE * radius * length / _BEND_WAVELENGTHS[0]
            u, v = x / (length * radius), y / (length * radius)
            bend_x, bend_y = (amount * sample_shifted_noise(u, v, key ^ k) for key in keys[:2])
            x, y = x + bend_x, y + bend_y
        return _measure_distance_inside(x / square, y / square, square, radius, keys)

    def heights(x_m: Array, y_m: Array, shortest_m: Numbers) -> Array:
        inside = inside_m(x_m, y_m)
        down = np.clip(inside / wall, 0.0, 1.0)
        x, y = np.broadcast_arrays(x_m, y_m)
        size = _BLOCK_WIDTH * radius
        lag = np.maximum(facet_heights(x / size, y / size, _BLOCK_SLOPE, keys[4]) - _BLOCK_BURIED, 0.0)
        bare = -depth * down * (1.0 - _BLOCK_HEIGHT * lag * down)
        if settings.talus == 0.0:
            return bare
        reach = (
            wall + (1.0 + _DEBRIS_BEYOND_TOE) * (1.0 + 2.0 * _TALUS_VARIATION) * settings.talus * depth / _TALUS_SLOPE
        )
        return bare + evaluate_where((inside > 0.0) & (inside < reach), add_talus, x, y, inside - wall, bare)

    return Landform(wall, heights, Crests([inside_m], heights, settings.diameter_m), Walls(depth, keys[4]))
