"""Which disparities a stereo camera can meet: from its pose and from how high the ground may be.

On level ground planar depth is the same along a row of the image: Z = h / (sin p + v cos p), with the height h and the
pitch p of the camera and v the row's distance from the optical axis over the focal length. The nearest ground is in the
bottom row. Relief comes nearer, so a share of the height is taken off.
"""

from __future__ import annotations

import math

from ...settings.topics.camera import RigSettings
from ..rig.focal_length import focal_px

#: Share of the camera's height that relief of unknown height may reach. Over 8 sites and 4 headings of rough ice and
#: each of the six shipped rigs, no pose loses more than 1 % of its disparities; with 0.3, up to 25 % of them do.
UNKNOWN_RELIEF = 0.5
#: Depth of hollows that is expected, over the depth of level ground: the least disparity is divided by it.
_HOLLOW = 2.0


def level_ground_disparities_px(rig: RigSettings) -> tuple[float, float]:
    """Disparity of level ground in the top and in the bottom row of the image; 0 where a row is above the horizon."""
    focal, pitch, height = focal_px(rig), math.radians(rig.pitch_deg), float(rig.height_m)
    centre, rows = int(rig.height_px) / 2 + float(rig.principal_y_px), int(rig.height_px)
    top, bottom = (max(0.0, math.sin(pitch) + (row - centre) / focal * math.cos(pitch)) for row in (0, rows))
    scale = focal * float(rig.baseline_m) / height
    return scale * top, scale * bottom


def disparity_range_px(rig: RigSettings, relief: float = UNKNOWN_RELIEF) -> tuple[float, float] | None:
    """The least and greatest disparity to expect, px; None where level ground is not in the image.

    ``relief`` is the share of the camera's height that the ground may reach in the near part of the image.
    """
    top, bottom = level_ground_disparities_px(rig)
    return (top / _HOLLOW, bottom / (1 - relief)) if bottom > 0 else None
