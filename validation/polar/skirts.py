"""The skirt of a scan: the sand around its rock that was scanned with it.

A skirt is found by slope and height. Dry sand is never steeper than its angle of repose, and the sides of rocks are
steeper. So triangles are sand if slopes below this angle connect them with the open edge of the scan. Tops of rocks
beside holes in a scan are excluded, because they are too high above the plane of its edge.
"""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array

#: Angle of repose of dry sand in degrees; common sands have this angle to within a few degrees.
REPOSE_DEG = 35.0
#: Largest distance in metres of sand from a plane: of a skirt above the plane of its edge, and of all sand from the
#: plane of the sandbox. It is three times 1.4 cm, the standard deviation of the rims of terrain 04 from their plane.
BOUND_M = 0.04
#: Number of times that normals are averaged over the triangles at a corner. As edges are 4 mm long, two times average
#: over about a centimetre.
_AVERAGING_PASSES = 2


def find_open_corners(faces: Array) -> Array:
    """Return the indices of the vertices on the open edges of triangles (m, 3); none if they are closed."""
    edges = np.sort(np.concatenate([faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    return np.unique(unique[count == 1])


def fit_rim_plane(rim: Array, middle: Array) -> Array:
    """Fit a plane (3,), its height at a ``middle`` (2,) and its slopes, to a rim (n, 3). Most of the rim is on the
    plane, and little is below it."""
    basis = np.column_stack([np.ones(len(rim)), rim[:, :2] - middle])
    heights = rim[:, 2]
    weight = (heights <= np.quantile(heights, 0.6)).astype(np.float64)
    plane = np.zeros(3)
    for _ in range(30):
        plane = np.linalg.solve(
            (basis.T * weight) @ basis + 1e-5 * len(rim) * np.diag([0.0, 1.0, 1.0]), (basis.T * weight) @ heights
        )
        above = np.maximum(heights - basis @ plane, 0.0)
        weight = 1 / (1 + (above / 0.004) ** 2) ** 2
    return plane


def find_skirt(vertices: Array, faces: Array) -> Array:
    """Find which of the triangles ``faces`` (m, 3) of a scan with ``vertices`` (n, 3), m, are sand. Returns a mask
    (m,)."""
    edge = find_open_corners(faces)
    if not len(edge):
        return np.zeros(len(faces), bool)
    middles = vertices[faces].mean(axis=1)
    plane = fit_rim_plane(vertices[edge], middles[:, :2].mean(axis=0))
    above = middles[:, 2] - plane[0] - (middles[:, :2] - middles[:, :2].mean(axis=0)) @ plane[1:]
    flat = (_measure_steepness(vertices, faces) < math.radians(REPOSE_DEG)) & (above < BOUND_M)
    reached = np.zeros(len(vertices), bool)
    reached[edge] = True
    skirt = np.zeros(len(faces), bool)
    while (found := flat & reached[faces].any(axis=1)).sum() > skirt.sum():
        skirt = found
        reached[faces[skirt]] = True
    return skirt


def _measure_steepness(vertices: Array, faces: Array) -> Array:
    """Compute the angles (m,) in radians between triangles and the horizontal plane, by averaged normals; more than a
    right angle for triangles that face down."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals *= 1.0 if normals[:, 2].sum() > 0 else -1.0
    for _ in range(_AVERAGING_PASSES):
        at_corners = np.zeros_like(vertices)
        for k in range(3):
            np.add.at(at_corners, faces[:, k], normals)
        normals = at_corners[faces].sum(axis=1)
    return np.asarray(np.arctan2(np.hypot(normals[:, 0], normals[:, 1]), normals[:, 2]))
