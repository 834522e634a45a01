"""Margins of the lander's arm joints to their limits, with the scoop on each cell."""

from __future__ import annotations

import numpy as np

from ...physics.arm.parametric_arm import find_joint_margin, make_parametric_arm
from ...settings.topics.scene import Settings
from ...support.arrays import Array

#: Margin of each joint without a stated arm: more than any rule requires.
_UNLIMITED_MARGIN_DEG = 180.0


def has_arm(settings: Settings) -> bool:
    """Return whether the settings have an arm of known reach: a shipped arm, not an arm from the user's file."""
    return settings.lander.kind == "PARAMETRIC"


def find_joint_margins_deg(settings: Settings, site_m: float, east_m: Array, north_m: Array, height_m: Array) -> Array:
    """Find the smallest distance, degrees, of a joint to its limit in each cell (rows, columns).

    NaN out of reach and for an unknown height. ``site_m`` is the height of the ground under the left camera, on which
    the lander stands.
    """
    known = np.isfinite(height_m)
    found = np.full(height_m.shape, np.nan)
    found[known] = (
        np.degrees(
            find_joint_margin(make_parametric_arm(settings, site_m), east_m[known], north_m[known], height_m[known])
        )
        if has_arm(settings)
        else _UNLIMITED_MARGIN_DEG
    )
    return found
