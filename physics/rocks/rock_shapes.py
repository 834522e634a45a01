"""Shapes of rocks, as closed triangle meshes.

Fracture leaves convex polyhedra: a rock is the part of space behind a number of planes. Wear (sublimation, sputtering,
rolling) rounds their edges: the polyhedron is worn back by a radius, and a ball of that radius rolls around it. This is
exact and needs no smoothing. A radius of 0 is fresh fracture; a radius as large as the rock gives a ball.

Faces of broken ice are uneven: the ice is cleaved along three nearly perpendicular directions, cut by a few other
planes, chipped at its corners, and stepped where the crack went on at another depth. No image shows rocks of Europa or
Enceladus from nearer than metres: this look is a guess from glacier and sea ice.

A shape has unit size: seen from above it covers pi/4 square metres (a circle of diameter 1) and it is 1 m high, so that
a rock's diameter and height are its scale.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from ...support.arrays import Array
from ..random_numbers.seeds import make_generator

FAMILIES = ("FRAGMENTS", "BOULDERS", "SLABS", "BROKEN_ICE")
MIXED = FAMILIES[:3]
PER_FAMILY = 6
#: Subdivisions of the sphere that samples a shape, finest first: 5120, 1280 and 320 triangles.
SUBDIVISIONS_BY_LEVEL = (4, 3, 2)
#: Subdivisions for broken ice, whose faces have relief: 20480, 5120 and 1280 triangles.
ICE_LEVELS = (5, 4, 3)
#: Ratio of the height of a slab to the height of other rocks of its width.
SLAB_HEIGHT_RATIO = 0.45
#: Least radius of wear, over the radius of the largest ball in the rock.
_SHARPEST_WEAR = 0.03
#: Largest radius of wear.
_ROUNDEST_WEAR = 0.9
#: Broken ice: random deviation of cleavage planes.
_CLEAVAGE_JITTER = 0.12
#: Depth of its steps over the distance to the face.
_STEP_DEPTH = 0.05
#: Mean wavenumbers of the steps, in radians over that distance.
_STEP_WAVENUMBERS = (5.0, 11.0, 24.0, 50.0)
#: Part of a wave in which a step falls back.
_STEP_FALL_SHARE = 0.15


@dataclass(frozen=True)
class RockShape:
    """A rock of unit size: ``vertices`` (n, 3) and ``triangles`` (m, 3) int32 counter-clockwise from outside. ``plane``
    (m,) is true for a flat triangle, of a plane face or of broken ice, and false for a rounded one. ``height`` is a
    factor on the height of rocks of this family, ``face`` (m,) int32 the plane that a triangle lies on."""

    vertices: Array
    triangles: Array
    plane: Array
    height: float
    face: Array


@lru_cache(maxsize=8)
def make_icosphere(subdivisions: int) -> tuple[Array, Array]:
    """Make the unit directions (n, 3) and triangles (20·4^subdivisions, 3) of a subdivided icosahedron."""
    golden = (1 + 5**0.5) / 2
    points = [(a, b * golden, 0.0) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    vertices = np.array([np.roll(p, k) for k in range(3) for p in points])
    # The 20 triples of mutually neighbouring corners; neighbours are 2 apart.
    near = np.abs(np.linalg.norm(vertices[:, None] - vertices, axis=2) - 2.0) < 1e-9
    triangles = np.array([t for t in combinations(range(12), 3) if all(near[a, b] for a, b in combinations(t, 2))])
    corners = vertices[triangles]
    inward = (
        np.einsum(
            "ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners.sum(axis=1)
        )
        < 0
    )
    triangles[inward] = triangles[inward][:, ::-1]
    for _ in range(subdivisions):
        edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        unique, which = np.unique(edges, axis=0, return_inverse=True)
        ab, bc, ca = (which.reshape(-1, 3) + len(vertices)).T
        vertices = np.concatenate([vertices, vertices[unique].mean(axis=1)])
        a, b, c = triangles.T
        triangles = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), triangles.astype(np.int32)


def find_polyhedron_corners(normals: Array, depths: Array) -> Array:
    """Find the corners (n, 3) of the bounded polyhedron of points p with p·normals (k, 3) <= depths (k,)."""
    triples = np.array(list(combinations(range(len(normals)), 3)))
    systems = normals[triples]
    solvable = np.abs(np.linalg.det(systems)) > 1e-6
    points = np.linalg.solve(systems[solvable], depths[triples[solvable]][..., None])[..., 0]
    return points[(points @ normals.T <= depths + 1e-9).all(axis=1)]


def _draw_planes(family: str, random: np.random.Generator) -> tuple[Array, Array]:
    """Draw the unit normals and distances from the centre of the planes that bound a rock."""
    if family == "SLABS":
        sides = random.integers(5, 8)
        around = 2 * np.pi * (np.arange(sides) + random.uniform(-0.3, 0.3, sides)) / sides
        normals = np.stack([np.cos(around), np.sin(around), random.uniform(-0.3, 0.3, sides)], axis=1)
        depths = random.uniform(0.65, 1.0, sides)
        faces = np.array([[0, 0, 1.0], [0, 0, -1.0]]) + random.normal(0, 0.08, (2, 3)) * [1, 1, 0]
        normals, depths = np.concatenate([normals, faces]), np.append(depths, [0.4, 0.4])
    else:
        normals = random.normal(size=(11 if family == "FRAGMENTS" else 16, 3))
        depths = random.uniform(0.55, 1.0, len(normals))
    # A box about all of it, for the directions that chance leaves open.
    normals = np.concatenate([normals, np.eye(3), -np.eye(3)])
    depths = np.append(depths, np.ones(6))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True), depths


def _draw_cleavage(random: np.random.Generator) -> tuple[Array, Array]:
    """Draw the unit normals and distances from the centre of the planes that bound a rock of broken ice."""

    def unit(vectors: Array) -> Array:
        return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))

    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    normals = unit(np.concatenate([axes, -axes]) + random.normal(0, _CLEAVAGE_JITTER, (6, 3)))
    depths = np.tile(np.array([1.0, 0.8, 0.62]) * random.uniform(0.85, 1.1, 3), 2) * random.uniform(0.9, 1.1, 6)
    # Planes across the rock, then chips of its corners: each plane cuts off a part of the shape so far.
    cuts = unit(random.normal(size=(random.integers(3, 6), 3)))
    farthest = (cuts @ find_polyhedron_corners(normals, depths).T).max(axis=1)
    depths = np.append(depths, farthest * random.uniform(0.62, 0.85, len(cuts)))
    normals = np.concatenate([normals, cuts])
    corners = find_polyhedron_corners(normals, depths)
    chipped = corners[random.choice(len(corners), min(len(corners), random.integers(4, 9)), replace=False)]
    chips = unit(chipped + random.normal(0, 0.25, chipped.shape))
    reach = (chips @ corners.T).max(axis=1) * random.uniform(0.9, 0.97, len(chips))
    return np.concatenate([normals, chips]), np.append(depths, reach)


def _hull_area(points: Array) -> float:
    """Compute the area of the convex hull of points (n, 2), by Andrew's monotone chain."""
    # Points inside the polygon of those farthest out in 32 directions are not on the hull (Akl and Toussaint 1978).
    angles = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    far = points[np.argmax(points @ np.stack([np.cos(angles), np.sin(angles)]), axis=0)]
    far = far[np.any(far != np.roll(far, -1, axis=0), axis=1)]
    inward = (np.roll(far, -1, axis=0) - far) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    points = points[~(points @ inward.T - (far * inward).sum(axis=1) > 1e-9).all(axis=1)]
    ordered = points[np.lexsort(points.T)][:, ::-1].tolist()

    def chain(sequence: list[list[float]]) -> list[list[float]]:
        hull: list[list[float]] = []
        for p in sequence:
            while (
                len(hull) > 1
                and (
                    (hull[-1][0] - hull[-2][0]) * (p[1] - hull[-2][1])
                    - (hull[-1][1] - hull[-2][1]) * (p[0] - hull[-2][0])
                )
                <= 0
            ):
                hull.pop()
            hull.append(p)
        return hull[:-1]

    x, y = np.array(chain(ordered) + chain(ordered[::-1])).T
    return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) / 2


def _round_edges(normals: Array, depths: Array, wear: float) -> list[tuple[Array, Array]]:
    """Round the edges of a polyhedron by ``wear``. Return, for every level, its vertices and whether triangles are
    plane faces.
    """
    radius = wear * depths.min()
    corners = find_polyhedron_corners(normals, depths - radius)
    levels = []
    for subdivisions in SUBDIVISIONS_BY_LEVEL:
        directions, triangles = make_icosphere(subdivisions)
        farthest = np.argmax(directions @ corners.T, axis=1)
        a, b, c = farthest[triangles].T
        # One corner: part of a ball. Two: of the cylinder along an edge. Three: of a face.
        levels.append((corners[farthest] + radius * directions, (a != b) & (b != c) & (c != a)))
    return levels


def _blend_planes(
    normals: Array, depths: Array, angularity: float, random: np.random.Generator
) -> list[tuple[Array, Array]]:
    """Blend planes smoothly to a boulder with low lumps. Return, for every level, its vertices; it has no plane
    faces.
    """
    power = 4.0 + 8.0 * angularity
    waves, phases = random.normal(0, 2.0, (5, 3)), random.uniform(0, 2 * np.pi, 5)
    levels = []
    for subdivisions in SUBDIVISIONS_BY_LEVEL:
        directions, triangles = make_icosphere(subdivisions)
        blend = (np.maximum(directions @ normals.T / depths, 0.0) ** power).sum(axis=1) ** (-1.0 / power)
        swell = 1.0 + 0.03 * np.sin(directions @ waves.T + phases).sum(axis=1)
        levels.append((directions * (blend * swell)[:, None], np.zeros(len(triangles), bool)))
    return levels


def _follow_edges(directions: Array, planes: Array, step: float) -> Array:
    """Move unit directions (n, 3) onto an edge if they are within 0.4 of a ``step`` (rad) of it, so that edges have no
    teeth. ``planes`` (k, 3) are normals over distances from the centre.
    """
    order = np.argsort(directions @ planes.T, axis=1)
    across = planes[order[:, -1]] - planes[order[:, -2]]
    off = np.einsum("nk,nk->n", directions, across)
    along = across - off[:, None] * directions
    squared = np.einsum("nk,nk->n", along, along)
    moved = directions - (off / squared)[:, None] * along
    # Farther away, vertices would pass each other near corners.
    moved = np.where((np.abs(off) < 0.4 * step * np.sqrt(squared))[:, None], moved, directions)
    return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True))


def _break_ice(
    normals: Array, depths: Array, angularity: float, random: np.random.Generator
) -> list[tuple[Array, Array]]:
    """Make a rock of broken ice. Return, for every level, its vertices; all triangles are flat."""
    waves = [(random.normal(0, number, (3, 4)), random.uniform(0, 1, 4)) for number in _STEP_WAVENUMBERS]
    power = 8.0 + 42.0 * angularity  # rounds edges by about a step of the finest mesh at 0.9
    planes, levels = normals / depths[:, None], []
    for subdivisions in ICE_LEVELS:
        directions, triangles = make_icosphere(subdivisions)
        directions = _follow_edges(directions, planes, 1.107 / 2**subdivisions)  # an icosahedron's edge is 1.107 rad
        points = directions * ((np.maximum(directions @ planes.T, 0.0) ** power).sum(axis=1) ** (-1 / power))[:, None]
        steps = np.zeros(len(points))
        for octave, (wave, phase) in enumerate(waves):
            # The finer steps bend with the coarser ones.
            turn = (points @ wave + 16.0 * steps[:, None] * (octave > 0)) / (2 * np.pi) + phase
            turn -= np.floor(turn)
            saw = (
                np.where(turn < 1 - _STEP_FALL_SHARE, turn / (1 - _STEP_FALL_SHARE), (1 - turn) / _STEP_FALL_SHARE)
                - 0.5
            )
            steps += 0.5**octave * saw.mean(axis=1)
        levels.append((points * (1.0 + _STEP_DEPTH * steps)[:, None], np.ones(len(triangles), bool)))
    return levels


def _assign_faces(vertices: Array, triangles: Array, planes: Array) -> Array:
    """Find the plane (m,) int32 on which each triangle lies, of ``planes`` (k, 3), normals over distances from the
    centre.
    """
    return np.argmax(vertices[triangles].mean(axis=1) @ planes.T, axis=1).astype(np.int32)


def _make_rock(family: str, angularity: float, random: np.random.Generator) -> list[RockShape]:
    """Make one rock at every level, of unit size."""
    normals, depths = _draw_cleavage(random) if family == "BROKEN_ICE" else _draw_planes(family, random)
    sampled = ICE_LEVELS if family == "BROKEN_ICE" else SUBDIVISIONS_BY_LEVEL
    if family == "BROKEN_ICE":
        levels = _break_ice(normals, depths, angularity, random)
    elif family == "BOULDERS":
        levels = _blend_planes(normals, depths, angularity, random)
    else:
        levels = _round_edges(normals, depths, _SHARPEST_WEAR + (_ROUNDEST_WEAR - _SHARPEST_WEAR) * (1.0 - angularity))
    finest = levels[0][0]
    low, high = finest.min(axis=0), finest.max(axis=0)
    across = np.sqrt(np.pi / 4 / _hull_area(finest[:, :2]))
    scale = np.array([across, across, 1.0 / (high[2] - low[2])])
    height = SLAB_HEIGHT_RATIO if family == "SLABS" else 1.0
    # A worn boulder has no faces left.
    planes = (normals / depths[:, None])[: 1 if family == "BOULDERS" else None]
    return [
        RockShape(
            (vertices - (low + high) / 2) * scale,
            make_icosphere(subdivisions)[1],
            plane,
            height,
            _assign_faces(vertices, make_icosphere(subdivisions)[1], planes),
        )
        for subdivisions, (vertices, plane) in zip(sampled, levels, strict=True)
    ]


@lru_cache(maxsize=4)
def make_rock_shapes(family: str, angularity: float, seed: int) -> tuple[tuple[RockShape, ...], ...]:
    """Make the available shapes as ``[level][shape]``, finest level first, with the same shapes at every level.
    ``family`` is one of ``FAMILIES``, or "MIXED" for all of ``MIXED``; ``angularity`` is from 0, worn round, to 1,
    freshly broken.
    """
    families = MIXED if family == "MIXED" else (family,)
    rocks = [
        _make_rock(kind, angularity, make_generator(seed, "rocks", 0, FAMILIES.index(kind), k))
        for k in range(PER_FAMILY)
        for kind in families
    ]
    return tuple(zip(*rocks, strict=True))
