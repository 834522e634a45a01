"""An image of the ground that is placed by its own coordinate system: a GeoTIFF of one band, such as an ortho-albedo.

In the coordinate system of the ground its pixels stay as they are. From another projection of the same body they are
interpolated, bilinearly, on cells as wide as they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..support.arrays import Array
from ..support.foreign_bytes import ForeignBytes, read
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
from .map_projection import MapSystem, ellipsoid_m, make_crs_text, read_system
from .tiff import FIX, KIND, MOST_BYTES, Directory, UnreadError, grant_memory, read_directories, read_pixels

#: Pixels beside the ground that are kept, for interpolation; most pixels over the ground.
_BESIDE, _MOST_PIXELS = 2, 2**26
#: Cells between the places at which a projection is computed; between them it is taken for bilinear. A map of pixels of
#: 100 m then is off by less than 0.01 of them on the smallest moons.
_LATTICE = 16
#: Relative difference of the radii of one body, as files state them, and of the half axes of a sphere.
_SAME_BODY, _SPHERE = 0.01, 1e-9
_MODEL_KEY = 1024
_Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class MapImage:
    """Values (rows, columns) float64 over the ground, row 0 northernmost; those that the image lacks are their mean.

    ``west_m`` and ``south_m`` are the outer edges in the frame of the site, ``pixel_m`` the size of a pixel (east,
    north). ``mean`` is over the square of the ground where the image has values, and ``covered`` the share of it.
    """

    values: Array
    west_m: float
    south_m: float
    pixel_m: tuple[float, float]
    mean: float
    covered: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Grid:
    """Pixels of an image, north up and from west to east: the outer south-west corner and size in metres of its map;
    ``down`` and ``right`` tell whether its rows run south and its columns east in the file."""

    shape: tuple[int, int]
    west: float
    south: float
    size: tuple[float, float]
    down: bool
    right: bool

    def to_pixels(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Columns from the west edge and rows from the south edge, of places in metres of the map."""
        return (x - self.west) / self.size[0], (y - self.south) / self.size[1]


def read_map_image(path: Path, frame: MapFrame, size_m: float) -> MapImage:
    """The image of a file over the square of ``size_m`` around the origin of a site.

    Raises IcyMoonError for a file without a place, of another body or in a projection that is not known here, and for
    one that does not reach the ground.
    """
    return read(path, lambda foreign: _read(foreign, frame, size_m), KIND, FIX, MOST_BYTES)


def _read(foreign: ForeignBytes, frame: MapFrame, size_m: float) -> MapImage:
    grant_memory(foreign)
    images = read_directories(foreign)
    image = images[0]
    keys = read_keys(image.tags)
    placed = read_placement(image, keys)
    unit, _ = find_coordinate_unit(keys, foreign.name, 0.0)
    if placed is None or unit is None:
        raise UnreadError(
            "does not state where it lies on a map; state it in its folder with: "
            + gdal_lines.translate_command(foreign.name, "-a_srs SYSTEM -a_ullr WEST NORTH EAST SOUTH")
        )
    (east, north), corner = placed
    size = abs(east) * unit, abs(north) * unit
    grid = _Grid(image.shape, corner[0] * unit - size[0] / 2, corner[1] * unit - size[1] / 2, size, north < 0, east > 0)
    system = read_system(keys, unit)
    there = _Reader(foreign, images, grid)
    if _is_same_system(keys, system, make_geokeys(image.tags), frame):
        found = _cut_out(there, frame, size_m)
    else:
        found = _project(there, frame, size_m, _find_way(keys, system, frame, there))
    return _fill(found, size_m, frame, grid, unit, foreign.name)


class _Reader:
    """Reads windows of an image as values with scale, offset, missing marks and mask."""

    def __init__(self, foreign: ForeignBytes, images: list[Directory], grid: _Grid) -> None:
        self.grid, self.name = grid, foreign.name
        self._foreign, self._images = foreign, images

    def read(self, rows: range, columns: range) -> Array:
        """The window of pixels ``rows`` from the south edge and ``columns`` from the west edge, row 0 northernmost;
        NaN beyond the image and where it has no values."""
        if len(rows) * len(columns) > _MOST_PIXELS:
            raise UnreadError(
                f"has {len(columns)} x {len(rows)} pixels over the ground, and {_MOST_PIXELS} are read at most; make "
                f"them wider, or terrain.size_m smaller; in its folder with: {gdal_lines.warp_command(self.name)}"
            )
        high, wide = self.grid.shape
        inner = range(max(rows.start, 0), min(rows.stop, high)), range(max(columns.start, 0), min(columns.stop, wide))
        values = np.full((len(rows), len(columns)), np.nan)
        if not (len(inner[0]) and len(inner[1])):
            return values
        window = (
            range(high - inner[0].stop, high - inner[0].start) if self.grid.down else inner[0],
            inner[1] if self.grid.right else range(wide - inner[1].stop, wide - inner[1].start),
        )
        pixels = self._read_window(window)
        pixels = pixels if self.grid.down else pixels[::-1]
        pixels = pixels if self.grid.right else pixels[:, ::-1]
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
    """Whether map coordinates of an image, in metres, are map coordinates of the ground."""
    if system is not None and frame.system is not None:
        same_body = ellipsoid_m(keys) == ellipsoid_m(frame.geokeys.numbers())
        return same_body and replace(system, name="") == replace(frame.system, name="")
    if system is not None or frame.system is not None:
        return False
    text = make_crs_text(keys, 1.0)
    return geokeys == frame.geokeys or (bool(text) and text == make_crs_text(frame.geokeys.numbers(), 1.0))


def _find_way(
    keys: Mapping[int, Any], system: MapSystem | None, frame: MapFrame, there: _Reader
) -> Callable[[float, float], tuple[float, float]]:
    """From a place on the map of the ground to one on that of the image, in metres. Raises UnreadError, with the
    command that projects the image, where it is not known."""
    target = make_crs_text(frame.geokeys.numbers(), frame.unit_m)
    fix = gdal_lines.warp_command(there.name, f'-t_srs "{target}"') if target else ""
    with_fix = f"; project it in its folder with: {fix}" if fix else "; project it to the system of the ground."
    ground = frame.system
    if not keys.get(_MODEL_KEY):
        raise UnreadError(
            "states no coordinate system; state it in its folder, if it is that of the ground, with: "
            + gdal_lines.edit_command(there.name, f'-a_srs "{target}"')
        )
    if system is None or ground is None:
        raise UnreadError(f"has another map than the ground, and a projection that is not known here{with_fix}")
    if abs(system.radius_m / ground.radius_m - 1) > _SAME_BODY:
        raise UnreadError(
            f"is a map of a body with a radius of {system.radius_m / 1000:.6g} km, and the ground is of one with "
            f"{ground.radius_m / 1000:.6g} km; give an image of the same body."
        )
    for stated in (keys, frame.geokeys.numbers()):
        major, minor = ellipsoid_m(stated)
        if not major or abs(major - minor) > _SPHERE * major:
            raise UnreadError(
                f"has another coordinate system than the ground, and one of both is of an ellipsoid{with_fix}"
            )

    return _make_way(ground, system, frame, there.grid)


def _make_way(
    ground: MapSystem, system: MapSystem, frame: MapFrame, grid: _Grid
) -> Callable[[float, float], tuple[float, float]]:
    """``_find_way`` of two projections of a sphere: longitudes go on beyond the edge of the image's map at 180 degrees,
    and are those among which the image lies."""

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


def _box_of_ground(frame: MapFrame, size_m: float) -> _Box:
    """West, south, east and north edge of the ground in metres of its map."""
    half = size_m / 2
    west, south = (frame.origin[k] - half / frame.scale[k] for k in range(2))
    return west, south, frame.origin[0] + half / frame.scale[0], frame.origin[1] + half / frame.scale[1]


@dataclass(frozen=True)
class _Cut:
    """Values (rows, columns) with NaN, the outer south-west corner and the size of a pixel in metres of the ground's
    map."""

    values: Array
    west: float
    south: float
    size: tuple[float, float]


def _cut_out(there: _Reader, frame: MapFrame, size_m: float) -> _Cut:
    """The pixels of the image itself over the ground."""
    grid = there.grid
    west, south, east, north = _box_of_ground(frame, size_m)
    (left, right), (low, high) = (
        tuple(map(float, each)) for each in grid.to_pixels(*map(np.array, ([west, east], [south, north])))
    )
    columns = range(math.floor(left) - _BESIDE, math.ceil(right) + _BESIDE)
    rows = range(math.floor(low) - _BESIDE, math.ceil(high) + _BESIDE)
    values = there.read(rows, columns)
    return _Cut(values, grid.west + columns.start * grid.size[0], grid.south + rows.start * grid.size[1], grid.size)


def _project(
    there: _Reader, frame: MapFrame, size_m: float, way: Callable[[float, float], tuple[float, float]]
) -> _Cut:
    """The image interpolated on cells along the map of the ground, as wide as its pixels there."""
    west, south, east, north = _box_of_ground(frame, size_m)
    size = _pixel_on_ground_map(there.grid, frame, way)
    count = tuple(
        math.ceil(wide / each) + 2 * _BESIDE for wide, each in ((east - west, size[0]), (north - south, size[1]))
    )
    if count[0] * count[1] > _MOST_PIXELS:
        there.read(range(count[1]), range(count[0]))  # which refuses so many
    start = west - _BESIDE * size[0], south - _BESIDE * size[1]
    x = _lattice(count[0])
    y = _lattice(count[1])
    places = np.array([[way(start[0] + i * size[0], start[1] + j * size[1]) for i in x] for j in y])
    column, row = there.grid.to_pixels(places[..., 0], places[..., 1])
    columns = range(math.floor(column.min()) - _BESIDE, math.ceil(column.max()) + _BESIDE)
    rows = range(math.floor(row.min()) - _BESIDE, math.ceil(row.max()) + _BESIDE)
    values = there.read(rows, columns)[::-1]  # from the south, as the rows count
    made = np.empty((count[1], count[0]))
    for k in range(count[1]):
        at = [_along_row(each, x, y, k + 0.5) for each in (column, row)]
        made[count[1] - 1 - k] = _bilinear(values, at[0] - columns.start - 0.5, at[1] - rows.start - 0.5)
    return _Cut(made, *start, size)


def _lattice(count: int) -> Array:
    """Edges of cells, every ``_LATTICE`` of them, from the first one to the last."""
    return np.linspace(0.0, count, math.ceil(count / _LATTICE) + 1)


def _along_row(values: Array, x: Array, y: Array, at_y: float) -> Array:
    """Values on a lattice (y, x) at the middles of the cells of a row, bilinear."""
    k = min(int(np.searchsorted(y, at_y)), len(y) - 1)
    share = (at_y - y[k - 1]) / (y[k] - y[k - 1])
    return np.interp(np.arange(x[-1]) + 0.5, x, (1 - share) * values[k - 1] + share * values[k])


def _bilinear(values: Array, column: Array, row: Array) -> Array:
    """Values between pixels; NaN where one of the four around has none that counts."""
    left = np.clip(np.floor(column).astype(np.intp), 0, values.shape[1] - 2)
    low = np.clip(np.floor(row).astype(np.intp), 0, values.shape[0] - 2)
    u, v = column - left, row - low
    total = np.zeros(column.shape)
    for dy, across in ((0, 1 - v), (1, v)):
        for dx, along in ((0, 1 - u), (1, u)):
            weight = along * across
            total += np.where(weight > 0, weight * values[low + dy, left + dx], 0.0)
    return total


def _pixel_on_ground_map(
    grid: _Grid, frame: MapFrame, way: Callable[[float, float], tuple[float, float]]
) -> tuple[float, float]:
    """The size of a pixel of the image, in metres along x and y of the ground's map at the origin of the site."""
    step = 1.0
    x, y = frame.origin
    here = np.array(way(x, y))
    along_x = (np.array(way(x + step, y)) - here) / np.array(grid.size)
    along_y = (np.array(way(x, y + step)) - here) / np.array(grid.size)
    return step / float(np.hypot(*along_x)), step / float(np.hypot(*along_y))


def _fill(found: _Cut, size_m: float, frame: MapFrame, grid: _Grid, unit_m: float, name: str) -> MapImage:
    """The image in the frame of the site, with the mean where it has no values. Raises UnreadError if it has none over
    the ground, or only black ones."""
    pixel = found.size[0] * frame.scale[0], found.size[1] * frame.scale[1]
    west, south = ((corner - frame.origin[k]) * frame.scale[k] for k, corner in enumerate((found.west, found.south)))
    rows, columns = found.values.shape
    east = west + (np.arange(columns) + 0.5) * pixel[0]
    north = south + (np.arange(rows)[::-1] + 0.5) * pixel[1]
    over = (np.abs(north) <= size_m / 2)[:, None] & (np.abs(east) <= size_m / 2)[None, :]
    known = np.isfinite(found.values)
    if not over.any():  # a pixel is wider than the ground
        over = np.ones_like(known)
    if not (known & over).any():
        edges = (
            grid.west,
            grid.west + grid.shape[1] * grid.size[0],
            grid.south,
            grid.south + grid.shape[0] * grid.size[1],
        )
        a, b, c, d = (f"{edge / unit_m:.10g}" for edge in edges)
        raise UnreadError(
            f"has no values over the ground; its coordinates go from {a} to {b} east and from {c} to {d} north; give "
            "an image that covers the site, or set textures.mapping to OBJECT."
        )
    mean = float(found.values[known & over].mean())
    if not mean > 0:
        raise UnreadError(
            f"has a mean of {mean:.3g} over the ground, and an albedo is above 0; state its scale and offset in its "
            f"folder with: {gdal_lines.translate_command(name, '-a_scale SCALE -a_offset OFFSET')}"
        )
    covered = float((known & over).sum() / over.sum())
    warnings = []
    if covered < 1.0:
        warnings.append(
            f"{100 * (1 - covered):.2g} % of the ground has no value in {name}; there it has the mean of the rest, "
            f"{mean:.4g} of the file, which stands for surface.albedo."
        )
    return MapImage(
        np.where(known, found.values, mean), float(west), float(south), pixel, mean, covered, tuple(warnings)
    )
