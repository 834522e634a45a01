"""Digital elevation models in GeoTIFF, read from the bytes.

Blender's own loader turns whole numbers into fractions of their range and knows neither pixel size
nor missing values, so heights are read here: TIFF 6.0 and BigTIFF, strips and tiles, one band, uncompressed or
deflate, with or without predictor. Tags: TIFF 6.0 (Adobe 1992), GeoTIFF 1.1 (OGC 19-008r4),
GDAL_NODATA (gdal.org/drivers/raster/gtiff.html).
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import IcyMoonError

_TYPES = {1: "B", 2: "s", 3: "H", 4: "I", 5: "II", 6: "b", 8: "h", 9: "i", 11: "f", 12: "d", 16: "Q", 17: "q"}
_COMPRESSIONS = {2: "CCITT", 3: "CCITT", 4: "CCITT", 5: "LZW", 6: "JPEG", 7: "JPEG", 32773: "PackBits",
                 34887: "LERC", 34925: "LZMA", 50000: "ZSTD", 50001: "WebP"}
_MEND = "convert it with: gdal_translate -b 1 -co COMPRESS=DEFLATE in.tif out.tif"
_GEOGRAPHIC = 2  # value of GTModelTypeGeoKey: coordinates are degrees


@dataclass(frozen=True)
class GeoTiff:
    """Heights (rows, columns) float64 in the file's unit, missing ones NaN, row 0 first in the file.

    ``pixel`` is the size of a pixel (east, north) in the unit of the file's coordinates and
    ``corner`` those of the centre of the lower left pixel; None where the file does not state them.
    ``degrees`` says that the unit is degrees of longitude and latitude.
    """

    heights: np.ndarray
    pixel: tuple[float, float] | None
    corner: tuple[float, float] | None
    degrees: bool


def read(path: Path) -> GeoTiff:
    """Read a one-band elevation model. Raises IcyMoonError where it cannot be, with the mend."""
    data = path.read_bytes()
    try:
        tags, order = _tags(data)
        grid = _pixels(path, data, tags, order)
    except (struct.error, zlib.error, KeyError, IndexError, ValueError) as error:
        raise IcyMoonError(f"{path}: is not a whole TIFF file ({error}); copy it again or {_MEND}") from None
    return GeoTiff(_without_missing(grid, tags.get(42113)), *_georeference(tags, grid.shape[0], path))


def _tags(data: bytes) -> tuple[dict[int, tuple[Any, ...]], str]:
    """Values of the first directory's tags by number, and the byte order for struct."""
    order = {b"II": "<", b"MM": ">"}[data[:2]]
    magic = struct.unpack_from(f"{order}H", data, 2)[0]
    if magic not in (42, 43):
        raise ValueError(f"magic number {magic}")
    big = magic == 43
    at = struct.unpack_from(f"{order}Q" if big else f"{order}I", data, 8 if big else 4)[0]
    count = struct.unpack_from(f"{order}Q" if big else f"{order}H", data, at)[0]
    head, inline = (f"{order}HHQ", 8) if big else (f"{order}HHI", 4)
    at += 8 if big else 2
    tags = {}
    for _ in range(count):
        tag, kind, n = struct.unpack_from(head, data, at)
        at += struct.calcsize(head)
        if kind in _TYPES:
            pattern = f"{order}{n}s" if kind == 2 else order + _TYPES[kind] * n
            place = at
            if struct.calcsize(pattern) > inline:
                place = struct.unpack_from(f"{order}Q" if big else f"{order}I", data, at)[0]
            tags[tag] = struct.unpack_from(pattern, data, place)
        at += inline
    return tags, order


def _pixels(path: Path, data: bytes, tags: dict[int, tuple[Any, ...]], order: str) -> np.ndarray:
    """The one band as float64 (rows, columns)."""
    columns, rows = int(tags[256][0]), int(tags[257][0])
    compression = tags.get(259, (1,))[0]
    if compression not in (1, 8, 32946):
        name = _COMPRESSIONS.get(compression, f"method {compression}")
        raise IcyMoonError(f"{path}: is compressed with {name}, which Icy Moon does not read; {_MEND}")
    if tags.get(277, (1,))[0] != 1:
        raise IcyMoonError(f"{path}: has {tags[277][0]} bands, a height map has one; {_MEND}")
    kind = {1: "u", 2: "i", 3: "f"}.get(tags.get(339, (1,))[0], "?")
    bits = int(tags.get(258, (1,))[0])
    if f"{kind}{bits}" not in ("u8", "u16", "u32", "i8", "i16", "i32", "f32", "f64"):
        raise IcyMoonError(f"{path}: holds {bits}-bit values of a kind that Icy Moon does not read; {_MEND}")
    number = np.dtype(f"{order}{kind}{bits // 8}")
    predictor = tags.get(317, (1,))[0]
    tiled = 322 in tags
    width, height = (int(tags[322][0]), int(tags[323][0])) if tiled else (columns, int(tags.get(278, (rows,))[0]))
    height = height if tiled else min(height, rows)
    if min(width, height, columns, rows) < 1:
        raise ValueError("no pixels")
    offsets, sizes = (tags[324], tags[325]) if tiled else (tags[273], tags[279])
    grid = np.full((rows, columns), np.nan)
    across = -(-columns // width)
    for k, (offset, size) in enumerate(zip(offsets, sizes, strict=True)):
        top, left = k // across * height, k % across * width
        if size == 0:
            continue  # a sparse file: the tile is missing
        block = data[offset:offset + size]
        block = block if compression == 1 else zlib.decompress(block)
        tall = height if tiled else min(height, rows - top)
        values = _unpredicted(block, (tall, width), number, predictor, order)
        grid[top:top + height, left:left + width] = values[:rows - top, :columns - left]
    return grid


def _unpredicted(block: bytes, shape: tuple[int, int], number: np.dtype, predictor: int, order: str) -> np.ndarray:
    """A strip or tile as numbers, horizontal differencing (2) or floating-point prediction (3) undone."""
    rows, columns = shape
    if predictor == 3:
        # TIFF Technical Note 3: each row's bytes, most significant first plane by plane, differenced.
        planes = np.frombuffer(block, np.uint8, rows * columns * number.itemsize).reshape(rows, -1)
        planes = np.cumsum(planes, axis=1, dtype=np.uint8).reshape(rows, number.itemsize, columns)
        return np.ascontiguousarray(planes.transpose(0, 2, 1)).view(number.newbyteorder(">")).reshape(rows, columns)
    values = np.frombuffer(block, number, rows * columns).reshape(rows, columns)
    if predictor == 2:
        return np.cumsum(values, axis=1, dtype=number.newbyteorder("="))
    if predictor != 1:
        raise ValueError(f"predictor {predictor}")
    return values


def _without_missing(grid: np.ndarray, nodata: tuple[Any, ...] | None) -> np.ndarray:
    """The grid with NaN for what the file calls missing, and for what no height can be."""
    grid[~(np.abs(grid) < 1e30)] = np.nan  # the most negative float32 is a usual mark of missing heights
    if nodata:
        value = float(nodata[0].split(b"\0")[0])
        if np.isfinite(value):
            grid[np.abs(grid - value) <= 1e-6 * abs(value)] = np.nan
    return grid


def _georeference(tags: dict[int, tuple[Any, ...]], rows: int,
                  path: Path) -> tuple[tuple[float, float] | None, tuple[float, float] | None, bool]:
    """Pixel size, coordinates of the lower left pixel centre, and whether they are degrees."""
    keys = tags.get(34735, ())
    known = {keys[k]: keys[k + 3] for k in range(4, len(keys) - 3, 4) if keys[k + 1] == 0}
    degrees = known.get(1024) == _GEOGRAPHIC
    if 33550 in tags:
        east, north = (abs(float(v)) for v in tags[33550][:2])
        column, row, _, x, y = (float(v) for v in tags.get(33922, (0.0,) * 6)[:5])
    elif 34264 in tags:
        m = [float(v) for v in tags[34264]]
        if m[1] or m[4]:
            raise IcyMoonError(f"{path}: its grid is rotated against north; turn it with: gdalwarp in.tif out.tif")
        east, north, column, row, x, y = abs(m[0]), abs(m[5]), 0.0, 0.0, m[3], m[7]
    else:
        return None, None, degrees
    if not (0 < east < np.inf and 0 < north < np.inf):
        return None, None, degrees
    centre = 0.0 if known.get(1025) == 2 else 0.5  # the tie point is at a pixel's corner unless "pixel is point"
    return (east, north), (x + (centre - column) * east, y - (rows - 1 + centre - row) * north), degrees
