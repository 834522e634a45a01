"""Texels that are baked for vertices: their places on a mesh, and the light that they give the vertices.

Cycles can bake at vertices, but such light is not the light of the facets between them. A facet loses light from below
its plane, and a smooth normal deviates most from the facet at its corners. Light at the vertices is therefore too dark
if facets lean away from it, and too bright if they lean toward it. Texels lie within facets, one for each corner, and
Cycles moves each sample within its texel.

A vertex gets the mean of the texels around it. The weight of a texel is the weight of the vertex in linear
interpolation there, times the texel's part of the facet's area. The light over all facets then equals the texels' light
(the lumped projection on linear elements), with less noise than single points have.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array

#: Maximum number of corners of a facet that has texels.
MAX_CORNERS = 4
#: Number of texels along a side of a facet's square; a triangle uses three texels of the square.
_TEXELS_PER_SIDE = 2
#: Image coordinate of corners without texels, outside the image.
_OUTSIDE = -1.0
#: Angle in degrees by which the square of a quadrilateral is turned, so that no texel is on its diagonals.
_TURN_DEG = 5.0
#: Corners of a triangle in its square, with which the texels are at barycentric coordinates of 2/3, 1/6 and 1/6.
_TRIANGLE_CORNERS = np.array([[1 / 6, 1 / 6], [13 / 6, 1 / 6], [1 / 6, 13 / 6]])
#: The texel (column, row) of each corner of a quadrilateral in its square.
_TEXEL_OF_CORNER = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
#: The texels of a triangle among the four of its square.
_TRIANGLE_TEXELS = np.array([0, 1, 3])
#: Weights of a triangle's corners at each of its texels.
_LINEAR_WEIGHTS = (np.eye(3) * 3 + 1) / 6
#: Weights of a quadrilateral's corners at each of its texels.
_BILINEAR_WEIGHTS = np.array([[9, 3, 1, 3], [3, 9, 3, 1], [1, 3, 9, 3], [3, 1, 3, 9]]) / 16
#: Number of rings of covered vertices that get light from their neighbours.
_FILLED_RINGS = 2


@dataclass(frozen=True)
class Texels:
    """The texels of a mesh in a square image of ``side`` texels. ``places`` (corners, 2), 0 to 1, are the mesh's
    corners in the image. The other arrays are one for triangles and one for quadrilaterals: ``vertices`` (facets, 3 or
    4) at the corners, ``texels`` (facets, 3 or 4) as rows of the flat image, and ``areas`` (facets,) in m².
    """

    side: int
    places: Array
    vertices: tuple[Array, Array]
    texels: tuple[Array, Array]
    areas: tuple[Array, Array]


def lay_out_texels(starts: Array, counts: Array, corners: Array, areas: Array, wanted: Array) -> Texels:
    """Lay out the texels of a mesh. ``starts``, ``counts`` and ``areas`` (facets,) are the first corner, number of
    corners and area of each facet; ``corners`` are vertices. Only ``wanted`` (facets,) facets get texels; the corners
    of others are outside the image. Raises ValueError for a facet with fewer than three or more than four corners.
    """
    if len(counts) and (counts.min() < 3 or counts.max() > MAX_CORNERS):
        raise ValueError("A facet has more than four corners.")
    count = int(wanted.sum())
    columns = max(1, math.ceil(math.sqrt(count)))
    side = columns * _TEXELS_PER_SIDE
    square = np.zeros((len(counts), 2), np.int64)
    square[wanted] = np.stack(np.divmod(np.arange(count), columns)[::-1], axis=-1) * _TEXELS_PER_SIDE
    places = np.full((len(corners), 2), _OUTSIDE, np.float32)
    vertices, texels, of_kind = [], [], []
    for sides, shape, nearest in (
        (3, _TRIANGLE_CORNERS, _TEXEL_OF_CORNER[_TRIANGLE_TEXELS]),
        (4, _make_turned_square(), _TEXEL_OF_CORNER),
    ):
        chosen = np.flatnonzero((counts == sides) & wanted)
        rows = starts[chosen, None] + np.arange(sides)
        places[rows] = (square[chosen, None] + shape) / side
        at = square[chosen, None] + nearest
        vertices.append(corners[rows])
        texels.append(at[..., 1] * side + at[..., 0])
        of_kind.append(areas[chosen].astype(np.float64))
    return Texels(side, places, (vertices[0], vertices[1]), (texels[0], texels[1]), (of_kind[0], of_kind[1]))


def _make_turned_square() -> Array:
    """Return the corners (4, 2) of a quadrilateral in its square."""
    turn = math.radians(_TURN_DEG)
    turned = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    return _TEXELS_PER_SIDE / 2 + (_TEXEL_OF_CORNER * _TEXELS_PER_SIDE - _TEXELS_PER_SIDE / 2) @ turned


def gather_uncovered(found: Texels, image: Array, covered: Array, vertices: int) -> Array:
    """Gather as ``gather_to_vertices`` does, without the texels that are ``covered`` (texels,). If all texels around a
    vertex are covered, the vertex gets the mean of the nearest lit vertices, because a facet may show beside the rock
    that covers its corner.
    """
    seen = np.where(covered[:, None], 0.0, image)
    light = gather_to_vertices(found, seen, vertices)
    known = gather_to_vertices(found, np.where(seen[:, 3:] > 0, 1.0, 0.0) * np.ones(4), vertices)[:, 0] > 0
    for _ in range(_FILLED_RINGS):
        total, count = np.zeros((vertices, 3)), np.zeros(vertices)
        for corners in found.vertices:
            some = known[corners]
            for band in range(3):
                of_facet = (light[corners, band] * some).sum(axis=1)
                for k in range(corners.shape[1]):
                    total[:, band] += np.bincount(corners[:, k], of_facet, vertices)
            for k in range(corners.shape[1]):
                count += np.bincount(corners[:, k], some.sum(axis=1), vertices)
        filled = ~known & (count > 0)
        light[filled] = total[filled] / count[filled, None]
        known |= filled
    return light


def gather_to_vertices(found: Texels, image: Array, vertices: int) -> Array:
    """Compute the light (vertices, 3) at the vertices, from an image (texels, 4) whose alpha is 0 where nothing was
    baked.
    """
    total, weights = np.zeros((vertices, 3)), np.zeros(vertices)
    for at, texels, areas, shape in zip(
        found.vertices, found.texels, found.areas, (_LINEAR_WEIGHTS, _BILINEAR_WEIGHTS), strict=True
    ):
        for k in range(at.shape[1]):
            light = image[texels[:, k]].astype(np.float64)
            for j in range(at.shape[1]):
                weight = areas / at.shape[1] * shape[k, j] * (light[:, 3] > 0)
                weights += np.bincount(at[:, j], weight, vertices)
                for band in range(3):
                    total[:, band] += np.bincount(at[:, j], weight * light[:, band], vertices)
    return np.asarray(total / np.where(weights > 0, weights, 1.0)[:, None])
