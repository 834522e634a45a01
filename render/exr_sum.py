"""Light of one OpenEXR file added to another, without an OpenEXR library.

Only the passes whose light changes are decoded (OpenEXR technical introduction, "File Layout"; compressions none, ZIPS
and ZIP); other parts stay as they are.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np

from ..labels import BEAUTY
from .exr_parts import Piece, assembled, lasting, pieces

_LINES = {0: 1, 2: 1, 3: 16}  # in a chunk, by compression
_FLOAT = 2
_PLANET = f"{BEAUTY}.Combined_Planet"


class _Part:
    """The values of a part."""

    def __init__(self, piece: Piece) -> None:
        """Raises ValueError if a channel is not of 32-bit floats, KeyError for another compression."""
        self._piece, self.channels = piece, _channels(piece.value(b"channels"))
        left, self._top, right, bottom = struct.unpack("<4i", piece.value(b"dataWindow"))
        self._compression = piece.value(b"compression")[0]
        self._lines = _LINES[self._compression]
        self._width, self._height = right - left + 1, bottom - self._top + 1

    def pixels(self) -> np.ndarray:
        """Values (height, channel, width) float32."""
        count = len(self.channels)
        found = np.empty((self._height, count, self._width), "<f4")
        for chunk in self._piece.chunks:
            line = struct.unpack_from("<i", chunk)[0] - self._top
            rows = min(self._lines, self._height - line)
            raw = _inflated(chunk[8:], rows * count * self._width * 4)
            found[line:line + rows] = np.frombuffer(raw, "<f4").reshape(rows, count, self._width)
        return found

    def with_pixels(self, values: np.ndarray) -> Piece:
        """The part with other values of the same shape."""
        chunks = []
        for chunk in self._piece.chunks:
            line = struct.unpack_from("<i", chunk)[0]
            raw = np.ascontiguousarray(values[line - self._top:line - self._top + self._lines], "<f4").tobytes()
            data = _deflated(raw) if self._compression else raw
            chunks.append(struct.pack("<2i", line, len(data)) + data)
        return Piece(self._piece.attributes, chunks)


def _channels(data: bytes) -> list[str]:
    """Names of the channels in the order of the file."""
    names, at = [], 0
    while data[at] != 0:
        end = data.index(b"\0", at)
        names.append(data[at:end].decode())
        if struct.unpack_from("<i", data, end + 1)[0] != _FLOAT:
            raise ValueError(f"{names[-1]} is not of 32-bit floats")
        at = end + 17
    return names


def _inflated(data: bytes, size: int) -> bytes:
    """A chunk's values; one that did not shrink is stored as it is."""
    if len(data) == size:
        return data
    steps = np.frombuffer(zlib.decompress(data), np.uint8).copy()
    steps[1:] -= 128  # bytes are stored as differences about 128, first those at even places, then the others
    halves = np.cumsum(steps, dtype=np.uint8)
    whole = np.empty_like(halves)
    middle = (len(halves) + 1) // 2
    whole[0::2], whole[1::2] = halves[:middle], halves[middle:]
    return whole.tobytes()


def _deflated(raw: bytes) -> bytes:
    whole = np.frombuffer(raw, np.uint8)
    halves = np.concatenate([whole[0::2], whole[1::2]])
    steps = halves.copy()
    steps[1:] = halves[1:] - halves[:-1] + np.uint8(128)
    data = zlib.compress(steps.tobytes(), 4)
    return data if len(data) < len(raw) else raw


def _bands(parts: list[_Part], wanted: str) -> dict[str, tuple[int, int]]:
    """Where the bands R, G and B of a pass ``LAYER.PASS`` are: the number of the part and of the channel in it."""
    return {name[-1]: (number, k) for number, part in enumerate(parts) for k, name in enumerate(part.channels)
            if name.startswith(f"{wanted}.") and name[-2:] in (".R", ".G", ".B")}


def with_planet(image: bytes, planet: bytes) -> bytes:
    """An EXR file with what another has in its planet's light group added to its image and to its planet's group.

    Raises ValueError, IndexError, KeyError, struct.error or zlib.error for what cannot be added.
    """
    made = [lasting(piece, BEAUTY) for piece in pieces(image)]
    parts, more = [_Part(piece) for piece in made], [_Part(piece) for piece in pieces(planet)]
    values: dict[int, np.ndarray] = {}
    source = _bands(more, _PLANET)
    for wanted in (f"{BEAUTY}.Combined", _PLANET):
        found = _bands(parts, wanted)
        for band in "RGB":
            (number, k), (of, at) = found[band], source[band]
            if number not in values:
                values[number] = parts[number].pixels()
            values[number][:, k] += more[of].pixels()[:, at]
    return assembled([parts[k].with_pixels(values[k]) if k in values else piece for k, piece in enumerate(made)])
