"""The values in a part of an OpenEXR file, without an OpenEXR library.

OpenEXR technical introduction, "File Layout"; compressions none, ZIPS and ZIP, channels of 32-bit and 16-bit floats.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..support.arrays import Array
from ..support.foreign_bytes import inflate
from .exr_layout import read_channels
from .exr_parts import Piece, encode_attribute, read_pieces

_ZIP_COMPRESSION = 3
_LINES_PER_CHUNK = {0: 1, 2: 1, _ZIP_COMPRESSION: 16}  # in a chunk, by compression
#: EXR's number of 16-bit floats.
_HALF_TYPE = 1
#: EXR's number of 32-bit floats.
_FLOAT_TYPE = 2
_NUMPY_TYPES = {_HALF_TYPE: "<f2", _FLOAT_TYPE: "<f4"}
#: Largest RMS change by rounding to 16 bits, relative to the values, if no value is too small for 16 bits.
_MAX_ROUNDING = 2.0**-11
#: Bytes after a channel's name in a header, by type. They state no perceptual compression, and a value for every pixel.
_CHANNEL_ENTRIES = {kind: b"\0" + struct.pack("<4i", kind, 0, 1, 1) for kind in _NUMPY_TYPES}


class Pixels:
    """Decodes and encodes the values in a part."""

    def __init__(self, piece: Piece) -> None:
        """Prepare a part. Raises ValueError unless all channels are floats at every pixel, KeyError for another
        compression."""
        channels = read_channels(piece.value(b"channels"))
        for name, channel in channels.items():
            if channel.kind not in _NUMPY_TYPES or channel.steps != (1, 1):
                raise ValueError(f"{name[:40]!r} does not store floats, or does not cover every pixel")
        self._piece, self._stated = piece, {name: channel.stated for name, channel in channels.items()}
        self.channels = list(self._stated)
        left, self._top, right, bottom = struct.unpack("<4i", piece.value(b"dataWindow"))
        self._compression = piece.value(b"compression")[0]
        self._rows_per_chunk = _LINES_PER_CHUNK[self._compression]
        self._width, self._height = right - left + 1, bottom - self._top + 1

    def is_half_float(self, channel: str) -> bool:
        """Return whether a channel is stored as 16-bit floats."""
        return _read_type(self._stated[channel]) == _HALF_TYPE

    @property
    def _line(self) -> np.dtype[Any]:
        """The numpy type of a stored line: channel after channel, each with its own type."""
        return np.dtype(
            [(name, _NUMPY_TYPES[_read_type(self._stated[name])], (self._width,)) for name in self.channels]
        )

    def decode(self) -> Array:
        """Decode the values (height, channel, width) float32. Raises ValueError for chunks of another size."""
        found, stored = np.empty((self._height, len(self.channels), self._width), "<f4"), self._line
        if not self._compression:
            chunks = self._view_raw(stored)
            for k, name in enumerate(self.channels):
                found[chunks["line"] - self._top, k] = chunks["values"][name]
            return found
        for chunk in self._piece.chunks:
            line = struct.unpack_from("<i", chunk)[0] - self._top
            rows = min(self._rows_per_chunk, self._height - line)
            lines = np.frombuffer(_unpack(chunk[8:], rows * stored.itemsize), stored)
            for k, name in enumerate(self.channels):
                found[line : line + rows, k] = lines[name]
        return found

    def _view_raw(self, stored: np.dtype[Any]) -> Array:
        """View the chunks of an uncompressed part as a structured array: row number and bytes of each."""
        chunk = _raw_chunk_type(stored)
        if {len(each) for each in self._piece.chunks} != {chunk.itemsize}:
            raise ValueError("a line has the wrong size")
        return np.frombuffer(b"".join(self._piece.chunks), chunk)

    def compress(self) -> Piece:
        """Compress the part by ZIP unless it is compressed already. Raises as ``decode`` does."""
        if self._compression:
            return self._piece
        starts = _empty_chunks(self._top, self._height)
        stated = {
            **self._piece.attributes,
            b"compression": encode_attribute("compression", "compression", bytes([_ZIP_COMPRESSION])),
            b"chunkCount": encode_attribute("chunkCount", "int", struct.pack("<i", len(starts))),
        }
        return Pixels(Piece(stated, starts)).encode(self.decode())

    def encode(self, values: Array) -> Piece:
        """Return the part with other values (height, channel, width) of the same shape."""
        return replace(self._piece, chunks=self._encode_chunks(values, self._line))

    def select_channels(self, wanted: Sequence[int]) -> Piece:
        """Return the part with only the channels at the indices ``wanted``."""
        stated = b"".join(self._stated[self.channels[k]] for k in wanted) + b"\0"
        kept = {**self._piece.attributes, b"channels": encode_attribute("channels", "chlist", stated)}
        line = np.dtype([(name, self._line[name]) for name in (self.channels[k] for k in wanted)])
        return replace(self._piece, attributes=kept, chunks=self._encode_chunks(self.decode()[:, wanted], line))

    def round_to_half(self, wanted: Collection[int], values: Array) -> Piece:
        """Return the part with the channels at the indices ``wanted`` as 16-bit floats; ``values`` are from
        ``decode``."""
        for k in wanted:
            stated = self._stated[self.channels[k]]
            self._stated[self.channels[k]] = stated[:-16] + struct.pack("<i", _HALF_TYPE) + stated[-12:]
        stated = b"".join(self._stated.values()) + b"\0"
        kept = {**self._piece.attributes, b"channels": encode_attribute("channels", "chlist", stated)}
        return replace(self._piece, attributes=kept, chunks=self._encode_chunks(values, self._line))

    def replace_channels(self, name: str, components: Sequence[str], values: Array) -> Piece:
        """Return a part of the same size with other channels. The channels are ``name`` with each of ``components``,
        their values ``values`` (height, channel, width)."""
        channels = (
            b"".join(f"{name}.{component}".encode() + _CHANNEL_ENTRIES[_FLOAT_TYPE] for component in components) + b"\0"
        )
        attributes = {
            **self._piece.attributes,
            b"name": encode_attribute("name", "string", name.encode()),
            b"channels": encode_attribute("channels", "chlist", channels),
        }
        line = np.dtype([(component, "<f4", (self._width,)) for component in components])
        return replace(self._piece, attributes=attributes, chunks=self._encode_chunks(values, line))

    def _encode_chunks(self, values: Array, stored: np.dtype[Any]) -> list[bytes]:
        """Encode values as chunks, with lines of the numpy type ``stored``."""
        if not self._compression:
            lines = np.empty(self._height, _raw_chunk_type(stored))
            lines["line"], lines["bytes"] = np.arange(self._top, self._top + self._height), stored.itemsize
            for k, name in enumerate(stored.names or ()):
                lines["values"][name] = values[:, k]
            whole, step = lines.tobytes(), lines.itemsize
            return [whole[at : at + step] for at in range(0, len(whole), step)]
        chunks = []
        for chunk in self._piece.chunks:
            line = struct.unpack_from("<i", chunk)[0]
            part = values[line - self._top : line - self._top + self._rows_per_chunk]
            lines = np.empty(len(part), stored)
            for k, name in enumerate(stored.names or ()):
                lines[name] = part[:, k]
            data = _pack(lines.tobytes())
            chunks.append(struct.pack("<2i", line, len(data)) + data)
        return chunks


def encode_part(name: str, channels: Mapping[str, Array], half: bool = False) -> Piece:
    """Encode the channels (H, W), by component, as a part for the pass ``name``: 32-bit floats, or 16-bit floats with
    ``half``."""
    height, width = next(iter(channels.values())).shape
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    components = sorted(channels)
    listed = (
        b"".join(
            f"{name}.{each}".encode() + _CHANNEL_ENTRIES[_HALF_TYPE if half else _FLOAT_TYPE] for each in components
        )
        + b"\0"
    )
    starts = _empty_chunks(0, height)
    stated = {
        "channels": ("chlist", listed),
        "compression": ("compression", bytes([_ZIP_COMPRESSION])),
        "dataWindow": ("box2i", window),
        "displayWindow": ("box2i", window),
        "lineOrder": ("lineOrder", b"\0"),
        "name": ("string", name.encode()),
        "pixelAspectRatio": ("float", struct.pack("<f", 1.0)),
        "screenWindowCenter": ("v2f", bytes(8)),
        "screenWindowWidth": ("float", struct.pack("<f", 1.0)),
        "type": ("string", b"scanlineimage"),
        "chunkCount": ("int", struct.pack("<i", len(starts))),
    }
    attributes = {key.encode(): encode_attribute(key, kind, value) for key, (kind, value) in stated.items()}
    values = np.stack([np.asarray(channels[each], np.float32) for each in components], axis=1)
    return Pixels(Piece(attributes, starts)).encode(values)


def _raw_chunk_type(stored: np.dtype[Any]) -> np.dtype[Any]:
    """Return the numpy type of a chunk without compression: one line with values of the type ``stored``."""
    return np.dtype([("line", "<i4"), ("bytes", "<i4"), ("values", stored)])


def _empty_chunks(top: int, height: int) -> list[bytes]:
    """Make ZIP-compressed chunks without values for a part whose first line is ``top``."""
    return [struct.pack("<2i", line, 0) for line in range(top, top + height, _LINES_PER_CHUNK[_ZIP_COMPRESSION])]


def _read_type(stated: bytes) -> int:
    """Read the type of a channel's values from the channel's entry, which ends with four numbers after its name."""
    return int(struct.unpack_from("<i", stated, len(stated) - 16)[0])


def _unpack(data: bytes, size: int) -> bytes:
    """Decompress a chunk to ``size`` bytes. A chunk that did not shrink was stored without compression."""
    if len(data) == size:
        return data
    steps = np.frombuffer(inflate(data, size), np.uint8).copy()
    steps[1:] -= 128  # bytes are stored as differences about 128, first those at even places, then the others
    halves = np.cumsum(steps, dtype=np.uint8)
    whole = np.empty_like(halves)
    middle = (len(halves) + 1) // 2
    whole[0::2], whole[1::2] = halves[:middle], halves[middle:]
    return whole.tobytes()


def _pack(raw: bytes) -> bytes:
    whole = np.frombuffer(raw, np.uint8)
    halves = np.concatenate([whole[0::2], whole[1::2]])
    steps = halves.copy()
    steps[1:] = halves[1:] - halves[:-1] + np.uint8(128)
    data = zlib.compress(steps.tobytes(), 4)
    return data if len(data) < len(raw) else raw


def decode_parts(data: bytes) -> Iterator[tuple[str, dict[str, Array]]]:
    """Decode each part of an EXR file. Yield its view, empty if it has none, and its channels by name, (H, W) float32.

    Raises ValueError, KeyError or OverBudgetError for a file that is damaged or of another kind.
    """
    for piece in read_pieces(data):
        pixels = Pixels(piece)
        values = pixels.decode()
        view = piece.value(b"view").decode() if b"view" in piece.attributes else ""
        yield view, {name: values[:, k] for k, name in enumerate(pixels.channels)}


def compress(piece: Piece) -> Piece:
    """Compress a part by ZIP if it is not compressed.

    A part of an unsupported kind is returned unchanged. Raises ValueError for a damaged part.
    """
    try:
        pixels = Pixels(piece)
    except (KeyError, ValueError):
        return piece
    return pixels.compress()


def drop_passes(piece: Piece, unwanted: Collection[str]) -> Piece | None:
    """Drop a part's channels of ``unwanted`` passes (``LAYER.PASS``); return None if no channel remains.

    A part of an unsupported kind is returned unchanged. Raises ValueError for a damaged part.
    """
    if piece.name.split("-")[0] in unwanted:
        return None
    try:
        pixels = Pixels(piece)
    except (KeyError, ValueError):
        return piece
    wanted = [k for k, name in enumerate(pixels.channels) if ".".join(name.split(".")[:2]) not in unwanted]
    return piece if len(wanted) == len(pixels.channels) else pixels.select_channels(wanted) if wanted else None


def round_passes(piece: Piece, passes: Collection[str]) -> Piece:
    """Round the values of some passes (``LAYER.PASS``) to 16-bit floats. The passes stay unchanged if a value is too
    large for 16 bits, or if the values are so small that the RMS rounding error exceeds one in two thousand.

    A part of an unsupported kind is returned unchanged. Raises ValueError for a damaged part.
    """
    try:
        pixels = Pixels(piece)
    except (KeyError, ValueError):
        return piece
    named = [
        k
        for k, name in enumerate(pixels.channels)
        if ".".join(name.split(".")[:2]) in passes and not pixels.is_half_float(name)
    ]
    if not named:
        return piece
    decoded = pixels.decode()
    values = decoded[:, named]
    with np.errstate(over="ignore"):
        error = np.float64(values.astype("<f2")) - values
    fits = np.isfinite(error).all() and (error**2).sum() <= _MAX_ROUNDING**2 * np.square(values, dtype=np.float64).sum()
    return pixels.round_to_half(named, decoded) if fits else piece
