"""Chaos: plates of broken crust, lifted and tilted, standing in a lumpy matrix.

Conamara Chaos on Europa has plates of kilometres standing up to hundreds of metres above a matrix
(Carr et al. 1998, Nature 391, 363); the pattern is used here at whatever scale is asked for.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ....typed_settings import ChaosSettings
from ..noise.voronoi import voronoi
from .common import Landform, draw_key, smooth_step, turn, wander

#: Slope of the plates' scarps: debris at the foot leaves them no steeper.
_SCARP = math.tan(math.radians(60.0))
#: The lowest plate, as a share of the relief.
_LOWEST = 0.5
#: RMS of the three octaves of matrix noise below.
_MATRIX_RMS = 0.350


def make(settings: ChaosSettings, random: np.random.Generator, size_m: float) -> Landform | None:
    """Plates up to ``relief_m`` above a matrix of RMS height ``matrix_m``."""
    keys = [draw_key(random) for _ in range(10)]
    relief, plate, gap = settings.relief_m, settings.plate_m, settings.gap_m
    rough, share = settings.matrix_m / _MATRIX_RMS, settings.plate_share
    if relief == 0.0 and rough == 0.0:
        return None
    scarp = max(relief / _SCARP, 0.02 * plate)
    tilt = math.tan(math.radians(settings.tilt_deg))

    def matrix(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return sum((0.5**k * wander(u * 4.0 * 2.0**k, v * 4.0 * 2.0**k, keys[7 + k]) for k in range(3)),
                   start=np.zeros(()))

    def heights(x_m: np.ndarray, y_m: np.ndarray, shortest_m: Any) -> np.ndarray:
        v, u = turn(x_m / plate, y_m / plate, 0.0)
        bend_u, bend_v = (0.08 * wander(1.7 * u, 1.7 * v, k) for k in keys[:2])
        cells = voronoi(u + bend_u, v + bend_v, keys[2])
        # Random direction of the tilt from a point in the square: no sines needed.
        east, north = (tilt * (2.0 * cells.random(k) - 1.0) for k in keys[3:5])
        top = relief * (_LOWEST + (1.0 - _LOWEST) * cells.random(keys[5])) \
            - plate * (east * cells.x1 + north * cells.y1)
        inside = smooth_step((plate * cells.edge_distance() - gap / 2) / scarp)
        inside *= cells.random(keys[6]) < share
        low = rough * matrix(u, v) if rough else 0.0
        return low + inside * (top - low)

    return Landform(scarp, heights)
