"""The user's own rock: a closed mesh from a file, as the one shape of all rocks."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from ...settings.topics.rocks import RocksSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import absolute_path
from ...support.foreign_bytes import read
from ..triangle_files import obj, stl
from .place_rocks import LEVEL_RANKS
from .rock_shapes import RockShape, make_rock_shapes

OWN = "OWN"
#: Most triangles of a rock: as many as broken ice has in the foreground. A scene has thousands of rocks.
MAX_TRIANGLES = 20480
#: By suffix: reader and name of a format; most triangles that are read, and largest file in bytes.
_FORMATS = {".obj": (obj.parse_triangles, "an OBJ mesh"), ".stl": (stl.parse_triangles, "an STL mesh")}
_MAX_READ, _MAX_BYTES = 100_000, 20_000_000
#: Points across and along the square in which the area of a rock seen from above is sampled.
_SIDE = 256


def find_rock_shapes(rocks: RocksSettings, seed: int) -> tuple[tuple[RockShape, ...], ...]:
    """Find the shapes of the rocks of a scene as ``[level][shape]``, finest level first. ``rocks.shape_file`` is
    absolute.

    Raises IcyMoonError if the user's own rock cannot be read or is no rock.
    """
    if rocks.family != OWN:
        return make_rock_shapes(rocks.family, rocks.angularity, seed)
    path = absolute_path(rocks.shape_file, "rocks.shape_file")
    try:
        written_ns = path.stat().st_mtime_ns
    except OSError:
        written_ns = 0
    return ((_read_shape(path, written_ns)[0],),) * (1 + len(LEVEL_RANKS))


def read_proportions(path: Path) -> float:
    """Read a rock from a file, and return its height divided by its mean width. Raises IcyMoonError if it is no
    rock.
    """
    return _read_shape(path, path.stat().st_mtime_ns)[1]


@lru_cache(maxsize=4)
def _read_shape(path: Path, written_ns: int) -> tuple[RockShape, float]:
    if path.suffix.lower() not in _FORMATS:
        raise IcyMoonError(f"{path}: the mesh of a rock is read from {' and '.join(_FORMATS)}; convert this one.")
    parse, kind = _FORMATS[path.suffix.lower()]
    mesh = read(path, lambda foreign: parse(foreign, _MAX_READ), kind, "choose another file", most=_MAX_BYTES)
    return make_own_shape(*mesh, str(path))


def make_own_shape(vertices: Array, triangles: Array, where: str) -> tuple[RockShape, float]:
    """Make a rock of unit size from a closed mesh. Return the rock, and its height divided by its mean width.

    ``vertices`` (n, 3), z up, are in any unit; ``triangles`` (m, 3) may have separate vertices in one place as corners.
    The mean width is the diameter of a circle of the rock's area seen from above. Raises IcyMoonError, with ``where``,
    for a mesh that is not closed, encloses nothing or has too many triangles.
    """
    if len(triangles) > MAX_TRIANGLES:
        raise IcyMoonError(
            f"{where}: a rock has at most {MAX_TRIANGLES} triangles, but this one has {len(triangles)}; decimate it."
        )
    if not np.isfinite(vertices).all():
        raise IcyMoonError(f"{where}: the mesh has vertices that are not finite numbers; export it again.")
    points, joined = np.unique(np.asarray(vertices, np.float64), axis=0, return_inverse=True)
    corners = joined.reshape(-1)[triangles].astype(np.int32)
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]  # without an area
    if not _is_closed(corners):
        raise IcyMoonError(f"{where}: the mesh of a rock must be closed; fill its holes and let normals point out.")
    points -= (points.min(axis=0) + points.max(axis=0)) / 2
    a, b, c = (points[corners[:, k]] for k in range(3))
    volume = float(np.einsum("nk,nk->n", a, np.cross(b, c)).sum()) / 6
    size = np.ptp(points, axis=0)
    if abs(volume) <= 1e-9 * float(size.prod()) or not size.all():
        raise IcyMoonError(f"{where}: the mesh of a rock encloses no volume; choose another one.")
    if volume < 0:
        corners = corners[:, ::-1].copy()
    width = 2 * np.sqrt(_measure_area_from_above(points, corners) / np.pi)
    flat = np.ones(len(corners), bool)
    shape = RockShape(points / [width, width, size[2]], corners, flat, 1.0, np.zeros(len(corners), np.int32))
    return shape, float(size[2] / width)


def _is_closed(triangles: Array) -> bool:
    """Return whether each edge has exactly two triangles, which go along it in opposite directions."""
    edges = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    there, counts = np.unique(edges, axis=0, return_counts=True)
    back = np.unique(edges[:, ::-1], axis=0)
    return len(triangles) > 3 and bool((counts == 1).all()) and np.array_equal(there, back)


def _measure_area_from_above(points: Array, triangles: Array) -> float:
    """Measure the area of the outline of a mesh seen from above, within 1 %, by the middles of ``_SIDE``² cells."""
    low, size = points[:, :2].min(axis=0), np.ptp(points[:, :2], axis=0)
    cells = (points[:, :2] - low) / size * _SIDE - 0.5  # in cells, whose middles are whole numbers
    covered = np.zeros((_SIDE, _SIDE), bool)
    for corners in cells[triangles]:
        first = np.maximum(np.ceil(corners.min(axis=0)), 0).astype(int)
        last = np.minimum(np.floor(corners.max(axis=0)), _SIDE - 1).astype(int)
        if (first > last).any():
            continue
        x, y = np.meshgrid(*(np.arange(first[k], last[k] + 1) for k in (0, 1)))
        (ax, ay), (bx, by), (cx, cy) = corners
        sides = [
            (qx - px) * (y - py) - (qy - py) * (x - px)
            for (px, py), (qx, qy) in (((ax, ay), (bx, by)), ((bx, by), (cx, cy)), ((cx, cy), (ax, ay)))
        ]
        inside = np.logical_or(
            np.logical_and.reduce([side >= 0 for side in sides]), np.logical_and.reduce([side <= 0 for side in sides])
        )
        covered[first[1] : last[1] + 1, first[0] : last[0] + 1] |= inside
    return float(covered.mean() * size.prod())
