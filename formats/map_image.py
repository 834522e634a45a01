"""An image of the ground that is georeferenced by its own coordinate system: a GeoTIFF of one band, such as an
ortho-albedo.

In the coordinate system of the ground its pixels stay unchanged. In another projection of the same body they are
interpolated bilinearly to cells of the pixels' width.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..support.arrays import Array
from ..support.foreign_bytes import ForeignBytes, read
from . import gdal_lines
from .map_frame import MapFrame
from .placed_pixels import PixelGrid, PlacedImage, PlacedReader, Way, interpolate_pixels, open_placed_image
from .tiff import FIX, KIND, MAX_BYTES, UnreadError, grant_memory

#: Number of pixels beside the ground that are kept for interpolation, and largest number of pixels over the ground.
_BESIDE, _MAX_PIXELS = 2, 2**26
#: Largest number of pixels along a side of the image beyond the patch.
_MAX_SEEN = 2048
#: Number of cells between the positions at which a projection is computed; between them it is interpolated. A map
#: with pixels of 100 m is then off by less than 0.01 pixels on the smallest moons.
_LATTICE = 16
_Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class MapImage:
    """Values (rows, columns) float64 over the ground, row 0 northernmost; missing values are replaced by the mean.

    ``west_m`` and ``south_m`` are the outer edges in the frame of the site, ``pixel_m`` the size of a pixel (east,
    north). ``mean`` is taken over the square of the ground where the image has values, and ``covered`` is the share of
    the square where it has them.
    """

    values: Array
    west_m: float
    south_m: float
    pixel_m: tuple[float, float]
    mean: float
    covered: float
    warnings: tuple[str, ...] = ()


def read_map_image(path: Path, frame: MapFrame, size_m: float, seen_m: float = 0.0) -> MapImage:
    """Read the image of a file over the square of ``size_m`` around the origin of a site.

    Beyond it, the image is read over a square of ``seen_m``, limited to ``_MAX_SEEN`` pixels a side; its outermost
    pixels are then the mean. Raises IcyMoonError for a file without a place, of another body, in an unsupported
    projection, or that does not reach the ground.
    """
    return read(path, lambda foreign: _read(foreign, frame, size_m, seen_m), KIND, FIX, MAX_BYTES)


def _read(foreign: ForeignBytes, frame: MapFrame, size_m: float, seen_m: float) -> MapImage:
    grant_memory(foreign)
    placed = open_placed_image(foreign, frame)
    there = PlacedReader(foreign, placed.images, placed.grid)
    pixel = _find_pixel(placed, frame)
    wide_m = max(size_m, min(seen_m, _MAX_SEEN * min(pixel[k] * frame.scale[k] for k in range(2))))
    found = _cut_out(there, frame, wide_m) if placed.way is None else _project_image(there, frame, wide_m, placed.way)
    made = _fill_gaps_with_mean(found, size_m, frame, placed, foreign.name)
    return _frame_by_mean(made) if seen_m > size_m else made


def _find_pixel(placed: PlacedImage, frame: MapFrame) -> tuple[float, float]:
    """Find the size of a pixel of an image, in metres along x and y of the ground's map."""
    return placed.grid.size if placed.way is None else _measure_pixel_m(placed.grid, frame, placed.way)


def _frame_by_mean(made: MapImage) -> MapImage:
    """Set the outermost pixels of an image, which are repeated beyond it, to its mean."""
    values = np.pad(made.values[1:-1, 1:-1], 1, constant_values=made.mean)
    return replace(made, values=values)


def _find_ground_box(frame: MapFrame, size_m: float) -> _Box:
    """Find the west, south, east and north edge of the ground, in metres of its map."""
    half = size_m / 2
    west, south = (frame.origin[k] - half / frame.scale[k] for k in range(2))
    return west, south, frame.origin[0] + half / frame.scale[0], frame.origin[1] + half / frame.scale[1]


@dataclass(frozen=True)
class _Cut:
    """Values (rows, columns), NaN where unknown; their outer south-west corner and the size of a pixel, in metres of
    the ground's map."""

    values: Array
    west: float
    south: float
    size: tuple[float, float]


def _cut_out(there: PlacedReader, frame: MapFrame, size_m: float) -> _Cut:
    """Cut out the image's own pixels over the ground."""
    grid = there.grid
    west, south, east, north = _find_ground_box(frame, size_m)
    (left, right), (low, high) = (
        tuple(map(float, each)) for each in grid.to_pixels(*map(np.array, ([west, east], [south, north])))
    )
    columns = range(math.floor(left) - _BESIDE, math.ceil(right) + _BESIDE)
    rows = range(math.floor(low) - _BESIDE, math.ceil(high) + _BESIDE)
    _refuse_many(there, len(columns), len(rows))
    values = there.read(rows, columns)
    return _Cut(values, grid.west + columns.start * grid.size[0], grid.south + rows.start * grid.size[1], grid.size)


def _project_image(there: PlacedReader, frame: MapFrame, size_m: float, way: Way) -> _Cut:
    """Interpolate the image on cells along the ground's map, as wide as the image's pixels there."""
    west, south, east, north = _find_ground_box(frame, size_m)
    size = _measure_pixel_m(there.grid, frame, way)
    count = tuple(
        math.ceil(wide / each) + 2 * _BESIDE for wide, each in ((east - west, size[0]), (north - south, size[1]))
    )
    _refuse_many(there, *count)
    start = west - _BESIDE * size[0], south - _BESIDE * size[1]
    x = _make_lattice_edges(count[0])
    y = _make_lattice_edges(count[1])
    places = np.array([[way(start[0] + i * size[0], start[1] + j * size[1]) for i in x] for j in y])
    column, row = there.grid.to_pixels(places[..., 0], places[..., 1])
    columns = range(math.floor(column.min()) - _BESIDE, math.ceil(column.max()) + _BESIDE)
    rows = range(math.floor(row.min()) - _BESIDE, math.ceil(row.max()) + _BESIDE)
    _refuse_many(there, len(columns), len(rows))
    values = there.read(rows, columns)[::-1]  # from the south, as the rows count
    made = np.empty((count[1], count[0]))
    for k in range(count[1]):
        at = [_interpolate_row(each, x, y, k + 0.5) for each in (column, row)]
        made[count[1] - 1 - k] = interpolate_pixels(values, at[0] - columns.start - 0.5, at[1] - rows.start - 0.5)
    return _Cut(made, *start, size)


def _refuse_many(there: PlacedReader, columns: int, rows: int) -> None:
    """Raise UnreadError if the image has too many pixels over the area of the ground."""
    if rows * columns > _MAX_PIXELS:
        raise UnreadError(
            f"has {columns} x {rows} pixels over the ground, and {_MAX_PIXELS} are read at most; set a smaller "
            f"terrain.size_m, or make the pixels wider in its folder with: {gdal_lines.make_warp_command(there.name)}"
        )


def _make_lattice_edges(count: int) -> Array:
    """Return the edges of a lattice over ``count`` cells, at most ``_LATTICE`` cells apart, from the first edge to the
    last."""
    return np.linspace(0.0, count, math.ceil(count / _LATTICE) + 1)


def _interpolate_row(values: Array, x: Array, y: Array, at_y: float) -> Array:
    """Interpolate values on a lattice (y, x) bilinearly at the middles of the cells of a row."""
    k = min(int(np.searchsorted(y, at_y)), len(y) - 1)
    share = (at_y - y[k - 1]) / (y[k] - y[k - 1])
    return np.interp(np.arange(x[-1]) + 0.5, x, (1 - share) * values[k - 1] + share * values[k])


def _measure_pixel_m(grid: PixelGrid, frame: MapFrame, way: Way) -> tuple[float, float]:
    """Measure the size of a pixel of the image, in metres along x and y of the ground's map at the origin of the
    site."""
    step = 1.0
    x, y = frame.origin
    here = np.array(way(x, y))
    along_x = (np.array(way(x + step, y)) - here) / np.array(grid.size)
    along_y = (np.array(way(x, y + step)) - here) / np.array(grid.size)
    return step / float(np.hypot(*along_x)), step / float(np.hypot(*along_y))


def _fill_gaps_with_mean(found: _Cut, size_m: float, frame: MapFrame, placed: PlacedImage, name: str) -> MapImage:
    """Return the image in the frame of the site, with the mean where it has no values. Raises UnreadError if it has no
    values over the ground, or only black ones."""
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
        a, b, c, d = (f"{edge:.10g}" for edge in placed.edges)
        raise UnreadError(
            f"has no values over the ground; its coordinates go from {a} to {b} east and from {c} to {d} north; give "
            "an image that covers the site, or set textures.mapping to OBJECT."
        )
    mean = float(found.values[known & over].mean())
    if not mean > 0:
        raise UnreadError(
            f"has a mean of {mean:.3g} over the ground, and an albedo is above 0; state its scale and offset in its "
            f"folder with: {gdal_lines.make_translate_command(name, '-a_scale SCALE -a_offset OFFSET')}"
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
