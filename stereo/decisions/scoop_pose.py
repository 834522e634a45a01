"""Where a link of the arm is, from the depth of its pixels: iterative closest points from where it was told to be.

OpenCV's ``ppf_match_3d_ICP``, whose result leads from the model to the scene. A joint that is off shows as a pose that
is not the commanded one by more than the noise of the pose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from ...physics.arm.kinematics import Arm, forward

#: Of OpenCV's ICP: most iterations, least change, outliers beyond so many deviations, levels of its pyramid.
_ICP = (100, 0.005, 2.5, 6)
#: Neighbours of a point through which its normal is fitted.
_NEIGHBOURS = 12
#: Fewest points of a scene for a pose.
FEWEST_POINTS = 100
#: Most points that are matched: more cost time and change little.
_MOST_POINTS = 6000
#: Standard deviations of a pose beyond which a fault is noticed, at 95 % with 5 % false alarms.
NOTICED = 3.29


@dataclass(frozen=True)
class PoseFound:
    """A pose (4, 4) from the link to the frame of the points, and the root mean square distance that is left, m."""

    pose: np.ndarray
    residual_m: float


def sample_surface(vertices: np.ndarray, triangles: np.ndarray, count: int, random: np.random.Generator) -> np.ndarray:
    """Points and unit normals (count, 6) spread evenly over triangles (m, 3) of vertices (n, 3)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1)
    which = random.choice(len(triangles), count, p=area / area.sum())
    u, v = np.sqrt(random.random(count))[:, None], random.random(count)[:, None]
    points = (1 - u) * a[which] + u * (1 - v) * b[which] + u * v * c[which]
    return np.hstack([points, cross[which] / area[which, None]])


def find_pose(model: np.ndarray, points: np.ndarray, commanded: np.ndarray, eye: np.ndarray,
              random: np.random.Generator) -> PoseFound | None:
    """The pose of a link whose surface is ``model`` (n, 6: points and normals in its own frame), from the points (m, 3)
    that an ``eye`` (3,) sees of it, starting at the ``commanded`` pose (4, 4). None if there are too few points, or if
    OpenCV finds none.
    """
    if len(points) < FEWEST_POINTS:
        return None
    if len(points) > _MOST_POINTS:
        points = points[random.choice(len(points), _MOST_POINTS, replace=False)]
    # Around the scene, which single precision needs: the site may be far from its origin.
    middle = points.mean(axis=0)
    local = (points - middle).astype(np.float32)
    start = commanded.copy()
    start[:3, 3] -= middle
    _, scene = cv2.ppf_match_3d.computeNormalsPC3d(local, _NEIGHBOURS, True, tuple(float(x) for x in eye - middle))
    moved = _facing(_transformed(model, start), eye - middle)
    if len(moved) < FEWEST_POINTS:
        return None
    failed, residual, correction = cv2.ppf_match_3d_ICP(*_ICP).registerModelToScene(
        moved.astype(np.float32), np.ascontiguousarray(scene, np.float32))
    if failed or not np.isfinite(correction).all():
        return None
    found = np.asarray(correction, np.float64) @ start
    found[:3, 3] += middle
    return PoseFound(found, float(residual))


def _transformed(cloud: np.ndarray, pose: np.ndarray) -> np.ndarray:
    return np.hstack([cloud[:, :3] @ pose[:3, :3].T + pose[:3, 3], cloud[:, 3:] @ pose[:3, :3].T])


def _facing(cloud: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """The points whose normals face the eye: it sees no others, and the far side would pull the near one back."""
    return cloud[((eye - cloud[:, :3]) * cloud[:, 3:]).sum(axis=1) > 0]


def pose_error(found: np.ndarray, true: np.ndarray, point: np.ndarray) -> tuple[float, float]:
    """How far a pose (4, 4) is from the true one: mm at a ``point`` (3,) of the link's frame, and degrees."""
    apart = (found[:3, :3] - true[:3, :3]) @ point + found[:3, 3] - true[:3, 3]
    turn = found[:3, :3] @ true[:3, :3].T
    # By the sine too: the arc cosine of a small angle loses half its digits.
    sine = np.linalg.norm([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    return 1000 * float(np.linalg.norm(apart)), math.degrees(math.atan2(float(sine), (np.trace(turn) - 1) / 2))


def levers_of(arm: Arm, joints_rad: np.ndarray, point: np.ndarray) -> dict[str, float]:
    """Distance in metres of a ``point`` (3,) of the last link from the axis of each turning joint."""
    poses = forward(arm, joints_rad)
    place = poses[-1][:3, :3] @ point + poses[-1][:3, 3]
    found = {}
    for joint, pose in zip(arm.joints, poses, strict=True):
        if not joint.slides:
            axis, apart = pose[:3, :3] @ joint.axis, place - pose[:3, 3]
            found[joint.name] = float(np.linalg.norm(apart - (apart @ axis) * axis))
    return found


def smallest_fault_deg(sigma_mm: float, lever_m: float) -> float:
    """The smallest angle of a joint that is noticed, degrees, by what it moves at the end of its lever."""
    return math.degrees(NOTICED * sigma_mm / 1000 / lever_m) if lever_m > 0 else math.inf
