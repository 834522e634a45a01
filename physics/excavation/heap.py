"""The heap of spoil beside a trench: a ridge with round ends, whose flanks have the angle of repose."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array, Numbers
from .dig_grid import ExcavationGrid


def cone_size_m(volume_m3: float, repose_deg: float) -> tuple[float, float]:
    """Compute the height and the radius in metres of a cone of this volume whose slope is the angle of repose.

    The radius follows from R³ = 3 V / (π tan φ).
    """
    slope = math.tan(math.radians(repose_deg))
    radius = (3.0 * volume_m3 / (math.pi * slope)) ** (1.0 / 3.0)
    return radius * slope, radius


def ridge_height_m(volume_m3: float, length_m: float, repose_deg: float) -> float:
    """Compute the height in metres of a ridge whose crest has this length, with half a cone at each end.

    It is the positive root of V = L h² / tan φ + π h³ / (3 tan² φ), found by bisection.
    """
    slope = math.tan(math.radians(repose_deg))
    low, high = 0.0, cone_size_m(volume_m3, repose_deg)[0]
    for _ in range(60):
        h = 0.5 * (low + high)
        low, high = (h, high) if length_m * h * h / slope + math.pi * h**3 / (3 * slope**2) < volume_m3 else (low, h)
    return high


@dataclass(frozen=True)
class SpoilHeap:
    """A heap of spoil that is dropped along the line between two points (east, north), in metres."""

    start_m: tuple[float, float]
    end_m: tuple[float, float]
    repose_deg: float

    @property
    def length_m(self) -> float:
        """Length in metres of the line along which the heap lies."""
        return math.dist(self.start_m, self.end_m)

    def thickness(self, grid: ExcavationGrid, volume_m3: float, lumps_m: Numbers = 0.0, crest_m: float = 0.0) -> Array:
        """Compute the thickness (rows, columns) in metres of spoil of this volume on level ground; its sum is exact.
        ``lumps_m`` (rows, columns) is added to the distance of each cell from the line, which makes the heap uneven.
        Within ``crest_m`` of the line the crest is round.
        """
        if volume_m3 <= 0.0:
            return np.zeros((grid.rows, grid.columns))
        height = ridge_height_m(volume_m3, self.length_m, self.repose_deg)
        distance = np.hypot(self._distance_to_line(grid), crest_m) - crest_m + lumps_m
        shape = np.maximum(height - math.tan(math.radians(self.repose_deg)) * distance, 0.0)
        total = float(shape.sum()) * grid.cell_m**2
        if total <= 0.0:  # a heap smaller than a cell
            shape = np.zeros_like(shape)
            shape.flat[int(np.argmin(distance))] = 1.0
            total = grid.cell_m**2
        return shape * (volume_m3 / total)

    def _distance_to_line(self, grid: ExcavationGrid) -> Array:
        """Compute the distance (rows, columns) in metres of the cells from the line."""
        x, y = grid.east_m[None, :] - self.start_m[0], grid.north_m[:, None] - self.start_m[1]
        east, north = self.end_m[0] - self.start_m[0], self.end_m[1] - self.start_m[1]
        share = np.clip((x * east + y * north) / max(east**2 + north**2, 1e-30), 0.0, 1.0)
        return np.hypot(x - share * east, y - share * north)
