"""Effects of the body's curvature at a site: distance to the horizon, and drop of the ground."""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array, Numbers


def horizon_m(eye_height_m: float, body_radius_m: float) -> float:
    """Compute the distance in metres, along the tangent plane at the foot of the eye, at which the visible ground of a
    sphere ends.

    It is exact: the horizon is at the angle arccos(R / (R + h)), and the distance is R times the sine of this angle.
    """
    h = max(eye_height_m, 0.0)
    return body_radius_m * math.sqrt(h * (2.0 * body_radius_m + h)) / (body_radius_m + h)


def dip_deg(eye_height_m: float, body_radius_m: float) -> float:
    """Compute the angle in degrees of a sphere's horizon under the horizontal at the eye: arccos(R / (R + h))."""
    return math.degrees(
        math.atan2(
            horizon_m(eye_height_m, body_radius_m),
            body_radius_m * body_radius_m / (body_radius_m + max(eye_height_m, 0.0)),
        )
    )


def drop_m(distance_m: Numbers, body_radius_m: float) -> Array:
    """Compute the depth in metres of a sphere's ground below its tangent plane, at distances along the plane.

    It is R - sqrt(R² - r²), written without the difference of nearly equal numbers. Beyond R it stays at R.
    """
    r = np.minimum(np.asarray(distance_m, np.float64), body_radius_m)
    return r**2 / (body_radius_m + np.sqrt(body_radius_m**2 - r**2))
