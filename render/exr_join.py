"""Several OpenEXR files made into one, and light added up, without an OpenEXR library.

Blender writes a file per render. What takes more than one render (truth without Open Shading Language, one light
after the other) is put together here: parts are copied as they are, and only passes whose light changes are decoded
(OpenEXR technical introduction, "File Layout"; compressions none, ZIPS and ZIP).
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import IcyMoonError
from ..files import disk_errors
from ..labels import BEAUTY
from .exr_check import MAGIC, MULTIPART, Part, read_parts

_LINES = {0: 1, 2: 1, 3: 16}  # in a chunk, by compression
_FLOAT = 2
_PLANET = f"{BEAUTY}.Combined_Planet"


@dataclass
class _Part:
    """A part: its description, its header's bytes without the final zero, its chunks by their first line."""

    described: Part
    header: bytes
    chunks: dict[int, bytes]

    @property
    def channels(self) -> list[str]:
        """Names of the channels in the order of the file."""
        data, names, at = self.described.attributes[b"channels"], [], 0
        while data[at] != 0:
            end = data.index(b"\0", at)
            names.append(data[at:end].decode())
            if struct.unpack_from("<i", data, end + 1)[0] != _FLOAT:
                raise ValueError(f"{names[-1]} is not of 32-bit floats")
            at = end + 17
        return names

    def _box(self) -> tuple[int, int, int]:
        """Width, first line and height."""
        left, top, right, bottom = struct.unpack("<4i", self.described.attributes[b"dataWindow"])
        return right - left + 1, top, bottom - top + 1

    def pixels(self) -> np.ndarray:
        """Values (height, channel, width) float32."""
        width, top, height = self._box()
        count, lines = len(self.channels), _LINES[self.described.attributes[b"compression"][0]]
        found = np.empty((height, count, width), "<f4")
        for first, data in self.chunks.items():
            rows = min(lines, top + height - first)
            raw = _inflated(data, rows * count * width * 4)
            found[first - top:first - top + rows] = np.frombuffer(raw, "<f4").reshape(rows, count, width)
        return found

    def set_pixels(self, values: np.ndarray) -> None:
        """Give the part other values of the same shape."""
        _, top, _ = self._box()
        compression = self.described.attributes[b"compression"][0]
        for first in self.chunks:
            rows = values[first - top:first - top + _LINES[compression]]
            raw = np.ascontiguousarray(rows, "<f4").tobytes()
            self.chunks[first] = _deflated(raw) if compression else raw


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


def _attribute(name: bytes, kind: bytes, value: bytes) -> bytes:
    return name + b"\0" + kind + b"\0" + struct.pack("<i", len(value)) + value


def _read(path: Path) -> tuple[list[_Part], int]:
    """The parts of a file, all with what a file of several parts needs, and the file's flags."""
    data = path.read_bytes()
    described, several, table = read_parts(data)
    offsets = np.frombuffer(data, "<u8", sum(part.chunks for part in described), table).tolist()
    before, parts = (4 if several else 0), []
    for part in described:
        header, chunks = data[part.header][:-1], {}
        if not several:
            header += (_attribute(b"name", b"string", path.stem.encode())
                       + _attribute(b"type", b"string", b"scanlineimage")
                       + _attribute(b"chunkCount", b"int", struct.pack("<i", part.chunks)))
        for offset in offsets[:part.chunks]:
            line, size = struct.unpack_from("<2i", data, offset + before)
            chunks[line] = data[offset + before + 8:offset + before + 8 + size]
        offsets = offsets[part.chunks:]
        parts.append(_Part(part, header, chunks))
    return parts, struct.unpack_from("<i", data, 4)[0]


def _write(path: Path, parts: list[_Part], flags: int) -> None:
    start = struct.pack("<2i", MAGIC, flags | MULTIPART) + b"".join(part.header + b"\0" for part in parts) + b"\0"
    place, places, chunks = len(start) + 8 * sum(len(part.chunks) for part in parts), [], []
    for number, part in enumerate(parts):
        for line, data in part.chunks.items():
            chunks.append(struct.pack("<3i", number, line, len(data)) + data)
            places.append(place)
            place += len(chunks[-1])
    with disk_errors("write", path), path.open("wb") as file:
        file.write(start + np.array(places, "<u8").tobytes())
        file.writelines(chunks)


def _bands(parts: list[_Part], wanted: str) -> dict[str, tuple[_Part, int]]:
    """Where the bands R, G and B of a pass ``LAYER.PASS`` are: the part and the number of the channel in it."""
    found = {}
    for part in parts:
        for k, name in enumerate(part.channels):
            if name.startswith(f"{wanted}.") and name[-2:] in (".R", ".G", ".B"):
                found[name[-1]] = part, k
    return found


def _add(parts: list[_Part], light: list[_Part]) -> None:
    """Add what ``light`` has in its planet's group to the image and to its planet's group."""
    image, planet, more = (_bands(of, name) for of, name in (
        (parts, f"{BEAUTY}.Combined"), (parts, _PLANET), (light, _PLANET)))
    touched = {id(part): part for part, _ in (*image.values(), *planet.values())}
    values = {key: part.pixels() for key, part in touched.items()}
    for band in "RGB":
        part, k = more[band]
        change = part.pixels()[:, k]
        for part, k in (image[band], planet[band]):
            values[id(part)][:, k] += change
    for key, part in touched.items():
        part.set_pixels(values[key])


def join(image: Path, truth: Path | None, planet: Path | None) -> None:
    """Put the parts of ``truth`` behind those of ``image``, and add the light of ``planet`` to it; the other files
    are removed.

    Raises IcyMoonError if Blender wrote what cannot be put together.
    """
    try:
        parts, flags = _read(image)
        if planet is not None:
            _add(parts, _read(planet)[0])
        others, more = _read(truth) if truth is not None else ([], 0)
        _write(image, [*parts, *others], flags | more)
    except (ValueError, IndexError, KeyError, struct.error, zlib.error) as error:
        raise IcyMoonError(f"The images that Blender wrote to {image.parent.parent} cannot be put together "
                           f"({error}); render the pair again.") from None
    for used in (truth, planet):
        if used is not None:
            used.unlink()
