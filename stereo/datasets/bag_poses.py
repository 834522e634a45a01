"""Reads poses from a bag of ROS 1 or 2, in the order of time. Needs the package rosbags, not ROS."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.trajectories import MAX_POSES
from ...physics.camera.rotations import from_quaternion
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import shorten
from ...support.foreign_bytes import explain_errors
from ...support.suggestions import suggest_nearest

_TRANSFORMS_TYPE = "tf2_msgs/msg/TFMessage"
#: The topic of transforms that never change: the poses of frames that are fixed to other frames.
_STATIC_TOPIC = "/tf_static"
#: Types of messages with a pose, and the attributes that lead to it.
_POSE_PATHS = {
    "geometry_msgs/msg/PoseStamped": ("pose",),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose", "pose"),
    "nav_msgs/msg/Odometry": ("pose", "pose"),
    "geometry_msgs/msg/TransformStamped": ("transform",),
    _TRANSFORMS_TYPE: ("transform",),
}
_NANOSECOND_S = Decimal("1e-9")


@dataclass
class _Frame:
    """Poses (4, 4) of a moving frame by their stamps, in the frame ``parent``."""

    parent: str
    poses: dict[Decimal, Array] = field(default_factory=dict)

    def is_static(self) -> bool:
        """Return whether all poses are equal, as in a fixed transform that is sent repeatedly."""
        first, *others = self.poses.values()
        return all(np.array_equal(first, other) for other in others)


@dataclass(frozen=True)
class BagPoses:
    """Poses (4, 4) of the frame ``frame`` in the frame ``parent``, at ``stamps`` in seconds, in the order of time.

    Both names are from the bag and may be empty.
    """

    stamps: list[Decimal]
    poses: list[Array]
    frame: str
    parent: str

    def describe(self) -> str:
        """Describe the frame of the poses and its parent frame in words."""
        return f"{self.frame or 'the poses'} in {self.parent or 'a frame without a name'}, with the axes of the bag"


def read_bag_poses(bag: Path, topic: str = "", frame: str = "") -> BagPoses:
    """Read the poses of a moving frame from a topic of a bag.

    ``topic`` may be empty if only one topic has poses. ``frame`` is the moving frame if a topic has several, as /tf
    does. A frame that is fixed to a moving frame, as a camera to a robot, moves with it. Raises IcyMoonError if the bag
    has no poses, if different poses have one stamp, or if the moving frame's parent frame moves too.
    """
    if importlib.util.find_spec("rosbags") is None:
        raise IcyMoonError('Reading bags needs the package rosbags; pip install "icymoon[ros]".')
    if not bag.exists():
        raise IcyMoonError(f"{bag} is missing; give a bag of ROS 1 (a file) or of ROS 2 (its folder).")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with (
        explain_errors(bag, "a bag", "give a bag of ROS 1 (a file) or of ROS 2 (its folder)"),
        AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader,
    ):
        there = {each.topic: each for each in reader.connections if each.msgtype in _POSE_PATHS}
        moving = [name for name in there if name != _STATIC_TOPIC] or list(there)
        chosen = _choose_name(bag, "topic", topic, list(there) if topic else moving)
        topics = {chosen, _STATIC_TOPIC} if there[chosen].msgtype == _TRANSFORMS_TYPE else {chosen}
        found: dict[str, _Frame] = {}
        fixed: set[str] = set()
        for connection, _, raw in reader.messages([each for each in reader.connections if each.topic in topics]):
            for each in _read_message(reader.deserialize(raw, connection.msgtype), connection.msgtype):
                _add_pose(found, *each)
                if connection.topic != chosen:
                    fixed.add(each[0])
                if len(found[each[0]].poses) > MAX_POSES:
                    raise IcyMoonError(f"{bag}: {chosen} has more than {MAX_POSES} poses; cut it into several bags.")
    if frame and list(found) == [""]:
        raise IcyMoonError(f"{bag}: {chosen} has poses without the name of a moving frame; leave out --frame.")
    name = _choose_name(bag, "frame", frame, list(found) if frame else [each for each in found if each not in fixed])
    base, on_base = _find_moving_frame(name, found)
    _refuse_moving_parent(bag, name, base, found)
    poses = found[base].poses
    stamps = sorted(poses)
    return BagPoses(stamps, [poses[stamp] @ on_base for stamp in stamps], name, found[base].parent)


def _add_pose(found: dict[str, _Frame], name: str, parent: str, stamp: Decimal, pose: Array) -> None:
    """Add a pose to ``found``. Raises ValueError if it contradicts the other poses of its frame."""
    frame = found.setdefault(name, _Frame(parent))
    what = shorten(name) or "its topic"
    if frame.parent != parent:
        raise ValueError(f"{what} has poses in the frames {shorten(frame.parent)!r} and {shorten(parent)!r}")
    if not np.array_equal(frame.poses.setdefault(stamp, pose), pose):
        raise ValueError(f"{what} has different poses with the stamp {stamp:f} s")


def _find_moving_frame(name: str, found: Mapping[str, _Frame]) -> tuple[str, Array]:
    """Find the moving frame to which a frame is fixed, directly or through other fixed frames.

    Return its name and the fixed frame's pose (4, 4) in it. A frame that moves itself, or has no moving ancestor, is
    returned with the unit matrix.
    """
    base, pose = name, np.eye(4)
    passed = set()
    while base in found and base not in passed and found[base].is_static():
        passed.add(base)
        pose = next(iter(found[base].poses.values())) @ pose
        base = found[base].parent
    return (base, pose) if base in found and base not in passed else (name, np.eye(4))


def _refuse_moving_parent(bag: Path, name: str, base: str, found: Mapping[str, _Frame]) -> None:
    """Raise IcyMoonError if the parent of a moving frame moves too.

    The poses are then no path over the ground.
    """
    parent, _ = _find_moving_frame(found[base].parent, found)
    if parent not in found or parent == base or found[parent].is_static():
        return
    what = f"{shorten(name)} stands on {shorten(base)}, which moves" if name != base else f"{shorten(name)} moves"
    raise IcyMoonError(
        f"{bag}: {what} in {shorten(found[base].parent)}, and that moves in {shorten(found[parent].parent)}; give "
        f"--frame {shorten(parent)}, or record the pose in a fixed frame."
    )


def _choose_name(bag: Path, what: str, stated: str, there: list[str]) -> str:
    """Return the name that the user ``stated``, or the only name in ``there``.

    Raises IcyMoonError if both are missing.
    """
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


def _read_message(message: Any, kind: str) -> Iterator[tuple[str, str, Decimal, Array]]:
    """Yield the moving frame, parent frame, stamp and pose (4, 4) of each pose in a message."""
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
        seconds = (Decimal(int(stamp.sec)) + Decimal(int(stamp.nanosec)) * _NANOSECOND_S).quantize(_NANOSECOND_S)
        if not np.isfinite(pose).all():
            raise ValueError(f"the pose with the stamp {seconds:f} s has a number that is not finite")
        # Names of ROS 1 may begin with a slash, in one message and not in the next.
        yield (
            getattr(each, "child_frame_id", "").removeprefix("/"),
            each.header.frame_id.removeprefix("/"),
            seconds,
            pose,
        )
