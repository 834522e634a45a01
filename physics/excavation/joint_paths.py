"""The path of a scoop from recorded angles of the arm's joints, by the arm's forward kinematics.

Heights are absolute here, because the arm stands on the level of the ground under the left camera. Depths therefore
count from that level, not from the plane of the untouched ground.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import read_number_lines
from ...support.files import absolute_path
from ..arm.kinematics import Arm, Joint, find_joints_beyond_limits, find_tip
from ..arm.lander_arm import is_users_arm, make_arm
from ..arm.own_arm import UrdfArm, load_users_arm
from ..terrain.standing_places import make_rocky_ground
from .scoop_cut import Pull
from .scoop_paths import MAX_PLACES, make_pulls_through

#: Largest step in degrees (or centimetres) of a joint. Joints turn evenly between two recorded lines.
_JOINT_STEP_DEG = 1.0
#: A pull counts if the blade comes nearer to the ground than this, in metres, because it may cut between its ends.
_NEAR_GROUND_M = 0.02


def make_joint_pulls(settings: Settings) -> tuple[list[list[Pull]], float]:
    """Make the pulls of each state after the first, with depths below the level of the ground under the left camera.
    Also return the greatest depth in metres of the blade below the untouched ground. Raises IcyMoonError, with the
    line, for lines that cannot be read and for joints beyond their limits.
    """
    path = absolute_path(settings.excavation.file, "excavation.file")
    arm = make_arm(settings)
    own = load_users_arm(settings) if is_users_arm(settings) else None
    table = _read_joints(path, arm, own)
    states, width = int(settings.excavation.states), float(settings.excavation.width_m)
    if (beyond := table[:, 0].max()) >= states:
        raise IcyMoonError(
            f"{path}: has a state {beyond:g}, but excavation.states is {states}, so the last state is "
            f"{states - 1}; raise excavation.states."
        )
    poses = [_interpolate_poses(table[table[:, 0] == state, 1:]) for state in range(1, states)]
    if (places := sum(map(len, poses))) > MAX_PLACES:
        raise IcyMoonError(
            f"{path}: its joints turn so far that the blade has {places} places, a degree apart, more "
            f"than {MAX_PLACES}; keep the poses in which it digs."
        )
    made = [make_pulls_through(_find_tip_places(arm, own, each), width) for each in poses]
    if not any(made):
        raise IcyMoonError(f"{path}: has no state from 1 in which the scoop's tip moves; give the joints of its path.")
    return keep_near_ground(settings, made)


def keep_near_ground(settings: Settings, pulls: list[list[Pull]]) -> tuple[list[list[Pull]], float]:
    """Keep the pulls that come near the untouched ground, or all pulls if none does. Also return the blade's greatest
    depth in metres below that ground.

    On its way to the trench the scoop digs nothing, so the fine mesh need not reach there.
    """
    ground, rig = make_rocky_ground(settings), settings.rig
    level = float(ground.heights(np.array([rig.x_m]), np.array([rig.y_m]))[0])

    def below_m(pull: Pull) -> float:
        x, y = np.array([pull.point(float(along), 0.0) for along in pull.along_m]).T
        return float(np.nanmax(pull.depth_m + ground.heights(x, y) - level, initial=-math.inf))

    depths = {id(pull): below_m(pull) for each in pulls for pull in each}
    kept = [[pull for pull in each if depths[id(pull)] > -_NEAR_GROUND_M] for each in pulls]
    return kept if any(kept) else pulls, max(depths.values())


def _read_joints(path: Path, arm: Arm, own: UrdfArm | None) -> Array:
    """Read the state and the values of the moving joints (n, 1 + joints), in radians or metres."""
    moving = [joint for joint in arm.joints if own is None or joint.name in own.names]
    columns = ("state", *(f"{joint.name}_m" if joint.slides else f"{joint.name}_deg" for joint in moving))
    rows = []
    for number, row in read_number_lines(path, columns, "excavation.file", MAX_PLACES):
        if row is None or not all(map(math.isfinite, row)) or row[0] < 1 or row[0] != int(row[0]):
            raise IcyMoonError(
                f"{path}: line {number} is not a pose of the arm; give a whole state from 1, and "
                f"{', '.join(columns[1:])}."
            )
        values = np.array(
            [value if joint.slides else math.radians(value) for value, joint in zip(row[1:], moving, strict=True)]
        )
        joints = values if own is None else own.values(values)
        for k in find_joints_beyond_limits(arm, joints):
            raise IcyMoonError(
                f"{path}: line {number} puts the joint {_describe_limit(arm.joints[k], float(joints[k]))}; "
                "correct the line or the limits."
            )
        rows.append([row[0], *values])
    if not rows:
        raise IcyMoonError(f"{path}: has no line of numbers; give the joints of the scoop's path.")
    return np.array(rows)


def _describe_limit(joint: Joint, value: float) -> str:
    unit, scale = (" m", 1.0) if joint.slides else ("°", 180.0 / math.pi)
    return (
        f"{joint.name} at {scale * value:.4g}{unit}, but its limits are {scale * joint.low:.4g}{unit} to "
        f"{scale * joint.high:.4g}{unit}"
    )


def _interpolate_poses(rows: Array) -> Array:
    """Return the joints (k, joints) of recorded poses (n, joints), with poses in steps of a degree between them."""
    steps = [rows[:1]]
    for a, b in itertools.pairwise(rows):
        count = max(1, math.ceil(float(np.degrees(np.abs(b - a)).max()) / _JOINT_STEP_DEG))
        steps.append(a + np.linspace(0.0, 1.0, count + 1)[1:, None] * (b - a))
    return np.concatenate(steps)


def _find_tip_places(arm: Arm, own: UrdfArm | None, poses: Array) -> list[Array]:
    """Find the east, north and depth (3,) in metres of the tip in each pose."""
    tips = [find_tip(arm, values if own is None else own.values(values)) for values in poses]
    return [tip * (1.0, 1.0, -1.0) for tip in tips]
