"""The ``[[sweep]]`` tables of a plan that follow a trajectory from a file, with a pair for each pose. Imports no
Blender.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.trajectories import TRAJECTORY_KINDS, Trajectory, read_trajectory
from ...physics.camera.pose_sequence import CAMERA_IN, WORLD_IN, PoseSequence
from ...physics.light.directions import camera_angles, camera_axes
from ...physics.scene_checks import MIN_EYE_HEIGHT_M
from ...physics.terrain.standing_places import RockyGround
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import is_number
from ...support.files import parse_path, quote
from ...support.number_text import format_count
from ...support.suggestions import suggest_nearest
from .setting_sweeps import MAX_PAIRS, Sweep, Variation, check_keys, check_settings

KIND = "trajectory"
_TABLE_KEYS = ("file", "format", "times", "rate_hz", "every", "axes", "world", "heights", "origin_m", "gap_s")
#: Largest number of frames in a second whose stamps of nine decimals differ.
_MAX_HZ = 1e9
#: Angle above the horizon up to which a camera, or its point below, counts as level.
_LEVEL_DEG = 1.0
#: Value of ``world`` by which poses are relative to the first pose, which is put at the rig of the plan.
_RELATIVE_TO_FIRST = "FIRST"
_SPEED_KEYS = ("speed_right_m_s", "speed_down_m_s", "speed_forward_m_s")
_POSE_KEYS = ("x_m", "y_m", "height_m", "heading_deg", "pitch_deg", "roll_deg", "height_from", "z_m", "frame", "stamp")
#: The settings that each pose sets.
SETTINGS = frozenset(f"rig.{key}" for key in _POSE_KEYS)


def make_trajectory(sweep: Sweep, base: Settings, ground: Callable[[Settings], RockyGround]) -> list[Variation]:
    """Make the cameras of a trajectory, in the order of its poses.

    With ``rig.motion_exposure_s`` or ``rig.readout_s`` each camera moves during its exposure, at the velocity between
    its neighbours. Raises IcyMoonError that names the line of the plan at fault, and the line of the trajectory.
    """
    poses, above_ground = _read_poses(sweep, base, ground)
    if len(poses) > MAX_PAIRS:
        raise IcyMoonError(
            f"{sweep.place.at('file')}: {_find_file(sweep)} has {len(poses)} poses, more than {MAX_PAIRS}; "
            "state every, such as every = 10."
        )
    procedural = base.source.kind == "PROCEDURAL"
    if procedural and base.mesh.kind == "GRADED" and len(poses) > 1:
        raise IcyMoonError(
            f"{sweep.place}: mesh.kind is GRADED, which makes triangles for one site, so each pose would see a "
            "different ground; set mesh.kind to GRID, or take ground from a file."
        )
    z = poses.position_m[:, 2]
    if above_ground:
        height = z
    elif procedural:
        height = z - ground(base).heights(*poses.position_m[:, :2].T)
    else:  # the build finds the height, and refuses places under the ground
        height = np.full(len(poses), float(base.rig.height_m))
    _check_heights(poses, height, sweep)
    is_moving = base.rig.motion_exposure_s > 0 or base.rig.readout_s > 0
    moving = _compute_velocities(sweep, poses) if is_moving else None
    made = []
    for k in range(len(poses)):
        rig = _place_rig(poses, k, float(height[k]), above_ground) | (
            _make_speed_settings(*moving[k]) if moving is not None else {}
        )
        try:
            made.append(Variation(check_settings({"rig": rig}, sweep.place), sweep.place))
        except IcyMoonError as error:
            raise IcyMoonError(f"{error} Line {poses.line[k]} of {_find_file(sweep)} sets this value.") from None
    return made


def _place_rig(poses: PoseSequence, k: int, height_m: float, above_ground: bool) -> dict[str, Any]:
    """Make the settings of a rig at pose ``k``, ``height_m`` above the ground."""
    heading, pitch, roll = camera_angles(poses.rotation[k])
    x_m, y_m, z_m = poses.position_m[k].tolist()
    return {
        "x_m": x_m,
        "y_m": y_m,
        "height_m": height_m,
        "heading_deg": heading,
        "pitch_deg": pitch,
        "roll_deg": roll,
        "height_from": "GROUND" if above_ground else "ZERO",
        "z_m": 0.0 if above_ground else z_m,
        "frame": k,
        "stamp": format(poses.stamp[k], "f"),
    }


def describe_trajectory(sweep: Sweep) -> str:
    """Describe the poses of a trajectory in a sentence. Raises IcyMoonError as ``make_trajectory`` does."""
    found, poses = _read_file(sweep)
    said = [
        f"{_find_file(sweep).name}: {format_count(len(poses), 'pose')} in {poses.seconds[-1]:.6g} s on a path of "
        f"{poses.length_m:.4g} m",
        *_describe_views(sweep, found, poses),
        *found.notes,
    ]
    gaps = np.flatnonzero(poses.gaps(_read_positive(sweep, "gap_s")))
    if len(gaps):
        first = gaps[0]
        longest = float(np.diff(poses.seconds)[gaps].max())
        said.append(
            f"{format_count(len(gaps), 'gap')} of up to {longest:.4g} s (the first after line {poses.line[first]}), "
            "where the camera is assumed to stand still"
        )
    return "; ".join(said) + "."


def _describe_views(sweep: Sweep, found: Trajectory, poses: PoseSequence) -> list[str]:
    """Describe the view directions of the cameras, which reveal wrong axes or a quaternion in another order before a
    render. Empty for poses that begin at the rig of the plan."""
    world = _find_world_axes(sweep, found)
    if world == _RELATIVE_TO_FIRST:
        return []
    up = WORLD_IN[world][2]
    # Columns of a rotation are the camera's axes x right, y down, z forward.
    down_deg = np.degrees(np.arcsin(np.clip(-(up @ poses.rotation)[:, 2], -1.0, 1.0)))
    low, high = float(down_deg.min()), float(down_deg.max())
    views = _view_text(low) if _view_text(low) == _view_text(high) else f"from {_view_text(low)} to {_view_text(high)}"
    said = [f"cameras look {views}"]
    for verb, where, wrong in (
        ("look", "above the horizon", down_deg < -_LEVEL_DEG),
        ("stand", "upside down", (up @ poses.rotation)[:, 1] > math.sin(math.radians(_LEVEL_DEG))),
    ):
        if wrong.any():
            count, first = int(wrong.sum()), poses.line[int(np.argmax(wrong))]
            said.append(f"{count} {verb}{'s' if count == 1 else ''} {where} (the first in line {first})")
    return [*said, "check axes, world and the order in quaternions"] if len(said) > 1 else said


def _view_text(down_deg: float) -> str:
    rounded = round(down_deg) or 0
    return f"{abs(rounded)} degrees {'up' if rounded < 0 else 'down'}"


def _find_world_axes(sweep: Sweep, found: Trajectory) -> str:
    return _read_choice(
        sweep, "world", (*WORLD_IN, _RELATIVE_TO_FIRST), _RELATIVE_TO_FIRST if found.kind == "KITTI" else "ENU"
    )


def _read_file(sweep: Sweep) -> tuple[Trajectory, PoseSequence]:
    """Read the trajectory file of a sweep. Return its content, and its poses in the file's axes, thinned out and with
    the stamps as the plan states."""
    check_keys(sweep.table, _TABLE_KEYS, sweep.place, "a trajectory sweep")
    axes, kind = _read_choice(sweep, "axes", CAMERA_IN, "OPENCV"), _read_choice(sweep, "format", TRAJECTORY_KINDS, "")
    times = _read_path(sweep, "times") if "times" in sweep.table else None
    every, rate = _read_positive(sweep, "every", 1.0), _read_positive(sweep, "rate_hz")
    if every is None or every < 1 or every != int(every):
        raise IcyMoonError(f"{sweep.place.at('every')}: every is {quote(every)}, it must be a whole number from 1 up.")
    if rate is not None and rate > _MAX_HZ:
        raise IcyMoonError(
            f"{sweep.place.at('rate_hz')}: rate_hz is {rate:g}, more than {_MAX_HZ:g}, since stamps have nine "
            "decimals; lower it."
        )
    try:
        found = read_trajectory(_find_file(sweep), kind, times, CAMERA_IN[axes])
    except IcyMoonError as error:
        raise IcyMoonError(f"{sweep.place.at('file')}: {error}") from None
    poses = found.poses.at_rate(rate) if rate is not None else found.poses
    if not found.stamped and rate is None and len(poses) > 1:
        raise IcyMoonError(
            f"{sweep.place.at('file')}: {_find_file(sweep)} has no stamps; state times, a file of stamps, or rate_hz."
        )
    poses = poses.every(int(every))
    late = np.flatnonzero(np.diff(poses.seconds) <= 0)
    if len(late):
        k = int(late[0])
        same = poses.stamp[k] == poses.stamp[k + 1]
        what = f"lines {poses.line[k]} and {poses.line[k + 1]} of {_find_file(sweep)}"
        raise IcyMoonError(
            f"{sweep.place.at('file')}: {what} {'have the same stamp' if same else 'are not in the order of time'} "
            f"({poses.stamp[k + 1]:f} s); correct it, or state rate_hz, which takes the place of the stamps."
        )
    return found, poses


def _read_poses(sweep: Sweep, base: Settings, ground: Callable[[Settings], RockyGround]) -> tuple[PoseSequence, bool]:
    """Read the poses, in the axes and from the origin of the site. Return them, and whether their heights are above the
    ground."""
    found, poses = _read_file(sweep)
    world = _find_world_axes(sweep, found)
    heights = _read_choice(sweep, "heights", ("ZERO", "GROUND"), "ZERO")
    if world == _RELATIVE_TO_FIRST:
        for key in ("heights", "origin_m"):
            if key in sweep.table:
                raise IcyMoonError(
                    f"{sweep.place.at(key)}: with world = {quote(_RELATIVE_TO_FIRST)} the first pose is the pose of "
                    f"the rig; leave {key} out."
                )
        return poses.from_first(_make_rig_pose(sweep, base, ground)), False
    origin = sweep.table.get("origin_m", [0.0, 0.0, 0.0])
    if not isinstance(origin, list) or len(origin) != 3 or not all(map(is_number, origin)):
        raise IcyMoonError(f"{sweep.place.at('origin_m')}: origin_m is {quote(origin)}, but must be three numbers.")
    return poses.placed(WORLD_IN[world], np.array(origin, float)), heights == "GROUND"


def _make_rig_pose(sweep: Sweep, base: Settings, ground: Callable[[Settings], RockyGround]) -> Array:
    """Return the pose (4, 4) of the plan's rig."""
    rig = base.rig
    if rig.height_from == "ZERO":
        z = float(rig.z_m)
    elif base.source.kind == "PROCEDURAL":
        z = float(ground(base).heights(rig.x_m, rig.y_m)) + float(rig.height_m)
    else:
        raise IcyMoonError(
            f"{sweep.place}: the height of ground from a file is not known here, so the first pose has none; set "
            "rig.height_from to ZERO and state rig.z_m."
        )
    pose = np.eye(4)
    pose[:3, :3] = camera_axes(rig.heading_deg, rig.pitch_deg, rig.roll_deg)
    pose[:3, 3] = rig.x_m, rig.y_m, z
    return pose


def _check_heights(poses: PoseSequence, height_m: Array, sweep: Sweep) -> None:
    """Raise IcyMoonError for a pose beyond the ground or below it."""
    wrong = np.flatnonzero(~(height_m >= MIN_EYE_HEIGHT_M))
    if not len(wrong):
        return
    k = int(wrong[0])
    others = f", as {format_count(len(wrong) - 1, 'other')}" if len(wrong) > 1 else ""
    x, y, z = poses.position_m[k]
    at = f"{sweep.place.at('file')}: line {poses.line[k]} of {_find_file(sweep)}, east {x:.6g} m, north {y:.6g} m"
    if np.isfinite(height_m[k]):
        raise IcyMoonError(
            f"{at}, up {z:.6g} m, is {-height_m[k]:.3g} m under the ground{others}; state where the site's zero is in "
            "the file with origin_m, or heights = 'GROUND' if its heights are above the ground."
        )
    raise IcyMoonError(
        f"{at}, is beyond the ground{others}; raise terrain.size_m, or state where the site's zero is in the file with "
        "origin_m."
    )


def _compute_velocities(sweep: Sweep, poses: PoseSequence) -> list[tuple[Array, Array]]:
    return list(zip(*poses.motion(_read_positive(sweep, "gap_s")), strict=True))


def _make_speed_settings(velocity_m_s: Array, turn_rad_s: Array) -> dict[str, float]:
    """Make the settings of a motion; both vectors are in the camera's axes x right, y down, z forward."""
    x, y, z = np.degrees(turn_rad_s).tolist()
    turns = {"turn_right_deg_s": y, "turn_down_deg_s": -x, "roll_deg_s": z}
    return {**dict(zip(_SPEED_KEYS, velocity_m_s.tolist(), strict=True)), **turns}


def _find_file(sweep: Sweep) -> Path:
    if "file" not in sweep.table:
        raise IcyMoonError(f"{sweep.place}: a trajectory sweep lacks file, the poses to follow; name it.")
    return _read_path(sweep, "file")


def _read_path(sweep: Sweep, key: str) -> Path:
    value, place = sweep.table[key], sweep.place.at(key)
    if not isinstance(value, str) or not value:
        raise IcyMoonError(f"{place}: {key} is {quote(value)}, but must be the name of a file in quotes.")
    return place.file.parent / parse_path(value, f"{place}: {key}")


def _read_positive(sweep: Sweep, key: str, default: float | None = None) -> float | None:
    """Read a number above 0 that a sweep may state."""
    value = sweep.table.get(key, default)
    if value is None:
        return None
    if not is_number(value) or value <= 0:
        raise IcyMoonError(f"{sweep.place.at(key)}: {key} is {quote(value)}, but must be a number above 0.")
    return float(value)


def _read_choice(sweep: Sweep, key: str, names: Iterable[str], default: str) -> str:
    value, names = sweep.table.get(key, default), list(names)
    if value not in (default, *names):
        raise IcyMoonError(f"{sweep.place.at(key)}: {key} is {quote(value)}, {suggest_nearest(str(value), names)}")
    return str(value)
