"""Writing small GeoTIFFs in tests, independently of the reader: TIFF 6.0, one band."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.support.arrays import Array


def write_tiff(
    path: Path,
    values: Array,
    *,
    order: str = "<",
    deflate: bool = False,
    predictor: int = 1,
    rows_per_strip: int = 0,
    tile: int = 0,
    pixel: tuple[float, float] | None = None,
    tie: tuple[float, ...] = (0, 0, 0, 0, 0, 0),
    nodata: str = "",
    geographic: bool = False,
    point: bool = False,
    extra: dict[int, tuple[Any, ...]] | None = None,
    keys: dict[int, int] | None = None,
    metadata: str = "",
    matrix: tuple[float, ...] = (),
    scale_z: float = 0.0,
) -> Path:
    """Write ``values`` (rows, columns) of a TIFF number type.

    ``keys`` are GeoKeys beside those of ``geographic`` and ``point``, the unit of length being the metre
    unless they are given; ``matrix`` is written in place of the pixel's size.
    """
    rows, columns = values.shape
    values = values.astype(np.dtype(f"{order}{values.dtype.str[1:]}"))
    strip = rows_per_strip or rows
    if tile:
        padded = np.zeros((-(-rows // tile) * tile, -(-columns // tile) * tile), values.dtype)
        padded[:rows, :columns] = values
        blocks = [padded[r : r + tile, c : c + tile] for r in range(0, rows, tile) for c in range(0, columns, tile)]
    else:
        blocks = [values[r : r + strip] for r in range(0, rows, strip)]
    packed = [_predicted(block, predictor) for block in blocks]
    packed = [zlib.compress(block) if deflate else block for block in packed]
    kind = {"u": 1, "i": 2, "f": 3}[values.dtype.kind]
    shorts: dict[int, tuple[int, ...]] = {
        258: (values.dtype.itemsize * 8,),
        259: (8 if deflate else 1,),
        262: (1,),
        277: (1,),
        339: (kind,),
        317: (predictor,),
    }
    longs = {256: (columns,), 257: (rows,), **({322: (tile,), 323: (tile,)} if tile else {278: (strip,)})}
    doubles: dict[int, tuple[float, ...]] = {}
    if pixel:
        doubles = {34264: matrix} if matrix else {33550: (*pixel, scale_z), 33922: tie}
        stated = {1024: 2 if geographic else 1, 1025: 2 if point else 1, **({3076: 9001} if keys is None else keys)}
        shorts[34735] = (1, 1, 0, len(stated), *(n for key in sorted(stated) for n in (key, 0, 1, stated[key])))
    tags: dict[int, tuple[str, int, tuple[float, ...]]] = {t: ("H", 3, v) for t, v in shorts.items()}
    tags |= {t: ("I", 4, v) for t, v in longs.items()}
    tags |= {t: ("d", 12, v) for t, v in doubles.items()}
    tags |= {t: ("H", 3, v) for t, v in (extra or {}).items()}
    if nodata:
        tags[42113] = ("B", 2, tuple(nodata.encode() + b"\0"))
    if metadata:
        tags[42112] = ("B", 2, tuple(metadata.encode() + b"\0"))
    where, sizes = (324, 325) if tile else (273, 279)
    tags[where] = tags[sizes] = ("I", 4, (0,) * len(packed))
    start = 8
    offsets = []
    for block in packed:
        offsets.append(start)
        start += len(block)
    tags[where], tags[sizes] = ("I", 4, tuple(offsets)), ("I", 4, tuple(map(len, packed)))
    head = struct.pack(f"{order}2sHI", b"II" if order == "<" else b"MM", 42, start)
    entries, heap, heap_at = b"", b"", start + 2 + 12 * len(tags) + 4
    for tag in sorted(tags):
        code, number, content = tags[tag]
        data = struct.pack(f"{order}{len(content)}{code}", *content)
        if len(data) <= 4:
            inline = data.ljust(4, b"\0")
        else:
            inline = struct.pack(f"{order}I", heap_at + len(heap))
            heap += data
        entries += struct.pack(f"{order}HHI", tag, number, len(content)) + inline
    path.write_bytes(head + b"".join(packed) + struct.pack(f"{order}H", len(tags)) + entries + b"\0" * 4 + heap)
    return path


def _predicted(block: Array, predictor: int) -> bytes:
    if predictor == 2:
        return np.diff(block, axis=1, prepend=block.dtype.type(0)).astype(block.dtype).tobytes()
    if predictor == 3:
        rows, columns = block.shape
        planes = np.frombuffer(block.astype(block.dtype.newbyteorder(">")).tobytes(), np.uint8)
        planes = planes.reshape(rows, columns, -1).transpose(0, 2, 1).reshape(rows, -1)
        return np.diff(planes, axis=1, prepend=np.uint8(0)).tobytes()
    return block.tobytes()
