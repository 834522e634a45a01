"""The structure of an OpenEXR file, checked without an OpenEXR library and without decoding a pixel.

If a disk fills up while Blender writes an image, Blender reports no error and leaves a file whose table of chunks is
missing or points beyond its end. A file may also come from a stranger, while libraries trust its headers. So this
module reads the headers and the heads of all chunks (OpenEXR technical introduction, "File Layout") as foreign bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.foreign_bytes import Budget, Cursor, ForeignBytes, read

MAGIC = 20000630
MULTIPART = 0x1000
#: Name of the format in errors.
KIND = "an EXR file"
#: Largest file of ours in bytes: images of 16384 x 16384 px have some gigabytes.
MAX_BYTES = 2**36
#: Version of the file format.
_FORMAT_VERSION = 2
#: Flag of a file in tiles.
_TILED_FLAG = 0x200
#: Flag of names above 31 bytes.
_LONG_NAMES_FLAG = 0x400
_PART_TYPES = (b"scanlineimage", b"tiledimage")
#: Lines in a chunk by compression, as OpenEXR 3.5 writes them.
_LINES_PER_CHUNK = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256, 10: 256, 11: 32, 12: 256, 13: 1}
#: Bytes of a value by the type of its channel: whole number, 16-bit float, 32-bit float.
_VALUE_BYTES = {0: 4, 1: 2, 2: 4}
#: Largest size of all headers in bytes; Blender writes some hundreds of bytes for each pass.
_MAX_HEADER_BYTES = 2**20
#: Maximum number of channels of all parts; Blender writes a few for each pass.
_MAX_CHANNELS = 2**12
#: Longest name in bytes.
_MAX_NAME_BYTES = 255
#: Largest pixel coordinate, as in the OpenEXR library: the sum of two fits into 32 bits.
_LARGEST_COORDINATE = 2**30 - 1
#: Bytes of memory for the decoded values of any file.
_BASE_MEMORY = 2**27
#: Further bytes of memory for each byte of the file. Deflate packs a constant image a thousandfold, but the images of a
#: pair threefold.
_MEMORY_PER_BYTE = 64
#: Bytes of memory for a chunk's entry in the table of chunks.
_CHUNK_MEMORY = 128
#: Bytes of memory for a channel, besides its values.
_CHANNEL_MEMORY = 1024


@dataclass(frozen=True)
class Channel:
    """A channel of a part: the type of its values, the steps between its sampled columns and rows, and its entry in the
    header. The types are 0 (32-bit whole numbers), 1 (16-bit floats) and 2 (32-bit floats)."""

    kind: int
    steps: tuple[int, int]
    stated: bytes

    @property
    def value_bytes(self) -> int:
        """Number of bytes of one value of the channel."""
        return _VALUE_BYTES[self.kind]


@dataclass(frozen=True)
class Part:
    """One part of an EXR file. ``values`` has its attributes by name; ``stated`` has them with name, type, size and
    value as in the file. ``window`` is the data window (left, top, right, bottom), both ends included. ``places``
    (chunks, 2) has the offset of each chunk's first byte after the part's number, and the offset of its end."""

    values: Mapping[bytes, bytes]
    stated: Mapping[bytes, bytes]
    window: tuple[int, int, int, int]
    channels: Mapping[str, Channel]
    places: Array

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        left, top, right, bottom = self.window
        return bottom - top + 1, right - left + 1

    @property
    def decoded_bytes(self) -> int:
        """Bytes of memory for all values of the part as 32-bit numbers."""
        rows, columns = self.shape
        return len(self.channels) * (4 * rows * columns + _CHANNEL_MEMORY)


@dataclass(frozen=True)
class _Header:
    """Attributes of a part by name: their values, their types, and their bytes in the file."""

    values: dict[bytes, bytes]
    kinds: dict[bytes, bytes]
    stated: dict[bytes, bytes]

    def value(self, name: bytes, kind: bytes, size: int | None = None) -> bytes:
        """Return the value of an attribute. Raises KeyError if it is missing, ValueError for another type or size."""
        value = self.values[name]
        if self.kinds[name] != kind or (size is not None and len(value) != size):
            raise ValueError(
                f"the attribute {name.decode('ascii', 'replace')} of type {self.kinds[name][:40]!r} and "
                f"{len(value)} bytes"
            )
        return value


def decoding_budget(size: int) -> Budget:
    """Return how many bytes the decoded values of a file of ``size`` bytes may take."""
    return Budget(_BASE_MEMORY + _MEMORY_PER_BYTE * size)


def read_layout(foreign: ForeignBytes, tiles: bool = False) -> list[Part]:
    """Read the parts of an EXR file. Their chunks must lie in the file, without overlap, and in the image of their
    part. ``tiles`` allows parts stored in tiles. Raises ValueError, KeyError or OverBudgetError if the file is damaged
    or has deep data."""
    cursor = foreign.cursor(0, min(foreign.size, _MAX_HEADER_BYTES))
    magic, version = cursor.unpack("<2I")
    flags = version & ~0xFF
    if magic != MAGIC:
        raise ValueError("it does not begin as an EXR file")
    if version & 0xFF != _FORMAT_VERSION or flags & ~(MULTIPART | _TILED_FLAG | _LONG_NAMES_FLAG):
        raise ValueError(f"version {version:#x}")
    several = bool(flags & MULTIPART)
    headers: list[_Header] = []
    while not headers or several:
        header = _read_header(cursor)
        if not header.values and headers:
            break
        headers.append(header)
    found: list[Part] = []
    counts = [_read_part(header, bool(flags & _TILED_FLAG) and not several, tiles, found) for header in headers]
    if sum(len(part.channels) for part in found) > _MAX_CHANNELS:
        raise ValueError(f"more than {_MAX_CHANNELS} channels")
    places = _find_chunks(foreign, cursor.at, found, counts, several)
    return [
        Part(part.values, part.stated, part.window, part.channels, each)
        for part, each in zip(found, places, strict=True)
    ]


def _read_header(cursor: Cursor) -> _Header:
    header = _Header({}, {}, {})
    while name := cursor.take_until(b"\0", _MAX_NAME_BYTES):
        kind = cursor.take_until(b"\0", _MAX_NAME_BYTES)
        size = cursor.take(4)
        if name in header.values:
            raise ValueError(f"the attribute {name[:40]!r} twice")
        value = cursor.take(int.from_bytes(size, "little", signed=True))
        header.values[name], header.kinds[name] = value, kind
        header.stated[name] = b"%b\0%b\0%b%b" % (name, kind, size, value)
    return header


def _read_part(header: _Header, is_tiled: bool, tiles: bool, found: list[Part]) -> int:
    """Add the part of a header to ``found``, without the byte ranges of its chunks. Returns the number of its
    chunks."""
    window = _read_window(header, b"dataWindow")
    if b"displayWindow" in header.values:
        _read_window(header, b"displayWindow")
    if b"lineOrder" in header.values:
        header.value(b"lineOrder", b"lineOrder", 1)
    if b"type" in header.values:
        kind = header.value(b"type", b"string")
        if kind not in _PART_TYPES:
            raise ValueError(f"a part of type {kind[:40]!r}")
        is_tiled = is_tiled or kind == b"tiledimage"
    if is_tiled and not tiles:
        raise ValueError("it is stored in tiles")
    compression = header.value(b"compression", b"compression", 1)[0]
    if compression not in _LINES_PER_CHUNK:
        raise ValueError(f"compression {compression}")
    left, top, right, bottom = window
    count = (
        _count_tiles(header, right - left + 1, bottom - top + 1)
        if is_tiled
        else -(-(bottom - top + 1) // _LINES_PER_CHUNK[compression])
    )
    if b"chunkCount" in header.values:
        (stated,) = struct.unpack("<i", header.value(b"chunkCount", b"int", 4))
        if stated != count:
            raise ValueError(f"{stated} chunks instead of {count}")
    found.append(
        Part(
            header.values,
            header.stated,
            window,
            read_channels(header.value(b"channels", b"chlist")),
            np.empty((0, 2), np.int64),
        )
    )
    return count


def _read_window(header: _Header, name: bytes) -> tuple[int, int, int, int]:
    left, top, right, bottom = struct.unpack("<4i", header.value(name, b"box2i", 16))
    if not (
        -_LARGEST_COORDINATE <= left <= right <= _LARGEST_COORDINATE
        and -_LARGEST_COORDINATE <= top <= bottom <= _LARGEST_COORDINATE
    ):
        raise ValueError(f"a window from ({left}, {top}) to ({right}, {bottom})")
    return left, top, right, bottom


def read_channels(value: bytes) -> dict[str, Channel]:
    """Read the channels of a header by name, in the order of the file, from the attribute ``channels``. Raises
    ValueError for a channel that occurs twice or has an unknown type, and for a list without an end."""
    cursor, found = Cursor(value, Budget()), {}
    while name := cursor.take_until(b"\0", _MAX_NAME_BYTES):
        entry = cursor.take(16)
        kind, _, across, down = struct.unpack("<iBxxx2i", entry)
        text = name.decode()
        if text in found or kind not in _VALUE_BYTES or min(across, down) < 1:
            raise ValueError(f"the channel {text[:40]!r} of type {kind} at every ({across}, {down}) pixels")
        found[text] = Channel(kind, (across, down), b"%b\0%b" % (name, entry))
    if cursor.left or not found:
        raise ValueError(f"{len(found)} channels, and {cursor.left} bytes after them")
    return found


def _count_tiles(header: _Header, width: int, height: int) -> int:
    """Count the tiles of all levels of a part."""
    across, down, mode = struct.unpack("<2IB", header.value(b"tiles", b"tiledesc", 9))
    levels, rounds_up = mode & 0xF, mode >> 4
    if not (0 < across <= _LARGEST_COORDINATE and 0 < down <= _LARGEST_COORDINATE and levels <= 2 and rounds_up <= 1):
        raise ValueError(f"tiles of {across} x {down} px in mode {mode}")
    if levels == 0:
        return -(-width // across) * -(-height // down)

    def counts(size: int, tile: int, longest: int) -> list[int]:
        number = (longest - 1).bit_length() if rounds_up else longest.bit_length() - 1
        return [-(-max(1, (size + (rounds_up << k) - rounds_up) >> k) // tile) for k in range(number + 1)]

    if levels == 1:
        longest = max(width, height)
        return sum(x * y for x, y in zip(counts(width, across, longest), counts(height, down, longest), strict=True))
    return sum(counts(width, across, width)) * sum(counts(height, down, height))


def _find_chunks(foreign: ForeignBytes, table: int, parts: list[Part], counts: list[int], several: bool) -> list[Array]:
    """Find the byte range of each chunk of each part. Raises ValueError for an impossible range."""
    count = sum(counts)
    foreign.budget.charge(_CHUNK_MEMORY * count, "table of chunks")
    offsets = np.frombuffer(foreign.part(table, 8 * count), "<u8")
    if not table + 8 * count <= int(offsets.min()) <= int(offsets.max()) < foreign.size:
        raise ValueError("a chunk lies outside of the file")
    # A chunk is its part's number (if there are several), its first line or its tile, the size of its data, its data.
    skip, tiled = 4 if several else 0, {b"tiles" in part.values for part in parts}
    if len(tiled) > 1:
        raise ValueError("it is stored partly in tiles")
    head = skip + (20 if True in tiled else 8)
    heads = np.frombuffer(b"".join([foreign.part(place, head) for place in offsets.tolist()]), "<i4").reshape(count, -1)
    number = np.repeat(np.arange(len(parts)), counts)
    if several and (heads[:, 0] != number).any():
        raise ValueError("a chunk is of another part")
    _check_places_in_image(parts, counts, number, heads[:, skip // 4 : -1])
    sizes = heads[:, -1].astype(np.int64)
    if sizes.min() < 0:
        raise ValueError(f"a chunk of {sizes.min()} bytes")
    places = np.stack([offsets.astype(np.int64) + skip, offsets.astype(np.int64) + head + sizes], axis=1)
    ordered = places[np.argsort(places[:, 0], kind="stable")]
    if (ordered[1:, 0] - skip < ordered[:-1, 1]).any() or ordered[-1, 1] > foreign.size:
        raise ValueError("its chunks overlap, or the last is cut off")
    return np.split(places, np.cumsum(counts)[:-1])


def _check_places_in_image(parts: list[Part], counts: list[int], number: Array, stated: Array) -> None:
    """Raise ValueError for chunks with lines outside the part or with repeated lines. Tiles are only checked for
    duplicates."""
    if stated.shape[1] == 1:
        tops, steps = (
            np.array(each, np.int64)
            for each in zip(
                *((part.window[1], _LINES_PER_CHUNK[part.values[b"compression"][0]]) for part in parts), strict=True
            )
        )
        place, rest = np.divmod(stated[:, 0].astype(np.int64) - tops[number], steps[number])
        wrong = rest.any() or (place < 0).any() or (place >= np.array(counts)[number]).any()
        stated = np.stack([number, place], axis=1)
    else:
        wrong = (stated < 0).any()
        stated = np.concatenate([number[:, None], stated], axis=1)
    if wrong or len(set(map(tuple, stated.tolist()))) < len(stated):
        raise ValueError("a chunk has lines outside the image, or lines of another chunk")


def check_decodable(foreign: ForeignBytes, tiles: bool = False) -> list[Part]:
    """Read the parts of a file, and check that all values fit into its ``decoding_budget``.

    ``tiles`` and the errors are those that ``read_layout`` has.
    """
    parts = read_layout(foreign, tiles)
    budget = decoding_budget(foreign.size)
    for part in parts:
        budget.charge(part.decoded_bytes, "pixels")
    return parts


def is_whole(path: Path) -> bool:
    """Return whether every chunk of a scan-line EXR file, of one part or several, lies within the file."""
    return bool(read_sizes(path))


def read_sizes(path: Path) -> set[tuple[int, int]]:
    """Read the columns and rows of each part of a scan-line EXR file; no sizes if it is not whole."""
    try:
        return {part.shape[::-1] for part in read(path, read_layout, KIND, "write it again", most=MAX_BYTES)}
    except IcyMoonError:
        return set()
