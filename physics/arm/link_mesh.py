"""Triangles of a robot's link from STL (binary and ASCII) and Wavefront OBJ, which need no library.

The file comes from a stranger: sizes are bounded, indices are checked, and nothing else that it names is opened.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import IcyMoonError
from ...support.foreign_bytes import RefusedError, read
from ..mesh import obj, stl

#: Largest file in bytes, and most triangles of one file.
MOST_BYTES, MOST_TRIANGLES = 200_000_000, 1_000_000


def read_link_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) in the file's unit and triangles (m, 3).

    Raises IcyMoonError if the file is missing, of another format, too large, empty or broken.
    """
    parse = {".stl": stl.parse_triangles, ".obj": obj.parse_triangles}.get(path.suffix.lower())
    if parse is None:
        raise IcyMoonError(f"{path}: meshes of a URDF are read from STL and OBJ; convert this one.")
    return read(path, lambda foreign: _checked(*parse(foreign, MOST_TRIANGLES)), f"an {path.suffix[1:].upper()} mesh",
                "export it again, or change the URDF", most=MOST_BYTES)


def _checked(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if not len(triangles):
        raise RefusedError("has no triangle; export it again.")
    if not np.isfinite(vertices).all() or np.abs(vertices).max() > 1e9:
        raise RefusedError("has vertices that are no place; export it again.")
    return vertices, triangles
