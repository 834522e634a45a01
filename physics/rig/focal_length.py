"""The focal length of the rig's cameras in pixels.

``rig`` is the ``rig`` topic of the settings.
"""

from __future__ import annotations

from ...settings.topics.camera import RigSettings


def focal_px(rig: RigSettings) -> float:
    """Focal length in pixels; the sensor width spans the image width, pixels are square."""
    return float(rig.focal_length_mm) / float(rig.sensor_width_mm) * int(rig.width_px)
