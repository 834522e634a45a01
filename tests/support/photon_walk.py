"""Photons that walk through a half-space of scatterers: a second way to delays of light in ice, without diffusion.

Each photon enters along the normal, scatters by Henyey and Greenstein's phase function and is absorbed at a path drawn
beforehand, so that no path is cut. Lengths are in transport mean free paths l*.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from icymoon.support.arrays import Array


@dataclass(frozen=True)
class Exits:
    """Photons (n,) that left: their path inside, the cosine of their exit, their distance from the entry."""

    path: Array
    cosine: Array
    radius: Array
    started: int

    @property
    def albedo(self) -> float:
        """The share of photons that left."""
        return len(self.path) / self.started


def walk(count: int, absorption: float, asymmetry: float, seed: int, index: float = 1.0) -> Exits:
    """Let ``count`` photons walk; ``absorption`` is μa l*, ``index`` the refractive index of the medium, whose smooth
    surface reflects leaving photons by Fresnel's formulas. Photons start inside."""
    random = np.random.default_rng(seed)
    mean_free = 1.0 - asymmetry
    place, way = np.zeros((count, 3)), np.tile([0.0, 0.0, 1.0], (count, 1))
    path = np.zeros(count)
    death = random.exponential(1.0 / absorption, count)
    left: list[tuple[Array, Array, Array]] = []
    while len(path):
        step = random.exponential(mean_free, len(path))
        crosses = place[:, 2] + way[:, 2] * step < 0.0
        step = np.where(crosses, place[:, 2] / np.maximum(-way[:, 2], 1e-12), step)
        place += way * step[:, None]
        path += step
        alive = path < death
        cosine = -way[:, 2]
        out = crosses & alive & (random.random(len(path)) >= reflect(cosine, index))
        left.append((path[out], cosine[out], np.hypot(place[out, 0], place[out, 1])))
        way[crosses, 2] *= -1.0
        place[crosses, 2] = 0.0
        way[~crosses] = _turn(way[~crosses], asymmetry, random)
        keep = alive & ~out
        place, way, path, death = place[keep], way[keep], path[keep], death[keep]
    path, cosine, radius = (np.concatenate(parts) for parts in zip(*left, strict=True))
    return Exits(path, cosine, radius, count)


def reflect(cosine: Array, index: float) -> Array:
    """The share of unpolarised light (n,) that a smooth surface reflects back into a medium of a refractive index."""
    inside = np.clip(np.abs(cosine), 1e-9, 1.0)
    sine = index * np.sqrt(1.0 - inside**2)
    outside = np.sqrt(np.maximum(1.0 - sine**2, 0.0))
    across = (index * inside - outside) / (index * inside + outside)
    along = (inside - index * outside) / (inside + index * outside)
    return np.where(sine >= 1.0, 1.0, 0.5 * (across**2 + along**2))


def _turn(way: Array, asymmetry: float, random: np.random.Generator) -> Array:
    """Directions (n, 3) after one scattering."""
    share, turn = random.random(len(way)), 2.0 * np.pi * random.random(len(way))
    if asymmetry == 0.0:
        cosine = 2.0 * share - 1.0
    else:
        ratio = (1.0 - asymmetry**2) / (1.0 - asymmetry + 2.0 * asymmetry * share)
        cosine = (1.0 + asymmetry**2 - ratio**2) / (2.0 * asymmetry)
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    # A frame about the old direction: Duff et al. 2017, Journal of Computer Graphics Techniques 6, 1.
    x, y, z = way.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    second = np.stack([b, sign + y * y * a, -y], axis=1)
    turned = (sine * np.cos(turn))[:, None] * first + (sine * np.sin(turn))[:, None] * second + cosine[:, None] * way
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)
