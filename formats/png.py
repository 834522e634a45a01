"""Encodes PNG files in numpy, for pictures made in Blender."""

from __future__ import annotations

import struct
import zlib

import numpy as np

from ..support.arrays import Array
from ..support.png_pixels import PNG_START


def encode_png(picture: Array, level: int = 1) -> bytes:
    """Encode an RGB picture (H, W, 3), uint8, or a grey one (H, W), uint8 or uint16, as a PNG file.

    ``level`` of compression is from 0 (none) to 9.
    """
    height, width = picture.shape[:2]
    values = picture.astype(f">u{picture.itemsize}").reshape(height, -1).view(np.uint8)
    rows = np.zeros((height, 1 + values.shape[1]), np.uint8)  # each begins with its filter, none
    rows[:, 1:] = values
    header = struct.pack(">2I5B", width, height, 8 * picture.itemsize, 2 if picture.ndim == 3 else 0, 0, 0, 0)
    return PNG_START + b"".join(
        _make_chunk(name, data)
        for name, data in ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), level)), (b"IEND", b""))
    )


def _make_chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
