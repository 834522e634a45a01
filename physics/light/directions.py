"""Directions in the local frame: x east, y north, z up, azimuth and heading clockwise from north."""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array

#: Sine of the angle to the vertical below which double precision cannot separate heading and roll.
_MIN_SINE = 1e-12


def direction_toward(azimuth_deg: float, elevation_deg: float) -> Array:
    """Compute the unit vector (3,) toward a point of the sky, from azimuth and elevation."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    return np.array(
        [math.sin(azimuth) * math.cos(elevation), math.cos(azimuth) * math.cos(elevation), math.sin(elevation)]
    )


def camera_axes(heading_deg: float, pitch_down_deg: float, roll_deg: float = 0.0) -> Array:
    """Compute the axes x right, y down, z forward of a camera as columns (3, 3), in world axes (OpenCV convention).
    Without roll x is level; a positive roll turns the camera clockwise, as seen from behind.
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
    """Compute the heading, pitch down and roll in degrees for which ``camera_axes`` returns ``axes`` (3, 3). For a
    camera that looks straight up or down the roll is 0 and the heading has the whole turn.
    """
    right, forward = axes[:, 0], axes[:, 2]
    level = math.hypot(forward[0], forward[1])
    pitch = math.atan2(-forward[2], level)
    if level < _MIN_SINE:
        return math.degrees(math.atan2(-right[1], right[0])), math.degrees(pitch), 0.0
    heading = math.atan2(forward[0], forward[1])
    unrolled = camera_axes(math.degrees(heading), math.degrees(pitch))
    roll = math.atan2(float(right @ unrolled[:, 1]), float(right @ unrolled[:, 0]))
    return math.degrees(heading), math.degrees(pitch), math.degrees(roll)
