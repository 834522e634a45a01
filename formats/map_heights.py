"""Heights of a map around a site, as means over the cells of nested rings: a pyramid that is made while the file is
read.

Pieces of the file's own tiles or strips are read one after the other and summed, so that memory does not grow with the
file. Overviews in a file are not used: it does not state whether they are averages.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..physics.mesh.blend_maps import LevelMeans
from ..physics.mesh.height_map import USUAL_MARKS, clear_missing_mark
from ..physics.mesh.nested_rings import Level
from ..physics.mesh.square_means import Squares, SquareSums
from ..support.arrays import Array
from ..support.foreign_bytes import ForeignBytes, read
from . import gdal_lines
from .geotiff import apply_mask, clear_missing, scale_to_metres, warn_unstated_metres
from .map_frame import MapFrame
from .map_projection import make_crs_text, states_degrees
from .placed_pixels import PixelGrid, PlacedImage, Way, interpolate_pixels, open_placed_image, reverse_range
from .tiff import FIX, KIND, MAX_BYTES, UnreadError, find_tile_size, grant_memory, read_pixels

#: Largest number of pixels of a piece that is read at once, and of a window that is kept for all levels inside it.
_BLOCK_PIXELS, _KEPT_PIXELS = 2**21, 2**23
#: Widest piece, in pixels.
_BLOCK_WIDTH = 4096
#: Number of positions along a side of a level at which a projection is computed; between them it is interpolated.
_PLACES = 33
#: Heights of a map in another projection are interpolated from a grid of means. These are the grid's finest step in
#: pixels, and its largest number of means along a side.
_FINEST_STEP, _MAX_STEPS = 0.125, 4096
#: Half the width of the narrowest square, in pixels. Heights between pixels are bilinear, so a narrower square has the
#: same mean.
_MIN_HALF = 1 / 32
#: Tolerated distance in pixels of a site beyond the edge of a map, by rounding.
_ROUNDED = 1e-6
#: Largest error of a level's bilinear projection, in cells of the level.
_MAX_BENT_CELLS = 0.5
#: Least width of the squares over which the known share of the map is taken, in cells.
WIDE_CELLS = 4.0


@dataclass(frozen=True)
class MapCover:
    """The extent of a map seen from the site: the width of a pixel in metres of ground at the site, and the distances
    in metres, along x or y, from the site to the farthest and to the nearest edge. The nearest distance is negative for
    a site beside the map."""

    pixel_m: float
    farthest_m: float
    nearest_m: float


@dataclass(frozen=True)
class MapMeans:
    """The means of a map at each level, and warnings for the user."""

    levels: list[LevelMeans]
    warnings: tuple[str, ...]


#: Returns heights (rows, columns) in metres for pixels (rows from the south, columns from the west), NaN if missing.
ReadBlock = Callable[[range, range], Array]


@dataclass(frozen=True)
class MapPixels:
    """The pixels of a map around a site: the ``shape`` (rows, columns) of all pixels, the position ``origin`` (column,
    row) of the site from the centre of the south-western pixel, and the pixels per metre of ground along x and y.
    ``cut`` divides a window into pieces for ``read``.

    ``way`` converts metres around the site to columns and rows; None if the pixels lie along the axes. ``bent`` is the
    end of a sentence about a map around which this conversion fails.
    """

    shape: tuple[int, int]
    origin: tuple[float, float]
    per_m: tuple[float, float]
    read: ReadBlock
    cut: Callable[[range, range], Iterator[tuple[range, range]]]
    way: Way | None = None
    bent: str = ""

    @property
    def cover(self) -> MapCover:
        """The extent of the map about the site."""
        pixel = [1 / each for each in self.per_m]
        west, south = ((self.origin[k] + 0.5) * pixel[k] for k in range(2))
        east, north = ((self.shape[1 - k] - 0.5 - self.origin[k]) * pixel[k] for k in range(2))
        edges = west, east, south, north
        return MapCover(float(np.mean(pixel)), max(edges), min(edges))


def convert_array_to_pixels(heights_m: Array, pixel_m: tuple[float, float], west_m: float, south_m: float) -> MapPixels:
    """Make pixels from heights (rows, columns) in memory, row 0 northernmost. The centre of the lower left pixel is at
    ``west_m`` and ``south_m``."""
    from_south = heights_m[::-1]

    def read_block(rows: range, columns: range) -> Array:
        return from_south[rows.start : rows.stop, columns.start : columns.stop]

    def cut(rows: range, columns: range) -> Iterator[tuple[range, range]]:
        step = max(1, _BLOCK_PIXELS // max(len(columns), 1))
        for start in range(rows.start, rows.stop, step):
            yield range(start, min(start + step, rows.stop)), columns

    per_m = 1 / pixel_m[0], 1 / pixel_m[1]
    rows, columns = heights_m.shape
    return MapPixels((rows, columns), (-west_m * per_m[0], -south_m * per_m[1]), per_m, read_block, cut)


def read_cover(path: Path, frame: MapFrame) -> MapCover:
    """Read the extent of a map about the site of ``frame`` from the file's tags. Raises IcyMoonError as ``read_means``
    does."""

    def parse(foreign: ForeignBytes) -> MapCover:
        grant_memory(foreign)
        return _place_pixels(_FileBlocks(foreign, open_placed_image(foreign, frame), None, 1.0), frame).cover

    return read(path, parse, KIND, FIX, MAX_BYTES)


def read_means(
    path: Path,
    frame: MapFrame,
    levels: Sequence[Level],
    wide_m: float,
    missing: float | None,
    height_scale: float = 1.0,
) -> MapMeans:
    """Read the mean heights of a map over the cells of ``levels``, see ``measure_levels``.

    ``missing`` marks missing values beside the file's own marks; ``height_scale`` multiplies the heights. Raises
    IcyMoonError for a file that is not a height map, has no place, is of another body, has an unsupported projection,
    is bent around the site, or does not contain the site.
    """

    def parse(foreign: ForeignBytes) -> MapMeans:
        grant_memory(foreign)
        blocks = _FileBlocks(foreign, open_placed_image(foreign, frame), missing, height_scale)
        found = measure_levels(_place_pixels(blocks, frame), levels, wide_m)
        return MapMeans(found, tuple(blocks.list_warnings()))

    return read(path, parse, KIND, FIX, MAX_BYTES)


class _FileBlocks:
    """Reads pieces of a file as heights in metres."""

    def __init__(self, foreign: ForeignBytes, placed: PlacedImage, missing: float | None, height_scale: float) -> None:
        self.placed, self.name = placed, foreign.name
        self._foreign, self._missing, self._height_scale = foreign, missing, height_scale
        self._extremes = math.inf, -math.inf
        self._states_unit = True

    def read(self, rows: range, columns: range) -> Array:
        """Read the heights of pixels, see ``ReadBlock``."""
        grid, image = self.placed.grid, self.placed.images[0]
        window = grid.find_window(rows, columns)
        grant_memory(self._foreign)  # the piece before is no longer held
        values, number = read_pixels(self._foreign, image, window)
        clear_missing(values, number, image.tags.get(42113))
        if self._missing is not None:
            clear_missing_mark(values, self._missing, number)
        apply_mask(values, self._foreign, self.placed.images, window)
        known = values[np.isfinite(values)]
        if known.size:
            self._extremes = min(self._extremes[0], float(known.min())), max(self._extremes[1], float(known.max()))
        self._states_unit = scale_to_metres(values, image, self.placed.keys)[1]
        return grid.turn_north_up(values)[::-1] * self._height_scale

    def cut(self, rows: range, columns: range) -> Iterator[tuple[range, range]]:
        """Cut a window into pieces of whole tiles, so that each tile is read once."""
        grid = self.placed.grid
        width, height = find_tile_size(self.placed.images[0])
        across = len(columns) if width >= grid.shape[1] else max(width, _BLOCK_WIDTH // width * width)
        down = max(height, _BLOCK_PIXELS // min(max(across, 1), max(len(columns), 1)) // height * height)
        for some_rows in _cut_range(rows, down, grid.shape[0] if grid.down else 0):
            if width >= grid.shape[1]:
                yield some_rows, columns
                continue
            for some_columns in _cut_range(columns, across, 0 if grid.right else grid.shape[1]):
                yield some_rows, some_columns

    def list_warnings(self) -> Iterator[str]:
        """List sentences on the values that were read, without the name of the file."""
        if self._missing is None and 42113 not in self.placed.images[0].tags:
            for extreme in self._extremes:
                if abs(extreme) in USUAL_MARKS:
                    state = gdal_lines.make_edit_command(self.name, f"-a_nodata {extreme:g}")
                    yield (
                        f"it has heights of exactly {extreme:g}, a usual mark of missing heights, which were read as "
                        f"heights; set source.missing, or state the mark in its folder with: {state}"
                    )
        if not self._states_unit and not states_degrees(self.placed.keys):
            yield from warn_unstated_metres(self.placed.unit_m, self.name)


def _cut_range(wanted: range, step: int, turned: int) -> Iterator[range]:
    """Cut a range at multiples of ``step``. They are counted from the other end if ``turned``, the number of pixels, is
    not 0."""
    there = reverse_range(wanted, turned) if turned else wanted
    start = there.start
    while start < there.stop:
        stop = min((start // step + 1) * step, there.stop)
        yield reverse_range(range(start, stop), turned) if turned else range(start, stop)
        start = stop


def _place_pixels(blocks: _FileBlocks, frame: MapFrame) -> MapPixels:
    """Find the pixels of a file around a site. Raises UnreadError if the site is outside."""
    placed, grid = blocks.placed, blocks.placed.grid
    if placed.way is None:
        per_m = tuple(1 / (frame.scale[k] * grid.size[k]) for k in range(2))
        at, way = frame.origin, None
    else:
        at, way = _try_way(placed.way, *frame.origin), _make_pixel_way(placed.way, grid, frame)
        here, east, north = (np.array(way(*offset)) for offset in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))
        per_m = tuple(float(math.hypot(*each)) for each in np.stack([east - here, north - here], axis=1))
    column, row = grid.to_pixels(np.array(at[0]), np.array(at[1]))
    if not (-_ROUNDED <= column <= grid.shape[1] + _ROUNDED and -_ROUNDED <= row <= grid.shape[0] + _ROUNDED):
        a, b, c, d = (f"{edge:.10g}" for edge in placed.edges)
        x, y = (f"{each / placed.unit_m:.10g}" for each in at)
        raise UnreadError(
            f"does not contain the site, which is at {x} east, {y} north in its coordinates, for these go from {a} "
            f"to {b} east and from {c} to {d} north; give a map that contains the site."
        )
    origin = float(column) - 0.5, float(row) - 0.5
    bent = _describe_bent_map(blocks.name, frame) if way else ""
    return MapPixels(grid.shape, origin, (per_m[0], per_m[1]), blocks.read, blocks.cut, way, bent)


def _try_way(way: Way, x: float, y: float) -> tuple[float, float]:
    """Convert a position by ``way``; NaN where the projection is undefined."""
    try:
        return way(x, y)
    except (ValueError, OverflowError, ZeroDivisionError):
        return math.nan, math.nan


def _make_pixel_way(way: Way, grid: PixelGrid, frame: MapFrame) -> Way:
    """Make the conversion from metres around the site to columns and rows, counted from pixel centres."""

    def to_pixel(x_m: float, y_m: float) -> tuple[float, float]:
        x, y = _try_way(way, frame.origin[0] + x_m / frame.scale[0], frame.origin[1] + y_m / frame.scale[1])
        return (x - grid.west) / grid.size[0] - 0.5, (y - grid.south) / grid.size[1] - 0.5

    return to_pixel


def _describe_bent_map(name: str, frame: MapFrame) -> str:
    """Return the end of a sentence about a map that cannot be laid around a site by another projection."""
    target = make_crs_text(frame.geokeys.numbers(), frame.unit_m)
    option = f'-t_srs "{target}"'
    fix = f" with: {gdal_lines.make_warp_command(name, option)}" if target else "."
    return f"is bent or torn around the site; project it to the system of source.file in its folder{fix}"


def measure_levels(pixels: MapPixels, levels: Sequence[Level], wide_m: float) -> list[LevelMeans]:
    """Measure the mean height of a map over the cell around each point of each level.

    The share of known heights is measured over squares of ``wide_m``, or of ``WIDE_CELLS`` cells if these are wider. In
    another projection, cells lie along the axes of the map and are as wide there as the level's cells. Raises
    UnreadError for a map that is bent or torn around the site.
    """
    found: list[LevelMeans] = []
    for level in reversed(levels):
        places = _make_resampling_grid(pixels, level)
        wide = places.squares.widened(max(WIDE_CELLS, wide_m / level.cell_m))
        sums = SquareSums(places.squares.at_least(_MIN_HALF), wide.at_least(_MIN_HALF))
        rows, columns = _find_window(sums.wide, pixels.shape)
        if len(rows) and len(columns):
            if len(rows) * len(columns) <= _KEPT_PIXELS:
                pixels = _hold_window_in_memory(pixels, rows, columns)
            for some_rows, some_columns in pixels.cut(rows, columns):
                sums.add(pixels.read(some_rows, some_columns), some_rows.start, some_columns.start)
        found.append(places.interpolate(sums))
    return found[::-1]


def _find_window(squares: Squares, shape: tuple[int, int]) -> tuple[range, range]:
    """Find the rows and columns of a map that squares touch."""
    left, right, low, high = squares.window
    rows, columns = (
        range(max(0, math.floor(first)), max(0, min(count, math.ceil(last) + 1)))
        for first, last, count in ((low, high, shape[0]), (left, right, shape[1]))
    )
    return rows, columns


def _hold_window_in_memory(pixels: MapPixels, rows: range, columns: range) -> MapPixels:
    """Return the same pixels with a window of them in memory."""
    kept = np.empty((len(rows), len(columns)))
    for some_rows, some_columns in pixels.cut(rows, columns):
        down = slice(some_rows.start - rows.start, some_rows.stop - rows.start)
        across = slice(some_columns.start - columns.start, some_columns.stop - columns.start)
        kept[down, across] = pixels.read(some_rows, some_columns)

    def read_block(wanted_rows: range, wanted_columns: range) -> Array:
        return kept[
            wanted_rows.start - rows.start : wanted_rows.stop - rows.start,
            wanted_columns.start - columns.start : wanted_columns.stop - columns.start,
        ]

    def cut(wanted_rows: range, wanted_columns: range) -> Iterator[tuple[range, range]]:
        yield wanted_rows, wanted_columns

    return replace(pixels, read=read_block, cut=cut)


@dataclass(frozen=True)
class _ResamplingGrid:
    """The square windows over which pixels are averaged, and the positions ``at`` (column, row) of a level's points
    between them, in steps of windows. ``at`` is None if the points are the middles of the windows."""

    squares: Squares
    at: tuple[Array, Array] | None

    def interpolate(self, sums: SquareSums) -> LevelMeans:
        if self.at is None:
            return LevelMeans(sums.means, sums.wide_share)
        total, weight, share = (
            interpolate_pixels(each, *self.at) for each in (sums.total, sums.weight, sums.wide_share)
        )
        some = weight > 1e-9 * float(sums.weight.max(initial=0.0)) if weight.size else weight > 0
        return LevelMeans(np.where(some, total / np.where(some, weight, 1.0), np.nan), share)


def _make_resampling_grid(pixels: MapPixels, level: Level) -> _ResamplingGrid:
    axis = level.axis_m
    if pixels.way is None:
        columns, rows = (pixels.origin[k] + axis * pixels.per_m[k] for k in range(2))
        return _ResamplingGrid(
            Squares(columns, rows, (level.cell_m * pixels.per_m[0] / 2, level.cell_m * pixels.per_m[1] / 2)), None
        )
    some = np.linspace(-level.half_m, level.half_m, _PLACES)
    found = np.array([[pixels.way(float(x), float(y)) for x in some] for y in some])
    step = some[1] - some[0]
    along_x, along_y = (np.diff(found, axis=axis_of) / step for axis_of in (1, 0))
    per_m = [float(np.median(np.hypot(along_x[:-1, :, k], along_y[:, :-1, k]))) for k in range(2)]
    middle = np.array([[pixels.way(float(x), float(y)) for x in some[:-1] + step / 2] for y in some[:-1] + step / 2])
    bent = np.abs(middle - (found[:-1, :-1] + found[1:, :-1] + found[:-1, 1:] + found[1:, 1:]) / 4)
    width = [max(level.cell_m * each, 1.0) for each in per_m]
    low, high = found.min(axis=(0, 1)), found.max(axis=(0, 1))
    steps = [max(level.cell_m * each / 2, _FINEST_STEP) for each in per_m]
    if not (np.isfinite(found).all() and np.isfinite(middle).all()) or any(
        float(bent[..., k].max()) > _MAX_BENT_CELLS * width[k] or (high[k] - low[k]) / steps[k] > _MAX_STEPS
        for k in range(2)
    ):
        raise UnreadError(pixels.bent)
    columns, rows = (low[k] + steps[k] * np.arange(math.ceil((high[k] - low[k]) / steps[k]) + 2) for k in range(2))
    squares = Squares(columns, rows, (level.cell_m * per_m[0] / 2, level.cell_m * per_m[1] / 2))
    share = (axis + level.half_m) / step
    y, x = np.meshgrid(share, share, indexing="ij")
    at = [(interpolate_pixels(found[..., k], x, y) - low[k]) / steps[k] for k in range(2)]
    return _ResamplingGrid(squares, (at[0], at[1]))
