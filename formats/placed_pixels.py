"""A GeoTIFF of one band as georeferenced pixels: its windows, counted from the south-west, and the conversion from the
map of the ground to the file's own map."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..support.arrays import Array
from ..support.foreign_bytes import ForeignBytes
from . import gdal_lines
from .geokeys import GeoKeys, make_geokeys
from .geotiff import (
    apply_mask,
    clear_missing,
    find_coordinate_unit,
    read_keys,
    read_metadata,
    read_placement,
    read_scaling,
)
from .map_forward import project_point
from .map_frame import MapFrame
from .map_projection import MapSystem, make_crs_text, read_ellipsoid_m, read_system
from .tiff import Directory, UnreadError, read_directories, read_pixels

#: Relative difference of the radii of one body, as files state them, and of the half axes of a sphere.
_SAME_BODY, _SPHERE = 0.01, 1e-9
_MODEL_KEY = 1024
#: Projections on which a full turn of longitude is the same way along x everywhere.
_ROUND_THE_BODY = ("Equidistant cylindrical", "Mercator", "Cylindrical equal area")
#: Converts a place on the map of the ground to a place on another map, both in metres.
Way = Callable[[float, float], tuple[float, float]]


@dataclass(frozen=True)
class PixelGrid:
    """The pixel grid of an image, north up and from west to east: its outer south-west corner and the size of a pixel,
    in metres of its map. ``down`` and ``right`` tell whether its rows run south and its columns east in the file."""

    shape: tuple[int, int]
    west: float
    south: float
    size: tuple[float, float]
    down: bool
    right: bool

    def to_pixels(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Convert places, in metres of the map, to columns from the west edge and rows from the south edge."""
        return (x - self.west) / self.size[0], (y - self.south) / self.size[1]

    def find_window(self, rows: range, columns: range) -> tuple[range, range]:
        """Return the file's rows and columns for rows from the south edge and columns from the west edge."""
        high, wide = self.shape
        return reverse_range(rows, high) if self.down else rows, columns if self.right else reverse_range(columns, wide)

    def turn_north_up(self, pixels: Array) -> Array:
        """Turn pixels (rows, columns) of the file so that row 0 is northernmost and column 0 westernmost."""
        pixels = pixels if self.down else pixels[::-1]
        return pixels if self.right else pixels[:, ::-1]


def reverse_range(wanted: range, count: int) -> range:
    """Convert a range of pixels in a row or column of ``count`` to indices from its other end."""
    return range(count - wanted.stop, count - wanted.start)


def interpolate_pixels(values: Array, column: Array, row: Array) -> Array:
    """Interpolate values bilinearly between pixels; NaN where one of the four neighbours is invalid."""
    left = np.clip(np.floor(column).astype(np.intp), 0, values.shape[1] - 2)
    low = np.clip(np.floor(row).astype(np.intp), 0, values.shape[0] - 2)
    u, v = column - left, row - low
    total = np.zeros(column.shape)
    for dy, across in ((0, 1 - v), (1, v)):
        for dx, along in ((0, 1 - u), (1, u)):
            weight = along * across
            total += np.where(weight > 0, weight * values[low + dy, left + dx], 0.0)
    return total


@dataclass(frozen=True)
class PlacedImage:
    """The first image of a file with its place: its GeoKeys, its pixel grid in metres of its map, and metres per unit
    of the file. ``way`` converts coordinates of the ground's map to this map; None if both maps are the same."""

    images: list[Directory]
    keys: Mapping[int, Any]
    grid: PixelGrid
    unit_m: float
    way: Way | None

    @property
    def edges(self) -> tuple[float, float, float, float]:
        """West, east, south and north edge, in the unit of the file."""
        grid = self.grid
        east, north = grid.west + grid.shape[1] * grid.size[0], grid.south + grid.shape[0] * grid.size[1]
        west, east, south, north = (edge / self.unit_m for edge in (grid.west, east, grid.south, north))
        return west, east, south, north


def open_placed_image(foreign: ForeignBytes, frame: MapFrame) -> PlacedImage:
    """Open the image of a file with its map, for the ground of ``frame``.

    Raises UnreadError for a file without a map position, of another body, and in an unsupported projection.
    """
    images = read_directories(foreign)
    image = images[0]
    keys = read_keys(image.tags)
    placed = read_placement(image, keys)
    unit, _ = find_coordinate_unit(keys, foreign.name, 0.0)
    if placed is None or unit is None:
        raise UnreadError(
            "does not state its place on a map; state it in its folder with: "
            + gdal_lines.make_translate_command(foreign.name, "-a_srs SYSTEM -a_ullr WEST NORTH EAST SOUTH")
        )
    (east, north), corner = placed
    size = abs(east) * unit, abs(north) * unit
    grid = PixelGrid(
        image.shape, corner[0] * unit - size[0] / 2, corner[1] * unit - size[1] / 2, size, north < 0, east > 0
    )
    system = read_system(keys, unit)
    same = _is_same_system(keys, system, make_geokeys(image.tags), frame)
    if same and system is not None and system.kind in _ROUND_THE_BODY:
        grid = _shift_to_site(grid, system, frame)
    way = None if same else _find_way(keys, system, frame, grid, foreign.name)
    return PlacedImage(images, keys, grid, unit, way)


def _shift_to_site(grid: PixelGrid, system: MapSystem, frame: MapFrame) -> PixelGrid:
    """Shift the grid of an image around the body by multiples of 360°, so that it is near the site. The image's
    longitudes may count to 180 or to 360."""
    once = project_point(system, system.longitude_deg, 0.0, 1)[0] - project_point(system, system.longitude_deg, 0.0)[0]
    middle = grid.west + grid.shape[1] * grid.size[0] / 2
    return replace(grid, west=grid.west + once * round((frame.origin[0] - middle) / once))


class PlacedReader:
    """Reads windows of an image as values: scaled, with their offset, and NaN by missing marks and mask."""

    def __init__(self, foreign: ForeignBytes, images: list[Directory], grid: PixelGrid) -> None:
        self.grid, self.name = grid, foreign.name
        self._foreign, self._images = foreign, images

    def read(self, rows: range, columns: range) -> Array:
        """Read the pixels ``rows`` from the south edge and ``columns`` from the west edge, with row 0 northernmost. NaN
        beyond the image and where it has no values."""
        high, wide = self.grid.shape
        inner = range(max(rows.start, 0), min(rows.stop, high)), range(max(columns.start, 0), min(columns.stop, wide))
        values = np.full((len(rows), len(columns)), np.nan)
        if not (len(inner[0]) and len(inner[1])):
            return values
        pixels = self.grid.turn_north_up(self._read_window(self.grid.find_window(*inner)))
        top, left = rows.stop - inner[0].stop, inner[1].start - columns.start
        values[top : top + len(inner[0]), left : left + len(inner[1])] = pixels
        return values

    def _read_window(self, window: tuple[range, range]) -> Array:
        image = self._images[0]
        values, number = read_pixels(self._foreign, image, window)
        clear_missing(values, number, image.tags.get(42113))
        apply_mask(values, self._foreign, self._images, window)
        scale, offset = read_scaling(image, read_metadata(image))
        return values * scale + offset


def _is_same_system(
    keys: Mapping[int, Any], system: MapSystem | None, geokeys: GeoKeys | None, frame: MapFrame
) -> bool:
    """Return whether the map coordinates of an image, in metres, equal the map coordinates of the ground."""
    if system is not None and frame.system is not None:
        same_body = read_ellipsoid_m(keys) == read_ellipsoid_m(frame.geokeys.numbers())
        return same_body and replace(system, name="") == replace(frame.system, name="")
    if system is not None or frame.system is not None:
        return False
    text = make_crs_text(keys, 1.0)
    return geokeys == frame.geokeys or (bool(text) and text == make_crs_text(frame.geokeys.numbers(), 1.0))


def _find_way(keys: Mapping[int, Any], system: MapSystem | None, frame: MapFrame, grid: PixelGrid, name: str) -> Way:
    """Find the conversion from map coordinates of the ground to map coordinates of the image, in metres. Raises
    UnreadError, with the command that projects the image, if it is unknown."""
    target = make_crs_text(frame.geokeys.numbers(), frame.unit_m)
    fix = gdal_lines.make_warp_command(name, f'-t_srs "{target}"') if target else ""
    with_fix = f"; project it in its folder with: {fix}" if fix else "; project it to the system of the ground."
    ground = frame.system
    if not keys.get(_MODEL_KEY):
        raise UnreadError(
            "states no coordinate system; if it is the system of the ground, state it in its folder with: "
            + gdal_lines.make_edit_command(name, f'-a_srs "{target}"')
        )
    if system is None or ground is None:
        raise UnreadError(f"has another coordinate system than the ground, in an unsupported projection{with_fix}")
    if abs(system.radius_m / ground.radius_m - 1) > _SAME_BODY:
        raise UnreadError(
            f"is a map of a body with a radius of {system.radius_m / 1000:.6g} km, and the ground is of one with "
            f"{ground.radius_m / 1000:.6g} km; give a map of the same body."
        )
    for stated in (keys, frame.geokeys.numbers()):
        major, minor = read_ellipsoid_m(stated)
        if not major or abs(major - minor) > _SPHERE * major:
            raise UnreadError(
                f"has another coordinate system than the ground, and one of the two is for an ellipsoid{with_fix}"
            )

    return _make_way(ground, system, frame, grid)


def _make_way(ground: MapSystem, system: MapSystem, frame: MapFrame, grid: PixelGrid) -> Way:
    """Make the conversion of ``_find_way`` between two projections of a sphere. Longitudes continue beyond the edge of
    the image's map at 180 degrees, in the range of the image."""

    def apart_deg(longitude_deg: float) -> float:
        return (longitude_deg - system.longitude_deg + 180.0) % 360.0 - 180.0

    longitude, latitude = ground.to_sphere(*frame.origin)

    def misses(turns: int) -> float:
        x = project_point(system, longitude, latitude, turns)[0]
        return abs(x - grid.west - grid.shape[1] * grid.size[0] / 2)

    middle = apart_deg(longitude) + 360.0 * min((0, -1, 1), key=misses)

    def way(x: float, y: float) -> tuple[float, float]:
        longitude, latitude = ground.to_sphere(x, y)
        return project_point(system, longitude, latitude, round((middle - apart_deg(longitude)) / 360.0))

    return way
