"""Hollows: cups with sharp rims that sublimation leaves where no wind blows.

Suncups and scallops on snow fields; light reflected within a hollow deepens it (Betterton 2001, Phys.
Rev. E 63, 056129). Elongated, they stand in for sastrugi, which need wind and so cannot be expected
on an airless moon.
"""

from __future__ import annotations

import numpy as np

from ....settings.topics.landforms import HollowsSettings
from ....support.arrays import Array, Numbers
from ..noise.voronoi import find_voronoi_cells
from .landform import Landform, draw_key, rotate_coordinates, sample_shifted_noise

#: Sideways bending of the rims, in hollows.
_BEND_SIZE = 0.15
#: Wavelength of the bending, in hollows.
_BEND_WAVELENGTH = 0.8
#: The shallowest hollow, as a share of the deepest.
_SHALLOWEST = 0.6
#: Half the mean slope beside an edge, in depths per diameter; it gives the depth of a hollow half a crest's width from
#: the edge.
_CREST_SLOPE = 3.0


def make(settings: HollowsSettings, random: np.random.Generator, size_m: float) -> Landform | None:
    """Make hollows between rims at the level of the ground, the deepest ``depth_m`` deep; None without depth."""
    keys = [draw_key(random) for _ in range(4)]
    depth, diameter = settings.depth_m, settings.diameter_m
    crest = _CREST_SLOPE * depth * settings.crest_m / diameter
    if depth == 0.0:
        return None

    def heights(x_m: Array, y_m: Array, shortest_m: Numbers) -> Array:
        along, across = rotate_coordinates(x_m, y_m, settings.azimuth_deg)
        u, v = along / (diameter * settings.elongation), across / diameter
        bend_u, bend_v = (
            _BEND_SIZE * sample_shifted_noise(u / _BEND_WAVELENGTH, v / _BEND_WAVELENGTH, k) for k in keys[2:]
        )
        cells = find_voronoi_cells(u + bend_u, v + bend_v, keys[0])
        deep = depth * (_SHALLOWEST + (1.0 - _SHALLOWEST) * cells.random(keys[1]))
        # The square of F1 / F2 is 0 at a cell's point and 1 on all its edges.
        below = deep * (1.0 - cells.f1**2 / np.maximum(cells.f2, 1e-12) ** 2)
        if crest:
            # A hyperbola: level on the edge from both sides, and as deep as before at the point.
            below = (np.hypot(below, crest) - crest) * (deep / (np.hypot(deep, crest) - crest))
        return -below

    return Landform(diameter / 2, heights)
