"""Triangles of a robot's link from STL (binary and ASCII), Wavefront OBJ and Collada, read without other libraries.

The file comes from a stranger. Its size is bounded, its indices are checked, and no other file that it names is opened.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import RefusedError, read
from ..triangle_files import obj, stl
from . import collada

#: By suffix: reader, name and largest file in bytes of a format. XML takes several times its bytes of memory.
_FORMATS = {
    ".stl": (stl.parse_triangles, "an STL mesh", 200_000_000),
    ".obj": (obj.parse_triangles, "an OBJ mesh", 200_000_000),
    ".dae": (collada.parse_triangles, "a Collada mesh", 40_000_000),
}
#: Most triangles of one file.
MAX_TRIANGLES = 1_000_000


def read_link_mesh(path: Path) -> tuple[Array, Array]:
    """Read the vertices (n, 3) and the triangles (m, 3) of a mesh. Vertices of Collada are in metres, others in the
    file's unit.

    Raises IcyMoonError if the file is missing, of another format, too large, empty or broken.
    """
    suffix = path.suffix.lower()
    if suffix not in _FORMATS:
        raise IcyMoonError(f"{path}: meshes of a URDF are read from STL, OBJ and Collada (.dae); convert this one.")
    parse, kind, most = _FORMATS[suffix]
    return read(
        path,
        lambda foreign: _check_mesh(*parse(foreign, MAX_TRIANGLES)),
        kind,
        "export it again, or change the URDF",
        most=most,
    )


def _check_mesh(vertices: Array, triangles: Array) -> tuple[Array, Array]:
    """Return the mesh. Raises RefusedError if it has no triangles or a coordinate that is not finite."""
    if not len(triangles):
        raise RefusedError("has no triangle; export it again.")
    if not np.isfinite(vertices).all() or np.abs(vertices).max() > 1e9:
        raise RefusedError("has vertices that are not finite numbers; export it again.")
    return vertices, triangles
