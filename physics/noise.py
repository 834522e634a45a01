"""Gradient noise as a function of position.

Any points in any order, the same numbers in every Blender, on every machine: integer hashing and
float64 arithmetic only. Source of the method: Perlin, "Improving Noise", SIGGRAPH 2002 (quintic
fade); lattice gradients come from a 32-bit integer hash instead of a permutation table, so the
lattice has no period.
"""

from __future__ import annotations

import numpy as np

_DIRECTIONS = 64
_ANGLES = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
_GRADIENT_X, _GRADIENT_Y = np.cos(_ANGLES), np.sin(_ANGLES)


def hashed(ix: np.ndarray, iy: np.ndarray, key: int) -> np.ndarray:
    """Well mixed uint32 of integer lattice coordinates (int64 arrays) and a 32-bit key."""
    h = ix.astype(np.uint32) * np.uint32(0x9E3779B1)
    h ^= iy.astype(np.uint32) * np.uint32(0x85EBCA77)
    h += np.uint32(key & 0xFFFFFFFF)
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        h ^= h >> np.uint32(shift)
        h *= np.uint32(factor)
    h ^= h >> np.uint32(16)
    return h


def gradient_noise(x: np.ndarray, y: np.ndarray, key: int) -> np.ndarray:
    """Noise of zero mean, unit wavelength and about unit range (|value| <= 1).

    ``x`` and ``y`` are float64 arrays of one shape in lattice units; the result has that shape.
    Continuous with continuous second derivatives, zero at lattice points.
    """
    fx, fy = np.floor(x), np.floor(y)
    ix, iy = fx.astype(np.int64), fy.astype(np.int64)
    dx, dy = x - fx, y - fy
    ux = dx * dx * dx * (dx * (dx * 6 - 15) + 10)
    uy = dy * dy * dy * (dy * (dy * 6 - 15) + 10)

    def corner(i: int, j: int) -> np.ndarray:
        direction = hashed(ix + i, iy + j, key) & np.uint32(_DIRECTIONS - 1)
        return _GRADIENT_X[direction] * (dx - i) + _GRADIENT_Y[direction] * (dy - j)

    low = corner(0, 0)
    low += ux * (corner(1, 0) - low)
    high = corner(0, 1)
    high += ux * (corner(1, 1) - high)
    return (low + uy * (high - low)) * np.sqrt(2.0)
