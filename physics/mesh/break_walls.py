"""Walls of broken ice: steep triangles are refined, and chips that differ from top to bottom are broken out.

A height field gives a wall one shape from rim to foot, like a hanging curtain. Here the vertices of steep triangles are
moved into the ice, along the ground's normal, by a depth that depends on their position in three dimensions. The depths
are shallow scoops that meet at edges, as brittle ice breaks (conchoidal fracture). Their size and depth are guesses
from broken sea ice and glacier fronts; no image resolves either moon at metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ..terrain.landforms import Walls
from ..terrain.landforms.landform import smooth_step
from ..terrain.noise.lattice_noise import hash_lattice, to_uniform
from .split_triangles import split_at_sides

#: Vertical part of the unit normal of the gentlest slope that begins to break, 52 degrees.
_GROUND_COSINE = math.cos(math.radians(52.0))
#: Vertical part of the unit normal of the gentlest slope that is fully a wall, 68 degrees. The sides of fragments, up
#: to 66 degrees steep, break too.
_WALL_COSINE = math.cos(math.radians(68.0))
#: Widths of the scoops over the height of the wall.
_SCOOP_WIDTHS = (0.5, 0.2, 0.08)
#: Greatest depth of a scoop over its width.
_SCOOP_DEPTH = 0.25
#: Random variation of the depths of scoops.
_SCOOP_VARIATION = 0.35
#: Largest slope of a scoop's middle plane.
_SCOOP_TILT = 0.45
#: Extra depth of a scoop's middle over a point one width away.
_SCOOP_CURVATURE = 1.3
#: Depth of the edges between scoops, at which nearly all of them lie in the ice.
_EDGE_DEPTH = 0.55
#: Length in pixels above which a side of a wall's triangle is halved.
_LONGEST_SIDE_PX = 3.0
#: Maximum number of halvings.
_MAX_HALVINGS = 5
#: Number of smoothing passes over a wall before it is broken.
_SMOOTHING_PASSES = 3
#: Share of the largest number of vertices that the mesh has before walls are broken.
SHARE_BEFORE_BREAKING = 0.75
#: Number of points that are processed at a time.
_POINTS_AT_ONCE = 16384


def breaks_walls(settings: Settings) -> bool:
    """Return whether the mesh of complete ``settings`` has broken walls in the cameras' view."""
    cracks, chaos, pits, mesh = settings.cracks, settings.chaos, settings.pits, settings.mesh
    walls = (
        (chaos.edges != "ROUNDED" and chaos.relief_m > 0.0)
        or (cracks.edges != "ROUNDED" and cracks.depth_m > 0.0)
        or (pits.depth_m > 0.0 and pits.coverage > 0.0)
    )
    return bool(walls and mesh.walls == "BROKEN" and mesh.kind == "GRADED" and settings.source.kind == "PROCEDURAL")


@dataclass(frozen=True)
class BrokenMesh:
    """A mesh with broken walls: positions (n, 3), triangles (m, 3) int32, and for each triangle (m,) the index of the
    original triangle that contains it. ``spacing_m`` (n,) are spacings of vertices on the map, and ``loose_m`` (n,)
    thicknesses of loose material, or None; an added vertex has the mean of two others.
    """

    positions: Array
    faces: Array
    of_face: Array
    spacing_m: Array
    loose_m: Array | None = None


def scoop_depth(points: Array, key: int) -> Array:
    """Compute the depth (n,) of scoops of width 1 at points (n, 3), from 0 to about 1. It is continuous, with edges
    between scoops: each cell of a lattice has one bowl, and the deepest bowl counts.
    """
    base = np.floor(points)
    cell, zero = base.astype(np.int64), np.zeros(len(points), np.int64)
    deepest = np.zeros(len(points))
    for i, j, k in product((-1, 0, 1), repeat=3):
        place = hash_lattice(cell[:, 0] + i, cell[:, 1] + j, key) ^ hash_lattice(cell[:, 2] + k, zero, key)
        tilt = hash_lattice(place.astype(np.int64), zero, key)
        off = [
            points[:, axis] - base[:, axis] - shift - _ten_bit_fractions(place, axis)
            for axis, shift in enumerate((i, j, k))
        ]
        bowl = _EDGE_DEPTH + _SCOOP_VARIATION * to_uniform(hash_lattice(tilt.astype(np.int64), zero, key))
        for axis, along in enumerate(off):
            bowl += along * ((2.0 * _SCOOP_TILT) * (_ten_bit_fractions(tilt, axis) - 0.5) - _SCOOP_CURVATURE * along)
        np.maximum(deepest, bowl, out=deepest)
    return deepest


def _ten_bit_fractions(h: Array, third: int) -> Array:
    """Extract numbers in [0, 1) from ten bits of hashes."""
    return np.asarray(((h >> np.uint32(10 * third)) & np.uint32(1023)) * (1.0 / 1024.0))


def chip_depth_m(points: Array, walls: Walls, finest_m: Array) -> Array:
    """Compute the depth (n,) in metres of the chips of walls at points (n, 3), without chips finer than ``finest_m``
    (n,).
    """
    total = np.zeros(len(points))
    for octave, size in enumerate(_SCOOP_WIDTHS):
        width = size * walls.height_m
        share = np.clip(width / finest_m - 1.0, 0.0, 1.0)
        some = np.flatnonzero(share)
        for start in range(0, len(some), _POINTS_AT_ONCE):
            here = some[start : start + _POINTS_AT_ONCE]
            total[here] += share[here] * (_SCOOP_DEPTH * width) * scoop_depth(points[here] / width, walls.key + octave)
    return total


def wall_steepness(normals: Array) -> Array:
    """Compute the share (n,), 0 to 1, by which ground with upward normals (n, 3) of any length is a wall."""
    up = normals[:, 2] / np.maximum(np.linalg.norm(normals, axis=1), 1e-30)
    return smooth_step((_GROUND_COSINE - up) / (_GROUND_COSINE - _WALL_COSINE))


def face_normals(positions: Array, faces: Array) -> Array:
    """Compute the normals (m, 3) of triangles; their length is twice the area."""
    a, b, c = (positions[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def break_walls(
    positions: Array,
    faces: Array,
    walls: Walls,
    spacing_m: Array,
    pixel_m: Array,
    most: int,
    loose_m: Array | None = None,
) -> BrokenMesh:
    """Break the walls of a mesh whose vertices are ``spacing_m`` (n,) apart on the map and carry ``loose_m`` (n,) of
    loose material, if that is known.

    Pixels are ``pixel_m`` (n,) wide; where they are infinite, nothing is visible and walls stay as they are. Long sides
    of a wall's triangles are halved until they are short in pixels, or until more than ``most`` vertices would be
    needed. Vertices on the mesh's border, as beside triangles that were cut for fine relief, stay fixed.
    """
    free = np.isfinite(pixel_m)
    free[_find_border(faces, free)] = False
    seen_m = np.where(free, pixel_m, np.inf)
    of_face = np.arange(len(faces))
    positions = _smooth_walls(positions, faces, free)
    for _ in range(_MAX_HALVINGS):
        edges, sides, some = _find_long_sides(positions, faces, seen_m)
        if not len(edges) or len(positions) + len(edges) > most:
            break
        middle = np.where(sides >= 0, len(positions) + sides, -1)
        positions, seen_m, spacing_m = (
            np.concatenate([each, each[edges].mean(axis=1)]) for each in (positions, seen_m, spacing_m)
        )
        loose_m = None if loose_m is None else np.concatenate([loose_m, loose_m[edges].mean(axis=1)])
        added, part_of = split_at_sides(faces[some], middle)
        faces, of_face = (
            np.concatenate([np.delete(whole, some, axis=0), new.astype(whole.dtype)])
            for whole, new in ((faces, added), (of_face, of_face[some][part_of]))
        )
    return BrokenMesh(
        positions - _chip_offsets(positions, faces, walls, np.isfinite(seen_m)), faces, of_face, spacing_m, loose_m
    )


def _smooth_walls(positions: Array, faces: Array, free: Array) -> Array:
    """Smooth the walls of a mesh over a few triangles, by moving the ``free`` (n,) vertices. Return all positions (n,
    3).

    Rims and feet run obliquely to the mesh, so its columns would otherwise show as flutes in the wall.
    """
    near = faces[free[faces].any(axis=1)]
    wall = _vertex_steepness(positions, near) * free
    near = near[(wall > 0.0)[near].any(axis=1)]
    number = np.maximum(2.0 * np.bincount(near.ravel(), minlength=len(positions)), 1.0)
    positions = positions.copy()
    some = np.flatnonzero(wall)
    for _ in range(_SMOOTHING_PASSES):
        around = np.zeros((len(some), 3))
        for axis in range(3):
            at = positions[near, axis]
            total = sum(
                (np.bincount(near[:, k], at[:, (k + 1) % 3] + at[:, (k + 2) % 3], len(positions)) for k in range(3)),
                start=np.zeros(len(positions)),
            )
            around[:, axis] = (total / number)[some]
        positions[some] += (0.5 * wall[some])[:, None] * (around - positions[some])
    return positions


def _sum_vertex_normals(positions: Array, faces: Array) -> Array:
    """Sum the normals of some triangles at each vertex, (n, 3)."""
    of_faces = face_normals(positions, faces)
    return np.stack(
        [
            sum(
                (np.bincount(faces[:, k], of_faces[:, axis], len(positions)) for k in range(3)),
                start=np.zeros(len(positions)),
            )
            for axis in range(3)
        ],
        axis=1,
    )


def _vertex_steepness(positions: Array, faces: Array) -> Array:
    """Compute the steepness (n,) of the vertices of some triangles; 0 for all other vertices."""
    normals = _sum_vertex_normals(positions, faces)
    return wall_steepness(normals) * (normals[:, 2] != 0.0)


def _triangle_sides(faces: Array) -> Array:
    """List the sides (m, 3, 2) of triangles, each from the lower to the higher vertex."""
    return np.sort(np.stack([faces[:, [k, (k + 1) % 3]] for k in range(3)], axis=1), axis=2).astype(np.int64)


def _find_border(faces: Array, near: Array) -> Array:
    """Find the vertices on sides that belong to only one triangle, among the vertices ``near`` (n,)."""
    sides = _triangle_sides(faces[near[faces].any(axis=1)]).reshape(-1, 2)
    sides = sides[near[sides].any(axis=1)]  # all triangles of these sides are among the faces
    keys, uses = np.unique(sides[:, 0] * len(near) + sides[:, 1], return_counts=True)
    keys = keys[uses == 1]
    return np.concatenate([keys // len(near), keys % len(near)])


def _find_long_sides(positions: Array, faces: Array, seen_m: Array) -> tuple[Array, Array, Array]:
    """Find the long sides (k, 2) of walls, and the c triangles with a long side. Return the long sides, the indices (c,
    3) of each triangle's sides among them (-1 for short sides), and the indices (c,) of these triangles.
    """
    near = np.flatnonzero(np.isfinite(seen_m)[faces].any(axis=1))
    wall = near[wall_steepness(face_normals(positions, faces[near])) > 0.0]
    sides = _triangle_sides(faces[wall]).reshape(-1, 2)
    length = np.linalg.norm(positions[sides[:, 0]] - positions[sides[:, 1]], axis=1)
    sides = sides[length > _LONGEST_SIDE_PX * seen_m[sides].max(axis=1)]
    many = len(positions)
    keys = np.unique(sides[:, 0] * many + sides[:, 1])
    touched = np.zeros(many, bool)
    touched[sides] = True
    some = near[touched[faces[near]].sum(axis=1) > 1]
    their = _triangle_sides(faces[some])
    wanted = their[..., 0] * many + their[..., 1]
    place = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
    which = np.where(keys[place] == wanted, place, -1) if len(keys) else np.full(wanted.shape, -1)
    cut = (which >= 0).any(axis=1)
    return np.stack([keys // many, keys % many], axis=1), which[cut], some[cut]


def _chip_offsets(positions: Array, faces: Array, walls: Walls, free: Array) -> Array:
    """Compute the offsets (n, 3) in metres by which chips move each vertex into the ice; 0 unless the vertex is
    ``free``.
    """
    near = faces[free[faces].any(axis=1)]
    normals = _sum_vertex_normals(positions, near)
    length, number = np.zeros(len(positions)), np.zeros(len(positions))
    for k in range(3):
        side = np.linalg.norm(positions[near[:, k]] - positions[near[:, (k + 1) % 3]], axis=1)
        length += np.bincount(near[:, k], side, len(positions))
        number += np.bincount(near[:, k], minlength=len(positions))
    wall, depth = wall_steepness(normals), np.zeros((len(positions), 3))
    here = np.flatnonzero((wall > 0.0) & free & (number > 0.0))
    unit = normals[here] / np.linalg.norm(normals[here], axis=1, keepdims=True)
    finest = 2.0 * length[here] / number[here]
    depth[here] = unit * (wall[here] * chip_depth_m(positions[here], walls, finest))[:, None]
    return depth
