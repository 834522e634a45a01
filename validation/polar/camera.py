"""The stereo camera of the photographs, fitted to the outlines of the rocks.

The fit has a focal length and a principal point for each eye, two terms of radial distortion for both, the right eye's
rotation and position relative to the left one, and a pose of the left eye for each position. It starts from the survey.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...physics.camera.rotations import from_vector
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from .data_set import (
    EYES,
    HEIGHT_PX,
    ROCK,
    SURVEYED_BASELINE_M,
    SURVEYED_EYES,
    SURVEYED_PITCH_DEG,
    SURVEYED_YAW_DEG,
    WIDTH_PX,
    Rock,
    Terrain,
    View,
)

_IMAGE_CENTRE_PX = np.array([WIDTH_PX, HEIGHT_PX]) / 2
#: Directions in the image in which outlines are compared: the upper half, since sand hides the feet of rocks.
_OUTLINE_ANGLES_RAD = np.radians(np.arange(0.0, 181.0, 15.0))
_OUTLINE_DIRECTIONS = np.stack([np.cos(_OUTLINE_ANGLES_RAD), -np.sin(_OUTLINE_ANGLES_RAD)])
#: Part of a scan's height that may be sand and is left out.
_SAND_SHARE = 0.25
#: For each round of the fit: the distance in pixels within which an outline belongs to a rock, and the distance beyond
#: which it counts less.
_FIT_ROUNDS_PX = ((60.0, 15.0), (40.0, 8.0), (30.0, 5.0), (30.0, 4.0))
_MATCHED_PX = 10.0
#: Steps for derivatives of the shared parameters: focal length and principal point of the left and the right eye,
#: distortion, rotation and position of the right eye.
_SHARED_STEPS = (1.0,) * 6 + (1e-3,) * 2 + (1e-4,) * 6
#: Expected deviations of the shared parameters from their start.
_SHARED_PRIOR = (200.0, 15.0, 15.0, 200.0, 15.0, 15.0, 0.3, 0.3, 0.02, 0.02, 0.02, 0.03, 0.02, 0.02)
_POSE_STEPS = (0.01,) * 3 + (1e-3,) * 3
_POSE_PRIOR = (20.0, 20.0, 10.0, 1.0, 1.0, 1.0)
_SHARED_COUNT = len(_SHARED_STEPS)


def make_camera_rotation(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Array:
    """Make the rotation (3, 3) from world axes to OpenCV's camera axes: yaw from +X over +Y, pitch down, roll clockwise
    about the axis."""
    yaw, pitch, roll = (math.radians(angle) for angle in (yaw_deg, pitch_deg, roll_deg))
    forward = np.array([math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)])
    right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    about = np.array([[math.cos(roll), math.sin(roll), 0.0], [-math.sin(roll), math.cos(roll), 0.0], [0.0, 0.0, 1.0]])
    return about @ np.stack([right, np.cross(forward, right), forward])


@dataclass(frozen=True)
class Eye:
    """A pinhole camera with distortion: focal length and principal point in pixels, k1 and k2, and the pose from world
    to camera."""

    focal_px: float
    centre_px: Array
    k1: float
    k2: float
    turn: Array
    place_m: Array

    def project(self, points: Array) -> Array:
        """Project points (n, 3), m, to pixels (n, 2) by OpenCV's Brown-Conrady model."""
        inside = (points - self.place_m) @ self.turn.T
        plane = inside[:, :2] / inside[:, 2:]
        r2 = (plane**2).sum(axis=1, keepdims=True)
        return np.asarray(plane * (1 + self.k1 * r2 + self.k2 * r2**2) * self.focal_px + self.centre_px)

    def rays(self, pixels: Array) -> Array:
        """Return the directions (n, 3) of pixels (n, 2) in camera axes, with z = 1. The distortion is undone by
        iteration."""
        bent = (pixels - self.centre_px) / self.focal_px
        plane = bent.copy()
        for _ in range(20):
            r2 = (plane**2).sum(axis=1, keepdims=True)
            plane = bent / (1 + self.k1 * r2 + self.k2 * r2**2)
        return np.concatenate([plane, np.ones((len(plane), 1))], axis=1)


@dataclass(frozen=True)
class Calibration:
    """The fitted eyes by view, and the residuals: distances in pixels between outlines and projected rocks."""

    eyes: dict[View, Eye]
    left_px: Array

    @property
    def baseline_m(self) -> float:
        """Distance between the eyes in metres."""
        position = next(iter(self.eyes)).position
        left, right = (self.eyes[View(position, eye)].place_m for eye in EYES)
        return float(np.linalg.norm(right - left))

    @property
    def matched_share(self) -> float:
        """Share of the compared outline points within 10 px."""
        return float((np.abs(self.left_px) < _MATCHED_PX).mean())

    @property
    def median_px(self) -> float:
        """Median distance in pixels between outlines and projected rocks."""
        return float(np.median(np.abs(self.left_px)))


def _make_eye(x: Array, position: str, eye: str, pose: Array) -> Eye:
    turn = make_camera_rotation(SURVEYED_YAW_DEG[position] + pose[0], pose[1], pose[2])
    place = np.array(SURVEYED_EYES[position][0]) + pose[3:]
    if eye == "L":
        return Eye(x[0], _IMAGE_CENTRE_PX + x[1:3], x[6], x[7], turn, place)
    # In the left eye's axes a point at q is at turn' q - shift in the right eye's.
    beside = from_vector(x[8:11])
    return Eye(x[3], _IMAGE_CENTRE_PX + x[4:6], x[6], x[7], beside @ turn, place + turn.T @ beside.T @ x[11:14])


def find_extreme_points(points: Array, count: int = 300) -> Array:
    """Return the points, of (n, 3), that are farthest in at least one of ``count`` directions; only they can be on an
    outline."""
    k = np.arange(count) + 0.5
    polar, around = np.arccos(1 - 2 * k / count), np.pi * (1 + math.sqrt(5)) * k
    toward = np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)])
    return np.asarray(points[np.unique((points @ toward).argmax(axis=0))])


def _select_visible_part(rock: Rock) -> Array:
    heights = rock.vertices[:, 2]
    low = heights.min() + _SAND_SHARE * np.ptp(heights)
    return find_extreme_points(rock.vertices[heights > low])


class _Outlines:
    """The outlines of rocks in an eye, from the ``_select_visible_part`` of each rock."""

    def __init__(self, rocks: Sequence[Rock]) -> None:
        parts = [_select_visible_part(rock) for rock in rocks]
        self._points, self._firsts = np.concatenate(parts), np.cumsum([0, *map(len, parts)])[:-1]

    def middles(self, eye: Eye) -> Array:
        """Return the middles (n, 2) of the outlines in pixels."""
        return _outline_middles(np.split(eye.project(self._points), self._firsts[1:]))

    def supports(self, eye: Eye) -> Array:
        """Return the extent of each outline in each direction, (n, directions), in pixels."""
        return np.asarray(np.maximum.reduceat(eye.project(self._points) @ _OUTLINE_DIRECTIONS, self._firsts))


def _outline_middles(outlines: Sequence[Array]) -> Array:
    return np.array([(each.min(axis=0) + each.max(axis=0)) / 2 for each in outlines]).reshape(-1, 2)


def _step_gauss_newton(
    x: Array,
    residual: Callable[[Array], Array],
    weight: Array,
    steps: Array,
    start: Array,
    strength: Array,
) -> Array:
    """Take one step of Gauss and Newton; ``strength`` holds parameters at their start."""
    at = residual(x)
    slope = np.stack(
        [(residual(x + step * unit) - at) / step for step, unit in zip(steps, np.eye(len(x)), strict=True)], axis=1
    )
    left = (slope.T * weight) @ slope + np.diag(strength)
    return np.asarray(x - np.linalg.solve(left, (slope.T * weight) @ at + strength * (x - start)))


def _make_shared_parameters(coarse: Array) -> Array:
    """Convert the parameters that ``_find_pose`` fits to the shared parameters of eyes that are side by side and
    undistorted."""
    focal_px, x_px, y_px = coarse[0], *coarse[7:]
    return np.array([focal_px, 0, 0, focal_px, x_px, y_px, 0, 0, 0, 0, 0, SURVEYED_BASELINE_M, 0, 0])


_COARSE_STEPS = np.array([1.0, *_POSE_STEPS, 0.1, 0.1])


def _find_pose(terrain: Terrain, position: str, starts: Sequence[Array], prior: Array) -> tuple[float, Array]:
    """Find the camera pose of a position by a fit to the centres of rocks. Returns a score, about the number of rocks
    that fit, and the parameters.

    Parameters are the focal length, the six numbers of the pose, and the offset of the right eye's principal point.
    Raises IcyMoonError if no rock is outlined.
    """
    middles = np.array([(rock.vertices.min(axis=0) + rock.vertices.max(axis=0)) / 2 for rock in terrain.rocks])
    seen = [
        _outline_middles(
            [
                outline
                for azimuth in terrain.azimuths
                for outline in terrain.polygons(View(position, eye), azimuth, ROCK)
            ]
        )
        for eye in EYES
    ]
    if not all(map(len, seen)):
        raise IcyMoonError(f"Terrain {terrain.name}, position {position}: no rock is outlined; add its labels.")

    def projected(x: Array) -> list[Array]:
        return [_make_eye(_make_shared_parameters(x), position, eye, x[1:7]).project(middles) for eye in EYES]

    def distances(x: Array) -> list[Array]:
        return [np.linalg.norm(a[:, None] - b[None], axis=2) for a, b in zip(projected(x), seen, strict=True)]

    best = (-1.0, starts[0])
    for start in starts:
        x = start.copy()
        for turn in range(30):
            width = max(12.0, 200.0 * 0.85**turn)
            apart = distances(x)
            target = [b[each.argmin(axis=1)] for b, each in zip(seen, apart, strict=True)]
            weight = np.repeat(np.concatenate([1 / (1 + (each.min(axis=1) / width) ** 2) for each in apart]), 2)

            def residual(y: Array, target: list[Array] = target) -> Array:
                return np.concatenate([a - b for a, b in zip(projected(y), target, strict=True)]).ravel()

            x = _step_gauss_newton(x, residual, weight, _COARSE_STEPS, start, 25 / prior**2)
        score = float(sum((1 / (1 + (each.min(axis=1) / 10) ** 2)).sum() for each in distances(x)))
        best = max(best, (score, x), key=lambda found: found[0])
    return best


def _find_poses(terrain: Terrain) -> dict[str, Array]:
    """Find coarse poses: first of the position that fits best, then of the others, starting from its lens and tilt."""
    wide = [
        np.array([focal, yaw, pitch, 0, 0, 0, 0, 0, 0], np.float64)
        for focal, pitch, yaw in itertools.product(
            (1900.0, 2200.0), (SURVEYED_PITCH_DEG - 3, SURVEYED_PITCH_DEG, SURVEYED_PITCH_DEG + 3), (-6.0, 0.0, 6.0)
        )
    ]
    found = {
        position: _find_pose(terrain, position, wide, np.array([300, 10, 5, 2, 0.5, 0.5, 0.3, 20, 20]))
        for position in terrain.positions
    }
    anchor = max(found, key=lambda position: found[position][0])
    near = [
        found[anchor][1] + np.array([0, yaw, pitch, 0, 0, 0, 0, 0, 0])
        for yaw, pitch in itertools.product((-4.0, -2.0, 0.0, 2.0, 4.0), (-2.0, 0.0, 2.0))
    ]
    for position in found.keys() - {anchor}:
        found[position] = max(
            found[position],
            _find_pose(terrain, position, near, np.array([60, 5, 2, 1, 0.5, 0.5, 0.3, 3, 3])),
            key=lambda each: each[0],
        )
    return {position: x for position, (_, x) in found.items()}


def fit_camera(terrain: Terrain) -> Calibration:
    """Fit the camera. Raises IcyMoonError if fewer than half of the outlines meet a rock within 10 px."""
    poses, positions = _find_poses(terrain), terrain.positions
    outlines = _Outlines(terrain.rocks)
    x = np.concatenate([_make_shared_parameters(poses[positions[0]]), *(poses[each][1:7] for each in positions)])
    start = x.copy()
    start[4:6] = 0.0
    steps = np.array([*_SHARED_STEPS, *_POSE_STEPS * len(positions)])
    prior = np.array([*_SHARED_PRIOR, *_POSE_PRIOR * len(positions)])

    def eye_of(y: Array, view: View) -> Eye:
        k = _SHARED_COUNT + 6 * positions.index(view.position)
        return _make_eye(y, view.position, view.eye, y[k : k + 6])

    for reach, width in _FIT_ROUNDS_PX:
        targets = {
            view: _measure_outline_supports(terrain, view, outlines.middles(eye_of(x, view)), reach)
            for view in terrain.views
        }
        known = np.concatenate([np.isfinite(target).ravel() for target in targets.values()])
        if not known.any():
            raise IcyMoonError(
                f"Terrain {terrain.name}: no outline is near a rock, so the camera cannot be fitted; "
                "check that labels and rocks are of one terrain."
            )

        def residual(y: Array, targets: dict[View, Array] = targets, known: Array = known) -> Array:
            return np.concatenate(
                [(outlines.supports(eye_of(y, view)) - target).ravel() for view, target in targets.items()]
            )[known]

        for _ in range(6):
            weight = 1 / (1 + (residual(x) / width) ** 2) ** 2
            x = _step_gauss_newton(x, residual, weight, steps, start, (width / prior) ** 2)
    found = Calibration({view: eye_of(x, view) for view in terrain.views}, residual(x))
    met = found.matched_share * measure_compared_share(terrain, targets)
    if met < 0.5:
        raise IcyMoonError(
            f"Terrain {terrain.name}: only {met:.0%} of the outlines meet the rocks; check that "
            "labels and rocks are of one terrain."
        )
    return found


def measure_compared_share(terrain: Terrain, targets: dict[View, Array]) -> float:
    """Measure the share of the rocks with an outline to compare, among the rocks that could have one.

    ``targets`` are from ``_measure_outline_supports``. A few rocks of a wrong terrain meet some outline by chance, and
    a camera can be fitted to these few.
    """
    compared = sum(int(np.isfinite(target).any(axis=1).sum()) for target in targets.values())
    outlined = [
        float(np.median([len(terrain.polygons(view, azimuth, ROCK)) for azimuth in terrain.azimuths]))
        for view in targets
    ]
    return compared / max(sum(min(float(len(terrain.rocks)), count) for count in outlined), 1.0)


def _measure_outline_supports(terrain: Terrain, view: View, middles: Array, reach_px: float) -> Array:
    """Measure the extent of each rock's outline in each direction, as the median over the azimuths; NaN without an
    outline."""
    found = np.full((len(terrain.azimuths), len(middles), _OUTLINE_DIRECTIONS.shape[1]), np.nan)
    for k, azimuth in enumerate(terrain.azimuths):
        outlines = terrain.polygons(view, azimuth, ROCK)
        if not outlines:
            continue
        apart = np.linalg.norm(middles[:, None] - _outline_middles(outlines)[None], axis=2)
        for rock, outline in enumerate(apart.argmin(axis=1)):
            if apart[rock, outline] < reach_px and apart[:, outline].argmin() == rock:
                found[k, rock] = (outlines[outline] @ _OUTLINE_DIRECTIONS).max(axis=0)
    everywhere = np.isnan(found).all(axis=0)
    return np.asarray(np.where(everywhere, np.nan, np.nanmedian(np.where(everywhere, 0.0, found), axis=0)))
