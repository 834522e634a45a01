"""Reads heights from a file: GeoTIFF and NPY from their bytes, PNG and EXR through Blender's image loader.

Measured in 4.2, 5.0 and 5.2: Blender reads all 8 and 16-bit grey levels, and all 32-bit floats of an EXR, exactly. But
Blender scales the whole numbers of a TIFF, and up to 5.0 it returns wrong values for an EXR whose only channel is not
called Y.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...formats import geotiff, sidecar_files
from ...formats.exr_layout import KIND as EXR
from ...formats.exr_layout import read_layout
from ...formats.geotiff import MapPlace, Site
from ...formats.image_size import check_pixels
from ...formats.map_site import TIFF_SUFFIXES, read_start
from ...physics.mesh.height_map import NO_HEIGHT, clear_stated_mark
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import ForeignBytes, RefusedError, explain_errors, parse_npy, read
from ...support.png_pixels import check_png
from .import_mesh import open_scratch_scene

_PNG_START, _EXR_START = b"\x89PNG\r\n\x1a\n", b"\x76\x2f\x31\x01"
#: Maximum number of pixels of a PNG or EXR file (4096 x 4096 take a gigabyte in Blender), and advice for larger files.
_MAX_PIXELS, _SMALLER_ADVICE = 2**24, "cut out what is needed, or save it as GeoTIFF"
#: Mean radius of Earth, m.
_EARTH_RADIUS_M = 6371008.8
#: Maximum number of bytes of an array.
_MAX_ARRAY_BYTES = 2**36
#: Maximum number of channels that a sentence names.
_MAX_NAMED_CHANNELS = 8


@dataclass(frozen=True)
class Heights:
    """A height map: ``values`` (rows, columns) float64, with row 0 in the north and NaN for missing values.

    Their unit is metres for a GeoTIFF, otherwise the unit of the file. ``pixel_m`` (east, north) and ``corner_m``
    (centre of the lower left pixel) are from the file. Without them they are None, and ``unplaced`` is the reason, as
    the end of a sentence. ``report`` contains other facts from the file, and ``warnings`` are for the user.
    ``file_shape`` is the shape of the whole file. ``place`` is the position of the site on a map; then ``corner_m`` is
    relative to the site's origin. ``stored`` is the type of the file's numbers.
    """

    values: Array
    pixel_m: tuple[float, float] | None = None
    corner_m: tuple[float, float] | None = None
    unplaced: str = sidecar_files.NO_PIXEL_SIZE
    report: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    file_shape: tuple[int, int] | None = None
    place: MapPlace | None = None
    stored: np.dtype[Any] = field(default_factory=lambda: np.dtype(int))


def read_heights(
    path: Path, site: Site | None = None, missing: float | None = None, body_radius_m: float = _EARTH_RADIUS_M
) -> Heights:
    """Read a height map. Of a large GeoTIFF, only the part that the ``site`` needs is read.

    ``missing`` is a value that means no height, in addition to the values that the file declares missing.
    ``body_radius_m`` is the body's radius in metres for commands that convert a file in degrees. Raises IcyMoonError if
    the file is missing, of another kind, unreadable or too small.
    """
    start, suffix = read_start(path, body_radius_m), path.suffix.lower()
    if suffix in TIFF_SUFFIXES:
        heights = _read_tiff(path, start, site, missing)
    else:
        heights = {".npy": _read_npy, ".png": _read_png, ".exr": _read_exr}[suffix](path, start)
        if missing is not None:
            sentences = clear_stated_mark(heights.values, missing, heights.stored)
            heights = replace(heights, report=(*heights.report, *sentences))
    if min(heights.values.shape) < 2:
        rows, columns = heights.values.shape
        raise IcyMoonError(f"{path}: has {columns} x {rows} pixels; a height map needs at least 2 x 2.")
    return heights


def _read_tiff(path: Path, start: bytes, site: Site | None, missing: float | None) -> Heights:
    if start[:4] not in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        raise IcyMoonError(f"{path}: is not a TIFF file, despite its name.")
    tiff = geotiff.read(path, site, missing)
    return Heights(
        tiff.heights_m,
        tiff.pixel_m,
        tiff.corner_m,
        tiff.unplaced,
        tiff.report,
        tiff.warnings,
        tiff.file_shape,
        tiff.place,
    )


def _read_npy(path: Path, start: bytes) -> Heights:
    def parse(foreign: ForeignBytes) -> Array:
        values = parse_npy(foreign, "iuf")
        if values.ndim != 2:
            raise RefusedError(
                f"contains {values.dtype} values of shape {values.shape}; "
                "save one number per pixel as an array (rows, columns), north first."
            )
        return values

    fix = "save the numbers by numpy.save as an array (rows, columns), north first"
    values = read(path, parse, "an array of numbers", fix, _MAX_ARRAY_BYTES)
    return Heights(_mask_missing(values.astype(np.float64)), stored=values.dtype)


def _read_png(path: Path, start: bytes) -> Heights:
    if not start.startswith(_PNG_START):
        raise IcyMoonError(f"{path}: is not a PNG file, despite its name.")

    def parse(foreign: ForeignBytes) -> int:
        head = check_png(foreign)
        if head.colours not in (0, 4):
            raise RefusedError("is a colour image, not heights; save it as 16-bit grey.")
        check_pixels(foreign, head.width * head.height, _MAX_PIXELS, _SMALLER_ADVICE)
        return head.bits

    highest = 2 ** read(path, parse, "a whole PNG file", "copy it again") - 1
    return Heights(
        np.rint(_load_pixels(path).astype(np.float64) * highest),
        unplaced=sidecar_files.why_unplaced(path),
        warnings=(*sidecar_files.describe_world_file(path), *sidecar_files.describe_gdal_notes(path)),
    )


def _read_exr(path: Path, start: bytes) -> Heights:
    if not start.startswith(_EXR_START):
        raise IcyMoonError(f"{path}: is not an EXR file, despite its name.")

    def parse(foreign: ForeignBytes) -> None:
        parts = read_layout(foreign)
        names = list(parts[0].channels) if len(parts) == 1 else ["(several parts)"]
        if not {"Y", "R"} & set(names):
            more = ", ..." if len(names) > _MAX_NAMED_CHANNELS else ""
            raise RefusedError(
                f"has the channels {', '.join(map(_show_name, names[:_MAX_NAMED_CHANNELS]))}{more}; "
                "save the heights as one channel called Y."
            )
        rows, columns = parts[0].shape
        check_pixels(foreign, rows * columns * -(-len(names) // 4), _MAX_PIXELS, _SMALLER_ADVICE)

    # Blender crashes on an incomplete file.
    read(path, parse, EXR, "save it again whole, in scan lines")
    return Heights(_mask_missing(_load_pixels(path).astype(np.float64)), stored=np.dtype(np.float32))


def _show_name(name: str) -> str:
    """Make a name from a file printable, for a sentence: at most 40 letters."""
    return "".join(letter if letter.isprintable() else "?" for letter in name[:40])


def _mask_missing(values: Array) -> Array:
    """Replace values that are missing or too large for a height by NaN."""
    return np.where(np.abs(values) < NO_HEIGHT, values, np.nan)


def _load_pixels(path: Path) -> Array:
    """Load the first channel (rows, columns), float32, of an image by Blender, without colour conversion."""
    with open_scratch_scene():
        with explain_errors(path, "an image", "save it again"):
            image = bpy.data.images.load(str(path), check_existing=False)
        image.colorspace_settings.name = "Non-Color"
        image.alpha_mode = "CHANNEL_PACKED"
        columns, rows = image.size
        buffer = np.empty(columns * rows * image.channels, np.float32)
        if not image.has_data or not buffer.size:
            raise IcyMoonError(f"{path}: Blender cannot read its pixels; save it again.")
        image.pixels.foreach_get(buffer)
        return buffer.reshape(rows, columns, -1)[::-1, :, 0].copy()  # Blender's first row is the bottom one
