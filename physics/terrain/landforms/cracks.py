"""Cracks: fractures with steep walls and, where material was pushed up, raised rims.

They run along the edges of Voronoi plates. Stretched plates give the long sub-parallel fractures of a
tiger stripe's flank (Helfenstein & Porco 2015, Astron. J. 150, 96, map them at 100 m and coarser; at
the scale of a lander their size is an assumption).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ....typed_settings import CracksSettings
from ..noise.voronoi import voronoi
from .common import Landform, draw_key, smooth_step, turn, wander

#: Bending of the cracks, in plates, and its wavelength in plates.
_BEND, _BEND_LENGTH = 0.06, 0.6


def make(settings: CracksSettings, random: np.random.Generator, size_m: float) -> Landform | None:
    """Cracks ``depth_m`` deep and ``width_m`` wide from edge to edge, with rims over another width to either side."""
    keys = [draw_key(random) for _ in range(3)]
    depth, width, rim = settings.depth_m, settings.width_m, settings.rim_m
    if depth == 0.0 and rim == 0.0:
        return None
    broad = settings.plate_m
    long = broad * settings.elongation

    def heights(x_m: np.ndarray, y_m: np.ndarray, shortest_m: Any) -> np.ndarray:
        along, across = turn(x_m, y_m, settings.azimuth_deg)
        u, v = along / long, across / broad
        bend_u, bend_v = (_BEND * wander(u / _BEND_LENGTH, v / _BEND_LENGTH, k) for k in keys[1:])
        distance = voronoi(u + bend_u, v + bend_v, keys[0]).edge_distance(long, broad) / (width / 2)
        wall = (depth + rim) * smooth_step(distance) - depth
        # The rim falls off over a crack's width, to nothing with no step.
        outer = np.clip((3.0 - distance) / 2.0, 0.0, 1.0)
        return np.where(distance < 1.0, wall, rim * outer * outer)

    return Landform(width / 2, heights)
