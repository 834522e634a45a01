"""Reads heights from a file: GeoTIFF and NPY from their bytes, PNG and EXR through Blender's image loader.

Measured in 4.2, 5.0 and 5.2: Blender reads all 8 and 16-bit grey levels, and all 32-bit floats of an EXR, exactly. It
scales the whole numbers of a TIFF, though, and up to 5.0 it returns wrong values for an EXR whose only channel is not
called Y.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...errors import IcyMoonError
from ...formats import geotiff
from ...formats.exr_layout import is_whole
from ...formats.mesh_file import read_opening
from ...physics.mesh.height_map import NO_HEIGHT
from .import_mesh import open_scratch_scene

SUFFIXES = (".tif", ".tiff", ".npy", ".png", ".exr")
_EXR_MAGIC = b"\x76\x2f\x31\x01"


@dataclass(frozen=True)
class Heights:
    """Values (rows, columns) float64, with row 0 in the north and NaN for missing values.

    Their unit is metres for a GeoTIFF, otherwise that of the file. ``pixel_m`` (east, north) and ``corner_m`` (centre
    of the lower left pixel) are from the file, or None; then ``unplaced`` is the reason, as the end of a sentence.
    ``report`` contains other facts from the file, and ``warnings`` are for the user.
    """

    values: np.ndarray
    pixel_m: tuple[float, float] | None = None
    corner_m: tuple[float, float] | None = None
    unplaced: str = "does not state the size of its pixels"
    report: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def read_heights(path: Path) -> Heights:
    """Read a height map. Raises IcyMoonError if it is missing, of another kind, unreadable or too small."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise IcyMoonError(f"{path}: is not a height map that Icy Moon reads; give one of {', '.join(SUFFIXES)}.")
    start = read_opening(path)
    reader = {".tif": _read_tiff, ".tiff": _read_tiff, ".npy": _read_npy, ".png": _read_png, ".exr": _read_exr}[suffix]
    heights = reader(path, start)
    if min(heights.values.shape) < 2:
        rows, columns = heights.values.shape
        raise IcyMoonError(f"{path}: has {columns} x {rows} pixels; a height map needs at least 2 x 2.")
    return heights


def _read_tiff(path: Path, start: bytes) -> Heights:
    if start[:4] not in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        raise IcyMoonError(f"{path}: is not a TIFF file, despite its name.")
    tiff = geotiff.read(path)
    return Heights(tiff.heights_m, tiff.pixel_m, tiff.corner_m, tiff.unplaced, tiff.report, tiff.warnings)


def _read_npy(path: Path, start: bytes) -> Heights:
    try:
        values = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise IcyMoonError(f"{path}: is not an array that numpy.save wrote ({error}).") from None
    if values.ndim != 2 or values.dtype.kind not in "iuf":
        raise IcyMoonError(f"{path}: contains {values.dtype} values of shape {values.shape}; "
                           "save one number per pixel as an array (rows, columns), north first.")
    return Heights(_mask_missing(values.astype(np.float64)))


def _read_png(path: Path, start: bytes) -> Heights:
    if not start.startswith(b"\x89PNG\r\n\x1a\n") or len(start) < 33:
        raise IcyMoonError(f"{path}: is not a PNG file, despite its name.")
    if not _chunks_are_whole(path.read_bytes()):
        raise IcyMoonError(f"{path}: is incomplete or damaged; copy it again.")
    bits, colour = start[24], start[25]
    if colour not in (0, 4):
        raise IcyMoonError(f"{path}: is a colour image, not heights; save it as 16-bit grey.")
    highest = 2**bits - 1
    return Heights(np.rint(_load_pixels(path).astype(np.float64) * highest))


def _chunks_are_whole(data: bytes) -> bool:
    """Whether a PNG is complete and all its checksums are right. Otherwise Blender would show black."""
    at = 8
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 4:at + 8 + length]
        if len(data) < at + 12 + length or zlib.crc32(body) != struct.unpack_from(">I", data, at + 8 + length)[0]:
            return False
        if kind == b"IEND":
            return True
        at += 12 + length
    return False


def _read_exr(path: Path, start: bytes) -> Heights:
    if not start.startswith(_EXR_MAGIC):
        raise IcyMoonError(f"{path}: is not an EXR file, despite its name.")
    channels = _exr_channels(start)
    if not {"Y", "R"} & set(channels):
        raise IcyMoonError(f"{path}: has the channels {', '.join(channels) or '(several parts)'}; "
                           "save the heights as one channel called Y.")
    if not is_whole(path):  # Blender crashes on an incomplete file
        raise IcyMoonError(f"{path}: is incomplete, or stored in tiles; save it again, in scan lines.")
    return Heights(_mask_missing(_load_pixels(path).astype(np.float64)))


def _mask_missing(values: np.ndarray) -> np.ndarray:
    """The values, with NaN for those that are missing or too large to be a height."""
    return np.where(np.abs(values) < NO_HEIGHT, values, np.nan)


def _exr_channels(start: bytes) -> list[str]:
    """Names of the channels in the first header."""
    at = start.find(b"channels\0chlist\0")
    if at < 0 or struct.unpack_from("<I", start, 4)[0] & 0x1000:
        return []
    at, names = at + 20, []
    while at < len(start) and start[at]:
        end = start.index(b"\0", at)
        names.append(start[at:end].decode("latin-1"))
        at = end + 17
    return names


def _load_pixels(path: Path) -> np.ndarray:
    """The first channel (rows, columns) float32, loaded by Blender without colour conversion."""
    with open_scratch_scene():
        try:
            image = bpy.data.images.load(str(path), check_existing=False)
        except RuntimeError as error:
            raise IcyMoonError(f"{path}: Blender cannot read it ({str(error).strip()}).") from None
        image.colorspace_settings.name = "Non-Color"
        image.alpha_mode = "CHANNEL_PACKED"
        columns, rows = image.size
        buffer = np.empty(columns * rows * image.channels, np.float32)
        if not image.has_data or not buffer.size:
            raise IcyMoonError(f"{path}: Blender cannot read its pixels; save it again.")
        image.pixels.foreach_get(buffer)
        return buffer.reshape(rows, columns, -1)[::-1, :, 0].copy()  # Blender's first row is the bottom one
