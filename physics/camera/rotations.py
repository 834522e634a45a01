"""Rotations as matrices, quaternions and vectors."""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array


def quaternion(rotation: Array) -> Array:
    """Compute w, x, y, z of a rotation matrix (3, 3): the eigenvector of the largest eigenvalue.

    Source: Bar-Itzhack 2000, JGCD 23, 1085.
    """
    m = rotation
    k = (
        np.array(
            [
                [m[0, 0] - m[1, 1] - m[2, 2], 0, 0, 0],
                [m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], 0, 0],
                [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1], 0],
                [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], m.trace()],
            ]
        )
        / 3
    )
    _, vectors = np.linalg.eigh(k)
    x, y, z, w = vectors[:, -1]
    return np.array([w, x, y, z]) * (1 if w >= 0 else -1)


def from_quaternion(wxyz: Array) -> Array:
    """Make the rotation (3, 3) of w, x, y, z of any length but 0. Raises ValueError for length 0 and for numbers that
    are not finite.
    """
    length = float(np.linalg.norm(wxyz))
    if not (math.isfinite(length) and length > 0):
        raise ValueError("its quaternion has length 0")
    w, x, y, z = wxyz / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def from_vector(vector: Array) -> Array:
    """Make the rotation (3, 3) about a vector (3,) by the vector's length in rad."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    return from_quaternion(np.array([math.cos(angle / 2), *(vector / angle * math.sin(angle / 2))]))


def to_vector(rotation: Array) -> Array:
    """Compute the rotation vector (3,): along the axis, with the angle in rad as its length, at most half a turn."""
    w, *axis = quaternion(rotation)
    sine = float(np.linalg.norm(axis))
    return np.array(axis) * (2 * math.atan2(sine, w) / sine if sine > 0 else 2.0)


def rotation_error(matrix: Array) -> float:
    """Return the largest deviation from the unit matrix of a matrix (3, 3) times its transpose; infinite for a mirrored
    matrix or elements that are not finite.
    """
    if not (np.isfinite(matrix).all() and np.linalg.det(matrix) > 0):
        return math.inf
    return float(np.abs(matrix @ matrix.T - np.eye(3)).max())


def nearest_rotation(matrix: Array) -> Array:
    """Find the rotation (3, 3) that is nearest to a matrix, by its singular values."""
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right)
