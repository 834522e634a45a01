"""Poses of a camera over time: how it moves between them, and the same poses in other axes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Decimal

import numpy as np

from ...support.arrays import Array
from .rotations import to_vector

#: Columns are the axes x right, y down, z forward of a camera in the axes that a file's rotations are of.
CAMERA_IN = {
    "OPENCV": np.eye(3),  # x right, y down, z forward
    "OPENGL": np.diag([1.0, -1.0, -1.0]),  # x right, y up, z backward; Blender's too
    "ROS": np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),  # x forward, y left, z up
}
#: East, north, up as rows, in the world axes of a file.
WORLD_IN = {
    "ENU": np.eye(3),
    "NED": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
}
#: Stamps have nine decimals.
_NANOSECOND = Decimal("1e-9")
#: A step in time longer than this multiple of the median one is a gap, if nothing else is stated.
_GAP_STEPS = 5.0


@dataclass(frozen=True)
class PoseSequence:
    """Poses in the order of time: ``position_m`` (n, 3), ``rotation`` (n, 3, 3) with columns x right, y down, z forward
    of the camera in world axes, ``stamp`` in seconds with all decimals, and the ``line`` of each in its file."""

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
        """Each ``step``-th pose, from the first on."""
        return PoseSequence(self.position_m[::step], self.rotation[::step], self.stamp[::step], self.line[::step])

    def at_rate(self, rate_hz: float) -> PoseSequence:
        """The same poses at a constant rate, from zero seconds on."""
        stamps = tuple((Decimal(k) / Decimal(repr(rate_hz))).quantize(_NANOSECOND) for k in range(len(self)))
        return replace(self, stamp=stamps)

    def placed(self, world: Array, origin_m: Array) -> PoseSequence:
        """The same poses in other world axes, the rows of ``world`` (3, 3), from ``origin_m`` (3,) in these ones."""
        return replace(self, position_m=(self.position_m - origin_m) @ world.T, rotation=world @ self.rotation)

    def from_first(self, pose: Array) -> PoseSequence:
        """The same path, begun at another ``pose`` (4, 4) of the camera."""
        first = self.rotation[0]
        return replace(
            self,
            position_m=(self.position_m - self.position_m[0]) @ first @ pose[:3, :3].T + pose[:3, 3],
            rotation=pose[:3, :3] @ first.T @ self.rotation,
        )

    def gaps(self, longest_s: float | None = None) -> Array:
        """Whether the camera's motion is unknown from one pose to the next (n - 1,): more than ``longest_s`` lie
        between, by default five median steps."""
        steps = np.diff(self.seconds)
        if longest_s is None:
            longest_s = _GAP_STEPS * float(np.median(steps)) if len(steps) else 0.0
        return np.asarray(steps > longest_s)

    def motion(self, longest_s: float | None = None) -> tuple[Array, Array]:
        """Velocity in m/s and rotation vector in rad/s, (n, 3) each, in the axes of the camera at each pose.

        The parabola through a pose and its neighbours gives them; beside an end or a gap, see ``gaps``, the straight
        line to the one neighbour. A pose between two gaps stands still.
        """
        steps, gaps = np.diff(self.seconds), self.gaps(longest_s)
        moved = np.diff(self.position_m, axis=0)
        turned = [
            # The axis of the turn is the same in the axes before and after it.
            to_vector(before.T @ after)
            for before, after in zip(self.rotation[:-1], self.rotation[1:], strict=True)
        ]
        return (
            np.einsum("nji,nj->ni", self.rotation, _rates(moved, steps, gaps)),
            _rates(np.array(turned).reshape(-1, 3), steps, gaps),
        )


def _rates(change: Array, step_s: Array, gaps: Array) -> Array:
    """Rates (n, 3) at n poses of changes (n - 1, 3) from each to the next."""
    weight = np.where(gaps, 0.0, 1.0 / step_s)[:, None]  # the nearer neighbour counts more
    none = np.zeros((1, 3))
    rate = weight**2 * change
    total = np.concatenate([none, rate]) + np.concatenate([rate, none])
    weights = np.concatenate([none[:, :1], weight]) + np.concatenate([weight, none[:, :1]])
    return np.asarray(total / np.where(weights > 0, weights, 1.0))
