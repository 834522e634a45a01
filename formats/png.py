"""Encoding PNG files in numpy, for pictures that are made in Blender."""

from __future__ import annotations

import struct
import zlib

import numpy as np


def encode_png(picture: np.ndarray, level: int = 1) -> bytes:
    """The file of an RGB picture (H, W, 3), uint8; ``level`` of compression from 0 (none) to 9."""
    height, width = picture.shape[:2]
    rows = np.zeros((height, 1 + 3 * width), np.uint8)  # each begins with its filter, none
    rows[:, 1:] = picture.reshape(height, -1)
    header = struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)  # 8 bits, RGB
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        _chunk(name, data) for name, data in ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), level)),
                                              (b"IEND", b"")))


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
