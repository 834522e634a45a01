"""Ground after it has failed: what still stands, and the talus at rest below it.

Heights are given on a square grid. Ground above the highest standing surface (``failing_slopes``) breaks off, becomes
loose and takes more volume. It slides on cells twice as wide, until no slope of it is steeper than its angle of repose
(``slide_to_repose``). What is kept is the *surface* of the talus, not its thickness: between the points of the grid the
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

#: Least thickness in metres, over the width of a wide cell, that counts as talus.
_MIN_THICKNESS = 0.02
#: Greatest thickness over the mean thickness about a place. Where ground falls away beside talus, as under a ledge, the
#: surface of the talus would otherwise hang in the air.
_THICKEST = 3.0
#: Number of shifts that restore the volume of wide cells, and the share of the missing height of each.
_SHIFTS, _SHIFT_SHARE = 4, 0.7
#: Height in metres of a surface where there is no talus.
_NO_TALUS_M = -1.0e6


@dataclass(frozen=True)
class Grid:
    """Points (side, side) at the middles of square cells ``cell_m`` wide, about the origin, rows from south to
    north."""

    side: int
    cell_m: float

    @property
    def axis_m(self) -> Array:
        """East or north of the points (side,)."""
        return (np.arange(self.side) - 0.5 * (self.side - 1)) * self.cell_m

    def find_cells(self, x_m: Array, y_m: Array) -> tuple[Array, Array, Array, Array]:
        """Row and column of the point south-west of places (n,) on the grid, and their distances (n,) from it north and
        east, in cells."""
        column, row = (np.clip(a / self.cell_m + 0.5 * (self.side - 1), 0.0, self.side - 1.0) for a in (x_m, y_m))
        j, i = (np.minimum(a.astype(np.int64), self.side - 2) for a in (column, row))
        return i, j, row - i, column - j


def _interpolate(values: Array, cells: tuple[Array, Array, Array, Array]) -> Array:
    """Values of a grid at places (n,), linear in each direction between its points."""
    i, j, north, east = cells
    south = values[i, j] + east * (values[i, j + 1] - values[i, j])
    return np.asarray(south + north * (values[i + 1, j] + east * (values[i + 1, j + 1] - values[i + 1, j]) - south))


def _interpolate_smoothly(values: Array, cells: tuple[Array, Array, Array, Array]) -> Array:
    """Values at places (n,) of a spline of second order, which has no creases along the diagonals of cells. It goes
    through planes and cuts other points by up to a cell."""
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
    talus and its mean thickness ``mean_m`` over 3 x 3 cells. ``broken_m3`` is the volume that broke off, ``factor``
    what multiplies thicknesses. ``breaks`` and ``rests`` (rows, columns) of the wide cells show where any ground breaks
    off, and where any talus rests."""

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
        """Heights (n,) of the hard ground that stands, and thicknesses (n,) of talus on it, at places (n,) on the grid,
        from the heights before. ``find_fine`` returns the heights of relief that is finer than the grid, at some of
        the places, from their coordinates and numbers. Broken faces have this relief, and talus a share ``roughness``
        of it."""
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
    """The ground of heights (side, side) after it has failed; None if all of it stands. ``volume_ratio`` is the volume
    of talus over the volume that broke off. The grid has an even number of points along a side."""
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
        _widen(_average_fours(broken) > 0.0),
        _widen(mean > 0.0),
    )


def _extend_top(layers: GroundLayers, cell_m: float, slope: float) -> Array:
    """Heights (rows, columns) of the surface of the talus. Beyond its edge the surface goes on downward at the angle of
    repose, so that it ends where it meets the ground between two points."""
    there = layers.spoil > _MIN_THICKNESS * cell_m
    if not there.any():
        return np.full(there.shape, _NO_TALUS_M)
    top = np.where(there, layers.top, layers.top[there].min() - slope * cell_m * max(there.shape))
    return -cut_to_slope(-top, cell_m, slope)


def _shift_to_volume(hard_m: Array, spoil_m: Array, mean_m: Array, top_m: Array) -> Array:
    """The surface of the talus shifted in each wide cell until its thickness above the fine ground has the mean
    ``spoil_m`` of the talus that slid there."""
    for _ in range(_SHIFTS):
        missing = spoil_m - _average_fours(_measure_on_fine(top_m, mean_m, hard_m))
        top_m = top_m + np.where(spoil_m > 0.0, _SHIFT_SHARE * missing, 0.0)
    return top_m


def _measure_on_fine(top_m: Array, mean_m: Array, hard_m: Array) -> Array:
    """Thickness of talus at the points of the fine grid, as ``FallenGround.settle`` finds it."""
    return np.minimum(np.maximum(_double(top_m) - hard_m, 0.0), _THICKEST * _double(mean_m))


def _average_fours(values: Array) -> Array:
    """Means of 2 x 2 points."""
    rows, columns = values.shape
    return np.asarray(values.reshape(rows // 2, 2, columns // 2, 2).mean(axis=(1, 3)))


def _average_nines(values: Array) -> Array:
    """Means of each point and its eight neighbours."""
    for axis in (0, 1):
        padded = np.pad(values, [(1, 1) if k == axis else (0, 0) for k in (0, 1)], mode="edge")
        parts = [np.moveaxis(padded, axis, 0)[k : k + values.shape[axis]] for k in range(3)]
        values = np.moveaxis((parts[0] + parts[1] + parts[2]) / 3.0, 0, axis)
    return values


def _double(values: Array) -> Array:
    """Values of a grid at the points of one with half its cells, as the spline of ``_interpolate_smoothly`` is cut."""
    for axis in (0, 1):
        padded = np.moveaxis(np.pad(values, [(1, 1) if k == axis else (0, 0) for k in (0, 1)], mode="edge"), axis, 0)
        made = np.empty((2 * (padded.shape[0] - 2), padded.shape[1]))
        made[0::2] = 0.75 * padded[1:-1] + 0.25 * padded[:-2]
        made[1::2] = 0.75 * padded[1:-1] + 0.25 * padded[2:]
        values = np.moveaxis(made, 0, axis)
    return values


def _widen(mask: Array) -> Array:
    """A mask that also has the neighbours of its cells, as interpolation reaches them."""
    wide = mask.copy()
    wide[1:] |= mask[:-1]
    wide[:-1] |= mask[1:]
    both = wide.copy()
    both[:, 1:] |= wide[:, :-1]
    both[:, :-1] |= wide[:, 1:]
    return both


def _round(values: Array) -> Array:
    """Values in single precision, which do not differ between machines in the last bit."""
    return values.astype(np.float32).astype(np.float64)
