"""Vertices of a PLY file as they stand in it.

Blender's PLY importer makes zeros of coordinates that are not numbers (measured in 4.2, 5.0 and 5.2) and
single precision of doubles; reconstructions have both. Format: Turk, "The PLY Polygon File Format", 1994.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

_TYPES = {"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
          "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
          "double": "f8", "float64": "f8"}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


def vertices(path: Path) -> np.ndarray | None:
    """Coordinates (n, 3) float64 of the vertices, or None where the file's layout is not the usual one.

    Usual is: vertices first, each of scalar properties with x, y and z among them.
    """
    with path.open("rb") as stream:
        header = [line.split() for line in iter(lambda: stream.readline(1024).decode("latin-1").strip(), "end_header")
                  if line]
        start = stream.tell()
    encoding = next((line[1] for line in header if line[0] == "format"), "")
    elements = [k for k, line in enumerate(header) if line[0] == "element"]
    if not elements or header[elements[0]][1] != "vertex":
        return None
    count = int(header[elements[0]][2])
    properties = list(itertools.takewhile(lambda line: line[0] != "element", header[elements[0] + 1:]))
    properties = [line for line in properties if line[0] == "property"]
    names = [line[-1] for line in properties]
    if not {"x", "y", "z"} <= set(names) or any(line[1] not in _TYPES for line in properties):
        return None
    if encoding == "ascii":
        with path.open("rb") as stream:
            stream.seek(start)
            rows = np.loadtxt(itertools.islice(stream, count), ndmin=2)
        return rows[:, [names.index(axis) for axis in "xyz"]] if rows.shape == (count, len(names)) else None
    order = _ORDERS.get(encoding)
    kind = np.dtype([(line[-1], f"{order}{_TYPES[line[1]]}") for line in properties]) if order else None
    if kind is None or path.stat().st_size < start + count * kind.itemsize:
        return None
    table = np.memmap(path, kind, "r", start, (count,)) if count else np.empty(0, kind)
    return np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)
