"""The world that rays are traced against: shapes of triangles, and their instances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..support.arrays import Array


@dataclass(frozen=True)
class Shape:
    """Triangles in the coordinates of an object, in metres.

    ``vertices`` (n, 3) float32 and ``triangles`` (m, 3) uint32. ``smooth`` (m,) triangles are shaded with normals
    interpolated between their vertices. ``label`` (m,) uint8 is the kind of object that a triangle belongs to.
    ``passing`` (n,) float32 is the share of light that goes through at a vertex; None if the shape is opaque.
    ``loose_m`` (n,) float32 is the thickness of loose material at a vertex; None without loose material.
    """

    vertices: Array
    triangles: Array
    smooth: Array
    label: Array
    passing: Array | None = None
    loose_m: Array | None = None

    def planes(self, triangles: Array) -> Array:
        """Return the planes (n, 4) float64 of triangles (n,): the cross product of two sides, in m², and its dot
        product with the first corner, in m³. Each plane is computed once, since many rays meet the same triangle."""
        asked = np.zeros(len(self.triangles), bool)
        asked[triangles] = True
        each = np.flatnonzero(asked)
        first, second, third = (self.vertices[corner].astype(np.float64) for corner in self.triangles[each].T)
        normal = cross_products(second - first, third - first)
        place = np.empty(len(self.triangles), np.int32)
        place[each] = np.arange(len(each))
        return np.column_stack([normal, dot_products(normal, first)])[place[triangles]]

    @cached_property
    def normals(self) -> Array:
        """Normals (n, 3) float64 of the vertices: the sum of the normals of their triangles, normalized, as in Cycles
        after it has moved vertices."""
        own = normalize(self.planes(np.arange(len(self.triangles)))[:, :3])
        each, count = self.triangles.ravel(), len(self.vertices)
        return normalize(np.stack([np.bincount(each, np.repeat(own[:, axis], 3), count) for axis in range(3)], axis=1))


@dataclass(frozen=True)
class Placed:
    """A shape and its k instances: float64 matrices (k, 4, 4) from the shape's coordinates to the world, and an int64
    number (k,) that labels each instance."""

    shape: Shape
    places: Array
    numbers: Array


@dataclass(frozen=True)
class World:
    """All objects that rays can meet."""

    placed: Sequence[Placed]
    #: For each place, one shape after the other: its shape, matrix (4, 4) and number.
    of: Array = field(init=False)
    places: Array = field(init=False)
    numbers: Array = field(init=False)

    def __post_init__(self) -> None:
        counts = [len(each.places) for each in self.placed]
        object.__setattr__(self, "of", np.repeat(np.arange(len(counts)), counts))
        object.__setattr__(
            self, "places", np.concatenate([each.places for each in self.placed] or [np.zeros((0, 4, 4))])
        )
        object.__setattr__(
            self, "numbers", np.concatenate([each.numbers for each in self.placed] or [np.zeros(0, np.int64)])
        )

    def move_planes(self, number: int, place: Array, triangle: Array) -> tuple[Array, Array]:
        """Move the planes of triangles (n,) of the shape ``number`` into the world, by their instances ``place`` (n,):
        normals (n, 3) of any length, and their dot products (n,) with points of the planes."""
        planes = self.placed[number].shape.planes(triangle)
        normal = self.transform_normals(number, place, planes[:, :3])
        if len(self.placed[number].places) == 1:
            first = self._first_place(number)
            return normal, planes[:, 3] * self._determinants[first] + normal @ self.places[first, :3, 3]
        return normal, planes[:, 3] * self._determinants[place] + dot_products(normal, self.places[place, :3, 3])

    def transform_normals(self, number: int, place: Array, normals: Array) -> Array:
        """Transform normals (n, 3), of any length, of the shape ``number`` to the world, by their instance ``place``
        (n,). This uses the cofactors of the matrix (its inverse transposed times its determinant), so that a cross
        product of two sides stays the cross product of the moved sides."""
        if len(self.placed[number].places) == 1:
            return np.asarray(normals @ self._cofactors[self._first_place(number)].T)
        return np.asarray(np.einsum("nij,nj->ni", self._cofactors[place], normals))

    def _first_place(self, number: int) -> int:
        """Return the index of the first instance of a shape."""
        return int(np.searchsorted(self.of, number))

    @cached_property
    def _cofactors(self) -> Array:
        rows = self.places[:, :3, :3]
        return np.cross(rows[:, [1, 2, 0]], rows[:, [2, 0, 1]])

    @cached_property
    def _determinants(self) -> Array:
        return dot_products(self.places[:, 0, :3], self._cofactors[:, 0])

    def highest_m(self) -> float:
        """Find a height in metres that no vertex exceeds, from boxes around the placed shapes; 0 without shapes."""
        tops = [0.0] if not len(self.places) else []
        for each in self.placed:
            low, high = each.shape.vertices.min(axis=0), each.shape.vertices.max(axis=0)
            rows = each.places[:, 2]
            tops += (np.maximum(rows[:, :3] * low, rows[:, :3] * high).sum(axis=1) + rows[:, 3]).tolist()
        return max(tops)


@dataclass(frozen=True)
class Hits:
    """The first triangle that each of n rays meets.

    ``place`` (n,) is the index of an instance in a ``World``, -1 for a ray that meets nothing; ``triangle`` (n,) is an
    index into the triangles of the shape there. The point is (1 - u - v) A + u B + v C of the triangle's corners, with
    ``u`` and ``v`` (n,). ``along`` (n,), float64, is the length of a ray in units of its direction's length.
    """

    along: Array
    place: Array
    triangle: Array
    u: Array
    v: Array

    @property
    def met(self) -> Array:
        """Whether each ray (n,) hits anything."""
        return np.asarray(self.place >= 0)


def cross_products(one: Array, other: Array) -> Array:
    """Return the cross products (n, 3) of vectors (n, 3); numpy's own function takes three times as long."""
    (a, b, c), (d, e, f) = one.T, other.T
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=1)


def dot_products(one: Array, other: Array) -> Array:
    """Return the dot products (n,) of vectors (n, 3)."""
    return np.asarray(np.einsum("ij,ij->i", one, other))


def normalize(vectors: Array) -> Array:
    """Scale vectors (n, 3) to unit length; 0 stays 0."""
    return np.asarray(vectors / np.maximum(np.sqrt(dot_products(vectors, vectors)), np.finfo(float).tiny)[:, None])
