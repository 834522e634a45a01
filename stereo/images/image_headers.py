"""Parse the headers of PNG, JPEG and WebP files, and extract the bytes that a decoder needs.

A decoder reserves memory for the size in the header, and unpacks all data that it finds. So the stated size is charged
first, and the file must have its end. Only the parts of PNG and WebP with pixels and colours are passed on.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np

from ...formats.image_size import read_webp_size
from ...formats.tiff import read_directories
from ...support.arrays import Array
from ...support.foreign_bytes import Budget, Cursor, ForeignBytes, OverBudgetError, RefusedError

#: The orientation of an image that viewers show as its pixels are stored.
UPRIGHT = 1
#: The first bytes of EXIF data in JPEG, and in some WebP files; a TIFF file follows.
_MARK = b"Exif\0\0"
_ORIENTATION, _MAX_BYTES, _MAX_ORIENTATION = 274, 2**16, 8

#: Most pixels of a foreign image, eight times the largest images of Middlebury, and most bytes of their array: 32 bits
#: each, and the header.
MAX_PIXELS = 2**26
MAX_IMAGE_BYTES = 4 * MAX_PIXELS + 2**12
#: Most bytes of a JPEG or WebP file: four for each of these pixels, and twice the least size of a file.
_MAX_PACKED_BYTES = 2**28
#: Most bytes of a file beside its pixels: profiles, notes, a film after a photograph.
_MAX_EXTRA_BYTES = 2**26
PNG_START, JPEG_START = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
#: Parts of a PNG that affect its pixels. Other parts, such as profiles and texts, may unpack to much more.
_PNG_PIXEL_PARTS = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
#: Most parts of a PNG; libpng writes parts of 8 KiB.
_MAX_PNG_PARTS = 200_000
_PNG_GREY_TYPE = 0  # the only colour type for which OpenCV gives one band
_WEBP_PIXEL_PARTS = (b"VP8X", b"ALPH", b"VP8 ", b"VP8L")
_WEBP_OPACITY, _WEBP_MOST_PARTS = 0x10, 10_000
#: Most segments, scans and fill bytes of a JPEG, because each takes time. A JPEG has about ten segments, and a
#: progressive one ten scans.
_MAX_SEGMENTS, _MAX_SCANS, _MAX_FILL = 10_000, 100, 64
#: Bytes of a scan that are searched at once.
_SEARCHED_BYTES = 2**16
_START_OF_IMAGE, _END_OF_IMAGE, _START_OF_SCAN, _EXIF = 0xD8, 0xD9, 0xDA, 0xE1
#: Most pixels per byte: with Huffman's codes, a block of 8 x 8 pixels has at least one bit, in one of at most two
#: bands. OpenCV would fill missing blocks with grey.
_PIXELS_PER_BYTE, _LAST_OF_HUFFMAN = 2 * 64 * 8, 0xC7
_FRAME_MARKERS = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_MARKERS_WITHOUT_LENGTH = {0x01, *range(0xD0, 0xD8)}  # markers without a length


@dataclass(frozen=True)
class EncodedImage:
    """An image before it is decoded: the input of a decoder, and the limits of its output."""

    content: bytes
    width: int
    height: int
    most_bytes: int  # most bytes of all pixels
    orientation: int = UPRIGHT  # the EXIF orientation, by which viewers turn the image


def is_webp(start: bytes) -> bool:
    """Return whether ``start`` are the first bytes of a WebP file."""
    return start[:4] == b"RIFF" and start[8:12] == b"WEBP"


def check_size(width: int, height: int, most_pixels: int | None = None) -> int:
    """Return the number of pixels of a size from a header. Raises RefusedError if it is 0 or too large."""
    most = MAX_PIXELS if most_pixels is None else most_pixels
    if width < 1 or height < 1:
        raise RefusedError(f"states {width} x {height} px, an image without pixels; make it again.")
    if width * height > most:
        raise RefusedError(
            f"states {width} x {height} px, and {most} pixels are the most that can be read; make it smaller."
        )
    return width * height


def parse_image(foreign: ForeignBytes) -> EncodedImage:
    """Parse a PNG, JPEG or WebP image. Raises RefusedError for another file, and the errors of the parsers below."""
    start = foreign.part(0, min(12, foreign.size))
    if start.startswith(PNG_START):
        return parse_png(foreign)
    if start.startswith(JPEG_START):
        return parse_jpeg(foreign)
    if is_webp(start):
        return parse_webp(foreign)
    raise RefusedError("is not a supported image; save it as PNG, JPEG, TIFF or WebP.")


def parse_png(foreign: ForeignBytes, most_pixels: int | None = None) -> EncodedImage:
    """Reduce a PNG image to the chunks that affect its pixels.

    Raises ValueError if it is torn, RefusedError and OverBudgetError if it is too large.
    """
    if foreign.part(0, min(len(PNG_START), foreign.size)) != PNG_START:
        raise RefusedError("is not a PNG image; convert it to PNG.")
    head = foreign.cursor(len(PNG_START), min(25, foreign.size - len(PNG_START)))
    if head.take(8) != b"\0\0\0\x0dIHDR":
        raise ValueError("it does not begin with its size")
    width, height, depth, colour = head.unpack(">IIBB")
    pixels = check_size(width, height, most_pixels)
    most = _charge_pixels(foreign, pixels * (1 if colour == _PNG_GREY_TYPE else 4) * (2 if depth == 16 else 1))
    cursor = foreign.cursor(8)
    kept, orientation = [PNG_START], UPRIGHT
    for _ in range(_MAX_PNG_PARTS):
        length, kind = cursor.unpack(">I4s")
        body = cursor.take(length)
        checksum = cursor.number(">I")
        if zlib.crc32(body, zlib.crc32(kind)) != checksum:
            raise ValueError("a checksum is wrong")
        if kind == b"IHDR" and len(kept) > 1:
            raise ValueError("it states its size twice")
        if kind in _PNG_PIXEL_PARTS:
            kept += [struct.pack(">I4s", length, kind), body, struct.pack(">I", checksum)]
        elif kind == b"eXIf":
            orientation = parse_orientation(body)
        elif not kind[0] & 0x20:  # a capital letter marks a part that decoders must read
            raise ValueError(f"an unknown part {kind!r}")
        if kind == b"IEND":
            return EncodedImage(b"".join(kept), width, height, most, orientation)
    raise ValueError(f"more than {_MAX_PNG_PARTS} parts")


def parse_jpeg(foreign: ForeignBytes) -> EncodedImage:
    """Cut a JPEG image at its end mark, because phones and drones write more data after it.

    Raises ValueError if it is torn, RefusedError and OverBudgetError if it is too large.
    """
    data = _read_bounded_content(foreign)
    cursor, values = Cursor(data, foreign.budget), np.frombuffer(data, np.uint8)
    cursor.skip(2)
    frame: tuple[int, int, int] | None = None
    scans, packs_blocks, orientation = 0, True, UPRIGHT
    for _ in range(_MAX_SEGMENTS):
        kind = _find_next_marker(cursor)
        if kind in _MARKERS_WITHOUT_LENGTH:
            continue
        if kind == _END_OF_IMAGE:
            if frame is None or not scans:
                raise ValueError("it has no pixels")
            width, height, _ = frame
            if packs_blocks and cursor.at < width * height / _PIXELS_PER_BYTE:
                raise ValueError(f"it has {cursor.at} bytes, fewer than its size needs")
            return EncodedImage(data[: cursor.at], *frame, orientation)
        length = cursor.number(">H") - 2
        if kind in _FRAME_MARKERS:
            if frame:
                raise ValueError("it states its size twice")
            frame, packs_blocks = _read_frame_header(cursor.take(length), foreign), kind <= _LAST_OF_HUFFMAN
            continue
        if kind == _EXIF and orientation == UPRIGHT:
            orientation = parse_orientation(cursor.take(length))
            continue
        cursor.skip(length)
        if kind == _START_OF_SCAN:
            scans += 1
            if frame is None or scans > _MAX_SCANS:
                raise ValueError(f"more than {_MAX_SCANS} scans" if frame else "pixels before their size")
            cursor.skip_to(_find_end_of_scan(values, cursor.at))
        elif kind == _START_OF_IMAGE:
            raise ValueError("an image within an image")
    raise ValueError(f"more than {_MAX_SEGMENTS} segments")


def _read_frame_header(body: bytes, foreign: ForeignBytes) -> tuple[int, int, int]:
    """Read the width, the height and the most bytes of the pixels from the content of a frame header."""
    depth, height, width, bands = struct.unpack_from(">BHHB", body)
    pixels = check_size(width, height)
    return width, height, _charge_pixels(foreign, pixels * (1 if bands == 1 else 4) * (1 if depth == 8 else 2))


def _find_next_marker(cursor: Cursor) -> int:
    if cursor.take(1) != b"\xff":
        raise ValueError(f"no marker at byte {cursor.at - 1}")
    for _ in range(_MAX_FILL):
        kind = cursor.number("B")
        if kind != 0xFF:
            return kind
    raise ValueError(f"no marker at byte {cursor.at - 1}")


def _find_end_of_scan(values: Array, at: int) -> int:
    """Find the position of the first marker after ``at`` that is neither a stuffed byte nor a restart.

    Raises ValueError if no marker follows, because the file was cut off.
    """
    for begin in range(at, len(values) - 1, _SEARCHED_BYTES):
        block = values[begin : begin + _SEARCHED_BYTES + 1]
        after = block[1:]
        found = np.flatnonzero((block[:-1] == 0xFF) & (after != 0) & (after != 0xFF) & (after & 0xF8 != 0xD0))
        if found.size:
            return begin + int(found[0])
    raise ValueError("it ends within its pixels")


def parse_webp(foreign: ForeignBytes) -> EncodedImage:
    """Reduce a WebP image to the chunks that affect its pixels.

    Raises ValueError if it is torn, RefusedError for an animation, and the errors of ``parse_png`` if it is too large.
    """
    outer = Cursor(_read_bounded_content(foreign), foreign.budget)
    if outer.take(4) != b"RIFF":
        raise ValueError("it does not begin as WebP")
    cursor = Cursor(outer.take(outer.number("<I")), foreign.budget)
    if cursor.take(4) != b"WEBP":
        raise ValueError("it does not begin as WebP")
    kept, sizes, orientation = [], [], UPRIGHT
    for _ in range(_WEBP_MOST_PARTS):
        if not cursor.left:
            break
        kind, length = cursor.unpack("<4sI")
        body = cursor.take(length)
        cursor.skip(min(length & 1, cursor.left))
        if kind in (b"ANIM", b"ANMF"):
            raise RefusedError("is an animation; save one of its images as PNG.")
        if kind == b"EXIF":
            orientation = parse_orientation(body)
        if kind not in _WEBP_PIXEL_PARTS:
            continue
        if kind == b"VP8X":
            body = bytes([body[0] & _WEBP_OPACITY]) + body[1:]  # other announced parts are left out
        if size := read_webp_size(kind, body):
            sizes.append(size)
        kept.append(struct.pack("<4sI", kind, length) + body + b"\0" * (length & 1))
    else:
        raise ValueError(f"more than {_WEBP_MOST_PARTS} parts")
    if not sizes or len(set(sizes)) > 1:
        raise ValueError("it states no size, or two")
    width, height = sizes[0]
    most = _charge_pixels(foreign, 4 * check_size(width, height))
    content = b"WEBP" + b"".join(kept)
    return EncodedImage(b"RIFF" + struct.pack("<I", len(content)) + content, width, height, most, orientation)


def _read_bounded_content(foreign: ForeignBytes) -> bytes:
    """Read the content of a file whose size in pixels is known only after it is read. Raises RefusedError if it is too
    large.
    """
    if foreign.size > _MAX_PACKED_BYTES:
        raise RefusedError(
            f"has {foreign.size / 1e6:.0f} MB, and {_MAX_PACKED_BYTES / 1e6:.0f} MB are the most that can be read "
            "of this kind; make it smaller."
        )
    return foreign.content()


def _charge_pixels(foreign: ForeignBytes, count: int) -> int:
    """Charge the bytes of all pixels, and return them. Raises RefusedError if the file is far larger than its
    pixels.
    """
    if foreign.size > count + _MAX_EXTRA_BYTES:
        raise RefusedError(f"has {foreign.size / 1e6:.0f} MB, far more than its pixels need; save it again.")
    return foreign.budget.charge(count, "pixels")


def parse_orientation(body: bytes) -> int:
    """Parse the orientation, 1 to 8, from EXIF data. Return 1 if they state none or cannot be read, as viewers do."""
    data = body.removeprefix(_MARK)[:_MAX_BYTES]
    try:
        stated = read_directories(ForeignBytes(data, len(data), Budget()))[0].number(_ORIENTATION, UPRIGHT)
    except (ValueError, KeyError, IndexError, struct.error, OverBudgetError):
        return UPRIGHT
    return stated if UPRIGHT <= stated <= _MAX_ORIENTATION else UPRIGHT
