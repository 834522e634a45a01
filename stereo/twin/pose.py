"""The pose of a camera over the plane that fits a map of depths: its height and its tilt."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.errors import IcyMoonError

#: Most points of a fit, rounds of the fit, and the share of the points nearest to the plane that count in the next
#: round.
_MAX_POINTS, _FIT_ROUNDS, _KEPT_SHARE = 20_000, 8, 0.8
#: Pitch above which a roll is a turn about the vertical, which a plane does not show.
_STRAIGHT_DOWN_DEG = 89.0
#: Fewest points for a plane.
_FEWEST_POINTS = 100


@dataclass(frozen=True)
class Pose:
    """Height above the plane, pitch down, roll clockwise (0 for a camera that looks straight down), and the RMS
    distance of the points from the plane.
    """

    height_m: float
    pitch_deg: float
    roll_deg: float
    relief_m: float


def fit_pose(disparity: Array, camera: StereoCamera) -> Pose:
    """Fit the pose over the plane through most points of a disparity map (H, W), px, NaN where unknown; the plane is
    assumed level.

    Raises IcyMoonError if there are too few points.
    """
    depth = camera.depth(disparity)
    row, column = np.nonzero(np.isfinite(depth))
    if len(row) < _FEWEST_POINTS:
        raise IcyMoonError(
            f"The true depth has {len(row)} points, and a plane needs {_FEWEST_POINTS}; give a denser map."
        )
    step = max(1, len(row) // _MAX_POINTS)
    row, column = row[::step], column[::step]
    z = depth[row, column]
    points = np.stack(
        [(column + 0.5 - camera.cx_px) / camera.focal_px * z, (row + 0.5 - camera.cy_px) / camera.focal_px * z, z],
        axis=1,
    )
    kept = points
    for _ in range(_FIT_ROUNDS):
        middle = kept.mean(axis=0)
        normal = np.linalg.svd(kept - middle, full_matrices=False)[2][2]
        off = np.abs((points - middle) @ normal)
        kept = points[off <= np.quantile(off, _KEPT_SHARE)]
    normal = normal * (math.copysign(1.0, float(normal @ middle)))  # away from the camera, which is down
    off = (points - middle) @ normal
    pitch_deg = math.degrees(math.asin(float(np.clip(normal[2], -1, 1))))
    roll_deg = math.degrees(math.atan2(float(normal[0]), float(normal[1])))
    return Pose(
        float(normal @ middle),
        pitch_deg,
        roll_deg if pitch_deg < _STRAIGHT_DOWN_DEG else 0.0,
        float(np.sqrt(np.mean(off**2))),
    )
