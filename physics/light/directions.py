"""Directions in the local frame: x east, y north, z up, azimuth and heading clockwise from north."""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array


def direction_toward(azimuth_deg: float, elevation_deg: float) -> Array:
    """Unit vector (3,) toward a point of the sky."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    return np.array(
        [math.sin(azimuth) * math.cos(elevation), math.cos(azimuth) * math.cos(elevation), math.sin(elevation)]
    )


def camera_axes(heading_deg: float, pitch_down_deg: float) -> Array:
    """Columns x right, y down, z forward (3, 3) of a level camera, world axes (OpenCV convention)."""
    forward = direction_toward(heading_deg, -pitch_down_deg)
    heading = math.radians(heading_deg)
    right = np.array([math.cos(heading), -math.sin(heading), 0.0])
    return np.stack([right, np.cross(forward, right), forward], axis=1)
