"""Poses in a bag of ROS 1 or 2, in the order of time. Needs the package rosbags, not ROS."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.trajectories import MOST_POSES
from ...physics.camera.rotations import from_quaternion
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import shorten
from ...support.foreign_bytes import explain_errors
from ...support.suggestions import suggest_nearest

_TRANSFORMS_TYPE = "tf2_msgs/msg/TFMessage"
#: Types of messages with a pose, and the attributes that lead to it.
_POSE_PATHS = {
    "geometry_msgs/msg/PoseStamped": ("pose",),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose", "pose"),
    "nav_msgs/msg/Odometry": ("pose", "pose"),
    "geometry_msgs/msg/TransformStamped": ("transform",),
    _TRANSFORMS_TYPE: ("transform",),
}
_NANOSECOND_S = Decimal("1e-9")


def read_bag_poses(bag: Path, topic: str = "", frame: str = "") -> tuple[list[Decimal], list[Array]]:
    """The stamps in seconds, and the poses (4, 4) of a moving frame, of a topic in a bag.

    ``topic`` may be empty if only one topic has poses. ``frame`` names the moving frame if a topic has several, as /tf
    does. Raises IcyMoonError for a bag without poses.
    """
    if importlib.util.find_spec("rosbags") is None:
        raise IcyMoonError('Bags are read by the package rosbags; pip install "icymoon[ros]".')
    if not bag.exists():
        raise IcyMoonError(f"{bag} is missing; give a bag of ROS 1 (a file) or of ROS 2 (its folder).")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with (
        explain_errors(bag, "a bag", "give a bag of ROS 1 (a file) or of ROS 2 (its folder)"),
        AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader,
    ):
        there = {each.topic: each for each in reader.connections if each.msgtype in _POSE_PATHS}
        chosen = _choose(bag, "topic", topic, list(there))
        found: dict[str, dict[Decimal, Array]] = {}
        for connection, _, raw in reader.messages([each for each in reader.connections if each.topic == chosen]):
            for name, stamp, pose in _read_message(reader.deserialize(raw, connection.msgtype), connection.msgtype):
                found.setdefault(name, {})[stamp] = pose
                if len(found[name]) > MOST_POSES:
                    raise IcyMoonError(f"{bag}: {chosen} has more than {MOST_POSES} poses; cut it into several bags.")
    poses = found[_choose(bag, "frame", frame, list(found))]
    stamps = sorted(poses)
    return stamps, [poses[stamp] for stamp in stamps]


def _choose(bag: Path, what: str, stated: str, there: list[str]) -> str:
    """The stated name, or the only name ``there``. Raises IcyMoonError if neither exists."""
    if stated in there:
        return stated
    if stated:
        raise IcyMoonError(f"{bag} has no {what} {shorten(stated)!r} with poses, {suggest_nearest(stated, there)}")
    if len(there) != 1:
        listed = ", ".join(map(shorten, there[:20]))
        raise IcyMoonError(
            f"{bag} has poses of several {what}s; give one of {listed} with --{what}."
            if there
            else f"{bag} has no poses; record a topic of one of {', '.join(_POSE_PATHS)}."
        )
    return there[0]


def _read_message(message: Any, kind: str) -> Iterator[tuple[str, Decimal, Array]]:
    """The moving frame, the stamp and the pose of each pose in a message."""
    for each in message.transforms if kind == _TRANSFORMS_TYPE else [message]:
        stamp = each.header.stamp
        value = each
        for name in _POSE_PATHS[kind]:
            value = getattr(value, name)
        moved = kind in (_TRANSFORMS_TYPE, "geometry_msgs/msg/TransformStamped")
        place, turn = (value.translation, value.rotation) if moved else (value.position, value.orientation)
        pose = np.eye(4)
        pose[:3, :3] = from_quaternion(np.array([turn.w, turn.x, turn.y, turn.z]))
        pose[:3, 3] = place.x, place.y, place.z
        yield (
            getattr(each, "child_frame_id", ""),
            (Decimal(int(stamp.sec)) + Decimal(int(stamp.nanosec)) * _NANOSECOND_S).quantize(_NANOSECOND_S),
            pose,
        )
