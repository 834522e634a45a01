"""Normals, labels and distances where rays hit the world, in double precision."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..support.arrays import Array
from .shapes import Hits, World, dot_products, normalize

#: Distance from a surface that a ray passes to the ray's new start, relative to the distance travelled.
_STEP_BEYOND = 1e-6
#: Maximum number of surfaces that a ray passes before it counts as ending nowhere.
_MAX_PASSED_SURFACES = 64
#: A ray passes a surface that transmits more than this share of light, as in Cycles' alpha threshold of depth.
_PASSING_SHARE = 0.5
#: Largest distance of a triangle's plane from the hit in single precision, relative to the ray's length. Above it the
#: ray grazes the triangle.
_MAX_PLANE_ERROR = 1e-4


class Tracer(Protocol):
    """Finds the triangles that rays meet."""

    name: str

    def intersect(self, origin: Array, direction: Array, near: float, far: float) -> Hits:
        """Find the first hits of rays (n, 3) from ``origin``, (3,) or (n, 3), at ``near`` to ``far`` times their
        direction."""

    def is_blocked(self, origin: Array, direction: Array, near: float, far: Array) -> Array:
        """Return whether (n,) rays (n, 3) meet anything from ``near`` to ``far`` (n,) times their direction."""

    def place(self, world: World) -> None:
        """Move the shapes to their places in another world with the same shapes."""

    def close(self) -> None:
        """Free the memory of the tracer."""


@dataclass(frozen=True)
class Surface:
    """The hit points of n rays on the world. ``along`` (n,), float64, is the length of a ray in units of its
    direction's length, infinite without a hit. ``normal`` (n, 3), float64, belongs to the triangle, on the side of the
    ray's origin; ``label`` (n,) uint8 to the triangle, and ``number`` (n,) int64 to the instance; ``loose_m`` (n,) is
    the thickness of loose material, in metres. These four are 0 without a hit."""

    along: Array
    normal: Array
    label: Array
    number: Array
    loose_m: Array


def find_surface(world: World, hits: Hits, origin: Array, direction: Array) -> Surface:
    """Find the surfaces that rays (n, 3) from ``origin``, (3,) or (n, 3), have met. Distances are computed again in
    double precision from the planes of the triangles, because Embree's distances are right only to 2.4e-7."""
    count = len(direction)
    found = Surface(
        np.full(count, np.inf),
        np.zeros((count, 3)),
        np.zeros(count, np.uint8),
        np.zeros(count, np.int64),
        np.zeros(count),
    )
    for number, rays in _group_by_shape(world, hits):
        place, triangle = hits.place[rays], hits.triangle[rays]
        normal, height = world.move_planes(number, place, triangle)
        toward = dot_products(normal, direction[rays])
        with np.errstate(divide="ignore", invalid="ignore"):
            before = normal @ origin if origin.ndim == 1 else dot_products(normal, origin[rays])
            exact = (height - before) / toward
            near = np.abs(exact - hits.along[rays]) <= _MAX_PLANE_ERROR * hits.along[rays]
        found.along[rays] = np.where(near, exact, hits.along[rays])
        found.normal[rays] = normalize(normal) * np.where(toward > 0, -1.0, 1.0)[:, None]
        found.label[rays] = world.placed[number].shape.label[triangle]
        found.number[rays] = world.numbers[place]
        shape = world.placed[number].shape
        if shape.loose_m is not None:
            found.loose_m[rays] = _interpolate(shape.loose_m.astype(np.float64), shape.triangles[triangle], hits, rays)
    return found


def find_shading_normals(world: World, hits: Hits, surface: Surface) -> Array:
    """Find the shading normals (n, 3) at the hits of rays, on the side of ``surface.normal``, without the bump of
    materials."""
    found = surface.normal.copy()
    for number, rays in _group_by_shape(world, hits):
        shape = world.placed[number].shape
        rays = rays[shape.smooth[hits.triangle[rays]]]
        corners = shape.triangles[hits.triangle[rays]]
        sides = [
            world.transform_normals(number, hits.place[rays], each)
            for each in (_interpolate(shape.normals, corners, hits, rays), shape.planes(hits.triangle[rays])[:, :3])
        ]
        found[rays] = (
            normalize(sides[0]) * np.where(dot_products(sides[1], surface.normal[rays]) < 0, -1.0, 1.0)[:, None]
        )
    return found


def _interpolate(values: Array, corners: Array, hits: Hits, rays: Array) -> Array:
    """Interpolate ``values`` (n, …) of the corners (k, 3) of triangles to the places (k, …) where rays meet them."""
    u, v = (each[rays].reshape(-1, *[1] * (values.ndim - 1)) for each in (hits.u, hits.v))
    return np.asarray((1 - u - v) * values[corners[:, 0]] + u * values[corners[:, 1]] + v * values[corners[:, 2]])


def _group_by_shape(world: World, hits: Hits) -> Iterator[tuple[int, Array]]:
    """Yield the index of each shape that is hit, and the rays that hit it."""
    rays = np.flatnonzero(hits.met)
    if not len(rays):
        return
    of = world.of[hits.place[rays]]
    order = np.argsort(of, kind="stable")
    starts = np.flatnonzero(np.diff(of[order], prepend=-1))
    yield from zip(of[order[starts]].tolist(), np.split(rays[order], starts[1:]), strict=True)


def intersect_opaque(tracer: Tracer, world: World, origin: Array, direction: Array, near: float, far: float) -> Hits:
    """Find the first hits of rays (n, 3) from ``origin``, (3,) or (n, 3), on surfaces that transmit at most half of the
    light; see ``Tracer.intersect``."""
    hits = tracer.intersect(origin, direction, near, far)
    if all(each.shape.passing is None for each in world.placed):
        return hits
    going = np.flatnonzero(_lets_pass(world, hits))
    for _ in range(_MAX_PASSED_SURFACES):
        if not len(going):
            break
        first = origin if origin.ndim == 1 else origin[going]
        start = first + direction[going] * (hits.along[going, None] * (1 + _STEP_BEYOND))
        beyond = tracer.intersect(start, direction[going], 0.0, far)
        passed = hits.along[going] * (1 + _STEP_BEYOND)
        for name in ("place", "triangle", "u", "v"):
            getattr(hits, name)[going] = getattr(beyond, name)
        hits.along[going] = beyond.along + passed
        going = going[_lets_pass(world, beyond)]
    hits.place[going] = -1
    return hits


def _lets_pass(world: World, hits: Hits) -> Array:
    """Return whether rays (n,) hit a surface that transmits them."""
    found = np.zeros(len(hits.place), bool)
    for number, rays in _group_by_shape(world, hits):
        shape = world.placed[number].shape
        if shape.passing is not None:
            corners = shape.triangles[hits.triangle[rays]]
            found[rays] = _interpolate(shape.passing, corners, hits, rays) >= _PASSING_SHARE
    return found
