"""The noises again, one point at a time in plain Python, to hold the fast ones against."""

from __future__ import annotations

import math
from collections.abc import Sequence

MASK = 0xFFFFFFFF


def hashed(column: int, row: int, key: int) -> int:
    """A well mixed 32-bit integer of a lattice square."""
    h = (((column * 0x9E3779B1) & MASK) ^ ((row * 0x85EBCA77) & MASK)) + key & MASK
    h = ((h ^ h >> 16) * 0x7FEB352D) & MASK
    h = ((h ^ h >> 15) * 0x846CA68B) & MASK
    return h ^ h >> 16


def gradient_noise(x: float, y: float, key: int) -> float:
    """Perlin's improved noise in two dimensions with 64 gradients of length √2."""
    column, row = math.floor(x), math.floor(y)
    total = 0.0
    for i in (0, 1):
        for j in (0, 1):
            angle = 2 * math.pi * (hashed(column + i, row + j, key) % 64) / 64
            dx, dy = x - column - i, y - row - j
            weight = 1.0
            for t in (abs(dx), abs(dy)):
                weight *= 1 - (6 * t**5 - 15 * t**4 + 10 * t**3)
            total += weight * math.sqrt(2) * (math.cos(angle) * dx + math.sin(angle) * dy)
    return total


def cell_noise(x: float, y: float, key: int) -> float:
    """The square's value."""
    return 2 * hashed(math.floor(x), math.floor(y), key) / 2**32 - 1


def value_noise(x: float, y: float, key: int) -> float:
    """Bilinear between the values of the four corners."""
    column, row = math.floor(x), math.floor(y)
    return sum(
        (1 - abs(x - column - i)) * (1 - abs(y - row - j)) * cell_noise(column + i, row + j, key)
        for i in (0, 1)
        for j in (0, 1)
    )


def broken_noise(x: float, y: float, key: int, planes: Sequence[Sequence[Sequence[float]]]) -> float:
    """The highest of the pieces of 9 x 9 squares, each the lowest of its planes, and a floor at -1. ``planes`` are the
    slopes east and north and the nearness of the top and the five sides of each kind."""
    highest = 0.0
    for column in range(math.floor(x) - 4, math.floor(x) + 5):
        for row in range(math.floor(y) - 4, math.floor(y) + 5):
            h = hashed(column, row, key)
            dx, dy = x - column - (h & 1023) / 1024, y - row - (h >> 10 & 1023) / 1024
            middle = (h >> 20 & 63) / 64 * 1.5
            # A side is so near that the piece ends at a distance of 1, also half way between two sides.
            room = 6.6 * math.cos(math.radians(36 * 1.4)) - middle
            top, *sides = planes[h >> 26]
            heights = [middle + top[0] * dx + top[1] * dy]
            heights += [middle + room * near + east * dx + north * dy for east, north, near in sides]
            highest = max(highest, min(heights))
    return highest - 1.0


def points_near(x: float, y: float, key: int, squares: int = 5) -> list[tuple[float, float, float, int, int]]:
    """Distance, place and square of the random points of many squares around a position, nearest first."""
    found = []
    for column in range(math.floor(x) - squares, math.floor(x) + squares + 1):
        for row in range(math.floor(y) - squares, math.floor(y) + squares + 1):
            h = hashed(column, row, key)
            px, py = column + (h & 0xFFFF) / 65536, row + (h >> 16) / 65536
            found.append((math.hypot(px - x, py - y), px, py, column, row))
    return sorted(found)


def edge_distance(x: float, y: float, key: int, length_x: float, length_y: float) -> float:
    """Distance to the nearest of the lines half way between the nearest point and the others, when a
    lattice square is ``length_x`` by ``length_y``."""
    (_, ax, ay, *_), *others = points_near(x, y, key)
    nearest = math.inf
    for _, bx, by, *_ in others:
        # Two points of the line, then the distance from a line by a cross product.
        mx, my, dx, dy = (ax + bx) / 2 * length_x, (ay + by) / 2 * length_y, (ay - by) * length_x, (bx - ax) * length_y
        cross = (x * length_x - mx) * dy - (y * length_y - my) * dx
        nearest = min(nearest, abs(cross) / math.hypot(dx, dy))
    return nearest


def musgrave(fractal: str, noise: list[float], roughness: float) -> float:
    """The fractal sums of Ebert et al. 2003, chapter 16, with offset and gain of 1, of given octaves."""
    weights = [roughness**k for k in range(len(noise))]
    if fractal in ("FBM", "TURBULENCE"):
        return sum(w * (abs(n) if fractal == "TURBULENCE" else n) for w, n in zip(weights, noise, strict=True))
    if fractal == "CRESTS":
        return sum(w * (1 - abs(n)) ** 2 for w, n in zip(weights, noise, strict=True))
    if fractal == "MULTIFRACTAL":
        return math.prod(w * n + 1 for w, n in zip(weights, noise, strict=True))
    if fractal == "HETERO":
        value = 1 + noise[0]
        for w, n in zip(weights[1:], noise[1:], strict=True):
            value += (n + 1) * w * value
        return value
    if fractal == "HYBRID":
        result = weight = noise[0] + 1
        for w, n in zip(weights[1:], noise[1:], strict=True):
            weight = min(weight, 1.0)
            signal = (n + 1) * w
            result += weight * signal
            weight *= signal
        return result
    assert fractal == "RIDGED"
    signal = result = (1 - abs(noise[0])) ** 2
    for w, n in zip(weights[1:], noise[1:], strict=True):
        weight = min(max(signal, 0.0), 1.0)
        signal = (1 - abs(n)) ** 2 * weight
        result += signal * w
    return result
