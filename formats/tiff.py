"""Pixels of a TIFF file, from its bytes: TIFF 6.0 (Adobe 1992) and BigTIFF, strips and tiles, one band.

Whatever compression loses nothing and Python can undo is read: none, deflate, LZW, PackBits, LZMA, and
ZSTD where Python has ``zstandard``, as official Blenders and Blender as a Python module do. Their
OpenImageIO is of no use here: its TIFF library is built without ZSTD (measured in 5.0).
"""

from __future__ import annotations

import lzma
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

#: The fix for whatever is not read, as a command.
FIX = "convert it with: gdal_translate -b 1 -co COMPRESS=DEFLATE in.tif out.tif"
#: Largest number of pixels that are read.
MOST_PIXELS = 2**30

_TYPES = {1: "B", 2: "s", 3: "H", 4: "I", 5: "II", 6: "b", 8: "h", 9: "i", 11: "f", 12: "d", 13: "I", 16: "Q",
          17: "q", 18: "Q"}
_OTHERS = {2: "CCITT", 3: "CCITT", 4: "CCITT", 6: "JPEG", 7: "JPEG", 34887: "LERC", 50000: "ZSTD", 50001: "WebP",
           50002: "JPEG XL", 52546: "JPEG XL"}
_NUMBERS = ("u1", "u2", "u4", "u8", "i1", "i2", "i4", "i8", "f2", "f4", "f8")
_MOST_DIRECTORIES = 1000

Tags = dict[int, tuple[Any, ...]]


class UnreadError(Exception):
    """A feature of a TIFF file that is not read, as the end of a sentence about the file."""


@dataclass(frozen=True)
class Directory:
    """One image of a TIFF file: the values of its ``tags`` by number, and the byte ``order`` for struct."""

    tags: Tags
    order: str

    def number(self, tag: int, otherwise: int) -> int:
        """First value of a tag of whole numbers."""
        return int(self.tags.get(tag, (otherwise,))[0])

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns. Raises KeyError if it does not state them."""
        return int(self.tags[257][0]), int(self.tags[256][0])

    @property
    def is_mask(self) -> bool:
        """Whether it marks which pixels of the image before it are known (NewSubfileType, bit 2)."""
        return bool(self.number(254, 0) & 4)

    @property
    def is_reduced(self) -> bool:
        """Whether it is a smaller copy of another (NewSubfileType, bit 0)."""
        return bool(self.number(254, 0) & 1)


def read_directories(data: bytes) -> list[Directory]:
    """The images of a TIFF file in their order. Raises struct.error, KeyError or ValueError if it is torn."""
    order = {b"II": "<", b"MM": ">"}[data[:2]]
    magic = struct.unpack_from(f"{order}H", data, 2)[0]
    if magic not in (42, 43):
        raise ValueError(f"magic number {magic}")
    place = f"{order}Q" if magic == 43 else f"{order}I"
    at = struct.unpack_from(place, data, 8 if magic == 43 else 4)[0]
    found: list[Directory] = []
    seen = set()
    while at and at not in seen and len(found) < _MOST_DIRECTORIES:
        seen.add(at)
        tags, end = _read_tags(data, at, order, place)
        found.append(Directory(tags, order))
        at = struct.unpack_from(place, data, end)[0]
    if not found:
        raise ValueError("no image")
    return found


def stores_floats(data: bytes) -> bool:
    """Whether a file is a TIFF file of floating-point numbers; False for one that is torn, or none."""
    try:
        return read_directories(data)[0].number(339, 1) == 3
    except (struct.error, KeyError, ValueError):
        return False


def _read_tags(data: bytes, at: int, order: str, place: str) -> tuple[Tags, int]:
    """Values of a directory's tags by number, and where it ends."""
    big = place.endswith("Q")
    count = struct.unpack_from(f"{order}Q" if big else f"{order}H", data, at)[0]
    head, inline = (f"{order}HHQ", 8) if big else (f"{order}HHI", 4)
    at += 8 if big else 2
    tags: Tags = {}
    for _ in range(count):
        tag, kind, n = struct.unpack_from(head, data, at)
        at += struct.calcsize(head)
        if kind in _TYPES:
            if n > len(data):
                raise ValueError(f"tag {tag} has {n} values")
            pattern = f"{order}{n}s" if kind == 2 else order + _TYPES[kind] * n
            where = struct.unpack_from(place, data, at)[0] if struct.calcsize(pattern) > inline else at
            tags[tag] = struct.unpack_from(pattern, data, where)
        at += inline
    return tags, at


def read_pixels(data: bytes, image: Directory) -> tuple[np.ndarray, np.dtype[Any]]:
    """The one band of an image as float64 (rows, columns), NaN where a tile is absent, and its own number type.

    Raises UnreadError if it is of a kind that is not read, and ValueError or an error of the
    decompressor if the file is torn.
    """
    number, unpack = _number_type(image), _choose_unpacker(image)
    rows, columns = image.shape
    tiled = 322 in image.tags
    width = image.number(322, 0) if tiled else columns
    height = image.number(323, 0) if tiled else min(image.number(278, rows), rows)
    if min(width, height, columns, rows) < 1:
        raise ValueError("no pixels")
    if rows * columns > MOST_PIXELS:
        raise UnreadError(f"has {columns} x {rows} pixels, Icy Moon reads {MOST_PIXELS} at most; cut it with: "
                          "gdal_translate -srcwin LEFT TOP WIDTH HEIGHT in.tif out.tif")
    if width * height > 4 * MOST_PIXELS:
        raise ValueError(f"tiles of {width} x {height} pixels")
    offsets, sizes = (image.tags[k] for k in ((324, 325) if tiled else (273, 279)))
    across = -(-columns // width)
    if len(offsets) != across * -(-rows // height):
        raise ValueError(f"{len(offsets)} tiles or strips")
    grid = np.full((rows, columns), np.nan)
    for k, (offset, size) in enumerate(zip(offsets, sizes, strict=True)):
        if size == 0:
            continue  # a sparse file: the tile is missing
        top, left = k // across * height, k % across * width
        tall = height if tiled else min(height, rows - top)
        length = tall * (-(-width // 8) if number.kind == "b" else width * number.itemsize)
        block = unpack(data[offset:offset + size], length)
        if len(block) < length:
            raise ValueError(f"a tile or strip of {len(block)} bytes")
        values = _undo_prediction(block[:length], (tall, width), number, image.number(317, 1))
        with np.errstate(invalid="ignore"):  # a number that is none stays none
            grid[top:top + height, left:left + width] = values[:rows - top, :columns - left]
    return grid, number


def _number_type(image: Directory) -> np.dtype[Any]:
    """The number type of the pixels of the only band; bool for one bit. Raises UnreadError for any other kind."""
    bands = image.number(277, 1)
    if bands != 1:
        raise UnreadError(f"has {bands} bands, a height map has one; {FIX}")
    if image.number(262, 1) == 3:
        raise UnreadError("holds colours of a palette, not heights")
    if image.number(266, 1) != 1 or image.number(274, 1) != 1:
        raise UnreadError(f"is stored with its bits or its rows in reverse order; {FIX}")
    bits = image.number(258, 1)
    if bits == 1 and image.is_mask:
        return np.dtype(bool)
    kind = {1: "u", 2: "i", 3: "f", 4: "u"}.get(image.number(339, 1), "?")
    if bits % 8 or f"{kind}{bits // 8}" not in _NUMBERS:
        raise UnreadError(f"holds {bits}-bit values of a kind that Icy Moon does not read; "
                          f"{FIX.replace('-co', '-ot Float32 -co', 1)}")
    return np.dtype(f"{image.order}{kind}{bits // 8}")


def _choose_unpacker(image: Directory) -> Callable[[bytes, int], bytes]:
    """What undoes the compression of a tile or strip, given the length that it has then. Raises UnreadError."""
    compression = image.number(259, 1)
    if compression == 50000 and (zstandard := _find_zstandard()):
        return zstandard
    known: dict[int, Callable[[bytes, int], bytes]] = {
        1: lambda block, length: block, 5: unpack_lzw, 8: _inflate, 32946: _inflate, 32773: _unpack_bits,
        34925: lambda block, length: lzma.LZMADecompressor().decompress(block, length)}
    if compression not in known:
        name = _OTHERS.get(compression, f"method {compression}")
        raise UnreadError(f"is compressed with {name}, which Icy Moon does not read here; {FIX}")
    return known[compression]


def _find_zstandard() -> Callable[[bytes, int], bytes] | None:
    try:
        import zstandard
    except ImportError:
        return None

    def unpack(block: bytes, length: int) -> bytes:
        try:
            return zstandard.ZstdDecompressor().decompress(block, max_output_size=length)
        except zstandard.ZstdError as error:
            raise ValueError(error) from None
    return unpack


def _inflate(block: bytes, length: int) -> bytes:
    return zlib.decompressobj().decompress(block, length)


def _unpack_bits(block: bytes, length: int) -> bytes:
    """PackBits (TIFF 6.0, section 9): runs and literals, each after a byte that counts them."""
    out, at = bytearray(), 0
    while at < len(block) and len(out) < length:
        count = block[at]
        if count < 128:
            out += block[at + 1:at + 2 + count]
            at += 2 + count
        else:
            out += block[at + 1:at + 2] * (257 - count if count > 128 else 0)
            at += 2 if count > 128 else 1
    return bytes(out)


def unpack_lzw(block: bytes, length: int) -> bytes:
    """LZW (TIFF 6.0, section 13): codes of 9 to 12 bits, the most significant first, each width one code early."""
    clear, end = 256, 257
    first = [bytes((k,)) for k in range(256)] + [b"", b""]
    table, last = first.copy(), b""
    out: list[bytes] = []
    held = bits = made = 0
    width = 9
    for byte in block:
        held, bits = held << 8 | byte, bits + 8
        if bits < width:
            continue
        bits -= width
        code = held >> bits
        held &= (1 << bits) - 1
        if code == clear:
            table, last, width = first.copy(), b"", 9
            continue
        if code == end or made >= length:
            break
        if code < len(table):
            string = table[code]
        elif code == len(table) and last:
            string = last + last[:1]
        else:
            raise ValueError(f"LZW code {code}")
        if last and len(table) < 4096:
            table.append(last + string[:1])
            width = max(width, min(12, (len(table) + 1).bit_length()))
        out.append(string)
        made += len(string)
        last = string
    return b"".join(out)


def _undo_prediction(block: bytes, shape: tuple[int, int], number: np.dtype[Any], predictor: int) -> np.ndarray:
    """A strip or tile as numbers, horizontal differencing (2) or floating-point prediction (3) undone."""
    rows, columns = shape
    if number.kind == "b":
        return np.unpackbits(np.frombuffer(block, np.uint8).reshape(rows, -1), axis=1)[:, :columns]
    if predictor == 3:
        # TIFF Technical Note 3: each row's bytes, most significant first plane by plane, differenced.
        planes = np.frombuffer(block, np.uint8).reshape(rows, -1)
        planes = np.cumsum(planes, axis=1, dtype=np.uint8).reshape(rows, number.itemsize, columns)
        return np.ascontiguousarray(planes.transpose(0, 2, 1)).view(number.newbyteorder(">")).reshape(rows, columns)
    if predictor == 2:
        # Differences are of whole numbers, which wrap around, even where the numbers have fractions.
        whole = np.dtype(f"{number.str[0]}u{number.itemsize}")
        steps = np.frombuffer(block, whole).reshape(rows, columns)
        return np.cumsum(steps, axis=1, dtype=whole.newbyteorder("=")).view(number.newbyteorder("="))
    if predictor != 1:
        raise ValueError(f"predictor {predictor}")
    return np.frombuffer(block, number).reshape(rows, columns)
