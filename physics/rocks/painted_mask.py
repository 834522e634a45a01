"""Masks that a user paints over the patch: where rocks, dirt and frost lie.

A mask is an image over the square of ``terrain.size_m`` about the origin, seen from above, north up: 0 is nowhere, 1 is
as much as without a mask. Between the centres of its pixels a mask is bilinear; beyond the outermost centres it is
constant. Blender shows images in the same way, so the rocks of a build and its surfaces follow the same mask.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import ForeignBytes, RefusedError, parse_npy, read
from ...support.png_pixels import PNG_START, decode_png

#: The topic and the key of the setting of each mask.
MASK_SETTINGS = {
    "rocks": ("rocks", "mask_file"),
    "dirt": ("surface", "dirt_mask_file"),
    "frost": ("surface", "frost_mask_file"),
}
#: Largest file in bytes, most pixels, and bytes of memory for reading one.
_MAX_BYTES, _MAX_PIXELS, _MAX_MEMORY = 2**28, 2**24, 2**31
#: Channels of a PNG that are brightness, by their number; others are opacity.
_GREY_CHANNELS = {1: 1, 2: 1, 3: 3, 4: 3}
_FIX = "save it as PNG, or open it in Blender's Image Editor and press Use Image as Mask"


def find_pixel_centres(size_m: float, count: int) -> tuple[Array, Array]:
    """Compute the coordinates east and north (count, count) in metres of the pixels that fill a square of side
    ``size_m`` about the origin, north first.
    """
    along = (np.arange(count) + 0.5) / count * size_m - size_m / 2
    x_m, y_m = np.meshgrid(along, along[::-1])
    return x_m, y_m


@dataclass(frozen=True)
class PaintedMask:
    """Values (rows, columns) from 0 to 1, row 0 northernmost, over a square of side ``size_m`` about the origin."""

    values: Array
    size_m: float

    def shares(self, x_m: Array, y_m: Array) -> Array:
        """Interpolate the share, from 0 to 1, at coordinates east and north in metres."""
        rows, columns = self.values.shape
        column, left = _find_cells(x_m / self.size_m + 0.5, columns)
        row, above = _find_cells(0.5 - y_m / self.size_m, rows)
        right, below = np.minimum(left + 1, columns - 1), np.minimum(above + 1, rows - 1)
        upper = self.values[above, left] * (1 - column) + self.values[above, right] * column
        lower = self.values[below, left] * (1 - column) + self.values[below, right] * column
        return np.asarray(upper * (1 - row) + lower * row, np.float64)


def _find_cells(along: Array, count: int) -> tuple[Array, Array]:
    """Find the pixel before each place ``along`` a side (0 to 1), and the place's distance from this pixel's centre,
    from 0 to 1 at the next centre. Return distances first.
    """
    at = np.clip(along * count - 0.5, 0.0, count - 1.0)
    first = np.minimum(np.floor(at), max(count - 2, 0)).astype(int)
    return at - first, first


def read_mask(path: Path) -> Array:
    """Read the values (rows, columns) float32 from 0 to 1, row 0 northernmost, of a PNG or NPY file.

    A PNG counts as it is stored, black 0 and white 1, a colour by the mean of its bands, without its opacity. The file
    is read once while it stays the same. Raises IcyMoonError for a missing or damaged file, another kind, and for
    numbers outside 0 to 1.
    """
    try:
        state = path.stat()
    except OSError:
        return _read_mask(path, 0, 0)
    return _read_mask(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=8)
def _read_mask(path: Path, written_ns: int, size: int) -> Array:
    values = read(path, _parse_mask, "a mask", _FIX, _MAX_BYTES, _MAX_MEMORY)
    if not np.isfinite(values).all() or values.min() < 0 or values.max() > 1:
        raise IcyMoonError(f"{path}: a mask has numbers from 0 to 1, but this one has others; scale it.")
    values.setflags(write=False)
    return values


def _parse_mask(foreign: ForeignBytes) -> Array:
    if foreign.part(0, min(foreign.size, len(PNG_START))) == PNG_START:
        pixels = decode_png(foreign)
        values = pixels[..., : _GREY_CHANNELS[pixels.shape[2]]].mean(axis=2, dtype=np.float32)
    elif foreign.name.lower().endswith(".npy"):
        values = parse_npy(foreign, "fiub").astype(np.float32)
    else:
        raise RefusedError(f"is not a PNG or NPY file; {_FIX}.")
    if values.ndim != 2 or not values.size or values.size > _MAX_PIXELS:
        raise RefusedError(
            f"has the shape {values.shape}; a mask is an array (rows, columns), of at most {_MAX_PIXELS} pixels."
        )
    return values
