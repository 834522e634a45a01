"""Checks and decodes PNG files (W3C, third edition) in numpy, without Blender and without an image library."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .foreign_bytes import ForeignBytes, RefusedError, inflate

if TYPE_CHECKING:
    from .arrays import Array

PNG_START = b"\x89PNG\r\n\x1a\n"
#: Bits of a value by the type of the colours: grey, RGB, palette, grey and opacity, RGB and opacity.
_BITS_BY_COLOUR_TYPE = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}
#: Number of values of a pixel by the type of the colours.
_VALUES_BY_COLOUR_TYPE = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
#: Filters of a row: the difference from the left pixel, the upper one, the mean of both, and Paeth's choice.
_LEFT, _UP, _MEAN, _PAETH = 1, 2, 3, 4


@dataclass(frozen=True)
class PngHead:
    """Facts of a PNG file about its pixels; ``colours`` is 0 grey, 2 RGB, 3 palette, 4 and 6 with opacity."""

    width: int
    height: int
    bits: int
    colours: int
    interlaced: bool = False


def check_png(foreign: ForeignBytes) -> PngHead:
    """Check that a PNG file is complete and that its checksums are right; return its head. Raises ValueError for any
    other."""
    head = None
    for _, body in _read_parts(foreign):
        head = head or _read_head(body)
    if head is None:
        raise ValueError("no head")
    return head


def decode_png(foreign: ForeignBytes) -> Array:
    """Decode a PNG file to (rows, columns, channels) float32, 0 to 1, row 0 at the top. Each value is divided by the
    largest value of its bits.

    The memory is charged to the file's budget. Raises ValueError for a damaged file, and RefusedError for a palette and
    for interlaced rows.
    """
    import numpy as np

    parts = [*_read_parts(foreign)]
    head = _read_head(parts[0][1])
    if head.colours == 3 or head.interlaced:
        raise RefusedError(f"has {'a palette' if head.colours == 3 else 'interlaced rows'}; save it without.")
    channels = _VALUES_BY_COLOUR_TYPE[head.colours]
    row_bytes = -(-head.width * channels * head.bits // 8)
    packed = b"".join(data for kind, data in parts if kind == b"IDAT")
    foreign.budget.charge(head.height * head.width * channels * 8, "pixels")
    rows = np.frombuffer(inflate(packed, head.height * (1 + row_bytes), foreign.budget), np.uint8)
    rows = rows.reshape(head.height, 1 + row_bytes)
    pixel_bytes = max(1, channels * head.bits // 8)
    values = _unfilter(rows[:, 0], rows[:, 1:].reshape(head.height, -1, pixel_bytes)).reshape(head.height, row_bytes)
    return (_unpack_bits(values, head, channels) / np.float32(2**head.bits - 1)).astype(np.float32)


def _read_parts(foreign: ForeignBytes) -> Iterator[tuple[bytes, bytes]]:
    """Read the kind and the content of each part of a file, from its head to its end. Raises ValueError if it is
    damaged."""
    cursor = foreign.cursor()
    if cursor.take(len(PNG_START)) != PNG_START:
        raise ValueError("it does not begin as a PNG file")
    first, kind = True, b""
    while kind != b"IEND":
        length = cursor.number(">I")
        body = cursor.take(4 + length)
        kind = body[:4]
        if cursor.number(">I") != zlib.crc32(body):
            raise ValueError(f"the checksum of its part {kind!r} is wrong")
        if first != (kind == b"IHDR"):
            raise ValueError(f"a part {kind!r} at byte {cursor.at - length - 12}")
        if first:
            _read_head(body[4:])
        first = False
        yield kind, body[4:]


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
    return PngHead(width, height, bits, colours, bool(methods[2]))


def _unfilter(filters: Array, stored: Array) -> Array:
    """Restore the bytes (rows, columns, bytes) of pixels that are stored as differences, by the filter (rows,) of each
    row.

    A pixel depends on the left, the upper and the upper left pixel. So all pixels on a diagonal are computed together.
    """
    import numpy as np

    if not filters.any():
        return stored
    if filters.max() > _PAETH:
        raise ValueError(f"the filter {filters.max()}")
    height, width, count = stored.shape
    found = np.zeros((height + 1, width + 1, count), np.int16)  # with a row above and a column to the left of zeros
    for diagonal in range(height + width - 1):
        row = np.arange(max(0, diagonal - width + 1), min(height, diagonal + 1))
        column = diagonal - row
        left, up, corner = found[row + 1, column], found[row, column + 1], found[row, column]
        kind = filters[row, None]
        guess = np.where(kind == _LEFT, left, 0)
        guess = np.where(kind == _UP, up, guess)
        guess = np.where(kind == _MEAN, (left + up) // 2, guess)
        guess = np.where(kind == _PAETH, _choose_nearest(left, up, corner), guess)
        found[row + 1, column + 1] = (stored[row, column] + guess) & 255
    return found[1:, 1:].astype(np.uint8)


def _choose_nearest(left: Array, up: Array, corner: Array) -> Array:
    """Choose, as Paeth's predictor does, the neighbour that is nearest to left + up - corner."""
    import numpy as np

    to_left, to_up, to_corner = abs(up - corner), abs(left - corner), abs(left + up - 2 * corner)
    return np.where((to_left <= to_up) & (to_left <= to_corner), left, np.where(to_up <= to_corner, up, corner))


def _unpack_bits(rows: Array, head: PngHead, channels: int) -> Array:
    """Unpack the numbers (rows, columns, channels) from the bytes (rows, bytes) of pixels."""
    import numpy as np

    if head.bits == 16:
        values = np.ascontiguousarray(rows).view(">u2")
    elif head.bits == 8:
        values = rows
    else:
        bits = np.unpackbits(rows, axis=1).reshape(len(rows), -1, head.bits)
        values = bits @ (1 << np.arange(head.bits)[::-1])
    return values[:, : head.width * channels].reshape(head.height, head.width, channels)
