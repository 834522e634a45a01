"""Lattice noises as functions of position.

Points may come in any order. The numbers are the same in every Blender on every machine, because only integer hashing
and float64 sums, products and roots are used (sines and powers differ between machines in the last bit). Source of the
method: Perlin, "Improving Noise", SIGGRAPH 2002 (quintic fade). Lattice values come from a 32-bit integer hash instead
of a permutation table, so the lattice repeats only after 2³² cells.

If many points share few lattice cells, the cells are hashed once and looked up; otherwise each point hashes its own
cell. Both ways give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ....support.arrays import Array

#: Number of directions of gradients.
_GRADIENT_DIRECTIONS = 64
_ANGLES = [2 * math.pi * k / _GRADIENT_DIRECTIONS for k in range(_GRADIENT_DIRECTIONS)]
#: Gradients of length √2, which gives noise of about unit range.
_GRADIENT_X, _GRADIENT_Y = (np.array([math.sqrt(2.0) * f(a) for a in _ANGLES]) for f in (math.cos, math.sin))
#: The twelve edge directions of Perlin's 3-D noise, of length √2.
_GRADIENTS_3D = np.array(
    [(a, b, 0) for a in (-1, 1) for b in (-1, 1)]
    + [(a, 0, b) for a in (-1, 1) for b in (-1, 1)]
    + [(0, a, b) for a in (-1, 1) for b in (-1, 1)],
    np.float64,
)
_COLUMN_FACTOR, _ROW_FACTOR, _WORD = 0x9E3779B1, 0x85EBCA77, 0xFFFFFFFF
#: Largest number of lattice corners per point for which a table is cheaper than hashing.
_TABLE_PER_POINT = 2


def _mix_bits(h: Array) -> Array:
    """Spread every bit of uint32 ``h`` over all others, in place."""
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        h ^= h >> np.uint32(shift)
        h *= np.uint32(factor)
    h ^= h >> np.uint32(16)
    return h


def hash_lattice(ix: Array, iy: Array, key: int) -> Array:
    """Hash integer lattice coordinates (int64 arrays that broadcast) and a 32-bit key to well mixed uint32."""
    return _hash_scaled(_scale(ix, _COLUMN_FACTOR), _scale(iy, _ROW_FACTOR), key)


def _scale(index: Array, factor: int) -> Array:
    return index.astype(np.uint32) * np.uint32(factor)


def _hash_scaled(column: Array, row: Array, key: int) -> Array:
    """Hash coordinates after ``_scale``, as ``hash_lattice`` does."""
    h: Array = column ^ row
    h += np.uint32(key & _WORD)
    return _mix_bits(h)


def to_uniform(h: Array) -> Array:
    """Convert hashes to numbers in [0, 1)."""
    return h * (1.0 / 2**32)


def quintic_fade(t: Array) -> Array:
    """Compute Perlin's quintic step 6 t⁵ - 15 t⁴ + 10 t³, from 0 at 0 to 1 at 1."""
    result = 6.0 * t
    result -= 15.0
    result *= t
    result += 10.0
    cube = t * t
    cube *= t
    result *= cube
    return result


@dataclass(frozen=True)
class LatticeCells:
    """The lattice cell of each point, and values at lattice corners near it. ``dx`` and ``dy`` are the places of the
    points in their cells, in [0, 1)."""

    dx: Array
    dy: Array
    _x: Array  # integral floats
    _y: Array
    _key: int
    _reach: int
    _index: Array | None
    _width: int
    _hashes: Array | None

    @classmethod
    def of(cls, x: Array, y: Array, key: int, reach: int = 0) -> LatticeCells:
        """Find the cells of points in lattice units; values at corners from -reach to reach + 1 are available."""
        left, below = np.floor(x), np.floor(y)
        dx, dy = x - left, y - below
        x_min, y_min = float(left.min()) - reach, float(below.min()) - reach
        width, height = (float(a.max()) - low + 2 + reach for a, low in ((left, x_min), (below, y_min)))
        if not width * height <= _TABLE_PER_POINT * left.size:
            return cls(dx, dy, left, below, key, reach, None, 0, None)
        hashes = hash_lattice(
            np.arange(width)[None, :].astype(np.int64) + int(x_min),
            np.arange(height)[:, None].astype(np.int64) + int(y_min),
            key,
        ).ravel()
        place = below - (y_min + reach)
        place *= width
        place += left
        place -= x_min + reach
        return cls(dx, dy, left, below, key, reach, place.astype(np.intp), int(width), hashes)

    def squares(self, who: Array | slice) -> tuple[Array, Array]:
        """Return the column and row (int64) of the cells of the points ``who`` (a slice or an index array)."""
        return self._x[who].astype(np.int64), self._y[who].astype(np.int64)

    def make_corner_reader(self, function: Callable[[Array], tuple[Array, ...]]) -> Callable[[int, int], list[Array]]:
        """Make a function ``f(i, j)`` that returns the arrays of a function of the hash at the corner (i, j) from each
        point's cell.
        """
        if self._index is None or self._hashes is None:
            ix, iy = self.squares(slice(None))
            column, row = _scale(ix, _COLUMN_FACTOR), _scale(iy, _ROW_FACTOR)

            def hash_each(i: int, j: int) -> list[Array]:
                right, up = np.uint32(i * _COLUMN_FACTOR & _WORD), np.uint32(j * _ROW_FACTOR & _WORD)
                return [*function(_hash_scaled(column + right, row + up, self._key))]

            return hash_each
        index, tables = self._index, function(self._hashes)

        def read_corner(i: int, j: int) -> list[Array]:
            start = (j + self._reach) * self._width + i + self._reach
            # "clip" spares the check of the indices, which are in range.
            return [table[start:].take(index, mode="clip") for table in tables]

        return read_corner


def _find_gradients(h: Array) -> tuple[Array, Array]:
    direction = (h & np.uint32(_GRADIENT_DIRECTIONS - 1)).astype(np.intp)
    return _GRADIENT_X.take(direction), _GRADIENT_Y.take(direction)


def _find_value(h: Array) -> tuple[Array]:
    return (to_uniform(h),)


def gradient_noise(x: Array, y: Array, key: int) -> Array:
    """Compute noise of zero mean, unit wavelength and about unit range (|value| <= 1).

    ``x`` and ``y`` are float64 arrays of one shape in lattice units; the result has that shape. The noise is
    continuous, with continuous second derivatives, and zero at lattice points.
    """
    cells = LatticeCells.of(np.asarray(x), np.asarray(y), key)
    gradients = cells.make_corner_reader(_find_gradients)
    u, v = quintic_fade(cells.dx), quintic_fade(cells.dy)
    right, above = cells.dx - 1.0, cells.dy - 1.0

    def corner(i: int, j: int) -> Array:
        along_x, along_y = gradients(i, j)
        along_x *= right if i else cells.dx
        along_y *= above if j else cells.dy
        along_x += along_y
        return along_x

    def blend(low: Array, high: Array, share: Array) -> Array:
        high -= low
        high *= share
        low += high
        return low

    return blend(blend(corner(0, 0), corner(1, 0), u), blend(corner(0, 1), corner(1, 1), u), v)


def cell_noise(x: Array, y: Array, key: int) -> Array:
    """Compute a random value in [-1, 1) for each unit square."""
    cells = LatticeCells.of(np.asarray(x), np.asarray(y), key)
    (value,) = cells.make_corner_reader(_find_value)(0, 0)
    value *= 2.0
    value -= 1.0
    return value


def value_noise(x: Array, y: Array, key: int) -> Array:
    """Compute noise with values in [-1, 1) at lattice points, linear between them.

    Summed over octaves of ratio 2 this is mid-point displacement: each octave puts a random displacement at points that
    the coarser octaves only interpolated.
    """
    cells = LatticeCells.of(np.asarray(x), np.asarray(y), key)
    values = cells.make_corner_reader(_find_value)
    (a,), (b,), (c,), (d,) = values(0, 0), values(1, 0), values(0, 1), values(1, 1)
    low, high = a + cells.dx * (b - a), c + cells.dx * (d - c)
    return 2.0 * (low + cells.dy * (high - low)) - 1.0


def gradient_noise_3d(points: Array, key: int) -> Array:
    """Compute gradient noise at points (n, 3) in lattice units, for surfaces that are no height field."""
    base = np.floor(points)
    cell = base.astype(np.int64)
    near = points - base
    u, v, w = (quintic_fade(near[:, k]) for k in range(3))

    def corner(i: int, j: int, k: int) -> Array:
        layer = hash_lattice(cell[:, 2] + k, np.int64(0) * cell[:, 2], key)
        h = hash_lattice(cell[:, 0] + i, cell[:, 1] + j, key) ^ layer
        direction = (_mix_bits(h).astype(np.uint64) * np.uint64(len(_GRADIENTS_3D))) >> np.uint64(32)
        g = _GRADIENTS_3D.take(direction.astype(np.intp), axis=0)
        return g[:, 0] * (near[:, 0] - i) + g[:, 1] * (near[:, 1] - j) + g[:, 2] * (near[:, 2] - k)

    def plane(k: int) -> Array:
        low, high = (a + u * (b - a) for a, b in ((corner(0, j, k), corner(1, j, k)) for j in (0, 1)))
        return low + v * (high - low)

    floor = plane(0)
    return floor + w * (plane(1) - floor)
