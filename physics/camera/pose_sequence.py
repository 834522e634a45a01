"""Poses of a camera over time: their motion, and their conversion to other axes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Decimal

import numpy as np

from ...support.arrays import Array
from .rotations import to_vector

#: By the name of a convention: a camera's axes x right, y down, z forward, as columns, in the axes that a file's
#: rotations use.
CAMERA_IN = {
    "OPENCV": np.eye(3),  # x right, y down, z forward
    "OPENGL": np.diag([1.0, -1.0, -1.0]),  # x right, y up, z backward; Blender's too
    "ROS": np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),  # x forward, y left, z up
}
#: By the name of a convention: east, north and up, as rows, in the world axes of a file.
WORLD_IN = {
    "ENU": np.eye(3),
    "NED": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
}
#: Smallest step of a stamp, which has nine decimals.
_NANOSECOND = Decimal("1e-9")
#: By default, a step in time longer than this multiple of the median step is a gap.
_GAP_MEDIAN_STEPS = 5.0


@dataclass(frozen=True)
class PoseSequence:
    """Poses in the order of time. ``position_m`` (n, 3) is in world axes. ``rotation`` (n, 3, 3) has the camera's axes
    x right, y down, z forward as columns. ``stamp`` is in seconds with all decimals, and ``line`` is the line of each
    pose in its file.
    """

    position_m: Array
    rotation: Array
    stamp: tuple[Decimal, ...]
    line: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.stamp)

    @property
    def seconds(self) -> Array:
        """Seconds (n,) since the first pose."""
        return np.array([float(stamp - self.stamp[0]) for stamp in self.stamp])

    @property
    def length_m(self) -> float:
        """Length of the path in metres."""
        return float(np.linalg.norm(np.diff(self.position_m, axis=0), axis=1).sum())

    def every(self, step: int) -> PoseSequence:
        """Return each ``step``-th pose, from the first on."""
        return PoseSequence(self.position_m[::step], self.rotation[::step], self.stamp[::step], self.line[::step])

    def at_rate(self, rate_hz: float) -> PoseSequence:
        """Return the same poses at a constant rate in Hz, from 0 s on."""
        stamps = tuple((Decimal(k) / Decimal(repr(rate_hz))).quantize(_NANOSECOND) for k in range(len(self)))
        return replace(self, stamp=stamps)

    def placed(self, world: Array, origin_m: Array) -> PoseSequence:
        """Return the same poses in other world axes: ``world`` (3, 3) has the new axes as rows, and ``origin_m`` (3,)
        is the new origin in the old axes.
        """
        return replace(self, position_m=(self.position_m - origin_m) @ world.T, rotation=world @ self.rotation)

    def from_first(self, pose: Array) -> PoseSequence:
        """Return the same path, moved so that it starts at ``pose`` (4, 4) of the camera."""
        first = self.rotation[0]
        return replace(
            self,
            position_m=(self.position_m - self.position_m[0]) @ first @ pose[:3, :3].T + pose[:3, 3],
            rotation=pose[:3, :3] @ first.T @ self.rotation,
        )

    def gaps(self, longest_s: float | None = None) -> Array:
        """Return whether the motion from each pose to the next (n - 1,) is unknown, because they are more than
        ``longest_s`` seconds apart. By default this limit is five median steps.
        """
        steps = np.diff(self.seconds)
        if longest_s is None:
            longest_s = _GAP_MEDIAN_STEPS * float(np.median(steps)) if len(steps) else 0.0
        return np.asarray(steps > longest_s)

    def motion(self, longest_s: float | None = None) -> tuple[Array, Array]:
        """Compute the velocity in m/s and the rotation vector in rad/s, (n, 3) each, in the axes of the camera at each
        pose.

        They follow from the parabola through a pose and its neighbours; beside an end or a gap (see ``gaps``), from the
        straight line to the only neighbour. A pose between two gaps has no motion.
        """
        steps, gaps = np.diff(self.seconds), self.gaps(longest_s)
        moved = np.diff(self.position_m, axis=0)
        turned = [
            # The axis of the turn is the same in the axes before and after it.
            to_vector(before.T @ after)
            for before, after in zip(self.rotation[:-1], self.rotation[1:], strict=True)
        ]
        return (
            np.einsum("nji,nj->ni", self.rotation, _compute_rates(moved, steps, gaps)),
            _compute_rates(np.array(turned).reshape(-1, 3), steps, gaps),
        )


def _compute_rates(change: Array, step_s: Array, gaps: Array) -> Array:
    """Compute rates (n, 3) at n poses, from the changes (n - 1, 3) between consecutive poses."""
    weight = np.where(gaps, 0.0, 1.0 / step_s)[:, None]  # the nearer neighbour counts more
    none = np.zeros((1, 3))
    rate = weight**2 * change
    total = np.concatenate([none, rate]) + np.concatenate([rate, none])
    weights = np.concatenate([none[:, :1], weight]) + np.concatenate([weight, none[:, :1]])
    return np.asarray(total / np.where(weights > 0, weights, 1.0))
