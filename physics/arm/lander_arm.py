"""The lander's arm, parametric or the user's own: one way to ask for its kinematics, its joints and its solids."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array
from . import parametric
from .kinematics import Arm, pose
from .lander_solids import Keypoint, arm_keypoints, arm_solids, still_keypoints, still_solids
from .own_arm import arm_of_file, commanded, own_arm
from .parametric import JOINTS, commanded_rad, lander_pose, real_rad
from .solids import Solid

NONE, OWN = "NONE", "OWN"


def is_own(settings: Settings) -> bool:
    """Whether the arm is from the user's file."""
    return settings.lander.kind == OWN


def arm_of(settings: Settings, site_m: float = 0.0) -> Arm:
    """The arm of complete settings; ``site_m`` is the height in metres of the ground under the left camera.

    Raises IcyMoonError if the user's own file cannot be used.
    """
    if not is_own(settings):
        return parametric.arm_of(settings, site_m)
    arm = settings.arm
    return arm_of_file(
        own_arm(settings),
        lander_pose(settings, site_m) @ pose(place=(arm.shoulder_x_m, arm.shoulder_y_m, arm.shoulder_z_m)),
    )


def joint_values(settings: Settings) -> Array:
    """Values of all joints of ``arm_of`` in radians, or metres of joints that slide, faults included."""
    if not is_own(settings):
        return real_rad(settings.arm)
    own = own_arm(settings)
    return own.values(commanded(own, settings.lander.joints))


def joint_facts(settings: Settings) -> dict[str, list[object]]:
    """Names of the joints that move, their real and commanded angles in degrees (metres of those that slide), and
    of another arm than ours the unit of each."""
    if not is_own(settings):
        return {
            "joints": list(JOINTS),
            "joints_deg": np.degrees(real_rad(settings.arm)).tolist(),
            "commanded_deg": np.degrees(commanded_rad(settings.arm)).tolist(),
        }
    own = own_arm(settings)
    slides = [own.slides(name) for name in own.names]
    angles = commanded(own, settings.lander.joints)
    shown = [float(value) if slid else float(np.degrees(value)) for value, slid in zip(angles, slides, strict=True)]
    return {
        "joints": list(own.names),
        "joints_deg": list(shown),
        "commanded_deg": list(shown),
        "units": ["m" if slid else "deg" for slid in slides],
    }


def solids_of(settings: Settings, pads_m: Sequence[float] = (0.0, 0.0)) -> dict[str, Solid]:
    """The solid of each link by name, in its own frame: first the still links, without the cameras' head, then the arm.

    ``pads_m`` are the heights of the ground under the left and the right pad over the level of the lander's frame.
    """
    return {
        **still_solids(settings, pads_m),
        **(own_arm(settings).solids if is_own(settings) else arm_solids(settings.arm)),
    }


def keypoints_of(settings: Settings, pads_m: Sequence[float] = (0.0, 0.0)) -> list[Keypoint]:
    """The points whose pixels are recorded. Of the user's own arm: the origin of each joint whose link is seen."""
    if not is_own(settings):
        return [*arm_keypoints(settings.arm), *still_keypoints(settings.lander, pads_m)]
    own = own_arm(settings)
    radii = {capsule.link: capsule.radius_m for capsule in own.capsules}
    return [
        *(
            (joint.name, joint.link, np.zeros(3), radii[k])
            for k, joint in enumerate(own.joints)
            if joint.name and k in radii
        ),
        *still_keypoints(settings.lander, pads_m),
    ]
