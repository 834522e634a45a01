"""Directions from an eye in which ground ends before the horizon."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...support.arrays import Array
from .nested_rings import Level

#: Number of distances that are tried along a direction.
_DISTANCES = 256


def find_open_directions(
    levels: Sequence[Level], heights_m: Sequence[Array], eye_m: tuple[float, float], azimuths_deg: Array, to_m: float
) -> Array:
    """Find whether ground ends within ``to_m`` of an eye at ``eye_m`` (east, north), bool (n,), in directions (n,) from
    north over east. ``heights_m`` (n, n) are the heights of the lattice of each level, NaN without ground.
    """
    azimuth = np.radians(np.asarray(azimuths_deg, np.float64))
    distance = np.geomspace(max(levels[0].cell_m, 1e-3 * to_m), max(to_m, levels[0].cell_m), _DISTANCES)
    x = eye_m[0] + np.sin(azimuth)[:, None] * distance
    y = eye_m[1] + np.cos(azimuth)[:, None] * distance
    away = np.maximum(np.abs(x), np.abs(y))
    there = np.zeros(x.shape, bool)
    inner = -1.0
    for level, heights in zip(levels, heights_m, strict=True):
        here = (away > inner) & (away <= level.half_m)
        column, row = (np.rint((at[here] + level.half_m) / level.cell_m).astype(np.int64) for at in (x, y))
        there[here] = np.isfinite(heights)[row, column]
        inner = level.half_m
    result: Array = ~there.all(axis=1)
    return result
