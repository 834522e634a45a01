"""Encodes PNG files in numpy, for pictures made in Blender, and checks foreign PNG files before a
library reads them."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np

from ..support.arrays import Array
from ..support.foreign_bytes import ForeignBytes

_PNG_START = b"\x89PNG\r\n\x1a\n"
#: Bits of a value by the type of the colours: grey, RGB, palette, grey and opacity, RGB and opacity.
_BITS_BY_COLOUR_TYPE = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}


@dataclass(frozen=True)
class PngHead:
    """Statements of a PNG file about its pixels; ``colours`` is 0 grey, 2 RGB, 3 palette, 4 and 6 with opacity."""

    width: int
    height: int
    bits: int
    colours: int


def check_png(foreign: ForeignBytes) -> PngHead:
    """The head of a PNG file that is complete and whose checksums are right. Raises ValueError for any other."""
    cursor = foreign.cursor()
    if cursor.take(len(_PNG_START)) != _PNG_START:
        raise ValueError("it does not begin as a PNG file")
    head, kind = None, b""
    while kind != b"IEND":
        length = cursor.number(">I")
        body = cursor.take(4 + length)
        kind = body[:4]
        if cursor.number(">I") != zlib.crc32(body):
            raise ValueError(f"the checksum of its part {kind!r} is wrong")
        if (head is None) != (kind == b"IHDR"):
            raise ValueError(f"a part {kind!r} at byte {cursor.at - length - 12}")
        if head is None:
            head = _read_head(body[4:])
    if head is None:
        raise ValueError("no head")
    return head


def _read_head(body: bytes) -> PngHead:
    width, height, bits, colours, *methods = struct.unpack(">2I5B", body)
    if not (
        0 < width < 2**31
        and 0 < height < 2**31
        and bits in _BITS_BY_COLOUR_TYPE.get(colours, ())
        and methods[:2] == [0, 0]
        and methods[2] <= 1
    ):
        raise ValueError(f"{width} x {height} pixels of {bits} bits and type {colours}")
    return PngHead(width, height, bits, colours)


def encode_png(picture: Array, level: int = 1) -> bytes:
    """The file of an RGB picture (H, W, 3), uint8, or a grey one (H, W), uint8 or uint16.

    ``level`` of compression is from 0 (none) to 9.
    """
    height, width = picture.shape[:2]
    values = picture.astype(f">u{picture.itemsize}").reshape(height, -1).view(np.uint8)
    rows = np.zeros((height, 1 + values.shape[1]), np.uint8)  # each begins with its filter, none
    rows[:, 1:] = values
    header = struct.pack(">2I5B", width, height, 8 * picture.itemsize, 2 if picture.ndim == 3 else 0, 0, 0, 0)
    return _PNG_START + b"".join(
        _make_chunk(name, data)
        for name, data in ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), level)), (b"IEND", b""))
    )


def _make_chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
