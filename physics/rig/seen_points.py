"""Points and mesh facets that can be in the frames of both eyes of the rig."""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.camera import RigSettings
from ...support.arrays import Array
from .focal_length import focal_px

#: Margin around the cameras' view, as a share of the image. It allows for tilted ground and for eyes that turn or move.
_VIEW_MARGIN = 0.05


def find_sides_passed(rig: RigSettings, right_m: Array, down_m: Array, depth_m: Array) -> Array:
    """Find beyond which of the five sides of the view volume each point is, bool (n, 5). Points are metres right of,
    below and in front of the left eye, in the axes of its camera. The view volume is convex; it contains the frames of
    both eyes and a margin.
    """
    scale = 1.0 / focal_px(rig)
    larger = (1.0 + 2.0 * (rig.overscan + _VIEW_MARGIN)) / 2.0
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
    """Return whether points (n,) are in a frame of the rig or near it. Points are metres east and north of the left eye
    and above it (usually negative)."""
    heading, pitch, roll = (math.radians(angle) for angle in (rig.heading_deg, rig.pitch_deg, rig.roll_deg))
    right = east_m * math.cos(heading) - north_m * math.sin(heading)
    ahead = east_m * math.sin(heading) + north_m * math.cos(heading)
    depth = ahead * math.cos(pitch) - above_m * math.sin(pitch)
    down = -ahead * math.sin(pitch) - above_m * math.cos(pitch)
    right, down = right * math.cos(roll) + down * math.sin(roll), down * math.cos(roll) - right * math.sin(roll)
    return ~find_sides_passed(rig, right, down, depth).any(axis=-1)


def find_seen_facets(passed: Array, starts: Array, corners: Array) -> Array:
    """Find the facets of a mesh that may be visible, bool (facets,): all except facets with all corners beyond one
    side. ``passed`` (vertices, 5) is ``find_sides_passed`` of the vertices. ``corners`` lists the vertices of all
    facets one after the other, and ``starts`` (facets,) is the index in ``corners`` at which each facet begins.
    """
    if not len(starts):
        return np.zeros(0, bool)
    return ~np.logical_and.reduceat(passed[corners], starts, axis=0).any(axis=-1)
