"""Lens distortion: Brown and Conrady's model with OpenCV's coefficients k1, k2, p1, p2, k3, and optional further ones.

k4, k5, k6 are the coefficients of a second polynomial that divides the radial one, and s1 to s4 describe a thin prism.
Coordinates are normalised: tangents of the angle to the optical axis, x right, y down.
"""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.camera import RigSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from .invert_growing import find_positive_roots, find_smallest_positive_root, invert

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3")  # in OpenCV's order
#: Maximum number of steps of Newton's method.
_MAX_NEWTON_STEPS = 25


def read_coefficients(rig: RigSettings) -> tuple[float, ...]:
    """Read k1, k2, p1, p2, k3 of a ``rig`` topic; zeros if its eyes are calibrated."""
    if rig.get("eyes") == "CALIBRATED":
        return (0.0,) * len(COEFFICIENTS)
    return tuple(float(rig[f"distortion_{name}"]) for name in COEFFICIENTS)


def distort_points(points: Array, k: tuple[float, ...]) -> Array:
    """Find where points (..., 2) of a pinhole image appear through the lens with 5, 8 or 12 coefficients ``k``."""
    p1, p2 = k[2:4]
    x, y = points[..., 0], points[..., 1]
    r2 = x**2 + y**2
    radial, _ = _compute_radial_factor(r2, k)
    found = np.stack(
        [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y],
        axis=-1,
    )
    if len(k) > 8:
        s1, s2, s3, s4 = k[8:]
        found += np.stack([r2 * (s1 + r2 * s2), r2 * (s3 + r2 * s4)], axis=-1)
    return found


def _compute_radial_factor(r2: Array, k: tuple[float, ...]) -> tuple[Array, Array]:
    """Return the radial factor at squared radii ``r2``, and twice its derivative with respect to ``r2``."""
    k1, k2, _, _, k3 = k[:5]
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    growth = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    if len(k) > 5:
        k4, k5, k6 = k[5:8]
        below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        radial = radial / below
        growth = (growth - radial * 2 * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) / below
    return radial, growth


def _jacobian(points: Array, k: tuple[float, ...]) -> Array:
    """Compute the Jacobian (..., 2, 2) of ``distort_points``."""
    p1, p2 = k[2:4]
    x, y = points[..., 0], points[..., 1]
    r2 = x**2 + y**2
    radial, growth = _compute_radial_factor(r2, k)
    mixed = growth * x * y + 2 * p1 * x + 2 * p2 * y
    found = np.stack(
        [
            np.stack([radial + growth * x**2 + 2 * p1 * y + 6 * p2 * x, mixed], axis=-1),
            np.stack([mixed, radial + growth * y**2 + 6 * p1 * y + 2 * p2 * x], axis=-1),
        ],
        axis=-2,
    )
    if len(k) > 8:
        s1, s2, s3, s4 = k[8:]
        along = np.stack([s1 + 2 * s2 * r2, s3 + 2 * s4 * r2], axis=-1)
        found += 2 * along[..., :, None] * points[..., None, :]
    return found


def is_seen(points: Array, k: tuple[float, ...]) -> Array:
    """Return whether a lens shows points (..., 2) of a pinhole image; it shows none beyond a fold or a pole of its
    polynomials.
    """
    with np.errstate(all="ignore"):
        unfolded = np.linalg.det(np.nan_to_num(_jacobian(points, k))) > 0
        return np.asarray(unfolded & ((points**2).sum(axis=-1) <= _find_fold_radius(k)))


def undistort_points(points: Array, k: tuple[float, ...]) -> Array:
    """Find the positions in a pinhole image of points (..., 2) seen through the lens, to 1e-9; NaN for points outside
    its field.

    Newton's method starts at the point itself, and then at the solution of the radial polynomial alone. A point beyond
    the fold of the polynomial has no solution on a real lens.
    """
    if not any(k):
        return points.copy()
    found = _search_by_newton(points, points, k)
    lost = ~np.isfinite(found).all(axis=-1)
    if lost.any():
        found[lost] = _search_by_newton(points[lost], _radial_guess(points[lost], k), k)
    return found


def _search_by_newton(points: Array, start: Array, k: tuple[float, ...]) -> Array:
    """Run Newton's method for ``undistort_points`` from ``start``; NaN where it ends outside the field of the lens."""
    found = start.copy()
    with np.errstate(all="ignore"):
        for _ in range(_MAX_NEWTON_STEPS):
            slope = _jacobian(found, k)
            step = distort_points(found, k) - points
            if np.nan_to_num(np.abs(step)).max(initial=0.0) < 1e-13:
                break
            determinant = slope[..., 0, 0] * slope[..., 1, 1] - slope[..., 0, 1] * slope[..., 1, 0]
            found[..., 0] -= (slope[..., 1, 1] * step[..., 0] - slope[..., 0, 1] * step[..., 1]) / determinant
            found[..., 1] -= (slope[..., 0, 0] * step[..., 1] - slope[..., 1, 0] * step[..., 0]) / determinant
        wrong = (np.abs(distort_points(found, k) - points).max(axis=-1) > 1e-9) | ~is_seen(found, k)
        # Roots beyond a fold do not count: they are on its far side, or where the polynomial rises again.
        wrong |= (found * points).sum(axis=-1) < 0
    found[wrong | ~np.isfinite(found).all(axis=-1)] = np.nan
    return found


def _radial_guess(points: Array, k: tuple[float, ...]) -> Array:
    """Compute the pinhole positions of points (n, 2) as if the lens had only its radial coefficients."""
    seen = np.hypot(*points.T)
    with np.errstate(all="ignore"):
        angle = invert(
            lambda a: np.tan(a) * _compute_radial_factor(np.tan(a) ** 2, k)[0],
            seen,
            math.atan(math.sqrt(_find_first_fold(k))),
        )
    return points * np.divide(np.tan(angle), seen, out=np.ones_like(seen), where=seen > 0)[:, None]


def _find_folds(k: tuple[float, ...]) -> tuple[Array, float]:
    """Find the squared radii, in order, at which the radial polynomial has an extremum, up to its first pole, and that
    pole.
    """
    above = np.poly1d([k[4], k[1], k[0], 1.0])  # by r^2
    below = np.poly1d([*k[7:4:-1], 1.0])
    r2 = np.poly1d([1.0, 0.0])
    slope = above * below + 2 * r2 * (above.deriv() * below - above * below.deriv())
    pole = find_smallest_positive_root(below.coeffs)
    folds = find_positive_roots(slope.coeffs)
    return folds[folds < pole], pole


def _find_first_fold(k: tuple[float, ...]) -> float:
    """Return the squared radius of the first fold or pole of the radial polynomial; infinite without them."""
    folds, pole = _find_folds(k)
    return float(folds[0]) if len(folds) else pole


def _find_fold_radius(k: tuple[float, ...]) -> float:
    """Find a squared radius beyond the fold of the radial polynomial: between the fold and the next extremum, else the
    pole; infinite without either. Between the extrema the polynomial falls, so no root counts there, and tangential
    terms may shift the fold a little.
    """
    folds, pole = _find_folds(k)
    return float(folds[:2].mean()) if len(folds) > 1 else pole


def find_overscan(rig: RigSettings) -> float | None:
    """Find the share of width and height to render beyond each border, so that every pixel of the sensor is lit; None
    if the lens sees rays that no pinhole image contains.

    Only the border pixels are tested, because they see farthest.
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
    seen = undistort_points((border - principal) / focal, read_coefficients(rig)) * focal + principal
    if not np.isfinite(seen).all():
        return None
    # Pixels are interpolated between rendered centres, so the outermost centres must enclose all visible points.
    beyond = np.maximum(0.5 - seen.min(axis=0), seen.max(axis=0) - (size - 0.5))
    return float(np.max(np.maximum(beyond - 1e-6, 0) / size))


def refuse_folds(points: Array, k: tuple[float, ...]) -> None:
    """Raise IcyMoonError if the lens would image two of the points (..., 2) of a pinhole image at one place."""
    slope = _jacobian(points, k)
    if (np.linalg.det(slope) <= 0).any():
        raise IcyMoonError(
            "rig.distortion_k1, k2, p1, p2 and k3 fold the image over itself within the field of view; "
            "lower them or narrow the field."
        )
