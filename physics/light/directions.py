"""Directions in the local frame: x east, y north, z up, azimuth and heading clockwise from north."""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array

#: Sine of the angle to the vertical below which a heading cannot be told from a roll in double precision.
_STRAIGHT = 1e-12


def direction_toward(azimuth_deg: float, elevation_deg: float) -> Array:
    """Unit vector (3,) toward a point of the sky."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    return np.array(
        [math.sin(azimuth) * math.cos(elevation), math.cos(azimuth) * math.cos(elevation), math.sin(elevation)]
    )


def camera_axes(heading_deg: float, pitch_down_deg: float, roll_deg: float = 0.0) -> Array:
    """Columns x right, y down, z forward (3, 3) of a camera, world axes (OpenCV convention).

    A camera of no roll has its x level; a positive one turns it clockwise, as seen from behind.
    """
    forward = direction_toward(heading_deg, -pitch_down_deg)
    heading = math.radians(heading_deg)
    right = np.array([math.cos(heading), -math.sin(heading), 0.0])
    axes = np.stack([right, np.cross(forward, right), forward], axis=1)
    if not roll_deg:
        return axes
    turn, roll = np.eye(3), math.radians(roll_deg)
    turn[:2, :2] = [[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]]
    return np.asarray(axes @ turn)


def camera_angles(axes: Array) -> tuple[float, float, float]:
    """Heading, pitch down and roll in degrees for which ``camera_axes`` are these axes (3, 3).

    A camera that looks straight up or down is given no roll: its heading has all of the turn.
    """
    right, forward = axes[:, 0], axes[:, 2]
    level = math.hypot(forward[0], forward[1])
    pitch = math.atan2(-forward[2], level)
    if level < _STRAIGHT:
        return math.degrees(math.atan2(-right[1], right[0])), math.degrees(pitch), 0.0
    heading = math.atan2(forward[0], forward[1])
    unrolled = camera_axes(math.degrees(heading), math.degrees(pitch))
    roll = math.atan2(float(right @ unrolled[:, 1]), float(right @ unrolled[:, 0]))
    return math.degrees(heading), math.degrees(pitch), math.degrees(roll)
