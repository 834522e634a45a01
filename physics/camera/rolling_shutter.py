"""The rolling shutter of a stereo pair: rows of both eyes are exposed one after the other, from the top down.

Row r of n, counted from 0, has the middle of its exposure T (r / (n - 1) - 1/2) after the middle of the readout, where
T is the readout time. Meanwhile the rig moves with constant velocity and rotation. Both eyes of the parallel rig see a
point in the same row, so at the same time. Its disparity is f B / Z, with Z along the axis of the pose of that row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...settings.topics.camera import RigSettings
from ...support.arrays import Array
from .blur import find_pose_after, has_rolling_shutter, read_motion
from .stereo_camera import StereoCamera

#: Maximum number of steps in the search for the row that shows a point, and the change in rows at which it ends.
_MAX_STEPS, _MIN_STEP_ROWS = 64, 1e-9
#: The formula for users of ``pair.json`` and of exports.
POSE_OF_ROW = (
    "pose of row r = stated pose of the left eye * [Exp(turn t), velocity t], t = readout (r / (rows - 1) - 1/2), "
    "r = 0 on top; the right eye stands the baseline along x of that pose"
)


@dataclass(frozen=True)
class RollingShutter:
    """The readout of ``rows`` rows, in seconds from the first to the last, and the motion of the left eye, in its axes
    at the middle of the readout: x right, y down, z forward.
    """

    readout_s: float
    rows: int
    velocity_m_s: Array  # (3,)
    turn_deg_s: Array  # (3,)

    @property
    def row_s(self) -> float:
        """Seconds from a row to the next row."""
        return self.readout_s / max(1, self.rows - 1)

    def find_time_s(self, row: Array) -> Array:
        """Find the seconds from the middle of the readout to the middle of each row's exposure. Rows may be fractional,
        and may lie outside the image.
        """
        return self.row_s * (np.asarray(row, np.float64) - (self.rows - 1) / 2)

    def find_row_poses(self, row: Array, along_m: float = 0.0) -> Array:
        """Find the poses (n, 4, 4) of an eye at the readout times of rows (n,), in its axes at the middle of the
        readout. The eye is ``along_m`` to the right of the left eye.
        """
        moves = np.stack([find_pose_after(self, float(time)) for time in self.find_time_s(row)])
        moves[:, :3, 3] += along_m * (moves[:, :3, 0] - (1.0, 0.0, 0.0))
        return moves

    def list_poses(self, pose: Array, along_m: float = 0.0, margin: int = 0) -> Array:
        """Compute the poses (rows + 2 margins, 4, 4) in the world, row by row, of an eye ``along_m`` to the right of
        the left eye. ``pose`` (4, 4) is the eye's pose in the middle, and ``margin`` the number of rows above and below
        the image.
        """
        return np.asarray(pose @ self.find_row_poses(np.arange(-margin, self.rows + margin), along_m))

    def to_json(self) -> dict[str, Any]:
        """Return the table ``rolling_shutter`` of exports."""
        return {
            "readout_s": self.readout_s,
            "rows": self.rows,
            "velocity_m_s": self.velocity_m_s.tolist(),
            "turn_deg_s": self.turn_deg_s.tolist(),
            "formula": POSE_OF_ROW,
        }


def find_rolling_shutter(rig: RigSettings) -> RollingShutter | None:
    """Find the rolling shutter of the parallel pair; None for a global shutter or a rig that stands still."""
    if not has_rolling_shutter(rig):
        return None
    return RollingShutter(float(rig.readout_s), int(rig.height_px), *read_motion(rig))


def turn_to_world(own: Array, pose: Array, row: Array) -> Array:
    """Rotate vectors (n, 3) from the axes of an eye to the world. ``pose`` is the pose (4, 4) of the eye, or the poses
    (rows, 4, 4) of its rows. For poses of rows, ``row`` (n,) states the row of each vector.
    """
    return np.asarray(own @ pose[:3, :3].T if pose.ndim == 2 else np.einsum("nij,nj->ni", pose[row, :3, :3], own))


def place_in_world(own: Array, pose: Array, row: Array) -> Array:
    """Move points (n, 3) from the axes of an eye to the world; see ``turn_to_world``."""
    return turn_to_world(own, pose, row) + (pose[:3, 3] if pose.ndim == 2 else pose[row, :3, 3])


def move_to_middle(points: Array, shutter: RollingShutter | None) -> Array:
    """Move points (H, W, 3) from the axes of the left eye at their rows to its axes at the middle of the readout."""
    if shutter is None:
        return points
    moves = shutter.find_row_poses(np.arange(points.shape[0]))
    return np.asarray(np.einsum("rij,rcj->rci", moves[:, :3, :3], points) + moves[:, None, :3, 3])


def project_points(points: Array, camera: StereoCamera, shutter: RollingShutter | None) -> tuple[Array, Array]:
    """Project points (n, 3), in the axes of the left eye at the middle of the readout. Return their pixel-corner
    coordinates (n, 2), column first, and planar depths (n,). Coordinates are NaN for points behind the camera, and for
    points that cross the rows as fast as the readout.

    A point is shown by the row whose pose projects it to this row. The search starts at the row of the middle pose, and
    the row of each projection is tried next. It converges where the image moves by less than a row while a row is read.
    """
    place, depth = _project(points, camera)
    if shutter is None:
        return place, depth
    row = place[:, 1].copy()
    left = np.flatnonzero(np.isfinite(row))  # the points whose row is not yet found
    for _ in range(_MAX_STEPS):
        place[left], depth[left] = _project(_transform_to_rows(points[left], shutter, row[left]), camera)
        change, row[left] = np.abs(place[left, 1] - row[left]), place[left, 1]
        left = left[change > _MIN_STEP_ROWS]
    place[left] = np.nan
    return place, depth


def _transform_to_rows(points: Array, shutter: RollingShutter, row: Array) -> Array:
    """Transform points (n, 3), in metres, to the axes of the eye at the time when each point's row (n,) is read. Rows
    are pixel-corner coordinates.
    """
    time = shutter.find_time_s(row - 0.5)[:, None]
    shifted = points - shutter.velocity_m_s * time
    speed = float(np.linalg.norm(shutter.turn_deg_s))
    if not speed:
        return np.asarray(shifted)
    axis, angle = shutter.turn_deg_s / speed, -np.radians(speed) * time
    along = (shifted @ axis)[:, None] * axis  # Rodrigues' formula for all points at once
    return np.asarray(along + np.cos(angle) * (shifted - along) + np.sin(angle) * np.cross(axis, shifted))


def _project(points: Array, camera: StereoCamera) -> tuple[Array, Array]:
    depth = points[:, 2]
    ahead = np.where(depth > 1e-6, depth, np.nan)
    return camera.focal_px * points[:, :2] / ahead[:, None] + (camera.cx_px, camera.cy_px), depth.copy()
