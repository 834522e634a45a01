"""Irregular triangles over a height map, few on flat ground, as in decimated reconstructions.

First the square is halved into right triangles wherever they miss the heights (Evans, Kirkpatrick and Townsend 2001,
"Right-triangulated irregular networks", Algorithmica 30, 264). Then the vertices are moved at random and edges are
flipped until no triangle can be made better (Lawson 1977), so that nothing of the squares is left to see.
"""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array

_MAX_FLIP_ROUNDS = 80  # of flips; the triangles that could still be better are harmless


def triangulate(random: np.random.Generator, heights: Array, triangles: int, flat: float) -> tuple[Array, Array]:
    """Positions (k, 2) of vertices in pixels (column, row) and faces (m, 3), counter-clockwise, about ``triangles`` in
    number.

    ``heights`` is (2^j + 1, 2^j + 1) in pixels. ``flat`` is the error that a flat triangle counts at least, as a share
    of its edge, so that flat ground has triangles too.
    """
    error = _measure_errors(heights, flat)
    low, high = 0.0, float(error.max())
    for _ in range(24):  # the number falls as the error that is allowed grows
        middle = (low + high) / 2
        low, high = (middle, high) if _count_triangles(error, middle) > triangles else (low, middle)
    places, faces = _split_square(error, high)
    places = _move_vertices(random, places, faces, heights.shape[0] - 1)
    return places, _flip_edges(random, places, faces)


def _list_levels(size: int) -> list[Array]:
    """Right triangles of each level, coarsest first: (m, 3, 2) columns and rows of the corners a, b and the right
    angle's c; the hypotenuse is a to b."""
    found = [np.array([[(0, 0), (size, size), (size, 0)], [(size, size), (0, 0), (0, size)]])]
    while abs(found[-1][0, 0] - found[-1][0, 1]).max() > 1:
        a, b, c = found[-1][:, 0], found[-1][:, 1], found[-1][:, 2]
        middle = (a + b) // 2
        found.append(np.concatenate([np.stack([c, a, middle], axis=1), np.stack([b, c, middle], axis=1)]))
    return found


def _measure_errors(heights: Array, flat: float) -> Array:
    """For each vertex, the largest deviation from the heights of the triangles that it halves and of all triangles
    within them."""
    error = np.zeros_like(heights)
    for level in reversed(_list_levels(heights.shape[0] - 1)):
        a, b, c = level[:, 0], level[:, 1], level[:, 2]
        if ((a + b) % 2).any():
            continue  # the smallest triangles, which cannot be halved
        middle = (a + b) // 2
        ends = (heights[a[:, 1], a[:, 0]] + heights[b[:, 1], b[:, 0]]) / 2
        missed = np.abs(ends - heights[middle[:, 1], middle[:, 0]])
        missed += flat * np.abs(a - b).max(axis=1)
        for end, other in ((a, c), (b, c)):  # the halves are halved at the middle of the short sides
            child = end + other
            even = (child % 2 == 0).all(axis=1)
            place = child[even] // 2
            missed[even] = np.maximum(missed[even], error[place[:, 1], place[:, 0]])
        np.maximum.at(error, (middle[:, 1], middle[:, 0]), missed)
    return error


def _halve_triangles(error: Array, most: float) -> list[tuple[Array, Array]]:
    """For each level the existing triangles, and which of them are halved."""
    size = error.shape[0] - 1
    level = np.array([[(0, 0), (size, size), (size, 0)], [(size, size), (0, 0), (0, size)]])
    found = []
    while len(level):
        a, b, c = level[:, 0], level[:, 1], level[:, 2]
        middle = (a + b) // 2
        split = ((a + b) % 2 == 0).all(axis=1) & (error[middle[:, 1], middle[:, 0]] > most)
        found.append((level, split))
        a, b, c, middle = a[split], b[split], c[split], middle[split]
        level = np.concatenate([np.stack([c, a, middle], axis=1), np.stack([b, c, middle], axis=1)])
    return found


def _count_triangles(error: Array, most: float) -> int:
    return 2 + sum(int(split.sum()) for _, split in _halve_triangles(error, most))


def _split_square(error: Array, most: float) -> tuple[Array, Array]:
    corners = np.concatenate([level[~split] for level, split in _halve_triangles(error, most)])
    width = error.shape[0]
    keys, faces = np.unique(corners[..., 1] * width + corners[..., 0], return_inverse=True)
    faces = faces.reshape(-1, 3)
    places = np.stack([keys % width, keys // width], axis=1).astype(float)
    faces[_compute_twice_area(places, faces) < 0] = faces[_compute_twice_area(places, faces) < 0][:, ::-1]
    return places, faces


def _compute_twice_area(places: Array, faces: Array) -> Array:
    a, b, c = (places[faces[:, k]] for k in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def _move_vertices(random: np.random.Generator, places: Array, faces: Array, size: int) -> Array:
    """Move each vertex by a distance too small to flip a triangle; vertices on the border stay."""
    height = np.full(len(places), np.inf)  # least height of a triangle at each vertex
    for k in range(3):
        a, b = places[faces[:, k]], places[faces[:, (k + 1) % 3]]
        of = _compute_twice_area(places, faces) / np.hypot(*(b - a).T)
        for corner in faces.T:
            np.minimum.at(height, corner, of)
    inside = ((places > 0) & (places < size)).all(axis=1)
    turn, far = 2 * np.pi * random.random(len(places)), 0.45 * np.sqrt(random.random(len(places)))
    step = np.stack([np.cos(turn), np.sin(turn)], axis=1) * (far * height * inside)[:, None]
    return np.asarray(places + step)


def _flip_edges(random: np.random.Generator, places: Array, faces: Array) -> Array:
    """The faces after flips of the edges that violate the Delaunay condition."""
    faces = faces.copy()
    for _ in range(_MAX_FLIP_ROUNDS):
        begin, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
        other = faces[:, [2, 0, 1]].ravel()
        key = np.minimum(begin, end) * len(places) + np.maximum(begin, end)
        order = np.argsort(key, kind="stable")
        pair = np.flatnonzero(key[order][1:] == key[order][:-1])
        one, two = order[pair], order[pair + 1]
        a, b, c, d = begin[one], end[one], other[one], other[two]
        flip = np.flatnonzero(_is_within_circle(places[a], places[b], places[c], places[d]))
        if not len(flip):
            break
        first, second = one[flip] // 3, two[flip] // 3
        rank = random.permutation(len(flip))
        best = np.full(len(faces), len(flip))
        np.minimum.at(best, first, rank)
        np.minimum.at(best, second, rank)
        alone = (best[first] == rank) & (best[second] == rank)  # no two flips touch the same triangle
        flip, first, second = flip[alone], first[alone], second[alone]
        faces[first] = np.stack([a[flip], d[flip], c[flip]], axis=1)
        faces[second] = np.stack([d[flip], b[flip], c[flip]], axis=1)
    return faces


def _is_within_circle(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Whether ``d`` lies within the circle through a, b and c, which are counter-clockwise; beyond rounding."""
    (ax, ay), (bx, by), (cx, cy) = ((p - d).T for p in (a, b, c))
    determinant = (
        (ax * ax + ay * ay) * (bx * cy - cx * by)
        - (bx * bx + by * by) * (ax * cy - cx * ay)
        + (cx * cx + cy * cy) * (ax * by - bx * ay)
    )
    scale = np.maximum(np.abs(a - d).max(axis=1), np.abs(b - d).max(axis=1)) ** 4
    return np.asarray(determinant > 1e-9 * scale)
