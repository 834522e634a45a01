"""The equidistant fisheye image from which the images of eyes are taken if no pinhole shows their field."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ...support.arrays import Array
from .calibrated_camera import CalibratedCamera
from .lens_models import Fisheye


@dataclass(frozen=True)
class Panorama:
    """A square image of ``size_px`` columns and rows about the axis of an eye of the parallel rig, in the eye's axes.

    A direction at the angle a off the axis is shown at the distance ``px_per_rad`` a from the middle of the image.
    Beyond the circle that touches its borders the image is black.
    """

    size_px: int
    px_per_rad: float

    @property
    def field_rad(self) -> float:
        """The angle that the image spans, in rad, at most 2 pi."""
        return self.size_px / self.px_per_rad

    @cached_property
    def _camera(self) -> CalibratedCamera:
        middle = (self.size_px - 1) / 2
        return CalibratedCamera(self.size_px, self.size_px, self.px_per_rad, self.px_per_rad, middle, middle, Fisheye())

    def show(self, directions: Array) -> Array:
        """Project directions (..., 3) of any length to columns and rows (..., 2), counted from the centre of the first
        pixel. NaN for NaN, and for the direction opposite to the axis, which lies all around the image.
        """
        return self._camera.show(directions)

    def to_json(self) -> dict[str, Any]:
        """Return the panorama's entry of ``pair.json``."""
        return {
            "projection": "equidistant fisheye",
            "size_px": self.size_px,
            "px_per_rad": self.px_per_rad,
            "field_deg": math.degrees(self.field_rad),
        }


def make_panorama(px_per_rad: float, widest_rad: float) -> Panorama:
    """Make the panorama of all directions up to an angle off the axis, with a border for the interpolation."""
    widest = min(math.pi, widest_rad)
    size = 2 * math.ceil(px_per_rad * widest + _BORDER_PX)
    # At most as many pixels as the whole sphere spans, since Cycles renders no wider field.
    return Panorama(min(size, 2 * math.floor(px_per_rad * math.pi)), px_per_rad)


#: Number of pixels beyond the outermost ray; splines reach two of them with more than 1 % of their weight.
_BORDER_PX = 3
