"""The ground that the blade of a scoop removes: all ground above the lowest height of the blade.

A height field cannot represent an undercut, so ground that would overhang the blade is removed too. A blade ends inside
cells, so the cut of a cell is the mean over 4 x 4 points in it. A prism of 8 x 30 cm on cells of 2.5 mm is then within
0.01 % of its volume; with one point it would be within 2 % (``tests/physics/excavation/test_scoop_cut.py``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array, Numbers
from .dig_grid import ExcavationGrid
from .scoop_marks import ScoopMarks

#: Number of points in a cell along each axis.
SUBSAMPLES = 4


@dataclass(frozen=True)
class Pull:
    """A straight pull of a blade ``width_m`` wide from (``x_m``, ``y_m``) along a heading in degrees, clockwise from
    north.

    ``along_m`` (n,), increasing, are distances along the pull. ``depth_m`` (n,) are depths of the blade's edge there,
    below the plane of the untouched ground. With ``from_deg`` the blade first rotates about its middle from that
    heading. With ``marks`` the edge leaves grooves and steps about these depths.
    """

    x_m: float
    y_m: float
    heading_deg: float
    width_m: float
    along_m: Array
    depth_m: Array
    from_deg: float | None = None
    marks: ScoopMarks | None = None

    def place(self, x_m: Numbers, y_m: Numbers) -> tuple[Array, Array]:
        """Return the distances of points along the pull and to its right, in metres."""
        east, north = math.sin(math.radians(self.heading_deg)), math.cos(math.radians(self.heading_deg))
        x, y = np.asarray(x_m) - self.x_m, np.asarray(y_m) - self.y_m
        return x * east + y * north, x * north - y * east

    def point(self, along_m: float, right_m: float) -> tuple[float, float]:
        """Return the east and north coordinates in metres of a point on the pull, the inverse of ``place``."""
        east, north = math.sin(math.radians(self.heading_deg)), math.cos(math.radians(self.heading_deg))
        return self.x_m + along_m * east + right_m * north, self.y_m + along_m * north - right_m * east

    def bounds_m(self, margin_m: float = 0.0) -> tuple[float, float, float, float]:
        """Return the west, south, east and north limits of the ground that the blade passes over, with a margin."""
        half = self.width_m / 2 + margin_m
        corners = [
            self.point(along, right)
            for along in (self.along_m[0] - margin_m, self.along_m[-1] + margin_m)
            for right in (-half, half)
        ]
        if self.from_deg is not None:
            corners += [(self.x_m - half, self.y_m - half), (self.x_m + half, self.y_m + half)]
        x, y = zip(*corners, strict=True)
        return min(x), min(y), max(x), max(y)

    def find_depth_at(self, x_m: Array, y_m: Array) -> Array:
        """Find the depth in metres of the blade's edge at points on its path; -inf at other points."""
        along, right = self.place(x_m, y_m)
        over = (np.abs(right) <= self.width_m / 2) & (along >= self.along_m[0]) & (along <= self.along_m[-1])
        if self.from_deg is not None:  # the sector outside a bend, which two pulls leave out
            before = math.radians(self.from_deg)
            past = (np.asarray(x_m) - self.x_m) * math.sin(before) + (np.asarray(y_m) - self.y_m) * math.cos(before)
            over |= (along <= 0.0) & (past >= 0.0) & (np.hypot(along, right) <= self.width_m / 2)
        depth = np.interp(along, self.along_m, self.depth_m)
        if self.marks is not None:
            depth = self.marks.add_to(depth, along - self.along_m[0], right, float(self.along_m[-1] - self.along_m[0]))
        return np.where(over, depth, -np.inf)

    def beside(self, x_m: Array, y_m: Array) -> tuple[Array, Array]:
        """Find the distance in metres of points from the blade's path (0 on the path), and the depth at the nearest
        point of the path.
        """
        along, right = self.place(x_m, y_m)
        nearest = np.clip(along, self.along_m[0], self.along_m[-1])
        out = np.hypot(along - nearest, np.maximum(np.abs(right) - self.width_m / 2, 0.0))
        return out, np.interp(nearest, self.along_m, self.depth_m)


def find_bounds_m(pulls: Sequence[Pull], margin_m: float = 0.0) -> tuple[float, float, float, float]:
    """Find the west, south, east and north limits in metres of the ground that all pulls pass over, with a margin."""
    ends = np.array([pull.bounds_m(margin_m) for pull in pulls])
    low, high = ends.min(axis=0), ends.max(axis=0)
    return float(low[0]), float(low[1]), float(high[2]), float(high[3])


def fit_plane(grid: ExcavationGrid, heights: Array, pulls: Sequence[Pull]) -> Array:
    """Fit the plane (3,), height = a + b east + c north, to the ground that the pulls pass over, by least squares. If
    that ground is less than three cells wide, the plane is level.
    """
    over = np.zeros(heights.shape, bool)
    for pull in pulls:
        window = grid.window(*pull.bounds_m())
        over[window] |= np.isfinite(pull.find_depth_at(*grid.points(window)))
    rows, columns = np.nonzero(over)
    if len(rows) == 0:
        at = pulls[0].point(float(np.mean(pulls[0].along_m)), 0.0)
        return np.array(
            [float(grid.interpolate(heights, np.array([at[0]]), np.array([at[1]]), np.zeros(1))[0]), 0.0, 0.0]
        )
    east, north, z = grid.east_m[columns], grid.north_m[rows], heights[rows, columns]
    if min(np.ptp(rows), np.ptp(columns)) < 2:
        return np.array([float(z.mean()), 0.0, 0.0])
    middle_east, middle_north = float(east.mean()), float(north.mean())
    design = np.stack([np.ones(len(z)), east - middle_east, north - middle_north], axis=1)
    a, b, c = np.linalg.lstsq(design, z, rcond=None)[0]
    return np.array([a - b * middle_east - c * middle_north, b, c])


def measure_cut_depth_m(grid: ExcavationGrid, top_m: Array, plane: Array, pulls: Sequence[Pull]) -> Array:
    """Compute the depth (rows, columns) in metres that the pulls remove from ground with its top at ``top_m``. Depths
    of the pulls are below ``plane``, as ``fit_plane`` returns it.
    """
    taken = np.zeros_like(top_m)
    window = grid.window(*find_bounds_m(pulls))
    windows = [grid.window(*pull.bounds_m()) for pull in pulls]
    x, y = grid.points(window)
    # Compare with the plane of the ground, so that a slope does not bias a half cut cell.
    level = plane[0] + plane[1] * x + plane[2] * y
    depth = np.empty(taken.shape)
    steps = ((np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5) * grid.cell_m
    for north in steps:
        for east in steps:
            depth[window] = -np.inf
            for pull, part in zip(pulls, windows, strict=True):
                at_x, at_y = grid.points(part)
                depth[part] = np.maximum(depth[part], pull.find_depth_at(at_x + east, at_y + north))
            over = np.isfinite(depth[window])
            floor = level - np.where(over, depth[window], 0.0)
            taken[window] += np.where(over, np.maximum(top_m[window] - floor, 0.0), 0.0)
    return taken / SUBSAMPLES**2
