"""A mesh of a square patch and rings around it, whose cells double in width from ring to ring, without a crack.

The cells of a ring are twice as wide as the cells of the next inner ring. Each of its innermost cells therefore has a
fifth vertex, in the middle of its inner side, which belongs to the finer cells, and is cut into three triangles; other
cells are cut into two. Two triangles share each edge inside the mesh.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array

#: Minimum and maximum number of cells along the inner side of a ring. A cell is then 1/16 to 1/128 of its distance from
#: the middle wide.
_FEWEST_CELLS, _MAX_CELLS = 32, 256
#: Minimum number of cells across a ring, so that widths double gradually.
_FEWEST_ACROSS = 2
#: Least width of a ring's cells over the pixels of its map, except where the doubling needs finer cells.
_PIXEL_SHARE = 0.5
#: Divisor of the number of cells along a side of the patch, so that rings can be twice as coarse again and again.
_MULTIPLE = 4


@dataclass(frozen=True)
class Level:
    """The patch, or a ring around it. ``half_m`` is half the side of its outer square and ``cell_m`` the width of its
    cells, in metres. ``inner`` and ``outer`` are the numbers of cells along the sides of its inner square (0 for the
    patch) and of its outer square.
    """

    half_m: float
    cell_m: float
    inner: int
    outer: int

    @property
    def across(self) -> int:
        """Number of cells from the inner square to the outer square."""
        return (self.outer - self.inner) // 2

    @property
    def axis_m(self) -> Array:
        """Coordinates (outer + 1,) in metres of the lines of the lattice, which covers the inner square too."""
        return np.linspace(-self.half_m, self.half_m, self.outer + 1)

    @property
    def triangles(self) -> int:
        """Number of triangles of this ring."""
        return 2 * (self.outer**2 - self.inner**2) + 4 * self.inner

    def find_ring_vertices(self) -> Array:
        """Find the lattice points that are vertices of the ring, outside the inner square: bool (outer + 1, outer +
        1).
        """
        own = np.ones((self.outer + 1, self.outer + 1), bool)
        if self.inner:
            inside = slice(self.across, self.across + self.inner + 1)
            own[inside, inside] = False
        return own


def count_cells(vertices: int) -> int:
    """Count the cells along a side of a patch with rings, for a wanted number of vertices along it. They are up to
    three more than without rings, to be a multiple of four.
    """
    return _MULTIPLE * math.ceil((vertices - 1) / _MULTIPLE)


def plan_levels(cells: int, size_m: float, reach_m: float, pixel_at: Callable[[float], float]) -> list[Level]:
    """Plan the patch of ``size_m`` with ``cells`` along its side, and the rings out to a distance of ``reach_m``.

    ``pixel_at`` returns the width in metres of the pixels of the map at a distance from the middle. The first rings are
    as narrow as possible where their cells are finer than half of a pixel.
    """
    levels = [Level(size_m / 2, size_m / cells, 0, cells)]
    most = max(_FEWEST_CELLS, min(_MAX_CELLS, cells // 2 // _MULTIPLE * _MULTIPLE))
    while levels[-1].half_m < reach_m * (1 - 1e-9):
        half, cell, inner = levels[-1].half_m, 2 * levels[-1].cell_m, levels[-1].outer // 2
        wanted = most if cell >= _PIXEL_SHARE * pixel_at(half) else _FEWEST_CELLS
        across = max(_FEWEST_ACROSS, wanted - inner // 2)
        across += (inner // 2 + across) % 2  # the next ring's inner side then is an even number of cells
        across = min(across, math.ceil((reach_m - half) / cell - 1e-9))
        levels.append(Level(half + across * cell, cell, inner, inner + 2 * across))
    return levels


@dataclass(frozen=True)
class RingMesh:
    """Positions (n, 2) of vertices in metres and triangles (m, 3), counter-clockwise from above. Vertices are sorted by
    level from the patch outward, in a level in the order of ``Level.find_ring_vertices``, rows from the south.
    """

    places: Array
    faces: Array


def build_rings(levels: Sequence[Level]) -> RingMesh:
    """Build the mesh of the levels of ``plan_levels``."""
    places: list[Array] = []
    faces: list[Array] = []
    count, before = 0, np.empty((0, 0), np.int64)
    for level in levels:
        own = level.find_ring_vertices()
        index = np.full(own.shape, -1, np.int64)
        index[own] = count + np.arange(own.sum())
        count += int(own.sum())
        y, x = np.nonzero(own)
        places.append(np.stack([level.axis_m[x], level.axis_m[y]], axis=1))
        if level.inner:
            inside = slice(level.across, level.across + level.inner + 1)
            index[inside, inside] = before[::2, ::2]
            faces += _join_to_inside(index, before, level)
        faces.append(_halve_cells(index, level))
        before = index
    return RingMesh(np.concatenate(places), np.concatenate(faces).astype(np.int32))


def _halve_cells(index: Array, level: Level) -> Array:
    """Make two triangles for each cell of a level's lattice, except for cells inside or beside the inner square."""
    wanted = np.ones((level.outer, level.outer), bool)
    if level.inner:
        inside, wide = (slice(level.across - k, level.across + level.inner + k) for k in (0, 1))
        wanted[inside, wide] = False
        wanted[wide, inside] = False
    j, i = np.nonzero(wanted)
    a, b, c, d = index[j, i], index[j, i + 1], index[j + 1, i + 1], index[j + 1, i]
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _join_to_inside(index: Array, before: Array, level: Level) -> list[Array]:
    """Make three triangles for each cell beside the inner square. The vertex amid the cell's inner side is from the
    lattice ``before``, the next level inward.
    """
    low, high = level.across, level.across + level.inner
    k = np.arange(low, high)
    sides = (  # two vertices of the outer side, two of the inner side, and the vertex amid the inner side
        (index[low - 1, k], index[low - 1, k + 1], index[low, k + 1], index[low, k], before[0, 1::2]),
        (index[high + 1, k + 1], index[high + 1, k], index[high, k], index[high, k + 1], before[-1, 1::2]),
        (index[k + 1, low - 1], index[k, low - 1], index[k, low], index[k + 1, low], before[1::2, 0]),
        (index[k, high + 1], index[k + 1, high + 1], index[k + 1, high], index[k, high], before[1::2, -1]),
    )
    return [
        np.stack(corners, axis=1)
        for a, b, c, d, middle in sides
        for corners in ((a, b, middle), (b, c, middle), (a, middle, d))
    ]


def drop_unknown_vertices(mesh: RingMesh, heights_m: Array) -> tuple[Array, Array]:
    """Return the positions (k, 3) and triangles (m, 3) of the part of a mesh whose vertices have finite heights
    (n,).
    """
    faces = mesh.faces[np.isfinite(heights_m)[mesh.faces].all(axis=1)]
    used = np.zeros(len(heights_m), bool)
    used[faces] = True
    number = np.cumsum(used) - 1
    positions = np.concatenate([mesh.places, heights_m[:, None]], axis=1)[used]
    return positions.astype(np.float32), number[faces].astype(np.int32)
