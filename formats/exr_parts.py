"""OpenEXR files split into parts and assembled again, without an OpenEXR library and without decoding a pixel.

Blender 5 writes a part for each pass, Blender 4 one part for a whole render. A pair's image consists of the parts of
two renders, radiance and truth. Facts that change from run to run (dates, times, memory) are left out of the headers,
so that equal pixels give equal files.
"""

from __future__ import annotations

import struct
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..support.foreign_bytes import Budget, ForeignBytes
from .exr_layout import MAGIC, MULTIPART, check_decodable

_FILE_START = struct.Struct("<2i")
#: Version of the file format.
_FORMAT_VERSION = 2
#: Flag of names above 31 bytes.
_LONG_NAMES_FLAG = 0x400
#: Attributes that change from run to run; further ones are ``cycles.LAYER.render_time`` and the like.
_RUN_ATTRIBUTES = {b"Date", b"Time", b"RenderTime", b"Memory", b"File", b"Hostname", b"Frame", b"Scene", b"Camera"}


@dataclass(frozen=True)
class Piece:
    """A part of a file: the attributes of its header by name, each with its bytes in the file, and its chunks. A chunk
    begins with the number of its first line."""

    attributes: Mapping[bytes, bytes]
    chunks: list[bytes]

    @property
    def name(self) -> str:
        """Name of the part, in Blender 5 the name of its pass; empty in a file of one part."""
        return self.value(b"name").decode() if b"name" in self.attributes else ""

    def value(self, name: bytes) -> bytes:
        """Return the bytes of an attribute's value, without its name, type and size. Raises KeyError if the part lacks
        it."""
        stated = self.attributes[name]
        return stated[stated.index(b"\0", len(name) + 1) + 5 :]


def read_pieces(data: bytes) -> list[Piece]:
    """Read the parts of an EXR file of scan lines. Raises ValueError, KeyError or OverBudgetError for another kind of
    file, and for values that take more memory than the file's size allows."""
    return [
        Piece(part.stated, [data[begin:end] for begin, end in part.places.tolist()])
        for part in check_decodable(ForeignBytes(data, len(data), Budget()))
    ]


def assemble(parts: Sequence[Piece]) -> bytes:
    """Assemble the bytes of an EXR file from these parts, whose names must differ."""
    headers = b"".join(b"".join(part.attributes.values()) + b"\0" for part in parts) + b"\0"
    long_names = any(len(name) > 31 for part in parts for name in part.attributes)
    place = _FILE_START.size + len(headers) + 8 * sum(len(part.chunks) for part in parts)
    places, chunks = [], []
    for number, part in enumerate(parts):
        for chunk in part.chunks:
            places.append(place)
            chunks += [struct.pack("<i", number), chunk]
            place += 4 + len(chunk)
    start = _FILE_START.pack(MAGIC, _FORMAT_VERSION | MULTIPART | (_LONG_NAMES_FLAG if long_names else 0))
    return b"".join((start, headers, np.array(places, "<u8").tobytes(), *chunks))


def keep_rows(piece: Piece, rows: range) -> tuple[Piece, int]:
    """Keep only the chunks of a part that contain some of ``rows``, counted from its top. Also return the number of
    rows in the first chunk that precede them. Raises ValueError for rows outside the part."""
    left, top, right, bottom = struct.unpack("<4i", piece.value(b"dataWindow"))
    if not 0 <= rows.start < rows.stop <= bottom - top + 1:
        raise ValueError(f"it has no lines {rows.start} to {rows.stop}")
    placed = sorted((struct.unpack_from("<i", chunk)[0] - top, chunk) for chunk in piece.chunks)
    starts = [start for start, _ in placed]
    first = bisect_right(starts, rows.start) - 1
    after = bisect_left(starts, rows.stop)
    end = starts[after] if after < len(starts) else bottom - top + 1
    chunks = [chunk for _, chunk in placed[first:after]]
    window = struct.pack("<4i", left, top + starts[first], right, top + end - 1)
    cut = {**piece.attributes, b"dataWindow": encode_attribute("dataWindow", "box2i", window)}
    if b"chunkCount" in cut:
        cut[b"chunkCount"] = encode_attribute("chunkCount", "int", struct.pack("<i", len(chunks)))
    return replace(piece, attributes=cut, chunks=chunks), rows.start - starts[first]


def keep_part_attributes(piece: Piece, name: str) -> Piece:
    """Drop a part's attributes about its render, and add the name, type and number of chunks that a file of several
    parts needs. ``name`` is used for a part without a name."""
    kept = {
        key: value
        for key, value in piece.attributes.items()
        if key not in _RUN_ATTRIBUTES and not key.startswith(b"cycles.")
    }
    kept.setdefault(b"name", encode_attribute("name", "string", name.encode()))
    kept.setdefault(b"type", encode_attribute("type", "string", b"scanlineimage"))
    kept.setdefault(b"chunkCount", encode_attribute("chunkCount", "int", struct.pack("<i", len(piece.chunks))))
    return replace(piece, attributes=kept)


def encode_attribute(name: str, kind: str, value: bytes) -> bytes:
    """Encode an attribute as the bytes of a file."""
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


def join_layers(
    layers: Mapping[str, Sequence[Piece]], less: Callable[[Piece], Piece | None] = lambda piece: piece
) -> bytes:
    """Join the parts of several files, by layer, in one EXR file. ``less`` maps a part to its replacement or to None.
    The only part of a layer, if it has no name, gets the layer's name."""
    return assemble(
        [
            keep_part_attributes(left, name)
            for name, pieces in layers.items()
            for piece in pieces
            if (left := less(piece)) is not None
        ]
    )
