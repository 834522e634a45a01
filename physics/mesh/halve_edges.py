"""Finer triangles for a mesh, so that it can carry finer relief."""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array
from .mesh_faults import face_normals


def edge_length_m(positions: Array, faces: Array) -> float:
    """Compute the median length in metres of the triangles' edges: the resolution of the mesh."""
    return float(np.median(np.linalg.norm(positions[faces] - positions[faces[:, [1, 2, 0]]], axis=2)))


def vertex_normals(positions: Array, faces: Array) -> Array:
    """Compute the unit normals (n, 3), faces weighted by area; zero where a vertex has no face."""
    normals = face_normals(positions, faces)
    corners, n = faces.ravel(), len(positions)
    total = np.stack([np.bincount(corners, np.repeat(normals[:, k], 3), n) for k in range(3)], axis=1)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)


def halve_edges(positions: Array, faces: Array) -> tuple[Array, Array]:
    """Cut each triangle of a mesh into four at the middles of its edges; the shape of the mesh is unchanged. Return
    positions and triangles.
    """
    begin, end = faces.astype(np.int64), faces[:, [1, 2, 0]].astype(np.int64)
    n = len(positions)
    key, which = np.unique((np.minimum(begin, end) * n + np.maximum(begin, end)).ravel(), return_inverse=True)
    middle = n + which.reshape(-1, 3)
    a, b, c = begin.T
    ab, bc, ca = middle.T
    four = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    cut = np.concatenate([np.stack(corners, axis=1) for corners in four])
    return np.concatenate([positions, (positions[key // n] + positions[key % n]) / 2]), cut


def count_halvings(edge_m: float, wanted_m: float, triangles: int, most: int) -> int:
    """Count the halvings after which edges of ``edge_m`` are at most ``wanted_m``, within ``most`` triangles."""
    needed = int(np.ceil(np.log2(max(edge_m / wanted_m, 1.0)) - 1e-6))
    possible = int(np.log2(max(most / max(triangles, 1), 1.0)) / 2)
    return min(needed, possible)
