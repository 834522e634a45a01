"""Ground after it has failed: the part that still stands, and the talus at rest below it.

Heights are given on a square grid. Ground above the highest standing surface (``failing_slopes``) breaks off, becomes
loose and takes more volume. It slides on cells twice as wide, until no slope of it is steeper than its angle of repose
(``slide_to_repose``). The *surface* of the talus is kept, not its thickness. Between the points of the grid, the
thickness is the height of that surface above the hard ground, so talus fills the finer relief under it and ends in a
line. A shift of the surface in each wide cell restores the volume that slid there, up to about 1 %, and one factor
restores the whole volume on the grid.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array, Numbers
from .failing_slopes import Strength, cut_to_slope, find_highest_standing
from .slide_to_repose import GroundLayers, relax_slopes

#: Least thickness that counts as talus, over the width of a wide cell.
_MIN_THICKNESS = 0.02
#: Greatest thickness over the mean thickness around a place. Without it, the surface of the talus would hang in the air
#: where ground falls away beside talus, as under a ledge.
_THICKEST = 3.0
#: Number of shifts that restore the volume of wide cells, and the share of the missing height of each.
_SHIFTS, _SHIFT_SHARE = 4, 0.7
#: Height in metres of a surface where there is no talus.
_NO_TALUS_M = -1.0e6


@dataclass(frozen=True)
class Grid:
    """A square grid of points (side, side) at the middles of cells ``cell_m`` wide. It is centred on the origin; rows
    go from south to north.
    """

    side: int
    cell_m: float

    @property
    def axis_m(self) -> Array:
        """Coordinates (side,) of the points in metres, the same to the east and to the north."""
        return (np.arange(self.side) - 0.5 * (self.side - 1)) * self.cell_m

    def find_cells(self, x_m: Array, y_m: Array) -> tuple[Array, Array, Array, Array]:
        """Find the row and column of the grid point south-west of each place (n,), and the place's distances (n,) north
        and east of this point, in cells.
        """
        column, row = (np.clip(a / self.cell_m + 0.5 * (self.side - 1), 0.0, self.side - 1.0) for a in (x_m, y_m))
        j, i = (np.minimum(a.astype(np.int64), self.side - 2) for a in (column, row))
        return i, j, row - i, column - j


def _interpolate(values: Array, cells: tuple[Array, Array, Array, Array]) -> Array:
    """Interpolate the values of a grid bilinearly at places (n,)."""
    i, j, north, east = cells
    south = values[i, j] + east * (values[i, j + 1] - values[i, j])
    return np.asarray(south + north * (values[i + 1, j] + east * (values[i + 1, j + 1] - values[i + 1, j]) - south))


def _interpolate_smoothly(values: Array, cells: tuple[Array, Array, Array, Array]) -> Array:
    """Evaluate a spline of second order at places (n,); it has no creases along the diagonals of cells. It reproduces
    planes, but does not pass through the points of other surfaces.
    """
    last = len(values) - 1
    (row, north), (column, east) = (
        (np.clip(np.where(off > 0.5, at + 1, at), 1, last - 1), np.where(off > 0.5, off - 1.0, off))
        for at, off in ((cells[0], cells[2]), (cells[1], cells[3]))
    )
    weights = [(0.5 * (0.5 - t) ** 2, 0.75 - t * t, 0.5 * (0.5 + t) ** 2) for t in (north, east)]
    total = np.zeros(len(row))
    for down in range(3):
        for right in range(3):
            total += weights[0][down] * weights[1][right] * values[row + down - 1, column + right - 1]
    return total


@dataclass(frozen=True)
class FallenGround:
    """The highest standing surface ``limit_m`` on a fine grid, and on cells twice as wide the surface ``top_m`` of the
    talus and its mean thickness ``mean_m`` over 3 x 3 cells. ``broken_m3`` is the volume that broke off, and ``factor``
    multiplies the thickness of talus. ``breaks`` and ``rests`` (rows, columns) of the wide cells are true where ground
    breaks off, and where talus rests.
    """

    grid: Grid
    wide: Grid
    limit_m: Array
    top_m: Array
    mean_m: Array
    factor: float
    broken_m3: float
    breaks: Array
    rests: Array

    def settle(
        self,
        hard_m: Array,
        x_m: Array,
        y_m: Array,
        find_fine: Callable[[Array, Array, Array], Array],
        roughness: float,
    ) -> tuple[Array, Array]:
        """Compute the heights (n,) of the hard ground that stands, and the thicknesses (n,) of talus on it, at places
        (n,) on the grid. ``hard_m`` (n,) are the heights before the failure. ``find_fine`` returns the heights of
        relief finer than the grid, from the coordinates of some places and their indices. Broken faces have this
        relief, and talus a share ``roughness`` of it.
        """
        standing, talus = hard_m.copy(), np.zeros(len(hard_m))
        i, j, north, east = self.wide.find_cells(x_m, y_m)
        near = np.flatnonzero(self.breaks[i, j] | self.rests[i, j])
        if len(near):
            x, y = x_m[near], y_m[near]
            limit = _interpolate(self.limit_m, self.grid.find_cells(x, y))
            fine = find_fine(x, y, near)
            standing[near] = np.minimum(hard_m[near], limit + fine)
            cells = i[near], j[near], north[near], east[near]
            thick = np.maximum(_interpolate_smoothly(self.top_m, cells) + roughness * fine - standing[near], 0.0)
            talus[near] = self.factor * np.minimum(thick, _THICKEST * _interpolate(self.mean_m, cells))
        return standing, talus


def let_ground_fail(
    height_m: Array,
    grid: Grid,
    strength: Strength,
    volume_ratio: float,
    cohesion_share: Numbers = 1.0,
) -> FallenGround | None:
    """Let ground of heights (side, side) fail; None if all of it stands. ``volume_ratio`` is the volume of talus over
    the volume that broke off. The grid must have an even number of points along a side.
    """
    limit = find_highest_standing(height_m, grid.cell_m, strength, cohesion_share)
    hard = np.minimum(height_m, limit)
    broken = height_m - hard
    if not broken.any():
        return None
    wide = Grid(grid.side // 2, 2.0 * grid.cell_m)
    layers = GroundLayers(_average_fours(hard), volume_ratio * _average_fours(broken))
    relax_slopes(layers, wide.cell_m, strength.friction_deg)
    slope = math.tan(math.radians(strength.friction_deg))
    mean = _average_nines(np.where(layers.spoil > _MIN_THICKNESS * wide.cell_m, layers.spoil, 0.0))
    top = _shift_to_volume(hard, layers.spoil, mean, _extend_top(layers, wide.cell_m, slope))
    have = float(_measure_on_fine(top, mean, hard).sum())
    broken_sum = float(broken.sum())
    return FallenGround(
        grid,
        wide,
        _round(limit),
        _round(top),
        _round(mean),
        float(np.float32(volume_ratio * broken_sum / have)) if have else 0.0,
        broken_sum * grid.cell_m**2,
        _widen_mask(_average_fours(broken) > 0.0),
        _widen_mask(mean > 0.0),
    )


def _extend_top(layers: GroundLayers, cell_m: float, slope: float) -> Array:
    """Compute the heights (rows, columns) of the surface of the talus. Beyond its edge the surface goes on downward at
    the angle of repose, so that it ends where it meets the ground between two points.
    """
    there = layers.spoil > _MIN_THICKNESS * cell_m
    if not there.any():
        return np.full(there.shape, _NO_TALUS_M)
    top = np.where(there, layers.top, layers.top[there].min() - slope * cell_m * max(there.shape))
    return -cut_to_slope(-top, cell_m, slope)


def _shift_to_volume(hard_m: Array, spoil_m: Array, mean_m: Array, top_m: Array) -> Array:
    """Shift the surface of the talus in each wide cell until its mean thickness above the fine ground is ``spoil_m``,
    the thickness of the talus that slid there.
    """
    for _ in range(_SHIFTS):
        missing = spoil_m - _average_fours(_measure_on_fine(top_m, mean_m, hard_m))
        top_m = top_m + np.where(spoil_m > 0.0, _SHIFT_SHARE * missing, 0.0)
    return top_m


def _measure_on_fine(top_m: Array, mean_m: Array, hard_m: Array) -> Array:
    """Measure the thickness of talus at the points of the fine grid, as ``FallenGround.settle`` computes it."""
    return np.minimum(np.maximum(_double(top_m) - hard_m, 0.0), _THICKEST * _double(mean_m))


def _average_fours(values: Array) -> Array:
    """Average groups of 2 x 2 points."""
    rows, columns = values.shape
    return np.asarray(values.reshape(rows // 2, 2, columns // 2, 2).mean(axis=(1, 3)))


def _average_nines(values: Array) -> Array:
    """Average each point with its eight neighbours."""
    for axis in (0, 1):
        padded = np.pad(values, [(1, 1) if k == axis else (0, 0) for k in (0, 1)], mode="edge")
        parts = [np.moveaxis(padded, axis, 0)[k : k + values.shape[axis]] for k in range(3)]
        values = np.moveaxis((parts[0] + parts[1] + parts[2]) / 3.0, 0, axis)
    return values


def _double(values: Array) -> Array:
    """Resample a grid to half its cell width, by the spline of ``_interpolate_smoothly``."""
    for axis in (0, 1):
        padded = np.moveaxis(np.pad(values, [(1, 1) if k == axis else (0, 0) for k in (0, 1)], mode="edge"), axis, 0)
        made = np.empty((2 * (padded.shape[0] - 2), padded.shape[1]))
        made[0::2] = 0.75 * padded[1:-1] + 0.25 * padded[:-2]
        made[1::2] = 0.75 * padded[1:-1] + 0.25 * padded[2:]
        values = np.moveaxis(made, 0, axis)
    return values


def _widen_mask(mask: Array) -> Array:
    """Add the eight neighbours of its cells to a mask, because interpolation reaches them."""
    wide = mask.copy()
    wide[1:] |= mask[:-1]
    wide[:-1] |= mask[1:]
    both = wide.copy()
    both[:, 1:] |= wide[:, :-1]
    both[:, :-1] |= wide[:, 1:]
    return both


def _round(values: Array) -> Array:
    """Round values to single precision, in which they do not differ between machines."""
    return values.astype(np.float32).astype(np.float64)
