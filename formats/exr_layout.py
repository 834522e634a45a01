"""Whether an OpenEXR file is whole, without an OpenEXR library.

Blender does not say that a disk filled up while it wrote an image: it leaves a file whose table of
chunks is missing or points beyond its end. Blender's Python has no OpenEXR to find out, so this
reads the file's structure (OpenEXR technical introduction, "File Layout"), not its pixels.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

MAGIC = 20000630
MULTIPART = 0x1000
_LINES_PER_CHUNK = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}  # by compression


def _read_text(data: bytes, at: int) -> tuple[bytes, int]:
    end = data.index(b"\0", at)
    return data[at:end], end + 1


def _read_header(data: bytes, at: int) -> tuple[dict[bytes, bytes], int]:
    """Attributes of the header that starts at a byte, and where it ends."""
    attributes: dict[bytes, bytes] = {}
    while data[at] != 0:
        name, at = _read_text(data, at)
        _, at = _read_text(data, at)
        (size,) = struct.unpack_from("<i", data, at)
        attributes[name] = data[at + 4:at + 4 + size]
        at += 4 + size
    return attributes, at + 1


def _count_chunks(attributes: dict[bytes, bytes]) -> int:
    if b"chunkCount" in attributes:
        return int(struct.unpack("<i", attributes[b"chunkCount"])[0])
    _, top, _, bottom = struct.unpack("<4i", attributes[b"dataWindow"])
    lines = _LINES_PER_CHUNK[attributes[b"compression"][0]]
    return -(-(bottom - top + 1) // lines)


@dataclass(frozen=True)
class Part:
    """One part of an EXR file: its attributes, the bytes of its header, its number of chunks."""

    attributes: dict[bytes, bytes]
    header: slice
    chunks: int


def read_parts(data: bytes) -> tuple[list[Part], bool, int]:
    """Parts of an EXR file, whether it is of the kind that may have several, and where its chunk table starts.

    Raises ValueError, IndexError, KeyError or struct.error for what is no EXR file.
    """
    magic, version = struct.unpack_from("<2i", data, 0)
    if magic != MAGIC:
        raise ValueError("not an EXR file")
    several = bool(version & MULTIPART)
    parts, at = [], 8
    while True:
        start = at
        attributes, at = _read_header(data, at)
        parts.append(Part(attributes, slice(start, at), _count_chunks(attributes)))
        if not several or data[at] == 0:
            return parts, several, at + several


def is_whole(path: Path) -> bool:
    """True if every chunk of a scan-line EXR file, of one part or several, lies within the file."""
    try:
        data = path.read_bytes()
        parts, several, table = read_parts(data)
        offsets = np.frombuffer(data, "<u8", sum(part.chunks for part in parts), table)
        # A chunk begins with its part (if there are several), its first line and its size in bytes.
        before_size = 8 if several else 4
        last = int(offsets.max())
        (size,) = struct.unpack_from("<i", data, last + before_size)
        return bool(offsets.min() > 0) and last + before_size + 4 + size <= len(data)
    except (OSError, ValueError, IndexError, KeyError, struct.error):
        return False
