"""Slides of loose material, until no slope is steeper than the angle of repose.

The higher of two neighbouring cells gives half of its excess height to the lower one. In each of 16 directions the
pairs of cells are disjoint, so all pairs of a direction are relaxed at once, in place. Mass is kept, the order is
fixed, and nothing overshoots. (Relaxing all pairs at once, as Jacobi's method does, takes 18 times as many sweeps.)
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...support.arrays import Array, Numbers

#: Steps in rows and columns to a cell's neighbours in 5 of the 16 directions. The transposed grid adds 3, and the
#: other 8 are opposites. With 8 directions in all, slopes would be up to 5 % too steep.
_NEIGHBOURS = ((1, 0), (1, 1), (1, -1), (2, 1), (2, -1))
#: The directions that only the transposed grid has, as steps on that grid.
_NEIGHBOURS_TRANSPOSED = ((1, 0), (2, 1), (2, -1))
#: Sweeps end when less than this share of a cell moves between any two cells.
_TOLERANCE = 0.03
#: Number of sweeps between tests.
_SWEEPS_PER_TEST = 10
#: Maximum number of sweeps.
_MAX_SWEEPS = 400
#: A slide over a long distance takes a number of sweeps proportional to the square of the distance. If ground still
#: slides, pairs this many times as far apart are therefore swept first. The result is the same, because no slope over a
#: distance is steeper than the steepest slope within it. A stride of up to 8 cells cannot skip a trench that is wider
#: than 8 cells.
_STRIDES = (4, 2)
#: Maximum number of sweeps at a stride.
_MAX_STRIDE_SWEEPS = 100
#: Maximum number of cycles of strides.
_MAX_CYCLES = 10
#: Maximum number of bulking passes; each pass turns less ground into spoil.
_BULKING_PASSES = 4
#: Width in cells of the margin around ground that may move.
_MARGIN_CELLS = 12


@dataclass
class GroundLayers:
    """Undisturbed ground and the loose spoil on it: heights and thicknesses (rows, columns) in metres."""

    ground: Array
    spoil: Array

    def copy(self) -> GroundLayers:
        """Copy the layers, so that they can be changed."""
        return GroundLayers(self.ground.copy(), self.spoil.copy())

    @property
    def top(self) -> Array:
        """Heights (rows, columns) of the surface, ground and spoil, in metres."""
        return self.ground + self.spoil


def relax_slopes(
    layers: GroundLayers,
    cell_m: float,
    repose_deg: float,
    bulking: float = 1.0,
    stood_m: Array | None = None,
    slides: Array | None = None,
) -> tuple[int, bool]:
    """Let spoil slide, in place; cells at the rim slide inward only. Return the number of sweeps, and whether all
    material rests.

    With ``stood_m``, the heights of the ground before it was dug, ground slides too, in the cells ``slides`` (rows,
    columns), everywhere by default. Sliding ground becomes spoil, which takes ``bulking`` times its volume. Two points
    of the ground may keep the difference in height that they had before the digging.
    """
    if stood_m is None:
        return _settle_slopes(layers.top, layers.spoil, cell_m, repose_deg, None)
    sweeps, rests = 0, True
    for _ in range(_BULKING_PASSES):
        top = layers.top
        loose = None if slides is None else np.where(slides, np.inf, layers.spoil)
        more, rests = _settle_slopes(top, loose, cell_m, repose_deg, stood_m)
        sweeps += more
        grown = _apply_change(layers, top - layers.top, bulking)
        if grown < _TOLERANCE * cell_m:
            break
    return sweeps, rests


def _apply_change(layers: GroundLayers, change_m: Array, bulking: float) -> float:
    """Apply a volume-preserving change of the surface to the layers: spoil leaves before ground, and arrives as spoil.
    Ground grows as it becomes spoil, so one factor raises all arriving material. Return the greatest height in metres
    that this growth adds to the change.
    """
    gone, come = np.maximum(-change_m, 0.0), np.maximum(change_m, 0.0)
    loose = np.minimum(gone, layers.spoil)
    solid = gone - loose
    arrived = float(come.sum())
    if arrived == 0.0:
        return 0.0
    factor = (float(loose.sum()) + bulking * float(solid.sum())) / arrived
    layers.spoil += factor * come - loose
    layers.ground -= solid
    return float(come.max()) * (factor - 1.0)


def _settle_slopes(
    top: Array, spoil: Array | None, cell_m: float, repose_deg: float, stood_m: Array | None
) -> tuple[int, bool]:
    """Let slopes that are too steep slide, in place; with ``spoil``, only spoil slides. Return the number of sweeps and
    whether all material rests.

    Each move between two cells lowers the sum of squares of all heights, at least by an amount that follows from the
    tolerance, so the sweeps end.
    """
    sweeps, rests = _sweep_at_stride(top, spoil, cell_m, repose_deg, stood_m, 1, _MAX_SWEEPS)
    for _ in range(_MAX_CYCLES):
        if rests:
            break
        for stride in _STRIDES:
            sweeps += _sweep_at_stride(top, spoil, cell_m, repose_deg, stood_m, stride, _MAX_STRIDE_SWEEPS)[0]
        more, rests = _sweep_at_stride(top, spoil, cell_m, repose_deg, stood_m, 1, _MAX_SWEEPS)
        sweeps += more
    return sweeps, rests


def _sweep_at_stride(
    top: Array,
    spoil: Array | None,
    cell_m: float,
    repose_deg: float,
    stood_m: Array | None,
    stride: int,
    most: int,
) -> tuple[int, bool]:
    """Sweep over pairs of cells ``stride`` times as far apart, until little moves or at most ``most`` times; see
    ``_settle_slopes``.
    """
    tangent = math.tan(math.radians(repose_deg))
    sweeps, window = 0, _find_moving_window(top, spoil, cell_m, tangent, stood_m)
    while window is not None:
        if sweeps >= most:
            return sweeps, False
        part = top[window], None if spoil is None else spoil[window]
        limits = _make_limits(None if stood_m is None else stood_m[window], part[0].shape, cell_m * tangent, stride)
        for _ in range(_SWEEPS_PER_TEST):
            moved = _sweep_once(*part, limits)
        sweeps += _SWEEPS_PER_TEST
        if moved < _TOLERANCE * cell_m * tangent:
            break
        window = _find_moving_window(top, spoil, cell_m, tangent, stood_m)
    return sweeps, True


def _find_moving_window(
    top: Array, spoil: Array | None, cell_m: float, tangent: float, stood_m: Array | None
) -> tuple[slice, slice] | None:
    """Find the rows and columns that contain all loose cells on slopes that are too steep, with a margin; None without
    such cells.
    """
    steep = np.zeros(top.shape, bool)
    for axis in (0, 1):
        drop = np.diff(top, axis=axis)
        limit: Numbers = tangent * cell_m
        if stood_m is not None:
            limit = np.maximum(limit, np.abs(np.diff(stood_m, axis=axis)))
        low, high = _axis_slices(axis, slice(None, -1)), _axis_slices(axis, slice(1, None))
        steep[low] |= drop < -limit
        steep[high] |= drop > limit
    if spoil is not None:
        steep &= spoil > 0
    rows, columns = (np.flatnonzero(steep.any(axis=k)) for k in (1, 0))
    if not len(rows):
        return None
    return (
        slice(max(int(rows[0]) - _MARGIN_CELLS, 0), int(rows[-1]) + _MARGIN_CELLS + 1),
        slice(max(int(columns[0]) - _MARGIN_CELLS, 0), int(columns[-1]) + _MARGIN_CELLS + 1),
    )


def _axis_slices(axis: int, of: slice) -> tuple[slice, slice]:
    return (of, slice(None)) if axis == 0 else (slice(None), of)


#: Two slices of cells that form pairs, whether rows and columns are transposed, and the largest difference in height.
_Limit = tuple[bool, tuple[slice, slice], tuple[slice, slice], Any]


def _make_limits(stood_m: Array | None, shape: tuple[int, ...], rise_m: float, stride: int) -> list[_Limit]:
    """Find the greatest allowed difference in height of all pairs of cells: by the angle of repose, or the difference
    before the digging if it is larger. Pairs are ``stride`` times as far apart as neighbours.
    """
    found: list[_Limit] = []
    for turned, steps in ((False, _NEIGHBOURS), (True, _NEIGHBOURS_TRANSPOSED)):
        stood = stood_m.T if turned and stood_m is not None else stood_m
        rows, columns = shape[::-1] if turned else shape
        for down, right in ((stride * a, stride * b) for a, b in steps):
            if down >= rows or abs(right) >= columns:
                continue
            rise = rise_m * math.hypot(down, right)
            found += [
                (turned, a, b, rise if stood is None else np.maximum(rise, np.abs(stood[a] - stood[b])))
                for a, b in _list_disjoint_pairs((rows, columns), down, right)
            ]
    return found


def _sweep_once(top: Array, spoil: Array | None, limits: list[_Limit]) -> float:
    """Sweep once over all pairs, in place. Return the largest height in metres that moved between two cells."""
    most = 0.0
    for turned, a, b, limit in limits:
        heights, loose = (top.T, None if spoil is None else spoil.T) if turned else (top, spoil)
        upper, lower = heights[a], heights[b]
        excess = upper - lower
        excess -= np.clip(excess, -limit, limit)
        if not excess.any():
            continue
        excess *= 0.5
        if loose is not None:
            np.clip(excess, -loose[b], loose[a], out=excess)
            loose[a] -= excess
            loose[b] += excess
        upper -= excess
        lower += excess
        most = max(most, float(excess.max()), -float(excess.min()))
    return most


def _list_disjoint_pairs(
    shape: tuple[int, ...], down: int, right: int
) -> Iterator[tuple[tuple[slice, slice], tuple[slice, slice]]]:
    """Yield slices of disjoint pairs of cells, ``down`` rows and ``right`` columns apart; together they cover all such
    pairs.
    """
    rows, columns = shape
    first = slice(max(-right, 0), columns - max(right, 0))
    second = slice(max(right, 0), columns - max(-right, 0))
    for start in range(2 * down):
        if start < rows - down:
            yield (slice(start, rows - down, 2 * down), first), (slice(start + down, rows, 2 * down), second)
