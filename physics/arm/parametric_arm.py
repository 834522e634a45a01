"""The arm of the settings: yaw, three pitches and a roll, with inverse kinematics in closed form.

The yaw is counted to the left of the lander's forward axis, the shoulder's angle above the horizontal, and the angles
of elbow and wrist upward from the line of the previous link. With all angles at zero, the arm is stretched out forward.
The tool's pitch is the sum of the three pitches.

The lander's frame has x forward, y left, z up. Its origin is beneath the middle between the cameras, because the mast
carries the rig, and on the level of the ground under the left camera.
"""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.lander import ArmSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from .kinematics import Arm, Capsule, Joint, make_rigid_transform

#: Joints of the arm in order, named as in the settings, and the link that each moves.
JOINTS = {"yaw": "turret", "shoulder": "upper_arm", "elbow": "forearm", "wrist": "hand", "roll": "scoop"}
#: Pitch in radians of the scoop as it enters the ground: straight down.
DOWN_RAD = -math.pi / 2
#: Radii in metres of the capsules around the links: half the width of their tubes and the motors on them.
RADII_M = {"turret": 0.06, "upper_arm": 0.05, "forearm": 0.045, "hand": 0.04}

_UP, _PITCH, _ALONG = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0])


def lander_pose(settings: Settings, site_m: float = 0.0) -> Array:
    """Compute the pose (4, 4) of the lander's frame in the world; ``site_m`` is the height, m, of the ground under the
    left camera.
    """
    rig = settings.rig
    view = math.radians(rig.heading_deg)
    ahead = view + math.radians(settings.lander.turn_deg)
    half = rig.baseline_m / 2
    rotation = np.array(
        [[math.sin(ahead), -math.cos(ahead), 0.0], [math.cos(ahead), math.sin(ahead), 0.0], [0.0, 0.0, 1.0]]
    )
    return make_rigid_transform(rotation, (rig.x_m + half * math.cos(view), rig.y_m - half * math.sin(view), site_m))


def find_lengths_m(arm: ArmSettings) -> tuple[float, float, float, float]:
    """Return the lengths in metres from yaw axis to shoulder axis, of upper arm and forearm, and from wrist to scoop
    tip.
    """
    return arm.offset_m, arm.upper_m, arm.fore_m, arm.hand_m + arm.scoop_length_m


def make_parametric_arm(settings: Settings, site_m: float = 0.0) -> Arm:
    """Make the parametric arm of complete settings; ``site_m`` is the height, m, of the ground under the left camera.

    The hand turns about its own axis, on which the tip lies, so a roll does not move the tip.
    """
    arm = settings.arm
    offset, upper, fore, _ = find_lengths_m(arm)
    places = ((0.0, 0.0, 0.0), (offset, 0.0, 0.0), (upper, 0.0, 0.0), (fore, 0.0, 0.0), (arm.hand_m, 0.0, 0.0))
    axes = (_UP, _PITCH, _PITCH, _PITCH, _ALONG)
    joints = tuple(
        Joint(
            name,
            link,
            k - 1,
            make_rigid_transform(place=place),
            axis,
            math.radians(arm[f"{name}_low_deg"]),
            math.radians(arm[f"{name}_high_deg"]),
        )
        for k, ((name, link), place, axis) in enumerate(zip(JOINTS.items(), places, axes, strict=True))
    )
    shoulder = make_rigid_transform(place=(arm.shoulder_x_m, arm.shoulder_y_m, arm.shoulder_z_m))
    return Arm(
        joints,
        lander_pose(settings, site_m) @ shoulder,
        np.array([arm.scoop_length_m, 0.0, 0.0]),
        _make_capsules(arm),
        find_lengths_m(arm),
    )


def _make_capsules(arm: ArmSettings) -> tuple[Capsule, ...]:
    """Make the capsules around the links of the arm."""
    radius = (arm.scoop_depth_m if arm.scoop_depth_m < arm.scoop_length_m else arm.scoop_length_m) / 2
    aside = max(arm.scoop_width_m / 2 - radius, 0.0)
    scoop = [
        Capsule(
            4, (radius, y, -arm.scoop_depth_m / 2), (arm.scoop_length_m - radius, y, -arm.scoop_depth_m / 2), radius
        )
        for y in sorted({-aside, aside})
    ]
    ends = {"turret": arm.offset_m, "upper_arm": arm.upper_m, "forearm": arm.fore_m, "hand": arm.hand_m}
    return (
        *(
            Capsule(k, (0.0, 0.0, 0.0), (length, 0.0, 0.0), RADII_M[link])
            for k, (link, length) in enumerate(ends.items())
        ),
        *scoop,
    )


def read_commanded_rad(arm: ArmSettings) -> Array:
    """Read the commanded angles (5,) of the joints in radians."""
    return np.radians([float(arm[f"{name}_deg"]) for name in JOINTS])


def find_real_angles_rad(arm: ArmSettings) -> Array:
    """Return the actual angles (5,) of the joints in radians: the commanded angle plus the fault of each joint."""
    return read_commanded_rad(arm) + np.radians([float(arm[f"{name}_offset_deg"]) for name in JOINTS])


def _wrap_angle(angle: Array) -> Array:
    """Wrap angles in radians to the range from -π to π."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


def solve_inverse_kinematics(
    arm: Arm, x: Numbers, y: Numbers, z: Numbers, pitch: Numbers = DOWN_RAD
) -> tuple[Array, Array]:
    """Find both joint solutions (2, ..., 5) in radians, elbow up first, that put the tip at world points in metres.

    Also return the margin (2, ...) of each solution: the smallest distance in radians of a joint to its limits,
    negative beyond them. Solutions and margins are NaN out of reach. ``pitch`` is the tool's angle above the
    horizontal; the roll is 0. The arguments have shapes that broadcast.
    """
    offset, upper, fore, hand = arm.lengths_m
    x, y, z, pitch = np.broadcast_arrays(*(np.asarray(each, np.float64) for each in (x, y, z, pitch)))
    place = np.linalg.inv(arm.base)
    px, py, pz = (place[k, 0] * x + place[k, 1] * y + place[k, 2] * z + place[k, 3] for k in range(3))
    # Position of the wrist from the shoulder's axis, in the vertical plane of the arm.
    out, up = np.hypot(px, py) - offset - hand * np.cos(pitch), pz - hand * np.sin(pitch)
    with np.errstate(invalid="ignore"):
        bend = np.arccos((out**2 + up**2 - upper**2 - fore**2) / (2 * upper * fore))
    yaw, found = np.arctan2(py, px), []
    for elbow in (-bend, bend):
        shoulder = np.arctan2(up, out) - np.arctan2(fore * np.sin(elbow), upper + fore * np.cos(elbow))
        wrist = _wrap_angle(pitch - shoulder - elbow)
        found.append(np.stack([yaw + 0 * elbow, _wrap_angle(shoulder), elbow, wrist, 0 * elbow], axis=-1))
    joints = np.stack(found)
    margins = np.minimum(joints - arm.low, arm.high - joints)[..., :4].min(axis=-1)
    return joints, margins


def choose_inverse_solution(arm: Arm, x: Numbers, y: Numbers, z: Numbers, pitch: Numbers = DOWN_RAD) -> Array:
    """Find the angles (..., 5) in radians that put the tip at world points in metres; NaN out of reach or beyond a
    limit. Of two solutions, the one farther from the limits is chosen. Points may be NaN.
    """
    joints, margins = solve_inverse_kinematics(arm, x, y, z, pitch)
    best = (np.nan_to_num(margins[1], nan=-np.inf) > np.nan_to_num(margins[0], nan=-np.inf))[..., None]
    chosen, margin = np.where(best, joints[1], joints[0]), np.where(best[..., 0], margins[1], margins[0])
    return np.where((margin >= 0)[..., None], chosen, np.nan)


def find_joint_margin(arm: Arm, x: Numbers, y: Numbers, z: Numbers, pitch: Numbers = DOWN_RAD) -> Array:
    """Find the smallest distance, rad, of a joint to its limits with the tip at world points, m; NaN out of reach. It
    is negative if a joint would exceed its limit. Of two solutions, the one with the larger distance counts.
    """
    return np.asarray(solve_inverse_kinematics(arm, x, y, z, pitch)[1].max(axis=0))
