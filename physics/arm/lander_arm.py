"""The lander's arm, parametric or from the user's file: its kinematics, joint values, solids and keypoints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array
from . import parametric_arm
from .kinematics import Arm, make_rigid_transform
from .lander_solids import Keypoint, list_arm_keypoints, list_still_keypoints, make_arm_solids, make_still_solids
from .own_arm import load_users_arm, make_arm_at, parse_commanded
from .parametric_arm import JOINTS, find_real_angles_rad, lander_pose, read_commanded_rad
from .solids import Solid

NONE, OWN = "NONE", "OWN"


def is_users_arm(settings: Settings) -> bool:
    """Return whether the arm is from the user's file."""
    return settings.lander.kind == OWN


def make_arm(settings: Settings, site_m: float = 0.0) -> Arm:
    """Make the arm of complete settings; ``site_m`` is the height in metres of the ground under the left camera.

    Raises IcyMoonError if the user's file cannot be used.
    """
    if not is_users_arm(settings):
        return parametric_arm.make_parametric_arm(settings, site_m)
    arm = settings.arm
    return make_arm_at(
        load_users_arm(settings),
        lander_pose(settings, site_m)
        @ make_rigid_transform(place=(arm.shoulder_x_m, arm.shoulder_y_m, arm.shoulder_z_m)),
    )


def joint_values(settings: Settings) -> Array:
    """Find the actual values of all joints of ``make_arm``, faults included, in radians, or metres for joints that
    slide.
    """
    if not is_users_arm(settings):
        return find_real_angles_rad(settings.arm)
    own = load_users_arm(settings)
    return own.values(parse_commanded(own, settings.lander.joints))


def describe_joints(settings: Settings) -> dict[str, list[object]]:
    """Describe the moving joints: names, and actual and commanded values in degrees (metres for joints that slide). For
    a user's arm, also give the unit of each joint.
    """
    if not is_users_arm(settings):
        return {
            "joints": list(JOINTS),
            "joints_deg": np.degrees(find_real_angles_rad(settings.arm)).tolist(),
            "commanded_deg": np.degrees(read_commanded_rad(settings.arm)).tolist(),
        }
    own = load_users_arm(settings)
    slides = [own.slides(name) for name in own.names]
    angles = parse_commanded(own, settings.lander.joints)
    shown = [float(value) if slid else float(np.degrees(value)) for value, slid in zip(angles, slides, strict=True)]
    return {
        "joints": list(own.names),
        "joints_deg": list(shown),
        "commanded_deg": list(shown),
        "units": ["m" if slid else "deg" for slid in slides],
    }


def make_solids(settings: Settings, pads_m: Sequence[float] = (0.0, 0.0)) -> dict[str, Solid]:
    """Make the solid of each link by name, in the link's frame: first the links that do not move, then the arm. The
    camera housing is left out. ``pads_m`` are the ground heights in metres under the left and the right pad, above the
    level of the lander's frame.
    """
    return {
        **make_still_solids(settings, pads_m),
        **(load_users_arm(settings).solids if is_users_arm(settings) else make_arm_solids(settings.arm)),
    }


def list_keypoints(settings: Settings, pads_m: Sequence[float] = (0.0, 0.0)) -> list[Keypoint]:
    """List the points whose pixels are recorded. For a user's arm, they include the origin of each joint whose link is
    visible.
    """
    if not is_users_arm(settings):
        return [*list_arm_keypoints(settings.arm), *list_still_keypoints(settings.lander, pads_m)]
    own = load_users_arm(settings)
    radii = {capsule.link: capsule.radius_m for capsule in own.capsules}
    return [
        *(
            (joint.name, joint.link, np.zeros(3), radii[k])
            for k, joint in enumerate(own.joints)
            if joint.name and k in radii
        ),
        *list_still_keypoints(settings.lander, pads_m),
    ]
