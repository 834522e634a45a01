"""The results of a matcher on the map from which a pair's ground was made: heights, their errors, and why some are
missing, as GeoTIFF in the coordinate system of the ground's file.

Cells are along the axes of the map and within the edges of the file. Heights count from the file's zero, in metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..formats.map_frame import MapFrame, map_frame_from_json
from ..formats.tiff_write import MapPlace, encode_tiff
from ..physics.camera.stereo_camera import StereoCamera
from ..render.pairs.pair_folder import Pair
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.files import write_bytes
from .decisions.dem import Grid, back_project_depth, make_dem, mean_by_cell
from .decisions.workspace import find_ground_pixels
from .matchers.methods import Method
from .measure.prepare_pair import PreparedPair
from .measure.row_metrics import disparity_to_depth

#: Classes of cells, and their values in the file.
NOT_SEEN, MEASURED, MISSING, OCCLUDED = range(4)
_CLASSES = (
    "0: not seen by the left eye; 1: at least half of its points measured; 2: missing, seen by both eyes; 3: missing, "
    "hidden from the right eye"
)
#: Width of a cell in pixels at the median depth if no width is stated, and the most cells along a side.
_PIXELS, _MAX_CELLS = 3.0, 2048
#: Share of the true points, from the nearest on, that the cells contain.
_SHARE = 0.9
#: Share of a cell's points that decides its class.
_HALF = 0.5


@dataclass(frozen=True)
class MapCells:
    """The cells of a pair's maps, square on the ground. ``pixel`` is their size in the unit of the file."""

    frame: MapFrame
    grid: Grid
    pixel: tuple[float, float]
    west: float
    north: float

    def encode(self, values: Array, text: str, unit: str = "m", missing: str = "nan") -> bytes:
        """Encode the values of the cells as the bytes of a GeoTIFF."""
        place = MapPlace(self.pixel, self.west, self.north, self.frame.geokeys, unit, missing, {"values": text})
        return encode_tiff(values, place)


def find_map_frame(prepared: PreparedPair) -> MapFrame | None:
    """Find the frame of a pair on the map of its ground; None without a map, or if the camera's place is unknown."""
    pair = prepared.pair
    if not isinstance(pair, Pair) or pair.rectified_pose("left") is None:
        return None
    return map_frame_from_json(pair.data.get("ground"))


def name_maps(method: Method, cell_m: float) -> dict[str, str]:
    """Name the files of a method's maps, by kind; ``cell_m`` is the stated size of a cell, or 0."""
    size = f"_{cell_m:g}m" if cell_m else ""
    kinds = ("height", "height_error", "class")
    return {f"{kind}_map": f"{method.file_name}_{kind}{size}.tif" for kind in kinds} | {
        "true_height_map": f"true_height{size}.tif"
    }


def make_cells(frame: MapFrame, position_m: Array, cell_m: float) -> MapCells:
    """Make cells of ``cell_m`` of ground that cover points (n, 2 or 3) of the site. They lie within the map's edges, on
    lines that count from its west and south edges. Raises IcyMoonError if the cells are too many or too large.
    """
    pixel = tuple(cell_m / frame.scale[k] / frame.unit_m for k in range(2))
    west, south, east, north = frame.bounds
    easting, northing = frame.to_map(position_m[:, 0], position_m[:, 1])
    counts = math.floor((east - west) / pixel[0] + 1e-9), math.floor((north - south) / pixel[1] + 1e-9)
    columns = _find_cell_range((easting - west) / pixel[0], counts[0])
    rows = _find_cell_range((northing - south) / pixel[1], counts[1])
    if not len(columns) or not len(rows):
        raise IcyMoonError(f"Cells of {cell_m:g} m are larger than the map of the ground; give smaller ones to --maps.")
    if max(len(columns), len(rows)) > _MAX_CELLS:
        least = cell_m * max(len(columns), len(rows)) / _MAX_CELLS
        raise IcyMoonError(
            f"Cells of {cell_m:g} m are {len(columns)} x {len(rows)}; give --maps {least:.2g} or more, for at most "
            f"{_MAX_CELLS} a side."
        )
    corner = west + columns.start * pixel[0], south + rows.stop * pixel[1]
    x, y = frame.to_site(*corner)
    return MapCells(frame, Grid(cell_m, len(rows), len(columns), float(x), float(y)), (pixel[0], pixel[1]), *corner)


def _find_cell_range(at: Array, count: int) -> range:
    """Return the range of the cells, out of ``count``, that contain positions ``at``, in cells."""
    return range(max(0, math.floor(at.min())), min(count, math.floor(at.max()) + 1))


def choose_cell_m(depth_m: Array, camera: StereoCamera) -> float:
    """Choose the size of a cell, m: 1, 2 or 5 times a power of ten, and at least three pixels at the median depth."""
    least = _PIXELS * float(np.median(depth_m)) / camera.focal_px
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= least * (1 - 1e-9))


def write_maps(
    prepared: PreparedPair, frame: MapFrame, disparity: Array, files: dict[str, Any], cell_m: float = 0.0
) -> None:
    """Write the maps of a disparity to the paths of ``files``, by the kinds of ``name_maps``.

    ``cell_m`` is the size of a cell on the ground, 0 for a suitable size. Raises IcyMoonError as ``make_cells`` does,
    and if the left image shows no ground.
    """
    pair = prepared.pair
    pose = pair.row_poses("left")
    assert pose is not None
    ground = find_ground_pixels(prepared)
    known = np.where(ground & prepared.known, prepared.truth, np.nan)
    true, index = back_project_depth(known, pair.camera.rectified, pose)
    if not len(true):
        raise IcyMoonError(f"{pair.folder} shows no ground, so there is nothing to map; point the camera at some.")
    depth = prepared.truth.ravel()[index]
    near = depth <= np.quantile(depth, _SHARE)
    cells = make_cells(frame, true[near], cell_m or choose_cell_m(depth[near], pair.camera))
    truth = make_dem(_raise_by_drop(frame, true), cells.grid, 1)
    measured = np.where(ground, disparity_to_depth(prepared, disparity), np.nan)
    points = back_project_depth(measured, prepared.depth_camera.rectified, pose)[0]
    found = make_dem(_raise_by_drop(frame, points), cells.grid)
    hidden, share = (
        mean_by_cell(true, each.ravel()[index], cells.grid) for each in (~prepared.visible, np.isfinite(measured))
    )
    zero = frame.height_zero_m
    source = "above the zero of the ground's file"
    for kind, data in {
        "true_height_map": _encode_heights(cells, truth.height_m + zero, f"true height {source}"),
        "height_map": _encode_heights(cells, found.height_m + zero, f"height measured from stereo {source}"),
        "height_error_map": _encode_heights(cells, found.height_m - truth.height_m, "measured minus true height"),
        "class_map": cells.encode(classify_cells(share, hidden), _CLASSES, "", str(NOT_SEEN)),
    }.items():
        write_bytes(files[kind], data)


def _raise_by_drop(frame: MapFrame, position_m: Array) -> Array:
    """Raise points (n, 3) of the site to heights above the zero of their map, which is curved if the ground has
    surroundings.
    """
    x, y, z = position_m.T
    return np.column_stack([x, y, z + frame.find_drop_m(x, y)])


def _encode_heights(cells: MapCells, values: Array, text: str) -> bytes:
    return cells.encode(values.astype(np.float32), text)


def classify_cells(measured: Array, hidden: Array) -> Array:
    """Classify cells, uint8 (rows, columns), by two shares of their points: ``measured``, and ``hidden`` from the right
    eye. Both are NaN for a cell without points.
    """
    classes = np.where(hidden > _HALF, OCCLUDED, MISSING)
    classes = np.where(measured >= _HALF, MEASURED, classes)
    return np.where(np.isfinite(measured), classes, NOT_SEEN).astype(np.uint8)
