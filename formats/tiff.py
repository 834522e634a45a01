"""Pixels of a TIFF file, from its bytes: TIFF 6.0 (Adobe 1992) and BigTIFF, strips and tiles, one band.

The file may come from a stranger and be far larger than memory. Only used tags and the tiles of a window are read, and
the values of both are counted before memory is allocated. All lossless compressions that Python can undo are supported:
none, deflate, LZW, PackBits, LZMA, and ZSTD where Python has ``zstandard``, as official Blenders and Blender as a
Python module do. Their OpenImageIO cannot help: its TIFF library is built without ZSTD (measured in 5.0). The package
``tifffile`` cannot help either: height maps are read in Blender's own Python, and the extension's zip contains no
wheels. For LZW, it also needs ``imagecodecs``, a binary wheel for each Python and platform.
"""

from __future__ import annotations

import lzma
import math
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.foreign_bytes import Budget, ForeignBytes, OverBudgetError, RefusedError, read
from . import gdal_lines

#: The name of the format in errors.
KIND = "a whole TIFF file"
#: The fix for a torn file, which no program can repair.
FIX = "copy it again from where it is whole"
#: Largest file in bytes; only the necessary tiles are read.
MAX_BYTES = 2**40
#: Largest number of pixels that are read.
MAX_PIXELS = 2**30
#: Bytes of memory for reading any file.
_BASE_MEMORY = 2**28
#: Further bytes of memory for each byte of the file. A tile may be absent, or packed a thousandfold, but real heights
#: are not.
_MEMORY_PER_BYTE = 64
#: Bytes of memory for a pixel during its conversion to a height.
_PIXEL_MEMORY = 16
#: Bytes of memory for a value of a tag.
_VALUE_MEMORY = 64

_VALUE_TYPES = {
    1: "B",
    2: "s",
    3: "H",
    4: "I",
    5: "II",
    6: "b",
    8: "h",
    9: "i",
    11: "f",
    12: "d",
    13: "I",
    16: "Q",
    17: "q",
    18: "Q",
}
_OTHER_COMPRESSIONS = {
    2: "CCITT",
    3: "CCITT",
    4: "CCITT",
    6: "JPEG",
    7: "JPEG",
    34887: "LERC",
    50000: "ZSTD",
    50001: "WebP",
    50002: "JPEG XL",
    52546: "JPEG XL",
}
_PIXEL_TYPES = ("u1", "u2", "u4", "u8", "i1", "i2", "i4", "i8", "f2", "f4", "f8")
_MAX_DIRECTORIES, _MAX_TAGS = 1000, 4096
#: The tags that this module or ``geotiff`` uses; others are skipped.
_USED_TAGS = {
    254,
    256,
    257,
    258,
    259,
    262,
    266,
    273,
    274,
    277,
    278,
    279,
    317,
    322,
    323,
    324,
    325,
    339,
    33550,
    33922,
    34264,
    34735,
    34736,
    34737,
    42112,
    42113,
}
#: Bytes of memory that a decompressor may take for its window.
_MAX_UNPACKER_MEMORY = 2**27

Tags = dict[int, tuple[Any, ...]]


class UnreadError(RefusedError):
    """An unsupported feature of a TIFF file, as the end of a sentence about the file."""


@dataclass(frozen=True)
class Directory:
    """One image of a TIFF file: the values of its ``tags`` by number, and the byte ``order`` for struct.

    ``name`` is the name of the file, for commands that convert it.
    """

    tags: Tags
    order: str
    name: str = "in.tif"

    def number(self, tag: int, otherwise: int) -> int:
        """Return the first value of a tag of whole numbers."""
        return int(self.tags.get(tag, (otherwise,))[0])

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns. Raises KeyError if the directory does not state them."""
        return int(self.tags[257][0]), int(self.tags[256][0])

    @property
    def is_mask(self) -> bool:
        """Whether the image marks the known pixels of the previous image (NewSubfileType, bit 2)."""
        return bool(self.number(254, 0) & 4)

    @property
    def is_reduced(self) -> bool:
        """Whether the image is a smaller copy of another image (NewSubfileType, bit 0)."""
        return bool(self.number(254, 0) & 1)


def grant_memory(foreign: ForeignBytes) -> None:
    """Allow the reading of a file memory in proportion to its size."""
    foreign.budget = Budget(_BASE_MEMORY + _MEMORY_PER_BYTE * foreign.size)


def read_directories(foreign: ForeignBytes) -> list[Directory]:
    """Read the images of a TIFF file in their order. Raises KeyError, ValueError or OverBudgetError if it is
    truncated."""
    start = foreign.cursor(0, min(foreign.size, 16))
    order = {b"II": "<", b"MM": ">"}[start.take(2)]
    magic = start.number(f"{order}H")
    if magic not in (42, 43):
        raise ValueError(f"magic number {magic}")
    place = f"{order}Q" if magic == 43 else f"{order}I"
    start.skip_to(8 if magic == 43 else 4)
    at = start.number(place)
    found: list[Directory] = []
    seen = set()
    while at and at not in seen and len(found) < _MAX_DIRECTORIES:
        seen.add(at)
        tags, at = _read_tags(foreign, at, order, place)
        found.append(Directory(tags, order, foreign.name))
    if not found:
        raise ValueError("no image")
    return found


def stores_floats(path: Path) -> bool:
    """Return whether a file is a TIFF file of floating-point numbers; False for a damaged file or another format."""
    try:
        return read(path, lambda foreign: read_directories(foreign)[0].number(339, 1) == 3, KIND, FIX, MAX_BYTES)
    except IcyMoonError:
        return False


def _read_tags(foreign: ForeignBytes, at: int, order: str, place: str) -> tuple[Tags, int]:
    """Read the values of a directory's tags by number, and the offset of the next directory, 0 after the last."""
    big = place.endswith("Q")
    head, inline = (f"{order}HHQ", 8) if big else (f"{order}HHI", 4)
    length = 8 if big else 2
    count = foreign.cursor(at, length).number(f"{order}Q" if big else f"{order}H")
    if count > _MAX_TAGS:
        raise ValueError(f"{count} tags")
    cursor = foreign.cursor(at + length, count * (struct.calcsize(head) + inline) + inline)
    tags: Tags = {}
    for _ in range(count):
        tag, kind, n = cursor.unpack(head)
        value = cursor.take(inline)
        if tag in _USED_TAGS and kind in _VALUE_TYPES:
            tags[tag] = _read_values(foreign, kind, n, order, place, value)
    return tags, cursor.number(place)


def _read_values(foreign: ForeignBytes, kind: int, n: int, order: str, place: str, value: bytes) -> tuple[Any, ...]:
    """Read ``n`` values of a tag, from its entry or from the offset in the entry."""
    unit = order + _VALUE_TYPES[kind]
    size = n * struct.calcsize(unit)
    foreign.budget.charge(size + _VALUE_MEMORY * (1 if kind == 2 else n), "tags")
    if size > len(value):
        value = foreign.part(int(struct.unpack(place, value)[0]), size)
    return struct.unpack(f"{order}{n}s" if kind == 2 else order + _VALUE_TYPES[kind] * n, value[:size])


def read_pixels(
    foreign: ForeignBytes, image: Directory, window: tuple[range, range] | None = None
) -> tuple[Array, np.dtype[Any]]:
    """Read an image's one band as float64 (rows, columns), NaN for an absent tile. Also return the file's number type.
    With a ``window`` (rows, columns), only its tiles or strips are read. Raises UnreadError for an unsupported kind of
    image, or one that needs more memory than a file of its size may use. Raises ValueError, or an error of the
    decompressor, for a truncated file or an impossible window."""
    number, unpack = _find_number_type(image), _choose_unpacker(image)
    rows, columns = image.shape
    tiled = 322 in image.tags
    width, height = find_tile_size(image)
    down, right = _checked_window(image, window)
    offsets, sizes = (image.tags[k] for k in ((324, 325) if tiled else (273, 279)))
    across = -(-columns // width)
    if not len(offsets) == len(sizes) == across * -(-rows // height):
        raise ValueError(f"{len(offsets)} tiles or strips")
    row_bytes = -(-width // 8) if number.kind == "b" else width * number.itemsize
    try:
        # A tile is in memory three times: packed, unpacked, and with its prediction undone.
        foreign.budget.charge(_PIXEL_MEMORY * len(down) * len(right) + 3 * height * row_bytes, "pixels")
    except OverBudgetError:
        raise UnreadError(
            f"has {columns} x {rows} pixels in tiles of {width} x {height}, which is more than a file of "
            f"{foreign.size / 1e6:.2g} MB may take of memory; "
            f"{_make_smaller(image, len(down) * len(right))}"
        ) from None
    grid = np.full((len(down), len(right)), np.nan)
    predictor, packed = image.number(317, 1), image.number(259, 1) != 1
    lefts = range(right.start // width * width, right.stop, width)
    columns_of = [(left // width, *_find_overlap(left, width, right)) for left in lefts]
    for top in range(down.start // height * height, down.stop, height):
        tall = height if tiled else min(height, rows - top)
        length = tall * row_bytes
        # No compression makes data much longer, so stated bytes beyond that do not belong to the strip.
        most = 2 * length + 2**16 if packed else length
        rows_there, rows_here = _find_overlap(top, tall, down)
        for place, columns_there, columns_here in columns_of:
            k = top // height * across + place
            if sizes[k] == 0:
                continue  # a sparse file: the tile is missing
            block = unpack(foreign.part(offsets[k], min(sizes[k], most)), length)
            if len(block) < length:
                raise ValueError(f"a tile or strip of {len(block)} bytes")
            values = _undo_prediction(block[:length], (tall, width), number, predictor)
            with np.errstate(invalid="ignore"):  # NaN stays NaN
                grid[rows_here, columns_here] = values[rows_there, columns_there]
    return grid, number


def _make_smaller(image: Directory, wanted: int) -> str:
    """Return the fix for a file whose ``wanted`` pixels take too much memory: tiles, or coarser pixels."""
    if _PIXEL_MEMORY * wanted <= _BASE_MEMORY // 2:
        return f"store it in tiles, in its folder with: {gdal_lines.make_tile_command(image.name)}"
    rows, columns = image.shape
    width = max(2, int(math.sqrt(_BASE_MEMORY / 2 / _PIXEL_MEMORY * columns / rows)))
    return "make it coarser in its folder with: " + gdal_lines.make_tile_command(
        image.name, f"-r average -outsize {min(width, columns)} 0"
    )


def find_tile_size(image: Directory) -> tuple[int, int]:
    """Find the width and height of the tiles or strips; the last strip may be lower. Raises ValueError for an image or
    a tile without pixels."""
    rows, columns = image.shape
    if 322 in image.tags:
        width, height = image.number(322, 0), image.number(323, 0)
    else:
        width, height = columns, min(image.number(278, rows), rows)
    if min(width, height, columns, rows) < 1:
        raise ValueError("no pixels")
    return width, height


def _checked_window(image: Directory, window: tuple[range, range] | None) -> tuple[range, range]:
    """Return the rows and columns to read; all without a ``window``. Raises ValueError for rows or columns outside the
    image, and UnreadError for too many."""
    rows, columns = image.shape
    down, right = window or (range(rows), range(columns))
    if not (0 <= down.start < down.stop <= rows and 0 <= right.start < right.stop <= columns):
        raise ValueError(f"no window of rows {down.start} to {down.stop} and columns {right.start} to {right.stop}")
    if len(down) * len(right) > MAX_PIXELS:
        raise UnreadError(
            f"has {columns} x {rows} pixels, Icy Moon reads {MAX_PIXELS} at most; "
            f"{_make_smaller(image, len(down) * len(right))}"
        )
    return down, right


def _find_overlap(start: int, size: int, wanted: range) -> tuple[slice, slice]:
    """Find the overlap of the ``wanted`` rows (or columns) with ``size`` rows from ``start`` on, as a slice of each:
    first of the ``size`` rows, then of the wanted ones."""
    first, last = max(start, wanted.start), min(start + size, wanted.stop)
    return slice(first - start, last - start), slice(first - wanted.start, last - wanted.start)


def _find_number_type(image: Directory) -> np.dtype[Any]:
    """Find the number type of the only band; bool for one bit. Raises UnreadError for an unsupported type."""
    bands = image.number(277, 1)
    if bands != 1:
        raise UnreadError(f"has {bands} bands, but only one can be read; {_convert_fix(image)}")
    if image.number(262, 1) == 3:
        raise UnreadError("holds colours of a palette, not heights; give a file with the numbers themselves.")
    if image.number(274, 1) != 1:  # GDAL would copy the rows as they are
        raise UnreadError(
            "states that its rows or columns are in reverse order, which other programs do not read; "
            "save it again with its first row on top."
        )
    if image.number(266, 1) != 1:
        raise UnreadError(f"is stored with its bits in reverse order; {_convert_fix(image)}")
    bits = image.number(258, 1)
    if bits == 1 and image.is_mask:
        return np.dtype(bool)
    kind = {1: "u", 2: "i", 3: "f", 4: "u"}.get(image.number(339, 1), "?")
    if bits % 8 or f"{kind}{bits // 8}" not in _PIXEL_TYPES:
        raise UnreadError(
            f"holds {bits}-bit values of a kind that Icy Moon does not read; {_convert_fix(image, '-ot Float32')}"
        )
    return np.dtype(f"{image.order}{kind}{bits // 8}")


def _convert_fix(image: Directory, *options: str) -> str:
    """Return the fix for a kind of file that only GDAL can read."""
    return f"convert it in its folder with: {gdal_lines.make_translate_command(image.name, *options)}"


def _choose_unpacker(image: Directory) -> Callable[[bytes, int], bytes]:
    """Choose the function that decompresses a tile or strip to a given length. Raises UnreadError for an unsupported
    method."""
    compression = image.number(259, 1)
    if compression == 50000 and (zstandard := _find_zstandard()):
        return zstandard
    known: dict[int, Callable[[bytes, int], bytes]] = {
        1: lambda block, length: block,
        5: unpack_lzw,
        8: _inflate,
        32946: _inflate,
        32773: _unpack_bits,
        34925: lambda block, length: lzma.LZMADecompressor(memlimit=_MAX_UNPACKER_MEMORY).decompress(block, length),
    }
    if compression not in known:
        name = _OTHER_COMPRESSIONS.get(compression, f"method {compression}")
        raise UnreadError(f"is compressed with {name}, which Icy Moon does not read here; {_convert_fix(image)}")
    return known[compression]


def _find_zstandard() -> Callable[[bytes, int], bytes] | None:
    try:
        import zstandard
    except ImportError:
        return None

    def unpack(block: bytes, length: int) -> bytes:
        unpacker = zstandard.ZstdDecompressor(max_window_size=_MAX_UNPACKER_MEMORY)
        try:  # by a stream, since otherwise memory is allocated for the size that the block states
            with unpacker.stream_reader(block) as stream:
                return bytes(stream.read(length))
        except zstandard.ZstdError as error:
            raise ValueError(error) from None

    return unpack


def _inflate(block: bytes, length: int) -> bytes:
    return zlib.decompressobj().decompress(block, length)


def _unpack_bits(block: bytes, length: int) -> bytes:
    """Decompress PackBits (TIFF 6.0, section 9): runs and literals, each after a byte that counts them."""
    out, at = bytearray(), 0
    while at < len(block) and len(out) < length:
        count = block[at]
        if count < 128:
            out += block[at + 1 : at + 2 + count]
            at += 2 + count
        else:
            out += block[at + 1 : at + 2] * (257 - count if count > 128 else 0)
            at += 2 if count > 128 else 1
    return bytes(out)


def unpack_lzw(block: bytes, length: int) -> bytes:
    """Decompress LZW (TIFF 6.0, section 13): codes of 9 to 12 bits, the most significant bit first. The width of the
    codes grows one code early."""
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


def _undo_prediction(block: bytes, shape: tuple[int, int], number: np.dtype[Any], predictor: int) -> Array:
    """Return a strip or tile as numbers, after undoing horizontal differencing (2) or floating-point prediction (3)."""
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
