"""A pattern projector as an inverse pinhole camera with an even intensity. Imports no Blender."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError

#: Maximum number of pixels of a projector.
_MAX_PIXELS = 2**24


@dataclass(frozen=True)
class Projector:
    """A projector of ``columns`` x ``rows`` square pixels. ``width_deg`` is the full angle of its rows. ``power_w`` is
    its radiant power from 400 to 700 nm with all pixels on; its intensity is the same in all directions of its field.
    ``right_m``, ``ahead_m`` and ``up_m`` place it from the left camera, and ``azimuth_deg`` and ``elevation_deg`` turn
    it from straight ahead, clockwise and upward. Raises IcyMoonError for impossible values.
    """

    columns: int = 640
    rows: int = 480
    width_deg: float = 60.0
    power_w: float = 5.0
    right_m: float = 0.125
    ahead_m: float = 0.0
    up_m: float = 0.0
    azimuth_deg: float = 0.0
    elevation_deg: float = 0.0

    def __post_init__(self) -> None:
        if self.columns < 1 or self.rows < 1 or self.columns * self.rows > _MAX_PIXELS:
            raise IcyMoonError(
                f"The projector has {self.columns} x {self.rows} pixels; give 1 to {_MAX_PIXELS / 1e6:.0f} million."
            )
        if not 0.1 <= self.width_deg <= 150:
            raise IcyMoonError(f"The projector's field is {self.width_deg:g}° wide; give 0.1° to 150°.")
        if not 0 < self.power_w < 1e5:
            raise IcyMoonError(f"The projector's power is {self.power_w:g} W; give more than 0 and less than 100000.")
        if self.cone_deg > 179:
            raise IcyMoonError(
                f"The projector's field is {self.cone_deg:.0f}° from corner to corner; give fewer rows or a smaller "
                "width, for 179° at most."
            )

    @property
    def focal_px(self) -> float:
        """Focal length in pixels of the projector."""
        return self.columns / 2 / math.tan(math.radians(self.width_deg) / 2)

    @property
    def cone_deg(self) -> float:
        """Full angle in degrees of the cone around the projector's field."""
        return 2 * math.degrees(math.atan(math.hypot(self.columns, self.rows) / 2 / self.focal_px))

    @property
    def solid_angle_sr(self) -> float:
        """Solid angle of the projector's field in sr."""
        x, y = self.columns / 2 / self.focal_px, self.rows / 2 / self.focal_px
        return 4 * math.asin(x * y / math.sqrt((1 + x * x) * (1 + y * y)))

    @property
    def share_of_cone(self) -> float:
        """Solid angle of the projector's field over the solid angle of the cone around the field."""
        return self.solid_angle_sr / (2 * math.pi * (1 - math.cos(math.radians(self.cone_deg) / 2)))

    @property
    def cone_power_w(self) -> float:
        """Power in W of a lamp that has the projector's intensity in the whole cone around its field."""
        return self.power_w / self.share_of_cone

    def place(self, left_eye: Array) -> Array:
        """Compute the pose (4, 4) of the projector in the world, axes right, down and ahead, from the pose (4, 4) of
        the left eye.
        """
        turn, tilt = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        about_down = np.array([[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]])
        about_right = np.array([[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]])
        made = np.eye(4)
        made[:3, :3] = left_eye[:3, :3] @ about_down @ about_right
        made[:3, 3] = left_eye[:3, 3] + left_eye[:3, :3] @ np.array([self.right_m, -self.up_m, self.ahead_m])
        return made

    def locate(self, points: Array, pose: Array) -> Array:
        """Project points (n, 3) in the world to pixel coordinates (n, 2), column and row with corners at whole numbers.
        NaN outside the projector's field.
        """
        own = (points - pose[:3, 3]) @ pose[:3, :3]
        with np.errstate(divide="ignore", invalid="ignore"):
            found = own[:, :2] / own[:, 2:] * self.focal_px + np.array([self.columns, self.rows]) / 2
            lit = (own[:, 2] > 0) & ((found >= 0) & (found <= [self.columns, self.rows])).all(axis=1)
        return np.where(lit[:, None], found, np.nan)


def sample_pattern(pattern: Array, place: Array) -> Array:
    """Sample a pattern (rows, columns) at pixel coordinates (n, 2), linearly between the middles of pixels. Returns
    values (n,), 0 where the coordinates are NaN.
    """
    rows, columns = pattern.shape
    lit = np.isfinite(place[:, 0])
    found = np.zeros(len(place))
    x = np.clip(place[lit, 0] - 0.5, 0, columns - 1)
    y = np.clip(place[lit, 1] - 0.5, 0, rows - 1)
    left, top = np.minimum(x.astype(int), max(columns - 2, 0)), np.minimum(y.astype(int), max(rows - 2, 0))
    right, low = np.minimum(left + 1, columns - 1), np.minimum(top + 1, rows - 1)
    x, y = x - left, y - top
    upper = (1 - x) * pattern[top, left] + x * pattern[top, right]
    found[lit] = (1 - y) * upper + y * ((1 - x) * pattern[low, left] + x * pattern[low, right])
    return found
