"""Poses of bags, of ROS 1 and 2, written here by the package rosbags."""

from __future__ import annotations

from decimal import Decimal

import numpy as np
import pytest
from icymoon.formats.trajectories import read_trajectory
from icymoon.physics.camera.rotations import from_vector, quaternion
from icymoon.stereo.cli import main
from icymoon.stereo.datasets.bag_poses import read_bag_poses
from icymoon.support.errors import IcyMoonError

pytest.importorskip("rosbags", reason="pip install icymoon[ros]")
TURNS = [from_vector(np.array([0.1 * k, -0.2, 0.3])) for k in range(3)]
PLACES = np.array([[1.0, 2.0, 3.0], [1.5, 2.0, 3.0], [2.0, 2.5, 3.0]])


def messages(kinds, kind):
    """(nanoseconds, message) of each pose, the last first."""
    for k in reversed(range(3)):
        w, x, y, z = map(float, quaternion(TURNS[k]))
        stamp = kinds["builtin_interfaces/msg/Time"](sec=1305031102 + k, nanosec=175304001)
        known = {"seq": k} if "seq" in kinds["std_msgs/msg/Header"].__dataclass_fields__ else {}
        header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="map", **known)
        turn = kinds["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)
        place = dict(zip("xyz", PLACES[k].tolist(), strict=True))
        if kind == "geometry_msgs/msg/PoseStamped":
            at = kinds["geometry_msgs/msg/Point"](**place)
            message = kinds[kind](header=header, pose=kinds["geometry_msgs/msg/Pose"](position=at, orientation=turn))
        else:
            moved = kinds["geometry_msgs/msg/Transform"](
                translation=kinds["geometry_msgs/msg/Vector3"](**place), rotation=turn
            )
            each = kinds["geometry_msgs/msg/TransformStamped"]
            message = kinds[kind](
                transforms=[each(header=header, child_frame_id=name, transform=moved) for name in ("left", "right")]
            )
        yield (1305031102 + k) * 10**9, message


def write_bag(path, version, *topics):
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_JAZZY)
    with Writer1(path) if version == 1 else Writer2(path, version=9) as writer:
        for topic, kind in topics:
            connection = writer.add_connection(topic, kind, typestore=store)
            for time, message in messages(store.types, kind):
                raw = store.serialize_ros1(message, kind) if version == 1 else store.serialize_cdr(message, kind)
                writer.write(connection, time, raw)
    return path


@pytest.mark.parametrize("version", [1, 2])
def test_poses_come_in_the_order_of_time_with_all_digits(tmp_path, version):
    bag = write_bag(
        tmp_path / ("run.bag" if version == 1 else "run"), version, ("/pose", "geometry_msgs/msg/PoseStamped")
    )
    stamps, poses = read_bag_poses(bag)
    assert stamps == [Decimal(f"{1305031102 + k}.175304001") for k in range(3)]
    np.testing.assert_allclose([pose[:3, 3] for pose in poses], PLACES)
    np.testing.assert_allclose([pose[:3, :3] for pose in poses], TURNS, atol=1e-12)


def test_transforms_are_those_of_a_frame_and_become_a_trajectory(tmp_path, capsys):
    bag = write_bag(tmp_path / "run", 2, ("/tf", "tf2_msgs/msg/TFMessage"))
    with pytest.raises(IcyMoonError, match="poses of several frames; give one of left, right with --frame"):
        read_bag_poses(bag)
    assert main(["poses", str(bag), "--frame", "right", "--out", str(tmp_path / "poses.txt")]) == 0
    assert "3 poses" in capsys.readouterr().out
    found = read_trajectory(tmp_path / "poses.txt").poses
    np.testing.assert_allclose(found.position_m, PLACES)
    np.testing.assert_allclose(found.rotation, TURNS, atol=1e-12)


def test_what_a_bag_has_not_is_a_sentence(tmp_path):
    two = write_bag(
        tmp_path / "two", 2, ("/a", "geometry_msgs/msg/PoseStamped"), ("/b", "geometry_msgs/msg/PoseStamped")
    )
    with pytest.raises(IcyMoonError, match="several topics; give one of /a, /b with --topic"):
        read_bag_poses(two)
    with pytest.raises(IcyMoonError, match="has no topic '/c' with poses"):
        read_bag_poses(two, "/c")
    assert len(read_bag_poses(two, "/b")[0]) == 3
    with pytest.raises(IcyMoonError, match="is missing; give a bag"):
        read_bag_poses(tmp_path / "absent")
    (tmp_path / "text.bag").write_text("no bag", encoding="utf-8")
    with pytest.raises(IcyMoonError, match="is not a bag that can be read"):
        read_bag_poses(tmp_path / "text.bag")
