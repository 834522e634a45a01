"""What an EXR file of others states about its channels, before a library decodes them.

After the OpenEXR technical introduction, "File Layout".
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from ...support.foreign_bytes import Cursor, ForeignBytes, RefusedError
from .image_headers import check_size

EXR = b"\x76\x2f\x31\x01"
_SEVERAL_PARTS, _DEEP = 0x1000, 0x800
#: Most bytes of all headers, which may have a picture, and attributes, parts and bytes of a name.
_MOST_HEADER, _MOST_ATTRIBUTES, _MOST_PARTS, _LONGEST_NAME = 2**24, 10_000, 1000, 255
_TYPES = ("u4", "f2", "f4")


@dataclass(frozen=True)
class Channel:
    """A channel of one of the parts of an EXR file, and its size and type."""

    part: int
    name: str
    width: int
    height: int
    dtype: np.dtype[np.generic]

    @property
    def size_bytes(self) -> int:
        """Bytes of its pixels."""
        return self.width * self.height * self.dtype.itemsize


def parse_channels(foreign: ForeignBytes) -> list[Channel]:
    """All channels that a file states, the pixels of all of them charged: a library decodes a part as a whole.

    Raises ValueError or struct.error if it is torn, RefusedError and OverBudgetError for one that is not read.
    """
    cursor = foreign.cursor(0, min(foreign.size, _MOST_HEADER))
    if cursor.take(4) != EXR:
        raise ValueError("it does not begin as EXR")
    flags = cursor.number("<I")
    if flags & _DEEP:
        raise RefusedError("has several depths in a pixel; save it with one, as a flat EXR file.")
    found: list[Channel] = []
    for part in range(_MOST_PARTS):
        attributes = _parse_header(cursor)
        if flags & _SEVERAL_PARTS and not attributes:
            break
        found += _channels_of(part, attributes, foreign)
        if not flags & _SEVERAL_PARTS:
            break
    else:
        raise ValueError(f"more than {_MOST_PARTS} parts")
    if not found:
        raise ValueError("it has no channels")
    return found


def _parse_header(cursor: Cursor) -> dict[bytes, bytes]:
    """The attributes of a part; none where there are no more parts."""
    found: dict[bytes, bytes] = {}
    for _ in range(_MOST_ATTRIBUTES):
        name = cursor.take_until(b"\0", _LONGEST_NAME)
        if not name:
            return found
        cursor.take_until(b"\0", _LONGEST_NAME)
        if name in found:
            raise ValueError(f"it states {name[:40]!r} twice")
        found[name] = cursor.take(cursor.number("<i"))
    raise ValueError(f"more than {_MOST_ATTRIBUTES} attributes")


def _channels_of(part: int, attributes: dict[bytes, bytes], foreign: ForeignBytes) -> list[Channel]:
    if attributes.get(b"type", b"").startswith(b"deep"):
        raise RefusedError("has several depths in a pixel; save it with one, as a flat EXR file.")
    left, top, right, bottom = struct.unpack("<4i", attributes[b"dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    check_size(width, height)
    cursor = Cursor(attributes[b"channels"], foreign.budget)
    found: dict[str, Channel] = {}
    while name := cursor.take_until(b"\0", _LONGEST_NAME).decode("utf-8", "replace"):
        kind, across, down = cursor.unpack("<i4x2i")
        if not (0 <= kind < len(_TYPES) and across > 0 and down > 0) or name in found:
            raise ValueError(f"the channel {name[:40]!r} is there twice, or of another kind")
        found[name] = Channel(part, name, -(-width // across), -(-height // down), np.dtype(f"<{_TYPES[kind]}"))
        foreign.budget.charge(found[name].size_bytes, "channels")
    return list(found.values())
