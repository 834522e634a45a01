"""Rings of vertices around a centre and the triangles between them, without cracks for any number per ring."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array

#: Distance between rings over the spacing along them; this value makes the triangles equilateral.
RINGS_APART = math.sqrt(3.0) / 2.0
_MIN_PER_RING = 6


@dataclass(frozen=True)
class VertexRings:
    """Rings with increasing radii in metres (n,), and numbers of vertices (n,). Every second ring is turned by half a
    step. Vertex 0 is the centre; the rings follow from the inside out, each counter-clockwise from east.
    """

    radius_m: Array
    count: Array

    @classmethod
    def of(cls, radius_m: Array, spacing_m: Array) -> VertexRings:
        """Make rings whose vertices are about ``spacing_m`` (n,) apart."""
        count = np.maximum(np.rint(2 * np.pi * radius_m / spacing_m), _MIN_PER_RING).astype(np.int64)
        return cls(np.asarray(radius_m, np.float64), count)

    @property
    def vertices(self) -> int:
        """Number of vertices, including the centre."""
        return 1 + int(self.count.sum())

    def map_positions(self) -> tuple[Array, Array]:
        """Compute east and north (vertices,) of the vertices from the centre, in metres."""
        ring, place = self._ring_places()
        angle = (place + 0.5 * (ring % 2)) * (2 * np.pi / self.count[ring])
        x, y = (np.concatenate([[0.0], self.radius_m[ring] * f(angle)]) for f in (np.cos, np.sin))
        return x, y

    def spread_to_vertices(self, values: Array, centre: float) -> Array:
        """Spread values (n,) of the rings to their vertices (vertices,); vertex 0 gets ``centre``."""
        return np.concatenate([[centre], np.repeat(values, self.count)])

    def faces(self) -> Array:
        """Make triangles (m, 3) int32, counter-clockwise from above.

        The edges of two neighbouring rings are sorted by the azimuth of their middles. Each edge makes a triangle with
        the vertex that the other ring has reached. The computation is in integers, so rounding leaves no crack.
        """
        first = 1 + np.concatenate([[0], np.cumsum(self.count)[:-1]])
        around = np.arange(self.count[0])
        fan = np.stack([0 * around, 1 + around, 1 + (around + 1) % self.count[0]], axis=1)
        ring, place = self._ring_places()
        turned = ring % 2
        inner = ring < len(self.count) - 1  # rings whose edges have a triangle outward
        outward = self._strip_triangles(ring[inner], place[inner], turned[inner], 1, first)
        inward = self._strip_triangles(ring[ring > 0], place[ring > 0], turned[ring > 0], -1, first)
        return np.concatenate([fan, outward, inward]).astype(np.int32)

    def _ring_places(self) -> tuple[Array, Array]:
        """Return the ring of each vertex except the centre, and its place on the ring."""
        ring = np.repeat(np.arange(len(self.count)), self.count)
        return ring, np.arange(len(ring)) - np.repeat(np.cumsum(self.count) - self.count, self.count)

    def _strip_triangles(self, ring: Array, place: Array, turned: Array, to: int, first: Array) -> Array:
        """Make triangles of the edges that start at places on rings, with a vertex of the next ring outward (1) or
        inward (-1).
        """
        own, other = self.count[ring], self.count[ring + to]
        # Count the edges of the other ring whose middle comes first; at equal azimuths the inner ring's does.
        ahead = (2 * place + 1 + turned) * other - (2 - turned) * own
        passed = -(-ahead // (2 * own)) if to == 1 else ahead // (2 * own) + 1
        apex = first[ring + to] + np.clip(passed, 0, other) % other
        start, end = first[ring] + place, first[ring] + (place + 1) % own
        return np.stack([start, apex, end] if to == 1 else [apex, start, end], axis=1)
