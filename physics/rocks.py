"""Sizes, places and shapes of ice blocks.

Sizes follow a truncated power law N(>D) ~ D^-a, the law fitted to block counts on Enceladus
(Pajola et al. 2021, Universe 7, 82); the exponent is a setting because no metre-scale value is known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .seeds import generator
from .terrain import Terrain


@dataclass(frozen=True)
class Rocks:
    """``n`` blocks: positions (n, 3) of the centres in m, ``diameter_m`` (n,), ``rotation`` (n, 3)
    Euler angles in radians, ``shape`` (n,) index of the mesh. ``smallest_m`` is the smallest
    diameter drawn, above the setting when the number of blocks was limited."""

    position_m: np.ndarray
    diameter_m: np.ndarray
    rotation: np.ndarray
    shape: np.ndarray
    smallest_m: float


def diameters(uniform: np.ndarray, smallest_m: float, largest_m: float, index: float) -> np.ndarray:
    """Diameters of the truncated power law for uniform numbers in [0, 1), by inversion."""
    ratio = (smallest_m / largest_m) ** index
    return smallest_m * (1.0 - uniform * (1.0 - ratio)) ** (-1.0 / index)


def mean_footprint_m2(smallest_m: float, largest_m: float, index: float) -> float:
    """Mean of pi D²/4 over the truncated power law."""
    if largest_m <= smallest_m:
        return math.pi / 4 * smallest_m**2
    log_ratio = math.log(largest_m / smallest_m)
    norm = -math.expm1(-index * log_ratio) / index  # integral of D^(-index-1), times smallest^index
    power = 2.0 - index
    second = log_ratio if abs(power) < 1e-9 else math.expm1(power * log_ratio) / power
    return math.pi / 4 * smallest_m**2 * second / norm


def _count(settings: Mapping[str, Any], area_m2: float, smallest_m: float, largest_m: float) -> float:
    return settings["coverage"] * area_m2 / mean_footprint_m2(smallest_m, largest_m, settings["power_index"])


def scatter(settings: Mapping[str, Any], ground: Terrain, seed: int, shortest_m: float, shapes: int,
            keep_clear_m: tuple[float, float]) -> Rocks:
    """Place the blocks that ``rocks`` settings describe on the ground.

    ``shortest_m`` is the shortest wavelength in the mesh (the ground the blocks must touch),
    ``shapes`` the number of meshes to choose from, ``keep_clear_m`` a point (the left camera) that
    no block may contain. A block's lowest point is under the lowest ground of its footprint, so
    none floats.
    """
    area = ground.size_m**2
    smallest, largest = settings["smallest_m"], max(settings["smallest_m"], settings["largest_m"])
    most = settings["most"]
    whole_law = _count(settings, area, smallest, largest)
    if whole_law > most:
        # Cut the law from below: the blocks above D are as many as the full law has above D.
        smallest = float(diameters(np.array(1.0 - most / whole_law), smallest, largest, settings["power_index"]))
    n = round(min(whole_law, most))
    random = generator(seed, "rocks")
    diameter = np.sort(diameters(random.random(n), smallest, largest, settings["power_index"]))[::-1]
    x, y = random.uniform(-ground.size_m / 2, ground.size_m / 2, (2, n))
    rotation = np.stack([random.normal(0, 0.3, n), random.normal(0, 0.3, n), random.uniform(0, 2 * np.pi, n)], 1)
    shape = random.integers(0, shapes, n)
    burial = np.clip(settings["burial"] + random.normal(0, 0.1, n) * (settings["burial"] > 0), 0.0, 0.95)
    clear = np.hypot(x - keep_clear_m[0], y - keep_clear_m[1]) > 0.75 * diameter
    x, y, diameter, rotation, shape, burial = (a[clear] for a in (x, y, diameter, rotation, shape, burial))
    ring = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    footprint_x = x[:, None] + 0.35 * diameter[:, None] * np.append(np.cos(ring), 0.0)
    footprint_y = y[:, None] + 0.35 * diameter[:, None] * np.append(np.sin(ring), 0.0)
    lowest = ground.heights(footprint_x, footprint_y, shortest_m).min(axis=1) if len(x) else x
    # Shapes reach 0.35 D to 0.5 D below their centre; 0.35 D keeps the flattest of them touching.
    position = np.stack([x, y, lowest + diameter * (0.35 - 0.85 * burial)], axis=1)
    return Rocks(position, diameter, rotation, shape, smallest)


def block_radii(directions: np.ndarray, angularity: float, random: np.random.Generator) -> np.ndarray:
    """Radius of one block along unit ``directions`` (n, 3), at most 0.5 and star-shaped.

    A block is the intersection of a ball with random half-spaces, as fracture leaves it;
    ``angularity`` blends from the ball (0) to the broken block (1).
    """
    planes = random.normal(size=(14, 3))
    planes /= np.linalg.norm(planes, axis=1, keepdims=True)
    depth = random.uniform(0.29, 0.46, 14)
    facing = np.maximum(directions @ planes.T, 1e-9)
    faceted = np.minimum((depth / facing).min(axis=1), 0.5)
    stretch = 1.0 - 0.3 * random.random(3)
    ball = 0.45 / np.linalg.norm(directions / stretch, axis=1) / stretch.max()
    return (1.0 - angularity) * ball + angularity * faceted
