"""Where a struct of Blender has its fields, as an uncompressed .blend file describes it for whoever reads it."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from itertools import pairwise

_POINTER = 8  # bytes


def offset_of(name: str, field: str, blend: bytes) -> int:
    """Bytes from the beginning of a struct to one of its fields. Raises KeyError if there is none."""
    words = _Words(blend, blend.index(b"SDNANAME") + 4)
    names, types = words.strings(b"NAME"), words.strings(b"TYPE")
    words.expect(b"TLEN")
    lengths = words.shorts(len(types))
    words.expect(b"STRC")
    for _ in range(words.integer()):
        kind, count = words.shorts(2, align=False)
        fields = words.shorts(2 * count, align=False)
        if types[kind] == name:
            places = list(_places([(names[n], lengths[t]) for t, n in zip(fields[::2], fields[1::2], strict=True)]))
            return dict(places)[field]
    raise KeyError(name)


def _places(fields: list[tuple[str, int]]) -> Iterator[tuple[str, int]]:
    """(name, offset) of each field. Blender's structs have no gaps."""
    ends = [0]
    for name, length in fields:
        each = _POINTER if name.startswith(("*", "(")) else length
        for size in re.findall(r"\[(\d+)\]", name):
            each *= int(size)
        ends.append(ends[-1] + each)
    for (name, _), (start, _end) in zip(fields, pairwise(ends), strict=True):
        yield re.sub(r"\[.*|[*()]", "", name), start


class _Words:
    """Reads what follows in the description, little-endian."""

    def __init__(self, data: bytes, at: int) -> None:
        self._data, self._start, self._at = data, at - 4, at

    def expect(self, code: bytes) -> None:
        """Go over the four letters that a part begins with."""
        found = self._data[self._at : self._at + 4]
        if found != code:
            raise ValueError(f"{code!r} is missing; {found!r} is there")
        self._at += 4

    def integer(self) -> int:
        """The next number of 32 bits."""
        self._at += 4
        return int(struct.unpack_from("<i", self._data, self._at - 4)[0])

    def shorts(self, count: int, align: bool = True) -> tuple[int, ...]:
        """The next numbers of 16 bits; what follows them begins at a multiple of 4 bytes if they are the last."""
        self._at += 2 * count
        found = struct.unpack_from(f"<{count}h", self._data, self._at - 2 * count)
        if align:
            self._align()
        return found

    def strings(self, code: bytes) -> list[str]:
        """A part of texts that end with a zero."""
        self.expect(code)
        found = []
        for _ in range(self.integer()):
            end = self._data.index(0, self._at)
            found.append(self._data[self._at : end].decode())
            self._at = end + 1
        self._align()
        return found

    def _align(self) -> None:
        self._at += -(self._at - self._start) % 4
