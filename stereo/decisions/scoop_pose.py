"""Where a link of the arm is, from the depth of its pixels: iterative closest points from where it was told to be.

Each point is drawn to the plane of the nearest point of the link's surface (Chen and Medioni 1992). A step is damped,
so that directions which the points do not tell stay as commanded: few points of a scoop lie on all of its sides. A
joint that is off shows as a pose that is not the commanded one by more than the noise of the pose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...physics.arm.kinematics import pose, turn

#: Most steps, and the turn (rad) and shift (m) below which no further one is made.
_STEPS, _STILL = 40, 1e-6
#: Points further than so many medians from the surface are outliers, but none that is this near, m.
_OUTLIER, _NEAR_M = 2.5, 1e-3
#: Damping of a step, as a share of the mean of the diagonal.
_DAMPING = 1e-3
#: Fewest points for a pose: a scoop of 10 x 8 cm has some 190 pixels in the paper's camera, and half of them are seen.
FEWEST_POINTS = 40
#: Most points that are matched: more cost time and change little.
_MOST_POINTS = 500


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
    that an ``eye`` (3,) sees of it, starting at the ``commanded`` pose (4, 4). None if there are too few points.
    """
    if len(points) < FEWEST_POINTS:
        return None
    if len(points) > _MOST_POINTS:
        points = points[random.choice(len(points), _MOST_POINTS, replace=False)]
    facing = _facing(_transformed(model, commanded), eye)
    if len(facing) < FEWEST_POINTS:
        return None
    # Around its middle, as the site may be far from its origin; a turn about it moves the link least.
    middle = facing[:, :3].mean(axis=0)
    surface, scene = facing - np.append(middle, np.zeros(3)), points - middle
    motion, left = np.eye(4), math.inf
    for _ in range(_STEPS):
        step, left = _step(_transformed(surface, motion), scene)
        motion = step @ motion
        if np.abs(step - np.eye(4)).max() < _STILL:
            break
    found = commanded.copy()
    found[:3, :3] = motion[:3, :3] @ commanded[:3, :3]
    found[:3, 3] = motion[:3, :3] @ (commanded[:3, 3] - middle) + motion[:3, 3] + middle
    return PoseFound(found, left)


def _step(surface: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, float]:
    """The motion (4, 4) of a surface (n, 6) that brings it nearer to points (m, 3), and their distance from it, RMS."""
    place, normal = surface[:, :3], surface[:, 3:]
    squared = (place ** 2).sum(axis=1) - 2 * points @ place.T
    nearest = squared.argmin(axis=1)
    place, normal = place[nearest], normal[nearest]
    apart = np.linalg.norm(points - place, axis=1)
    kept = apart <= max(_OUTLIER * float(np.median(apart)), _NEAR_M)
    place, normal = place[kept], normal[kept]
    residual = ((points[kept] - place) * normal).sum(axis=1)
    rows = np.hstack([np.cross(place, normal), normal])
    # Turns weigh as much as shifts if they are measured at the size of the link.
    size = max(float(np.sqrt((place ** 2).sum(axis=1).mean())), 1e-9)
    rows[:, :3] /= size
    square = rows.T @ rows
    solved = np.linalg.solve(square + _DAMPING * np.trace(square) / 6 * np.eye(6), rows.T @ residual)
    turned = solved[:3] / size
    angle = float(np.linalg.norm(turned))
    return pose(turn(turned / angle, angle) if angle else None, solved[3:]), float(np.sqrt((residual ** 2).mean()))


def _transformed(cloud: np.ndarray, motion: np.ndarray) -> np.ndarray:
    return np.hstack([cloud[:, :3] @ motion[:3, :3].T + motion[:3, 3], cloud[:, 3:] @ motion[:3, :3].T])


def _facing(cloud: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """The points whose normals face the eye: it sees no others, and the far side would pull the near one back."""
    return cloud[((eye - cloud[:, :3]) * cloud[:, 3:]).sum(axis=1) > 0]


def pose_error(found: np.ndarray, true: np.ndarray, point: np.ndarray) -> tuple[float, float]:
    """How far a pose (4, 4) is from the true one: mm at a ``point`` (3,) of the link's frame, and degrees."""
    apart = (found[:3, :3] - true[:3, :3]) @ point + found[:3, 3] - true[:3, 3]
    apart_by = found[:3, :3] @ true[:3, :3].T
    # By the sine too: the arc cosine of a small angle loses half its digits.
    sine = np.linalg.norm([apart_by[2, 1] - apart_by[1, 2], apart_by[0, 2] - apart_by[2, 0],
                           apart_by[1, 0] - apart_by[0, 1]]) / 2
    return 1000 * float(np.linalg.norm(apart)), math.degrees(math.atan2(float(sine), (np.trace(apart_by) - 1) / 2))
