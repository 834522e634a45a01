"""The number of pixels of a foreign image, from its header, before a library allocates memory for them.

PNG (W3C, third edition), JPEG (ITU T.81), TIFF, OpenEXR, WebP (RFC 9649), BMP, Radiance HDR (Ward 1991), Targa (2.0).
"""

from __future__ import annotations

import math
import struct

from ..support.foreign_bytes import Cursor, ForeignBytes, RefusedError
from .exr_layout import Part, read_layout
from .tiff import grant_memory, read_directories

#: First bytes of a PNG file.
_PNG_MARK = b"\x89PNG\r\n\x1a\n"
#: First bytes of a JPEG file.
_JPEG_MARK = b"\xff\xd8\xff"
#: First bytes of an OpenEXR file.
_EXR_MARK = b"\x76\x2f\x31\x01"
_TIFF_MARKS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
#: Largest number of pixels for each byte of a file; photographs have 2 to 10.
_PIXELS_PER_BYTE = 16
#: Maximum number of scans of a JPEG file, usually 1 to 10; each may cover the whole image.
_MAX_SCANS = 100
#: Largest header in bytes, except for JPEG, whose comments precede it.
_MAX_HEADER_BYTES = 2**16
#: Bytes of a WebP part that contain its size.
_WEBP_SIZE_BYTES = 10
#: Number of values of a pixel whose memory is counted as one pixel.
_VALUES_PER_PIXEL = 4


def check_pixels(foreign: ForeignBytes, pixels: int, most: int, fix: str) -> None:
    """Raise RefusedError for an image of more than ``most`` pixels, unless its file is large enough
    for such an image."""
    if pixels < 1:
        raise ValueError("no pixels")
    if pixels > most + _PIXELS_PER_BYTE * foreign.size:
        raise RefusedError(f"states {pixels / 1e6:.0f} million pixels in {foreign.size / 1e6:.2g} MB; {fix}.")


def count_pixels(foreign: ForeignBytes) -> int:
    """Count the pixels that an image states; a pixel with more values than usual counts as several. Raises ValueError,
    KeyError or OverBudgetError for a damaged file or an unknown kind."""
    start = foreign.part(0, min(foreign.size, 32))
    if start.startswith(_EXR_MARK):
        return sum(_count_part(part) for part in read_layout(foreign, tiles=True))
    if start.startswith(_TIFF_MARKS):
        return _count_tiff(foreign)
    if start.startswith(_JPEG_MARK):
        return _count_jpeg(foreign)
    return math.prod(_read_size(foreign, start))


def _count_part(part: Part) -> int:
    return math.prod(part.shape) * -(-len(part.channels) // _VALUES_PER_PIXEL)


def _count_tiff(foreign: ForeignBytes) -> int:
    grant_memory(foreign)
    image = read_directories(foreign)[0]
    values = -(-image.number(277, 1) // _VALUES_PER_PIXEL)
    tile = image.number(322, 1) * image.number(323, 1)
    if min(*image.shape, image.number(277, 1), image.number(322, 1), image.number(323, 1)) < 1:
        raise ValueError("no pixels")
    return max(math.prod(image.shape), tile) * values


def _count_jpeg(foreign: ForeignBytes) -> int:
    content = foreign.content()
    if content.count(b"\xff\xda") > _MAX_SCANS:
        raise ValueError(f"more than {_MAX_SCANS} scans")
    cursor = Cursor(content, foreign.budget)
    cursor.skip(2)
    while True:
        mark, kind = cursor.unpack(">BB")
        while kind == 0xFF:  # any number of them may stand before a marker
            kind = cursor.number("B")
        if mark != 0xFF:
            raise ValueError(f"no marker at byte {cursor.at - 2}")
        length = cursor.number(">H")
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            _, height, width = cursor.unpack(">BHH")
            return int(height * width)
        cursor.skip(length - 2)


def _read_size(foreign: ForeignBytes, start: bytes) -> tuple[int, int]:
    """Read the width and height of a PNG, WebP, BMP, HDR or Targa image."""
    cursor = foreign.cursor(0, min(foreign.size, _MAX_HEADER_BYTES))
    if start.startswith(_PNG_MARK):
        cursor.skip(len(_PNG_MARK) + 8)
        width, height = cursor.unpack(">2I")
    elif start.startswith(b"RIFF") and start[8:12] == b"WEBP":
        cursor.skip(12)
        kind, _ = cursor.unpack("<4sI")
        width, height = read_webp_size(kind, cursor.take(min(_WEBP_SIZE_BYTES, cursor.left))) or (0, 0)
    elif start.startswith(b"BM"):
        cursor.skip(14)
        width, height = cursor.unpack("<2H" if cursor.number("<I") == 12 else "<2i")
    elif start.startswith((b"#?RADIANCE", b"#?RGBE")):
        cursor.take_until(b"\n\n", _MAX_HEADER_BYTES)
        words = cursor.take_until(b"\n", 100).split()
        width, height = int(words[3]), int(words[1])
    elif len(start) > 18 and start[1] <= 1 and start[2] in (1, 2, 3, 9, 10, 11) and start[16] in (8, 15, 16, 24, 32):
        cursor.skip(12)
        width, height = cursor.unpack("<2H")
    else:
        raise ValueError("its format is unknown")
    if not (0 < width < 2**31 and 0 < abs(height) < 2**31):
        raise ValueError(f"{width} x {height} pixels")
    return width, abs(height)


def read_webp_size(kind: bytes, body: bytes) -> tuple[int, int] | None:
    """Read width and height, px, from the first bytes of a WebP chunk; None for a chunk without them. Raises ValueError
    or struct.error if its beginning is damaged."""
    if kind == b"VP8X":
        width, width_high, height, height_high = struct.unpack_from("<4xHBHB", body)
        return 1 + width + (width_high << 16), 1 + height + (height_high << 16)
    if kind == b"VP8 ":
        mark, width, height = struct.unpack_from("<3x3sHH", body)
        if mark != b"\x9d\x01\x2a":
            raise ValueError("its pixels have no beginning")
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        mark, bits = struct.unpack_from("<BI", body)
        if mark != 0x2F:
            raise ValueError("its pixels have no beginning")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    return None
