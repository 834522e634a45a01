"""The pose of an arm's link from the depth of its pixels: iterative closest points from the commanded pose.

Each step reduces the distances of the points to the plane at the nearest point of the link's surface (Chen and Medioni
1992), and the distance to the commanded pose, weighted by the expected error of joints. Without the commanded pose the
result would turn at random, because few points lie on all sides of a scoop and a matcher's points have common errors. A
faulty joint shows as a pose that differs from the commanded one by more than the noise.

If a fault moves the link farther than its own size, points are nearest to a wrong side, and the steps end at a worse
pose. So they start at several poses: the commanded one, and turned ones at the middle of the points. The best fit is
kept.
"""

from __future__ import annotations

import math

import numpy as np

from ...physics.arm.kinematics import make_rigid_transform, rotation_about
from ...physics.camera.rotations import from_vector, to_vector
from ...support.arrays import Array

#: Most steps; and the turn (rad) and shift (m) below which the steps end.
_MAX_STEPS, _MIN_MOTION = 40, 1e-6
#: A point is an outlier if its distance from the surface exceeds the first number times the median distance, and the
#: second number, m.
_OUTLIER_FACTOR, _MIN_OUTLIER_M = 2.5, 1e-3
#: Prior standard deviations of a pose, rad and m: four degrees in a joint 2 m away.
_PRIOR_TURN_RAD, _PRIOR_SHIFT_M = math.radians(4.0), 0.12
#: Number of points with a common error, a window of 5 x 5 pixels; and the least noise of a point, m.
_CORRELATED_POINTS, _MIN_NOISE_M = 25, 2e-4
#: Fewest points for a pose. A scoop of 10 x 8 cm has some 190 pixels in the paper's camera; half of them are visible.
FEWEST_POINTS = 40
#: Most points that are matched. More points take time and change little.
_MAX_POINTS = 500
#: The other starts: turn (degrees, both ways about each axis), numbers of points and steps of the comparison, and the
#: largest ratio of a better start's misfit to the misfit from the commanded pose.
_START_TURN_DEG, _START_POINTS, _START_STEPS, _BETTER_START_SHARE = 15.0, 150, 15, 0.5
#: Largest distance that counts in a misfit, m, because points beside the link are far from all poses.
_MAX_MISFIT_M = 0.02


def sample_surface(vertices: Array, triangles: Array, count: int, random: np.random.Generator) -> Array:
    """Sample points and unit normals (count, 6) evenly on triangles (m, 3) of vertices (n, 3)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1)
    which = random.choice(len(triangles), count, p=area / area.sum())
    u, v = np.sqrt(random.random(count))[:, None], random.random(count)[:, None]
    points = (1 - u) * a[which] + u * (1 - v) * b[which] + u * v * c[which]
    return np.hstack([points, cross[which] / area[which, None]])


def find_pose(model: Array, points: Array, commanded: Array, eye: Array, random: np.random.Generator) -> Array | None:
    """Find the pose (4, 4) of a link from points (m, 3) on it that an ``eye`` (3,) sees. None if there are too few
    points.

    ``model`` (n, 6) has points and normals of the link's surface in its own frame. The search starts at the
    ``commanded`` pose (4, 4).
    """
    if len(points) < FEWEST_POINTS:
        return None
    if len(points) > _MAX_POINTS:
        points = points[random.choice(len(points), _MAX_POINTS, replace=False)]
    facing = _select_facing_points(_transform_cloud(model, commanded), eye)
    if len(facing) < FEWEST_POINTS:
        return None
    # Motions are about the link's middle. A turn about the site's origin, which may be far away, would shift the link.
    middle = facing[:, :3].mean(axis=0)
    surface, scene = facing - np.append(middle, np.zeros(3)), points - middle
    motion, _ = _fit_motion(surface, scene, _find_best_start(surface, scene), _MAX_STEPS)
    found = commanded.copy()
    found[:3, :3] = motion[:3, :3] @ commanded[:3, :3]
    found[:3, 3] = motion[:3, :3] @ (commanded[:3, 3] - middle) + motion[:3, 3] + middle
    return found


def _find_best_start(surface: Array, points: Array) -> Array:
    """Find the start motion (4, 4) of a surface (n, 6) from which the steps reach the best fit to points (m, 3)."""
    few = points[:: math.ceil(len(points) / _START_POINTS)]
    moved = make_rigid_transform(None, np.median(points, axis=0))
    turns = [rotation_about(sign * axis, math.radians(_START_TURN_DEG)) for axis in np.eye(3) for sign in (-1.0, 1.0)]
    starts = [np.eye(4), moved, *(moved @ make_rigid_transform(each, np.zeros(3)) for each in turns)]
    reached = [_fit_motion(surface, few, start, _START_STEPS)[0] for start in starts]
    misfits = np.array([_measure_rms_distance_m(_transform_cloud(surface, motion), few) for motion in reached])
    best = int(misfits.argmin())
    return reached[best if misfits[best] < _BETTER_START_SHARE * misfits[0] else 0]


def _fit_motion(surface: Array, points: Array, motion: Array, steps: int) -> tuple[Array, float]:
    """Fit a surface (n, 6) to points (m, 3) in at most ``steps`` steps.

    Return its motion (4, 4), and the RMS distance of the points from it, m.
    """
    left = math.inf
    for _ in range(steps):
        step, left = _step_motion(_transform_cloud(surface, motion), points, motion)
        motion = step @ motion
        if np.abs(step - np.eye(4)).max() < _MIN_MOTION:
            break
    return motion, left


def _measure_rms_distance_m(surface: Array, points: Array) -> float:
    """Measure the RMS distance, m, of points (m, 3) from a surface (n, 6), each limited to ``_MAX_MISFIT_M``."""
    place = surface[:, :3]
    squared = (place**2).sum(axis=1) - 2 * points @ place.T
    apart = squared.min(axis=1) + (points**2).sum(axis=1)
    return float(np.sqrt(np.clip(apart, 0.0, _MAX_MISFIT_M**2).mean()))


def _step_motion(surface: Array, points: Array, motion: Array) -> tuple[Array, float]:
    """Step a surface (n, 6), which was moved by ``motion``, toward points (m, 3) and the commanded pose.

    Return the step's motion (4, 4), and the RMS distance of the points from the surface, m.
    """
    place, normal = surface[:, :3], surface[:, 3:]
    squared = (place**2).sum(axis=1) - 2 * points @ place.T
    nearest = squared.argmin(axis=1)
    place, normal = place[nearest], normal[nearest]
    apart = np.linalg.norm(points - place, axis=1)
    kept = apart <= max(_OUTLIER_FACTOR * float(np.median(apart)), _MIN_OUTLIER_M)
    place, normal = place[kept], normal[kept]
    residual = ((points[kept] - place) * normal).sum(axis=1)
    left = float(np.sqrt((residual**2).mean()))
    rows = np.hstack([np.cross(place, normal), normal])
    certainty = 1 / (_CORRELATED_POINTS * max(left, _MIN_NOISE_M) ** 2)
    off = np.append(to_vector(motion[:3, :3]), motion[:3, 3])
    before = np.repeat([_PRIOR_TURN_RAD, _PRIOR_SHIFT_M], 3) ** -2.0
    solved = np.linalg.solve(certainty * rows.T @ rows + np.diag(before), certainty * rows.T @ residual - before * off)
    return make_rigid_transform(from_vector(solved[:3]), solved[3:]), left


def _transform_cloud(cloud: Array, motion: Array) -> Array:
    return np.hstack([cloud[:, :3] @ motion[:3, :3].T + motion[:3, 3], cloud[:, 3:] @ motion[:3, :3].T])


def _select_facing_points(cloud: Array, eye: Array) -> Array:
    """Select the points whose normals face the eye. Other points are invisible to the eye and would bias the fit."""
    return cloud[((eye - cloud[:, :3]) * cloud[:, 3:]).sum(axis=1) > 0]


def measure_pose_error(found: Array, true: Array, point: Array) -> tuple[float, float]:
    """Measure the error of a pose (4, 4) from the true one: mm at a ``point`` (3,) of the link's frame, and degrees."""
    apart = (found[:3, :3] - true[:3, :3]) @ point + found[:3, 3] - true[:3, 3]
    apart_by = found[:3, :3] @ true[:3, :3].T
    # The sine is used too, because the arc cosine of a small angle loses half of its digits.
    sine = (
        np.linalg.norm(
            [apart_by[2, 1] - apart_by[1, 2], apart_by[0, 2] - apart_by[2, 0], apart_by[1, 0] - apart_by[0, 1]]
        )
        / 2
    )
    return 1000 * float(np.linalg.norm(apart)), math.degrees(math.atan2(float(sine), (np.trace(apart_by) - 1) / 2))
