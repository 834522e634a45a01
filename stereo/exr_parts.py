"""Leaving out of an EXR file what is not needed before it is decoded, which is what reading costs.

Blender 5 writes a part for each pass. A file of one part, as Blender 4 writes it, is left as it is:
there the passes share their chunks.
"""

from __future__ import annotations

import struct
from collections.abc import Collection

import numpy as np

from ..render.exr_check import read_parts

_START = struct.Struct("<2i")


def only_passes(data: bytes, passes: Collection[str]) -> bytes:
    """The EXR file ``data`` with those parts only that hold ``passes`` (``LAYER.PASS``), all if none does.

    Raises ValueError, IndexError, KeyError or struct.error for what is no EXR file.
    """
    parts, several, table = read_parts(data)
    # A part is called after its pass, in some versions with "-VIEW" at the end.
    names = [part.attributes.get(b"name", b"").rstrip(b"\0").decode().split("-")[0] for part in parts]
    wanted = [k for k, name in enumerate(names) if name in passes]
    if not several or len(wanted) in (0, len(parts)):
        return data
    first = np.cumsum([0, *(part.chunks for part in parts)])
    offsets = np.frombuffer(data, "<u8", int(first[-1]), table)
    headers = b"".join(data[parts[k].header] for k in wanted) + b"\0"
    place = _START.size + len(headers) + 8 * sum(parts[k].chunks for k in wanted)
    places, chunks = [], []
    for number, k in enumerate(wanted):
        for offset in offsets[first[k]:first[k + 1]].tolist():
            # A chunk is its part's number, its first line, the size of its data, its data.
            (size,) = struct.unpack_from("<i", data, offset + 8)
            chunks.append(struct.pack("<i", number) + data[offset + 4:offset + 12 + size])
            places.append(place)
            place += 12 + size
    return b"".join((data[:_START.size], headers, np.array(places, "<u8").tobytes(), *chunks))
