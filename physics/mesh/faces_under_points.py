"""Faces of a mesh that can lie under points, so that a search for heights tests few faces."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array

#: Number of faces that are measured at a time, which bounds the memory.
_BLOCK = 2**18
#: Number of neighbouring faces with common bounds. If these are far from all points, the faces are not tested.
_RUN = 128
#: Number of cells along a side of the map of points, for each point along a side, and its maximum.
_CELLS_PER_POINT, _MAX_CELLS = 4, 2048
#: Widening of the bounds of faces, over the largest coordinate of a point: 16 steps of single precision.
_MARGIN = 16 * float(np.finfo(np.float32).eps)


@dataclass(frozen=True)
class FacesOnMap:
    """Faces seen from above. ``x_m`` and ``y_m`` (n,) are east and north of the vertices. ``corners`` (k,) is the
    vertex of each corner, and ``starts`` (m + 1,) the first corner of each face and the number of corners. ``runs`` (r,
    4) are the bounds of runs of faces: west, south, east and north.
    """

    x_m: Array
    y_m: Array
    corners: Array
    starts: Array
    runs: Array

    @classmethod
    def measure(cls, positions: Array, corners: Array, starts: Array) -> FacesOnMap:
        """Measure faces with positions (n, 3) and corners (k,); ``starts`` (m,) are the first corners of the faces."""
        x, y = (np.ascontiguousarray(positions[:, axis], np.float32) for axis in (0, 1))
        firsts = np.append(starts, len(corners)).astype(np.int64)
        runs = [np.empty((0, 4), np.float32)]
        for start in range(0, len(starts), _BLOCK):
            stop = min(start + _BLOCK, len(starts))
            some = corners[firsts[start] : firsts[stop]]
            runs.append(_measure_bounds(x[some], y[some], firsts[start:stop:_RUN] - firsts[start]))
        return cls(x, y, corners, firsts, np.concatenate(runs))

    def find_under(self, x_m: Array, y_m: Array) -> Array:
        """Find the faces (k,), in their order, that may have one of the points (n,) above or below them, and others
        close to points. No face is missed that has a point within its bounds on the map.
        """
        finite = np.isfinite(x_m) & np.isfinite(y_m)
        if not finite.any():
            return np.empty(0, np.int64)
        cells = _OccupiedCells.fill(x_m[finite].astype(np.float64), y_m[finite].astype(np.float64))
        runs, found = np.flatnonzero(cells.meet(self.runs)), [np.empty(0, np.int64)]
        for start in range(0, len(runs), _BLOCK // _RUN):
            some = runs[start : start + _BLOCK // _RUN]
            faces = (some[:, None] * _RUN + np.arange(_RUN)).ravel()
            faces = faces[faces < len(self.starts) - 1]
            corners, starts = self.pick(faces)
            found.append(faces[cells.meet(_measure_bounds(self.x_m[corners], self.y_m[corners], starts))])
        return np.concatenate(found)

    def pick(self, faces: Array) -> tuple[Array, Array]:
        """Return the vertex (k,) of each corner of some faces (m,), and the first corner (m,) of each of these
        faces.
        """
        sizes = self.starts[faces + 1] - self.starts[faces]
        starts = np.cumsum(sizes) - sizes
        return self.corners[np.repeat(self.starts[faces] - starts, sizes) + np.arange(sizes.sum())], starts


def _measure_bounds(x_m: Array, y_m: Array, starts: Array) -> Array:
    """Measure the west, south, east and north bounds (m, 4) of groups of points (n,) whose first points are ``starts``
    (m,).
    """
    return np.stack([each.reduceat(axis, starts) for each in (np.minimum, np.maximum) for axis in (x_m, y_m)], axis=1)


@dataclass(frozen=True)
class _OccupiedCells:
    """A map of square cells over points: its south-west corner (2,), the side of a cell and a margin, all in metres.
    ``before`` (n + 1, n + 1) is the number of points south and west of each corner of the cells, by row and column.
    """

    corner_m: Array
    side_m: float
    margin_m: float
    before: Array

    @classmethod
    def fill(cls, x_m: Array, y_m: Array) -> _OccupiedCells:
        points = np.stack([x_m, y_m])
        corner, count = points.min(axis=1), min(_CELLS_PER_POINT * math.ceil(math.sqrt(len(x_m))), _MAX_CELLS)
        margin = _MARGIN * float(np.abs(points).max())
        side = max(float(np.ptp(points, axis=1).max()), margin, 1e-9) / count
        column, row = np.minimum(((points - corner[:, None]) / side).astype(np.int64), count - 1)
        filled = np.bincount(row * count + column, minlength=count * count).reshape(count, count)
        before = np.zeros((count + 1, count + 1), np.int32)
        before[1:, 1:] = filled.cumsum(axis=0).cumsum(axis=1)
        return cls(corner, side, margin, before)

    def meet(self, bounds: Array) -> Array:
        """Return whether points lie in the cells that each of the bounds (m, 4) on the map reaches, bool (m,)."""
        count = len(self.before) - 1
        west, south, east, north = (
            np.clip(
                np.floor((bounds[:, k] - (self.corner_m[k % 2] - sign * self.margin_m)) / self.side_m), -1, count
            ).astype(np.int32)
            for k, sign in enumerate((-1, -1, 1, 1))
        )
        west, south = np.maximum(west, 0), np.maximum(south, 0)
        east, north = np.minimum(east, count - 1) + 1, np.minimum(north, count - 1) + 1
        inside = (east > west) & (north > south)
        b = self.before
        return np.asarray(inside & (b[north, east] - b[south, east] - b[north, west] + b[south, west] > 0))
