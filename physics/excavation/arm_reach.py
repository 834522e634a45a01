"""Reach of the lander's arm: whether it reaches the trench, and a place in reach to which the trench can move."""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ..arm.kinematics import Arm
from ..arm.lander_arm import is_users_arm, make_arm
from ..arm.parametric_arm import find_joint_margin
from .dig_site import is_dug, make_site
from .scoop_cut import Pull
from .scoop_paths import JOINTS, RECORDED

#: Number of places along a pull that are tested.
_PLACES_OF_PULL = 9
#: Step in metres of the moves of a trench that are tried.
_MOVE_STEP_M = 0.02
#: Largest move in metres.
_FARTHEST_MOVE_M = 3.0
#: Directions from the yaw axis in which a trench is placed, in degrees from the direction of its present middle.
_TURNS_DEG = (0.0, 15.0, -15.0, 30.0, -30.0, 60.0, -60.0, 90.0, -90.0)


def compute_share_in_reach(arm: Arm, pulls: list[Pull], east_m: float = 0.0, north_m: float = 0.0) -> float:
    """Compute the share of the blade's positions that the arm reaches with the scoop straight down, on pulls moved by
    ``east_m`` and ``north_m``. The ground is assumed to be level at height 0.
    """
    places = [
        (*pull.point(along, 0.0), -depth) for pull in pulls for along, depth in zip(*_sample_pull(pull), strict=True)
    ]
    x, y, z = np.array(places).T
    return float((np.nan_to_num(find_joint_margin(arm, x + east_m, y + north_m, z), nan=-1.0) >= 0.0).mean())


def _sample_pull(pull: Pull) -> tuple[Array, Array]:
    """Sample distances along a pull and the depths there, in metres."""
    along = np.linspace(pull.along_m[0], pull.along_m[-1], _PLACES_OF_PULL)
    return along, np.interp(along, pull.along_m, pull.depth_m)


def advise_on_reach(settings: Settings) -> list[str]:
    """Return a sentence, in a list, if the lander's arm does not reach all of the trench on level ground, with a place
    in reach; else an empty list. Nothing is checked for a user's arm, whose reach is unknown, or for recorded joints.
    Raises IcyMoonError for an excavation that cannot be dug.
    """
    if (
        not is_dug(settings)
        or settings.excavation.path == JOINTS
        or settings.lander.kind == "NONE"
        or is_users_arm(settings)
    ):
        return []
    pulls = [pull for each in make_site(settings).pulls for pull in each]
    if not pulls:
        return []
    arm = make_arm(settings)
    share = compute_share_in_reach(arm, pulls)
    if share == 1.0:
        return []
    part = "All of the trench is" if share == 0.0 else f"{100 * (1 - share):.0f} % of the trench is"
    return [
        f"{part} out of the arm's reach on level ground, with the scoop straight down; "
        f"{_describe_fix(settings, arm, pulls)}."
    ]


def _describe_fix(settings: Settings, arm: Arm, pulls: list[Pull]) -> str:
    """Describe, as a clause, how to bring the trench into reach, with a move in metres if one is enough."""
    moved = _find_move(arm, pulls)
    if moved is None:
        return "dig less deep, or lengthen arm.upper_m and arm.fore_m"
    if settings.excavation.path == RECORDED:
        return f"move the places of excavation.file by {moved[0]:.2f} m to the east and {moved[1]:.2f} m to the north"
    return (
        f"it would be in reach with excavation.start_x_m = {settings.excavation.start_x_m + moved[0]:.2f} and "
        f"excavation.start_y_m = {settings.excavation.start_y_m + moved[1]:.2f}"
    )


def _find_move(arm: Arm, pulls: list[Pull]) -> tuple[float, float] | None:
    """Find the shortest tried move (east, north), in metres to whole centimetres, that brings all pulls into reach;
    None without one.
    """
    ends = np.array([pull.point(float(along), 0.0) for pull in pulls for along in pull.along_m[[0, -1]]])
    middle = (ends.min(axis=0) + ends.max(axis=0)) / 2
    away = middle - arm.base[:2, 3]
    bearing = math.atan2(away[1], away[0])
    out = np.arange(_MOVE_STEP_M, _FARTHEST_MOVE_M, _MOVE_STEP_M)
    moves = [
        (round(float(east), 2), round(float(north), 2))
        for turn in _TURNS_DEG
        for east, north in np.stack(
            [
                arm.base[0, 3] + out * math.cos(bearing + math.radians(turn)) - middle[0],
                arm.base[1, 3] + out * math.sin(bearing + math.radians(turn)) - middle[1],
            ],
            axis=1,
        )
    ]
    return next(
        (
            move
            for move in sorted(moves, key=lambda each: math.hypot(*each))
            if compute_share_in_reach(arm, pulls, *move) == 1.0
        ),
        None,
    )
