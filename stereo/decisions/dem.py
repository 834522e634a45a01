"""Elevation models of a workspace: heights on square cells in the site's frame, north up, and their errors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.geotiff import describe_map_notes
from ...formats.tiff_write import Place, encode_tiff
from ...physics.camera.rolling_shutter import place_in_world
from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import MAX_BYTES, ForeignBytes, RefusedError, parse_npy, read

#: Fewest points for a known height of a cell: the median of fewer is as bad as one outlier.
FEWEST_POINTS_PER_CELL = 3
#: Ratio of the standard deviation of a normal distribution to its median absolute deviation.
_DEVIATION_OF_MEDIAN = 1.4826
#: Bytes of a file without its values, and most cells along a side.
_HEADER_BYTES, _MAX_CELLS = 2**14, 4096
_FRAME_TEXT = "Icy Moon site frame: x east, y north, z up, metres"


@dataclass(frozen=True)
class Grid:
    """A grid of square cells, row 0 northernmost.

    ``cell_m`` is the side of a cell; ``west_m`` and ``north_m`` are the outer corner of the north-west cell.
    """

    cell_m: float
    rows: int
    columns: int
    west_m: float
    north_m: float

    def centres(self) -> tuple[Array, Array]:
        """Return the east and the north (rows, columns) of the cells' centres, m."""
        east = self.west_m + (np.arange(self.columns) + 0.5) * self.cell_m
        north = self.north_m - (np.arange(self.rows) + 0.5) * self.cell_m
        x, y = np.meshgrid(east, north)
        return x, y

    def find_cells(self, position_m: Array) -> Array:
        """Return the index of the cell, counted row by row, that contains each point (n, 2 or 3); -1 outside."""
        column = np.floor((position_m[:, 0] - self.west_m) / self.cell_m)
        row = np.floor((self.north_m - position_m[:, 1]) / self.cell_m)
        inside = (column >= 0) & (column < self.columns) & (row >= 0) & (row < self.rows)
        return np.where(inside, np.where(inside, row, 0) * self.columns + np.where(inside, column, 0), -1).astype(
            np.intp
        )


@dataclass(frozen=True)
class Dem:
    """Heights (rows, columns) float64, m, and the number of points of each cell.

    A height is NaN if its cell has too few points.
    """

    grid: Grid
    height_m: Array
    points: Array

    @property
    def known(self) -> Array:
        """The cells (rows, columns), bool, with a known height."""
        return np.isfinite(self.height_m)

    def encode_geotiff(self, ground: Mapping[str, Any] | None = None) -> bytes:
        """Encode the heights as a GeoTIFF in the site's frame.

        The entry ``ground`` of a ``pair.json`` gives the position on a map, which the tag ``map`` contains as JSON.
        """
        grid = self.grid
        place = Place(grid.cell_m, grid.west_m, grid.north_m, _FRAME_TEXT, notes=describe_map_notes(ground))
        return encode_tiff(self.height_m.astype(np.float32), place)


def read_cells(path: Path, shape: tuple[int, ...], fix: str) -> Array:
    """Read all cells of a file in numpy's format, float32 or boolean of this shape, as float64.

    ``fix`` is the remedy in an error, an imperative without a full stop. Raises IcyMoonError if the file is missing,
    damaged or different.
    """

    def parse(foreign: ForeignBytes) -> Array:
        found = parse_npy(foreign, "fb")
        if found.shape != shape or found.dtype not in (np.float32, np.bool_):
            cells = " x ".join(map(str, shape))
            raise RefusedError(f"is not a map of {cells} cells; {fix}.")
        return found.astype(np.float64)

    return read(path, parse, "a map of cells", fix, most=min(4 * math.prod(shape) + _HEADER_BYTES, MAX_BYTES))


def back_project_depth(depth_m: Array, camera: StereoCamera, pose: Array) -> tuple[Array, Array]:
    """Back-project the known pixels of a planar depth (H, W), m.

    Return their points (n, 3), m, in the site's frame, and their flat indices (n,). ``pose`` (4, 4) is the transform
    from the eye of the parallel rig, in OpenCV's axes, to the site; with a rolling shutter it is (H, 4, 4), one for
    each row.
    """
    index = np.flatnonzero(np.isfinite(depth_m))
    row, column = np.divmod(index, depth_m.shape[1])
    rays = np.stack(
        [
            (column + 0.5 - camera.cx_px) / camera.focal_px,
            (row + 0.5 - camera.cy_px) / camera.focal_px,
            np.ones(len(index)),
        ],
        axis=1,
    )
    return place_in_world(rays * depth_m.ravel()[index, None], pose, row), index


def make_dem(position_m: Array, grid: Grid, fewest: int = FEWEST_POINTS_PER_CELL) -> Dem:
    """Make an elevation model: the median height of the points (n, 3) in each cell, NaN with fewer than ``fewest``
    points.

    The median resists the outliers of matchers at edges.
    """
    cell = grid.find_cells(position_m)
    inside = cell >= 0
    cell, height = cell[inside], position_m[inside, 2]
    order = np.lexsort((height, cell))
    cell, height = cell[order], height[order]
    count = np.bincount(cell, minlength=grid.rows * grid.columns)
    start = np.cumsum(count) - count
    median = np.full(len(count), np.nan)
    some = count >= max(1, fewest)
    low, high = start[some] + (count[some] - 1) // 2, start[some] + count[some] // 2
    median[some] = (height[low] + height[high]) / 2
    shape = grid.rows, grid.columns
    return Dem(grid, median.reshape(shape), count.reshape(shape))


def mean_by_cell(position_m: Array, values: Array, grid: Grid) -> Array:
    """Average values (n,) over the points of each cell; NaN in cells without points."""
    cell = grid.find_cells(position_m)
    inside = cell >= 0
    count = np.bincount(cell[inside], minlength=grid.rows * grid.columns)
    total = np.bincount(cell[inside], values[inside].astype(np.float64), minlength=len(count))
    return np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0).reshape(grid.rows, grid.columns)


def measure_height_errors(found: Dem, truth_m: Array, over: Array) -> dict[str, float | None]:
    """Measure the errors, m, of the heights in the cells ``over`` (rows, columns).

    ``bias_m`` is the mean, ``nmad_m`` 1.4826 times the median distance from the median, ``le90_m`` the 90th percentile
    of the absolute error (Höhle and Höhle 2009, ISPRS J. 64), and ``completeness`` the share of known cells. Errors are
    None without known cells, and the completeness without cells of known truth.
    """
    wanted = over & np.isfinite(truth_m)
    error = (found.height_m - truth_m)[wanted]
    known = error[np.isfinite(error)]
    share = known.size / error.size if error.size else None
    if not known.size:
        return {"bias_m": None, "rmse_m": None, "nmad_m": None, "le90_m": None, "completeness": share}
    spread = _DEVIATION_OF_MEDIAN * np.median(np.abs(known - np.median(known)))
    return {
        "bias_m": float(known.mean()),
        "rmse_m": float(np.sqrt((known**2).mean())),
        "nmad_m": float(spread),
        "le90_m": float(np.quantile(np.abs(known), 0.9)),
        "completeness": share,
    }


def read_grid(stated: Mapping[str, Any]) -> Grid:
    """Return the grid that the entry ``workspace`` of a ``pair.json`` states.

    Raises IcyMoonError unless the grid has 1 to 4096 cells along both sides, and a corner.
    """
    shape, origin = stated["shape"], stated["origin_m"]
    if len(shape) != 2 or len(origin) != 2 or not all(0 < side <= _MAX_CELLS for side in shape):
        raise IcyMoonError(
            f"pair.json states no workspace of at most {_MAX_CELLS} cells a side; render the pair again."
        )
    (rows, columns), (west, north) = shape, origin
    return Grid(float(stated["cell_m"]), int(rows), int(columns), float(west), float(north))
