"""What both eyes of the rig can have in their frames: points, and facets of a mesh."""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.camera import RigSettings
from ...support.arrays import Array
from .focal_length import focal_px

#: Margin around the view of the cameras as a share of the image, for tilted ground and for eyes that turn or move.
_MARGIN = 0.05


def find_sides_passed(rig: RigSettings, right_m: Array, down_m: Array, depth_m: Array) -> Array:
    """Which of the five sides of the space that the eyes see points (n,) are beyond, bool (n, 5).

    Points are metres right of, below and before the left eye, in axes of its camera. The space is a convex one that
    has what either eye has in its frame, and a margin around it.
    """
    scale = 1.0 / focal_px(rig)
    larger = (1.0 + 2.0 * (rig.overscan + _MARGIN)) / 2.0
    wide = scale * (larger * rig.width_px + abs(rig.principal_x_px)) + math.tan(math.radians(abs(rig.toe_in_deg)))
    high = scale * (larger * rig.height_px + abs(rig.principal_y_px))
    return np.stack(
        [
            depth_m <= 0.0,
            down_m >= high * depth_m,
            -down_m >= high * depth_m,
            right_m <= -wide * depth_m,
            right_m >= wide * depth_m + rig.baseline_m,
        ],
        axis=-1,
    )


def is_in_view(rig: RigSettings, east_m: Array, north_m: Array, above_m: Array) -> Array:
    """Whether either eye of the rig has points in its frame or near it.

    The points (n,) are metres east and north of the left eye and above it (most often negative).
    """
    heading, pitch, roll = (math.radians(angle) for angle in (rig.heading_deg, rig.pitch_deg, rig.roll_deg))
    right = east_m * math.cos(heading) - north_m * math.sin(heading)
    ahead = east_m * math.sin(heading) + north_m * math.cos(heading)
    depth = ahead * math.cos(pitch) - above_m * math.sin(pitch)
    down = -ahead * math.sin(pitch) - above_m * math.cos(pitch)
    right, down = right * math.cos(roll) + down * math.sin(roll), down * math.cos(roll) - right * math.sin(roll)
    return ~find_sides_passed(rig, right, down, depth).any(axis=-1)


def find_seen_facets(passed: Array, starts: Array, corners: Array) -> Array:
    """Which facets of a mesh may be seen, bool (facets,): all but those that are beyond one side with all corners.

    ``passed`` (vertices, 5) is ``find_sides_passed`` of the vertices, ``corners`` are the vertices of the facets'
    corners one facet after the other, ``starts`` (facets,) where each facet begins in them.
    """
    if not len(starts):
        return np.zeros(0, bool)
    return ~np.logical_and.reduceat(passed[corners], starts, axis=0).any(axis=-1)
