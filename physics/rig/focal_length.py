"""The focal length of the rig's cameras in pixels.

``rig`` is the ``rig`` topic of the settings.
"""

from __future__ import annotations

from ...settings.topics.camera import RigSettings


def focal_px(rig: RigSettings) -> float:
    """Compute the focal length in pixels. The sensor width spans the image width, and pixels are square."""
    return float(rig.focal_length_mm) / float(rig.sensor_width_mm) * int(rig.width_px)
