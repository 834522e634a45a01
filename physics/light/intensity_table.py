"""The intensity of a luminaire by direction, from a table of measurements. Imports no Blender.

Angles follow type C photometry: the vertical angle begins at the direction in which the luminaire shines, and the
horizontal angle turns counterclockwise about it, as seen from the luminaire's back. Between the angles of a table the
intensity is linear in both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array, Numbers


@dataclass(frozen=True)
class IntensityTable:
    """Intensities (m, n) in any unit at horizontal angles (m,) from 0 to 360 degrees and vertical angles (n,) from 0 to
    180 degrees. Both increase. A table with one horizontal angle is the same all around.
    """

    vertical_deg: Array
    horizontal_deg: Array
    values: Array

    @property
    def flux(self) -> float:
        """Exact integral of the interpolated intensity over all directions, in the unit of the values times sr."""
        theta = np.radians(self.vertical_deg)
        rise = np.diff(self.values, axis=1) / np.diff(theta)
        falls = -self.values * np.cos(theta)
        by_plane = (np.diff(falls, axis=1) + rise * np.diff(np.sin(theta))).sum(axis=1)
        if len(self.horizontal_deg) == 1:
            return float(2 * np.pi * by_plane[0])
        return float((np.diff(np.radians(self.horizontal_deg)) * (by_plane[1:] + by_plane[:-1]) / 2).sum())

    def find_intensity(self, vertical_deg: Numbers, horizontal_deg: Numbers) -> Array:
        """Interpolate the intensity linearly at angles that broadcast."""
        vertical, horizontal = np.broadcast_arrays(
            np.asarray(vertical_deg, np.float64), np.asarray(horizontal_deg, np.float64)
        )
        column, along = _locate_angles(self.vertical_deg, np.clip(vertical, 0.0, 180.0))
        at = (1 - along) * self.values[:, column] + along * self.values[:, column + 1]
        if len(self.horizontal_deg) == 1:
            return np.asarray(at[0])
        row, across = _locate_angles(self.horizontal_deg, horizontal % 360.0)
        first, second = (np.take_along_axis(at, each[None], axis=0)[0] for each in (row, row + 1))
        return np.asarray((1 - across) * first + across * second)

    def find_share(self, direction: Array) -> Array:
        """Compute the intensity over flux, 1/sr, toward directions (..., 3) along the luminaire's axes right, up and
        back.
        """
        unit = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
        vertical = np.degrees(np.arccos(np.clip(-unit[..., 2], -1.0, 1.0)))
        return self.find_intensity(vertical, np.degrees(np.arctan2(unit[..., 1], unit[..., 0]))) / self.flux


def _locate_angles(angles: Array, at: Array) -> tuple[Array, Array]:
    """Find the interval of increasing ``angles`` that contains each angle, and the share of the interval before the
    angle.
    """
    index = np.clip(np.searchsorted(angles, at, side="right") - 1, 0, len(angles) - 2)
    return index, (at - angles[index]) / (angles[index + 1] - angles[index])
