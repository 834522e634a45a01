"""Measured heights on a grid as ground: coordinates, interpolation, holes.

A height map stores the height at the centre of each pixel, rows from north to south, as images and GeoTIFF do. Between
centres heights are bilinear, as on a mesh of quadrilaterals. Procedural roughness of another ground may be added below
the size of a pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...support.arrays import Array, Numbers
from .ground_interface import Surface, compute_fine_heights

#: Magnitude above which a value is no height: the most negative float32 is a usual mark of missing heights.
NO_HEIGHT = 1e30


@dataclass(frozen=True)
class HeightMap:
    """Ground on a grid of measured heights.

    ``heights_m`` (rows, columns) is finite, row 0 northernmost. ``pixel_m`` is the size of a pixel (east, north).
    ``west_m`` and ``south_m`` are the coordinates of the centre of the lower left pixel. The ground is the part of the
    map within ``size_m``/2 of the origin; beyond it heights are NaN.
    """

    heights_m: Array
    pixel_m: tuple[float, float]
    west_m: float
    south_m: float
    size_m: float
    roughness: Surface | None = None

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """West, east, south and north edge of the ground in metres; west > east or south > north if there is no
        ground.
        """
        rows, columns = self.heights_m.shape
        half = self.size_m / 2
        return (
            max(self.west_m, -half),
            min(self.west_m + (columns - 1) * self.pixel_m[0], half),
            max(self.south_m, -half),
            min(self.south_m + (rows - 1) * self.pixel_m[1], half),
        )

    @property
    def resolution_m(self) -> float:
        """Shortest wavelength in metres that the measured heights carry: two pixels of the finer axis."""
        return 2.0 * min(self.pixel_m)

    def heights(self, x_m: Numbers, y_m: Numbers, shortest_m: float = 0.0) -> Array:
        """Compute heights in metres at east and north coordinates (arrays that broadcast); NaN beyond the ground.
        ``shortest_m`` limits the added roughness only; measured heights stay unchanged.
        """
        x, y = np.broadcast_arrays(np.asarray(x_m, np.float64), np.asarray(y_m, np.float64))
        west, east, south, north = self.bounds_m
        slack = 1e-9 * max(self.size_m, 1.0)  # a vertex on the edge is on the ground, whatever its last bit
        inside = (x >= west - slack) & (x <= east + slack) & (y >= south - slack) & (y <= north + slack)
        total = np.where(inside, self._bilinear(x, y), np.nan)
        if self.roughness is not None:
            total = total + compute_fine_heights(self.roughness, x, y, self.resolution_m, shortest_m)
        return total

    def _bilinear(self, x: Array, y: Array) -> Array:
        rows, columns = self.heights_m.shape
        column = np.clip((x - self.west_m) / self.pixel_m[0], 0.0, columns - 1.0)
        row = np.clip((rows - 1) - (y - self.south_m) / self.pixel_m[1], 0.0, rows - 1.0)
        left, top = (np.minimum(a.astype(np.int64), n - 2) for a, n in ((column, columns), (row, rows)))
        u, v = column - left, row - top
        h = self.heights_m
        above = h[top, left] * (1.0 - u) + h[top, left + 1] * u
        below = h[top + 1, left] * (1.0 - u) + h[top + 1, left + 1] * u
        return above * (1.0 - v) + below * v


def place_map(
    heights_m: Array,
    pixel_m: tuple[float, float],
    corner_m: tuple[float, float],
    *,
    centre: bool,
    origin_m: tuple[float, float],
    size_m: float,
) -> tuple[HeightMap, tuple[float, float, float]]:
    """Make a height map with its origin at the place that the settings state. Also return the shift (3,) that was
    added.

    ``corner_m`` are the file's own coordinates of the lower left pixel centre. With ``centre``, the origin is
    ``origin_m`` from the middle of the map, at its median height. Without it, the origin is ``origin_m`` in the file's
    coordinates, and heights stay.
    """
    rows, columns = heights_m.shape
    middle = (corner_m[0] + (columns - 1) * pixel_m[0] / 2, corner_m[1] + (rows - 1) * pixel_m[1] / 2)
    reference = middle if centre else (0.0, 0.0)
    shift = (-reference[0] - origin_m[0], -reference[1] - origin_m[1], -float(np.median(heights_m)) if centre else 0.0)
    moved = HeightMap(heights_m + shift[2], pixel_m, corner_m[0] + shift[0], corner_m[1] + shift[1], size_m)
    return moved, shift


def add_roughness(ground: HeightMap, roughness: Surface) -> HeightMap:
    """Return the same ground with procedural roughness below its resolution."""
    return replace(ground, roughness=roughness)


def fill_holes(heights_m: Array) -> Array:
    """Fill the NaN pixels of heights smoothly from their surroundings; known pixels stay. Raises ValueError if no pixel
    is finite.

    Push-pull (Gortler et al., "The Lumigraph", SIGGRAPH 1996): averages over ever larger squares are made, then each
    hole takes the finest available average, bilinearly.
    """
    known = np.isfinite(heights_m)
    if not known.any():
        raise ValueError("no finite height")
    return _fill_from_coarse(np.where(known, heights_m, 0.0).astype(np.float64), known.astype(np.float64))


def _fill_from_coarse(total: Array, weight: Array) -> Array:
    """Return averages ``total`` where ``weight`` is 1, filled where it is 0."""
    if weight.all():
        return total
    rows, columns = total.shape
    even = ((0, rows % 2), (0, columns % 2))
    blocks = [
        np.pad(a, even).reshape(math.ceil(rows / 2), 2, math.ceil(columns / 2), 2).sum(axis=(1, 3))
        for a in (total * weight, weight)
    ]
    coarse = _fill_from_coarse(blocks[0] / np.maximum(blocks[1], 1.0), np.minimum(blocks[1], 1.0))
    return np.where(weight > 0, total, _double_resolution(coarse, total.shape))


def _double_resolution(coarse: Array, shape: tuple[int, ...]) -> Array:
    """Resample to a grid of twice the resolution, bilinearly between the centres of the coarse squares."""
    for axis in (0, 1):
        at = np.clip((np.arange(shape[axis]) - 0.5) / 2, 0, coarse.shape[axis] - 1)
        low = np.minimum(at.astype(np.int64), max(coarse.shape[axis] - 2, 0))
        high = np.minimum(low + 1, coarse.shape[axis] - 1)
        part = (at - low).reshape((-1, 1) if axis == 0 else (1, -1))
        coarse = np.take(coarse, low, axis) * (1 - part) + np.take(coarse, high, axis) * part
    return coarse


def clear_missing_mark(values: Array, mark: float, number: np.dtype[Any]) -> int:
    """Set values equal to ``mark`` to NaN, in place, and return their number. ``number`` is the type of the file's
    values; a mark may be stated with fewer digits than the values have.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        slack = 2 * float(np.spacing(number.type(abs(mark)))) if number.kind == "f" else 0.0
        found = np.abs(values - mark) <= slack
    values[found] = np.nan
    return int(found.sum())


def clear_stated_mark(values: Array, mark: float, number: np.dtype[Any]) -> tuple[str, ...]:
    """Clear a mark that the settings state, see ``clear_missing_mark``; return a sentence about it."""
    count = clear_missing_mark(values, mark, number)
    return (f"{count} pixel{'s' * (count != 1)} of {mark:g} without a height, by source.missing",)


def clear_unstated_mark(values: Array) -> tuple[Array, list[str]]:
    """Replace a mark of missing heights that the file does not state by NaN. Return the heights and sentences.

    A value counts as a mark under three conditions. It is the lowest or the highest value; several pixels have exactly
    this value or it is a usual mark; and its distance from all others is more than ``_MARK_DISTANCE`` times their
    range. Examples are -9999, -32768 or 0 among heights of some kilometres.
    """
    sentences = []
    for pick in (np.min, np.max):
        known = np.isfinite(values)
        if not known.any():
            break
        mark = float(pick(values[known]))
        others = values[known & (values != mark)]
        count = int(known.sum()) - others.size
        if others.size < 2 or (count < 2 and abs(mark) not in USUAL_MARKS):
            continue
        gap = float(np.abs(others - mark).min())
        if gap > _MARK_DISTANCE * float(np.ptp(others)) and count < _MAX_MARKED * known.sum():
            values = np.where(values == mark, np.nan, values)
            sentences.append(
                f"{count} pixel{'s' * (count != 1)} of exactly {mark:g}, {gap:.4g} from all other "
                "heights, were taken for missing; if they are not, set source.missing = none"
            )
    return values, sentences


#: Marks of missing heights that programs use, without their sign.
USUAL_MARKS = (9999.0, 32768.0, 32767.0, 65535.0, 99999.0, 999999.0)
#: Least distance of a mark from the other heights, over their range.
_MARK_DISTANCE = 3.0
#: Largest share of pixels with a mark.
_MAX_MARKED = 0.5


def make_grid_mesh(heights_m: Array, x_m: Array, y_m: Array) -> tuple[Array, Array]:
    """Make vertices (n, 3) float32 and quadrilaterals (m, 4) int32 of heights (rows, columns) at ``x_m`` and
    ``y_m``.
    """
    rows, columns = heights_m.shape
    positions = np.empty((rows, columns, 3), np.float32)
    positions[..., 0], positions[..., 1], positions[..., 2] = x_m[None, :], y_m[:, None], heights_m
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)[None, :]).ravel()
    faces = np.stack([corner, corner + 1, corner + columns + 1, corner + columns], axis=1)
    return positions.reshape(-1, 3), faces.astype(np.int32)
