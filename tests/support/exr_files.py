"""EXR files by hand, whose every number can be wrong: OpenEXR technical introduction, "File Layout"."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path


def channel(name: bytes = b"Y", kind: int = 2, across: int = 1, down: int = 1) -> bytes:
    """A channel's entry."""
    return name + b"\0" + struct.pack("<4i", kind, 0, across, down)


def attribute(name: bytes, kind: bytes, value: bytes, size: int | None = None) -> bytes:
    """An attribute, with a stated ``size`` of its own."""
    return name + b"\0" + kind + b"\0" + struct.pack("<i", len(value) if size is None else size) + value


def window(left: int = 0, top: int = 0, right: int = 3, bottom: int = 3) -> bytes:
    """A window, both ends included."""
    return struct.pack("<4i", left, top, right, bottom)


def exr(
    replaced: Mapping[bytes, bytes] | None = None,
    *,
    version: int = 2,
    chunks: Sequence[tuple[int, int, bytes]] = (),
    offsets: Sequence[int] | None = None,
    compression: int = 0,
    extra: bytes = b"",
    end: bytes = b"\0",
    before: bytes = b"",
) -> bytes:
    """A file of 4 x 4 floats, uncompressed, a chunk for each line.

    ``replaced`` attributes stand in place of the usual ones (empty: none), and ``extra`` ones after them. ``chunks``
    are a stated line, a stated size and data; ``offsets`` stand in the table of chunks in place of the true ones.
    """
    stated = {
        b"channels": attribute(b"channels", b"chlist", channel() + b"\0"),
        b"compression": attribute(b"compression", b"compression", bytes([compression])),
        b"dataWindow": attribute(b"dataWindow", b"box2i", window()),
        b"displayWindow": attribute(b"displayWindow", b"box2i", window()),
        b"lineOrder": attribute(b"lineOrder", b"lineOrder", b"\0"),
        b"pixelAspectRatio": attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
        b"screenWindowCenter": attribute(b"screenWindowCenter", b"v2f", bytes(8)),
        b"screenWindowWidth": attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)),
        **(replaced or {}),
    }
    data = [
        struct.pack("<2i", line, size) + content
        for line, size, content in chunks or [(line, 16, struct.pack("<4f", *range(4))) for line in range(4)]
    ]
    head = struct.pack("<2i", 20000630, version) + before + b"".join(stated.values()) + extra + end
    place = len(head) + 8 * len(data if offsets is None else offsets)
    places = []
    for each in data:
        places.append(place)
        place += len(each)
    return (
        head
        + struct.pack(f"<{len(places if offsets is None else offsets)}Q", *(places if offsets is None else offsets))
        + b"".join(data)
    )


def one_chunk_named_often(path: Path, count: int = 4000, size: int = 2**20) -> Path:
    """A file whose table names the same chunk ``count`` times."""
    start = exr({b"dataWindow": attribute(b"dataWindow", b"box2i", window(0, 0, size // 4 - 1, count - 1))}, offsets=[])
    start = start[: start.index(b"screenWindowWidth") + len(attribute(b"screenWindowWidth", b"float", bytes(4))) + 1]
    at = len(start) + 8 * count
    path.write_bytes(start + struct.pack("<Q", at) * count + struct.pack("<2i", 0, size) + bytes(size))
    return path
