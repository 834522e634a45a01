"""Images as TIFF files: 8 and 16-bit whole numbers and 32-bit floats, with a place on the ground if they have one.

TIFF 6.0 (Adobe 1992) in strips, compressed by deflate (Adobe's technical note of 2002); places by GeoTIFF 1.1 (OGC
19-008r4). ``formats.geotiff`` reads them back, as do GDAL, QGIS, OpenCV and Blender.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from ..support.arrays import Array
from .geokeys import GeoKeys

#: Approximate bytes of a strip before compression; readers hold one strip at a time.
_STRIP_BYTES = 1 << 18
#: TIFF's number of a type, and its letter in ``struct``: text,
_ASCII = (2, "s")
#: 16-bit whole numbers,
_SHORT = (3, "H")
#: 32-bit whole numbers,
_LONG = (4, "I")
#: 64-bit floats.
_DOUBLE = (12, "d")


@dataclass(frozen=True)
class Place:
    """The place of a north-up image: the size of a pixel and the outer corner of the north-west pixel, in metres.
    ``frame`` names the coordinate system in a sentence. ``heights`` is true if values are heights in metres. ``notes``
    are texts by name, which GDAL shows as metadata."""

    pixel_m: float
    west_m: float
    north_m: float
    frame: str
    heights: bool = True
    notes: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class MapPlace:
    """The position of a north-up image on a map: the size of a pixel and the outer corner of the north-west one, in the
    unit of the coordinate system that the GeoKeys state.

    ``unit`` names the unit of the values for GDAL, ``missing`` is the value of pixels without one, and ``notes`` are
    texts by name that GDAL shows as metadata.
    """

    pixel: tuple[float, float]
    west: float
    north: float
    geokeys: GeoKeys
    unit: str = ""
    missing: str = "nan"
    notes: Mapping[str, str] = field(default_factory=dict)

    def make_tags(self) -> dict[int, tuple[tuple[int, str], list[float] | bytes]]:
        """Make the GeoTIFF tags for this map position."""
        keys = self.geokeys.for_areas_in_metres()
        return {
            33550: (_DOUBLE, [*self.pixel, 0.0]),
            33922: (_DOUBLE, [0.0, 0.0, 0.0, self.west, self.north, 0.0]),
            34735: (_SHORT, list(keys.directory)),
            **({34736: (_DOUBLE, list(keys.doubles))} if keys.doubles else {}),
            **({34737: (_ASCII, keys.text.encode("ascii", "replace") + b"\0")} if keys.text else {}),
            42112: (_ASCII, _make_metadata(self.notes, self.unit)),
            42113: (_ASCII, self.missing.encode("ascii") + b"\0"),
        }


def encode_tiff(pixels: Array, place: Place | MapPlace | None = None, description: str = "") -> bytes:
    """Encode pixels (H, W) or (H, W, bands), top row first, as a TIFF file: uint8, uint16 or float32.

    Values of float images may be NaN, which ``place`` marks as missing. Raises ValueError for another type or shape.
    """
    image = pixels[..., None] if pixels.ndim == 2 else pixels
    kinds = {np.dtype(np.uint8): 1, np.dtype(np.uint16): 1, np.dtype(np.float32): 3}
    if image.ndim != 3 or image.dtype not in kinds or not image.size:
        raise ValueError(f"pixels of {pixels.dtype} and shape {pixels.shape} are not a supported image")
    rows, columns, bands = image.shape
    bits = 8 * image.dtype.itemsize
    rows_each = max(1, _STRIP_BYTES // (columns * bands * image.dtype.itemsize))
    data = np.ascontiguousarray(image, image.dtype.newbyteorder("<"))
    strips = [zlib.compress(data[at : at + rows_each].tobytes(), 6) for at in range(0, rows, rows_each)]
    tags: dict[int, tuple[tuple[int, str], list[float] | bytes]] = {
        256: (_LONG, [columns]),
        257: (_LONG, [rows]),
        258: (_SHORT, [bits] * bands),
        259: (_SHORT, [8]),
        262: (_SHORT, [2 if bands >= 3 else 1]),
        277: (_SHORT, [bands]),
        278: (_LONG, [rows_each]),
        279: (_LONG, [len(strip) for strip in strips]),
        284: (_SHORT, [1]),
        339: (_SHORT, [kinds[image.dtype]] * bands),
    }
    if description:
        tags[270] = (_ASCII, description.encode("ascii", "replace") + b"\0")
    if extra := bands - (3 if bands >= 3 else 1):
        tags[338] = (_SHORT, [0] * extra)
    if isinstance(place, MapPlace):
        tags |= place.make_tags()
    elif place is not None:
        tags |= _make_place_tags(place, image.dtype.kind == "f")
    return _assemble_file(tags, strips)


def _make_place_tags(place: Place, floats: bool) -> dict[int, tuple[tuple[int, str], list[float] | bytes]]:
    """Make the scale, the tie point and the GeoKeys of a user-defined map in metres, which readers take for a local
    frame."""
    name = place.frame.encode("ascii", "replace") + b"|"
    keys = [
        (1024, 0, 1, 1),
        (1025, 0, 1, 1),
        (1026, 34737, len(name), 0),
        (3072, 0, 1, 32767),
        (3076, 0, 1, 9001),
        *([(4099, 0, 1, 9001)] if place.heights else []),
    ]
    directory = [1, 1, 0, len(keys), *(number for key in keys for number in key)]
    return {
        33550: (_DOUBLE, [place.pixel_m, place.pixel_m, 0.0]),
        33922: (_DOUBLE, [0.0, 0.0, 0.0, place.west_m, place.north_m, 0.0]),
        34735: (_SHORT, list(directory)),
        34737: (_ASCII, name + b"\0"),
        **({42112: (_ASCII, _make_metadata(place.notes))} if place.notes else {}),
        **({42113: (_ASCII, b"nan\0")} if floats else {}),
    }


def _make_metadata(notes: Mapping[str, str], unit: str = "") -> bytes:
    """Make GDAL_METADATA (gdal.org/drivers/raster/gtiff.html) with these texts, which GDAL escapes twice, and the unit
    of the first band's values."""
    items = "".join(f"<Item name={quoteattr(name)}>{escape(escape(text))}</Item>" for name, text in notes.items())
    items += f'<Item name="UNITTYPE" sample="0" role="unittype">{escape(unit)}</Item>' if unit else ""
    return f"<GDALMetadata>{items}</GDALMetadata>".encode() + b"\0"


def _assemble_file(tags: dict[int, tuple[tuple[int, str], list[float] | bytes]], strips: list[bytes]) -> bytes:
    """Assemble the file's bytes: header, values of the tags, strips, and the directory at the end."""
    body = bytearray(b"II*\0\0\0\0\0")
    offsets = []
    for strip in strips:
        offsets.append(len(body))
        body += strip + b"\0" * (len(strip) % 2)
    tags = {**tags, 273: (_LONG, list(offsets))}
    entries = []
    for number, ((kind, letter), values) in sorted(tags.items()):
        packed = values if isinstance(values, bytes) else struct.pack(f"<{len(values)}{letter}", *values)
        field = packed.ljust(4, b"\0")
        if len(packed) > 4:
            field = struct.pack("<I", len(body))
            body += packed + b"\0" * (len(packed) % 2)
        entries.append(struct.pack("<HHI", number, kind, len(values)) + field)
    struct.pack_into("<I", body, 4, len(body))
    return bytes(body + struct.pack("<H", len(entries)) + b"".join(entries) + b"\0\0\0\0")
