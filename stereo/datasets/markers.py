"""Finds numbers in foreign maps that mean "unknown": one value in many pixels, and disparities that no image can show.

Programs write 1e10 m where a ray meets nothing, 65535 in a PNG, 1e5 px, or -1 px for pixels without truth. Taken as
truth, a few such pixels would decide the mean error of a method.
"""

from __future__ import annotations

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ..measure.fit_check import MatchedPlaces, are_mostly_at_disparity, read_as_disparity

#: Least share of an image that a plateau covers, and the least factor by which it is nearer or farther than all other
#: points.
_MIN_PLATEAU_SHARE, _PLATEAU_DISTANCE_RATIO = 0.002, 1.5
#: Least distance of a plateau from all other values, in units of the smallest step between them. The levels of a coarse
#: map are one step apart.
_MIN_PLATEAU_STEPS = 2


def find_markers(values: Array, kind: str, camera: StereoCamera, places: MatchedPlaces) -> tuple[float, ...]:
    """Find the values that mean "unknown" in a map (H, W) of "depth" (m) or "disparity" (px), NaN where unknown.

    Such a value is the nearest or the farthest, is the same to the bit in many pixels, and is far beyond all others, or
    is the only negative disparity. A value that the images confirm is a real surface, such as a wall, and no marker.
    """
    return tuple(
        value
        for nearest in (False, True)
        if (value := _find_plateau(values, kind, camera, places, nearest)) is not None
    )


def _find_plateau(values: Array, kind: str, camera: StereoCamera, places: MatchedPlaces, nearest: bool) -> float | None:
    """Find the value of the plateau at one end of the range; None without a plateau."""
    disparity = read_as_disparity(values, kind, camera)
    known = disparity > -camera.doffs_px  # no surface is at the horizon or behind the camera
    if not known.any():
        return None
    end = float((np.max if nearest else np.min)(disparity[known]))
    plateau = known & (disparity == end)
    others = np.unique(disparity[known & ~plateau])
    if plateau.mean() < _MIN_PLATEAU_SHARE or not others.size:
        return None
    beside = float(others[-1 if nearest else 0])
    if others.size > 1 and abs(end - beside) <= _MIN_PLATEAU_STEPS * float(np.diff(others).min()):
        return None
    near, far = sorted((end + camera.doffs_px, beside + camera.doffs_px), reverse=True)
    if not (near >= _PLATEAU_DISTANCE_RATIO * far or (kind == "disparity" and end < 0 < beside)):
        return None
    return None if are_mostly_at_disparity(plateau, end, places) else float(values[plateau][0])


def is_possible(disparity: Array) -> Array:
    """Find the pixels (H, W), bool, whose disparity in px is smaller than the width of the map, or NaN.

    A larger disparity is impossible, because both images cannot show such a point.
    """
    return ~(np.abs(disparity) >= disparity.shape[1])
