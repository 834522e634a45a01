"""Numbers of the vertices of a PLY file as they stand in it.

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
    """Coordinates (n, 3) float64 of the vertices, or None where the file's layout is not the usual one."""
    return properties(path, "x", "y", "z")


def properties(path: Path, *wanted: str) -> np.ndarray | None:
    """These properties (n, len(wanted)) float64 of the vertices, or None where the file's layout is not the usual one.

    Usual is: vertices first, each of scalar properties with those ``wanted`` among them.
    """
    with path.open("rb") as stream:
        lines = (line.decode("latin-1").strip() for line in stream)
        header = [line.split() for line in itertools.takewhile(lambda line: line != "end_header", lines) if line]
        start = stream.tell()
    encoding = next((line[1] for line in header if line[0] == "format" and len(line) > 1), "")
    elements = [k for k, line in enumerate(header) if line[0] == "element"]
    if not elements or header[elements[0]][1:2] != ["vertex"] or len(header[elements[0]]) < 3:
        return None
    count = int(header[elements[0]][2])
    own = itertools.takewhile(lambda line: line[0] != "element", header[elements[0] + 1:])
    declared = [line for line in own if line[0] == "property"]
    names = [line[-1] for line in declared]
    if not set(wanted) <= set(names) or any(line[1] not in _TYPES for line in declared):
        return None
    if encoding == "ascii":
        with path.open("rb") as stream:
            stream.seek(start)
            rows = np.loadtxt(itertools.islice(stream, count), ndmin=2)
        return rows[:, [names.index(name) for name in wanted]] if rows.shape == (count, len(names)) else None
    order = _ORDERS.get(encoding)
    kind = np.dtype([(line[-1], f"{order}{_TYPES[line[1]]}") for line in declared]) if order else None
    if kind is None or path.stat().st_size < start + count * kind.itemsize:
        return None
    table = np.memmap(path, kind, "r", start, (count,)) if count else np.empty(0, kind)
    return np.stack([table[name].astype(np.float64) for name in wanted], axis=1)
