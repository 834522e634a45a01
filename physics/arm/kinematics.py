"""Forward kinematics of an arm by the product of exponentials, in float64.

The link after joint i is at exp([S_1] q_1) ... exp([S_i] q_i) M_i, where S is the screw of a joint and M the pose of
the link at zero angles, both in the arm's own frame (Lynch and Park 2017, *Modern Robotics*, chapter 4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array


@dataclass(frozen=True)
class Joint:
    """A joint and the link that it moves.

    ``parent`` is the index of the joint before it, -1 for the base. ``origin`` (4, 4) is the pose of the link at value
    0 in the frame of the link before it. ``axis`` (3,) is the unit vector, in the link's frame, about which the link
    rotates or along which it slides. The limits ``low`` and ``high`` are in radians, or metres for a joint that slides.
    """

    name: str
    link: str
    parent: int
    origin: Array
    axis: Array
    low: float = -np.pi
    high: float = np.pi
    slides: bool = False


@dataclass(frozen=True)
class Capsule:
    """All points within ``radius_m`` of the line from ``start`` to ``end`` (3,), in the frame of a link.

    ``link`` is the index of the joint that moves it, -1 for the base.
    """

    link: int
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius_m: float


@dataclass(frozen=True)
class Arm:
    """The joints of an arm, the pose of its base, the point of its tool, and the capsules around its links.

    ``base`` (4, 4) is the pose of the base's frame in the world, and ``tip`` (3,) the tool's point in the frame of the
    last link. ``lengths_m`` are the lengths for closed inverse kinematics, which only a parametric arm has: from the
    axis of the yaw to the axis of the shoulder, upper arm, forearm, and wrist to tip. For another arm they are empty.
    """

    joints: tuple[Joint, ...]
    base: Array
    tip: Array
    capsules: tuple[Capsule, ...] = ()
    lengths_m: tuple[float, ...] = ()

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links that move, in the order of ``forward_kinematics``."""
        return tuple(joint.link for joint in self.joints)

    @property
    def low(self) -> Array:
        """Lower limits (joints,) in radians, or metres for joints that slide."""
        return np.array([joint.low for joint in self.joints])

    @property
    def high(self) -> Array:
        """Upper limits (joints,) in radians, or metres for joints that slide."""
        return np.array([joint.high for joint in self.joints])


def make_cross_matrix(axis: Array) -> Array:
    """Make the matrix (3, 3) that maps v to axis x v."""
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_about(axis: Array, angle: float) -> Array:
    """Make the rotation (3, 3) about a unit axis by an angle in radians (Rodrigues' formula)."""
    k = make_cross_matrix(axis)
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k))


def make_rigid_transform(rotation: Array | None = None, place: tuple[float, ...] | Array = (0.0, 0.0, 0.0)) -> Array:
    """Make a rigid transformation (4, 4) from a rotation (3, 3) and a translation (3,) in metres."""
    made = np.eye(4)
    made[:3, :3] = np.eye(3) if rotation is None else rotation
    made[:3, 3] = place
    return made


def _compute_zero_poses(arm: Arm) -> list[Array]:
    """Compute the pose (4, 4) of each link in the base's frame with all joints at 0."""
    found: list[Array] = []
    for joint in arm.joints:
        found.append((found[joint.parent] if joint.parent >= 0 else np.eye(4)) @ joint.origin)
    return found


def _compute_joint_motion(joint: Joint, zero: Array, angle: float) -> Array:
    """Compute the motion (4, 4) of a joint in the base's frame. ``zero`` (4, 4) is the link's pose with all joints at
    0; ``angle`` is in radians, or metres for a joint that slides.
    """
    axis = zero[:3, :3] @ joint.axis
    if joint.slides:
        return make_rigid_transform(place=axis * angle)
    rotation, point = rotation_about(axis, angle), zero[:3, 3]
    return make_rigid_transform(rotation, point - rotation @ point)


def forward_kinematics(arm: Arm, joints_rad: Array) -> Array:
    """Compute the pose of each moving link in the world, (links, 4, 4), from the joints' values (links,) in radians, or
    metres for joints that slide.

    Limits are not applied: see ``find_joints_beyond_limits``.
    """
    zeros = _compute_zero_poses(arm)
    motions: list[Array] = []
    for joint, zero, angle in zip(arm.joints, zeros, np.asarray(joints_rad, np.float64), strict=True):
        before = motions[joint.parent] if joint.parent >= 0 else np.eye(4)
        motions.append(before @ _compute_joint_motion(joint, zero, float(angle)))
    return np.stack([arm.base @ motion @ zero for motion, zero in zip(motions, zeros, strict=True)])


def find_tip(arm: Arm, joints_rad: Array) -> Array:
    """Compute the position (3,) of the tool's point in the world, in metres."""
    last = forward_kinematics(arm, joints_rad)[-1]
    return np.asarray(last[:3, :3] @ arm.tip + last[:3, 3])


def find_joints_beyond_limits(arm: Arm, joints_rad: Array) -> list[int]:
    """Find the indices of the joints whose values exceed their limits by more than rounding."""
    # Settings are stored in single precision, so a rounded angle can exceed its limit by a relative 1e-7.
    angles, slack = np.asarray(joints_rad, np.float64), 1e-6
    return [int(k) for k in np.flatnonzero((angles < arm.low - slack) | (angles > arm.high + slack))]
