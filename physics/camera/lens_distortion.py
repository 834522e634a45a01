"""Lens distortion: Brown and Conrady's model with OpenCV's coefficients k1, k2, p1, p2, k3.

Coordinates are normalised: tangents of the angle to the optical axis, x right, y down.
"""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.camera import RigSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3")  # in OpenCV's order


def coefficients(rig: RigSettings) -> tuple[float, ...]:
    """k1, k2, p1, p2, k3 of a ``rig`` topic."""
    return tuple(float(rig[f"distortion_{name}"]) for name in COEFFICIENTS)


def distort(points: Array, k: tuple[float, ...]) -> Array:
    """Where points (..., 2) of a pinhole image appear through the lens."""
    k1, k2, p1, p2, k3 = k
    x, y = points[..., 0], points[..., 1]
    r2 = x**2 + y**2
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y],
        axis=-1,
    )


def _jacobian(points: Array, k: tuple[float, ...]) -> Array:
    """Jacobian (..., 2, 2) of ``distort``."""
    k1, k2, p1, p2, k3 = k
    x, y = points[..., 0], points[..., 1]
    r2 = x**2 + y**2
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    growth = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))  # of the radial factor by r², times 2
    mixed = growth * x * y + 2 * p1 * x + 2 * p2 * y
    return np.stack(
        [
            np.stack([radial + growth * x**2 + 2 * p1 * y + 6 * p2 * x, mixed], axis=-1),
            np.stack([mixed, radial + growth * y**2 + 6 * p1 * y + 2 * p2 * x], axis=-1),
        ],
        axis=-2,
    )


def undistort(points: Array, k: tuple[float, ...]) -> Array:
    """Where points (..., 2) that are seen through the lens are in a pinhole image, to 1e-9; NaN where nowhere.

    Newton's method from the point itself. A point beyond the fold of a polynomial that turns back has
    no answer that a lens could give.
    """
    found = points.copy()
    if not any(k):
        return found
    with np.errstate(all="ignore"):
        for _ in range(25):
            slope = _jacobian(found, k)
            step = distort(found, k) - points
            if np.nan_to_num(np.abs(step)).max(initial=0.0) < 1e-13:
                break
            determinant = slope[..., 0, 0] * slope[..., 1, 1] - slope[..., 0, 1] * slope[..., 1, 0]
            found[..., 0] -= (slope[..., 1, 1] * step[..., 0] - slope[..., 0, 1] * step[..., 1]) / determinant
            found[..., 1] -= (slope[..., 0, 0] * step[..., 1] - slope[..., 1, 0] * step[..., 0]) / determinant
        slope = _jacobian(found, k)
        wrong = (np.abs(distort(found, k) - points).max(axis=-1) > 1e-9) | (np.linalg.det(np.nan_to_num(slope)) <= 0)
        # A root beyond a fold is not on the way from the axis: on its far side, or where the polynomial rises again.
        wrong |= (found * points).sum(axis=-1) < 0
        wrong |= (found**2).sum(axis=-1) > _beyond_fold(k)
    found[wrong | ~np.isfinite(found).all(axis=-1)] = np.nan
    return found


def _beyond_fold(k: tuple[float, ...]) -> float:
    """A squared radius between the fold of the radial polynomial and the next, where it falls; infinite without them.

    Where it falls no root counts anyway, so tangential terms may move the folds a little.
    """
    slope = np.roots([7 * k[4], 5 * k[1], 3 * k[0], 1.0])  # of r (1 + k1 r^2 + k2 r^4 + k3 r^6), by r^2
    folds = np.sort(slope.real[(np.abs(slope.imag) < 1e-12) & (slope.real > 0)])
    return float(folds[:2].mean()) if len(folds) > 1 else math.inf


def overscan_needed(rig: RigSettings) -> float | None:
    """Share of width and height that has to be rendered beyond each border for every pixel of the sensor to be lit.

    It is found at the borders' pixels, which see farthest. None if the lens sees rays that no pinhole image contains.
    """
    width, height = int(rig.width_px), int(rig.height_px)
    focal = float(rig.focal_length_mm) / float(rig.sensor_width_mm) * width
    columns, rows = np.arange(width) + 0.5, np.arange(height) + 0.5
    border = np.concatenate(
        [
            *([[column, edge] for column in columns] for edge in (rows[0], rows[-1])),
            *([[edge, row] for row in rows] for edge in (columns[0], columns[-1])),
        ]
    )
    size, shift = np.array([width, height]), np.array([float(rig.principal_x_px), float(rig.principal_y_px)])
    principal = size / 2 + shift
    seen = undistort((border - principal) / focal, coefficients(rig)) * focal + principal
    if not np.isfinite(seen).all():
        return None
    # Pixels are interpolated between rendered centres, so the outermost centres must enclose all points that are seen.
    beyond = np.maximum(0.5 - seen.min(axis=0), seen.max(axis=0) - (size - 0.5))
    return float(np.max(np.maximum(beyond - 1e-6, 0) / size))


def refuse_folds(points: Array, k: tuple[float, ...]) -> None:
    """Raise IcyMoonError if the lens would show two of the points (..., 2) of a pinhole image in one place."""
    slope = _jacobian(points, k)
    if (np.linalg.det(slope) <= 0).any():
        raise IcyMoonError(
            "rig.distortion_k1, k2, p1, p2 and k3 fold the image over itself within the field of view; "
            "lower them or narrow the field."
        )
