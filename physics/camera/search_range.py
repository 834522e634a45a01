"""The disparities that a stereo camera can meet, from its pose and the possible height of the ground.

On level ground planar depth is constant along an image row: Z = h / (sin p + v cos p), with the camera's height h and
pitch p, and v the row's distance from the optical axis over the focal length. The nearest ground is in the bottom row.
Relief comes nearer, so a share of the height is subtracted.
"""

from __future__ import annotations

import math

from ...settings.topics.camera import RigSettings
from ..rig.focal_length import focal_px

#: Share of the camera's height that relief of unknown height may reach. Over 8 sites and 4 headings of rough ice and
#: each of the six shipped rigs, no pose loses more than 1 % of its disparities; with 0.3, up to 25 % of them do.
UNKNOWN_RELIEF = 0.5
#: Expected depth of hollows over the depth of level ground; it divides the least disparity.
_HOLLOW_DEPTH_RATIO = 2.0


def level_ground_disparities_px(rig: RigSettings) -> tuple[float, float]:
    """Compute the disparity in px of level ground in the top and the bottom row of the image; 0 for a row above the
    horizon.
    """
    focal, pitch, height = focal_px(rig), math.radians(rig.pitch_deg), float(rig.height_m)
    centre, rows = int(rig.height_px) / 2 + float(rig.principal_y_px), int(rig.height_px)
    top, bottom = (max(0.0, math.sin(pitch) + (row - centre) / focal * math.cos(pitch)) for row in (0, rows))
    scale = focal * float(rig.baseline_m) / height
    return scale * top, scale * bottom


def disparity_range_px(rig: RigSettings, relief: float = UNKNOWN_RELIEF) -> tuple[float, float] | None:
    """Find the least and the greatest disparity to expect, px; None if level ground is outside the image. ``relief`` is
    the largest height of the near ground as a share of the camera's height.
    """
    top, bottom = level_ground_disparities_px(rig)
    return (top / _HOLLOW_DEPTH_RATIO, bottom / (1 - relief)) if bottom > 0 else None
