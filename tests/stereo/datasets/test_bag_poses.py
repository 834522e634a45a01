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
    found = read_bag_poses(bag)
    assert found.stamps == [Decimal(f"{1305031102 + k}.175304001") for k in range(3)]
    np.testing.assert_allclose([pose[:3, 3] for pose in found.poses], PLACES)
    np.testing.assert_allclose([pose[:3, :3] for pose in found.poses], TURNS, atol=1e-12)


def test_transforms_are_those_of_a_frame_and_become_a_trajectory(tmp_path, capsys):
    bag = write_bag(tmp_path / "run", 2, ("/tf", "tf2_msgs/msg/TFMessage"))
    with pytest.raises(IcyMoonError, match="poses of several frames; give one of left, right with --frame"):
        read_bag_poses(bag)
    assert main(["poses", str(bag), "--frame", "right", "--out", str(tmp_path / "poses.txt")]) == 0
    assert "3 poses of right in map, with the axes of the bag: " in capsys.readouterr().out
    assert (
        (tmp_path / "poses.txt").read_text(encoding="utf-8").startswith("# run: right in map, with the axes of the bag")
    )
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
    assert len(read_bag_poses(two, "/b").stamps) == 3
    with pytest.raises(IcyMoonError, match="is missing; give a bag"):
        read_bag_poses(tmp_path / "absent")
    (tmp_path / "text.bag").write_text("no bag", encoding="utf-8")
    with pytest.raises(IcyMoonError, match="is not a bag that can be read"):
        read_bag_poses(tmp_path / "text.bag")
    with pytest.raises(IcyMoonError, match=r"/a has poses without the name of a moving frame; leave out --frame"):
        read_bag_poses(two, "/a", "map")


def write_transforms(path, *transforms, fixed=()):
    """A bag with /tf of (parent, child, second, place, turn), and of ``fixed`` ones with /tf_static; the turn is a
    quaternion x, y, z, w, and may be missing."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kinds = store.types
    with Writer(path, version=9) as writer:
        connections = {
            topic: writer.add_connection(topic, "tf2_msgs/msg/TFMessage", typestore=store)
            for topic, each in (("/tf", transforms), ("/tf_static", fixed))
            if each
        }
        both = [("/tf_static", *each) for each in fixed] + [("/tf", *each) for each in transforms]
        for topic, parent, child, second, place, *turn in both:
            stamp = kinds["builtin_interfaces/msg/Time"](sec=second, nanosec=0)
            message = kinds["tf2_msgs/msg/TFMessage"](
                transforms=[
                    kinds["geometry_msgs/msg/TransformStamped"](
                        header=kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=parent),
                        child_frame_id=child,
                        transform=kinds["geometry_msgs/msg/Transform"](
                            translation=kinds["geometry_msgs/msg/Vector3"](*map(float, place)),
                            rotation=kinds["geometry_msgs/msg/Quaternion"](
                                *(turn[0] if turn else (0.0, 0.0, 0.0, 1.0))
                            ),
                        ),
                    )
                ]
            )
            writer.write(connections[topic], second * 10**9, store.serialize_cdr(message, "tf2_msgs/msg/TFMessage"))
    return path


#: A quarter turn to the left about z.
LEFT = (0.0, 0.0, 0.5**0.5, 0.5**0.5)


@pytest.mark.parametrize("static", [True, False], ids=["/tf_static", "sent again and again"])
def test_a_camera_on_a_robot_moves_with_it(tmp_path, static):
    """A robot looks north and drives east; its mast is 2 m ahead of it, and the camera 1 m above the mast."""
    robot = [("map", "robot", k, (k, 0, 0), LEFT) for k in range(3)]
    on_it = [("robot", "mast", 0, (2, 0, 0)), ("/mast", "camera", 0, (0, 0, 1), LEFT)]
    bag = (
        write_transforms(tmp_path / "run", *robot, fixed=on_it)
        if static
        else write_transforms(tmp_path / "run", *robot, *on_it, *((*each[:2], 1, *each[3:]) for each in on_it))
    )
    found = read_bag_poses(bag, frame="camera")
    assert (found.frame, found.parent, found.stamps) == ("camera", "map", [0, 1, 2])
    np.testing.assert_allclose([pose[:3, 3] for pose in found.poses], [[k, 2, 1] for k in range(3)], atol=1e-12)
    # Two quarter turns look back.
    np.testing.assert_allclose([pose[:3, 0] for pose in found.poses], [[-1, 0, 0]] * 3, atol=1e-12)
    if static:
        assert read_bag_poses(bag).frame == "robot", "the only frame that moves"


@pytest.mark.parametrize("on_mast", [False, True])
def test_a_frame_that_moves_on_another_one_that_moves_is_refused_with_a_fix_that_works(tmp_path, on_mast):
    robot = [("map", "robot", k, (k, 0, 0)) for k in range(3)]
    turns = [("/robot", "mast", k, (0, 0, k)) for k in range(3)]
    bag = write_transforms(tmp_path / "run", *robot, *turns, fixed=[("mast", "camera", 0, (0, 0, 1))])
    with pytest.raises(IcyMoonError, match="moves in robot, and that moves in map; give --frame robot"):
        read_bag_poses(bag, frame="camera" if on_mast else "mast")
    found = read_bag_poses(bag, frame="robot")
    assert (found.parent, [pose[0, 3] for pose in found.poses]) == ("map", [0, 1, 2])


def test_frames_that_stand_on_each_other_end(tmp_path):
    bag = write_transforms(tmp_path / "run", ("a", "b", 0, (1, 0, 0)), ("b", "a", 0, (-1, 0, 0)))
    assert [pose[0, 3] for pose in read_bag_poses(bag, frame="b").poses] == [1]


def test_a_frame_on_one_that_stands_still_is_a_path(tmp_path):
    """As a transform from the map to the odometry, which is sent again and again."""
    odometry = [("map", "odom", k, (5, 0, 0)) for k in range(3)]
    bag = write_transforms(tmp_path / "run", *odometry, *[("odom", "robot", k, (k, 0, 0)) for k in range(3)])
    assert [pose[0, 3] for pose in read_bag_poses(bag, frame="robot").poses] == [0, 1, 2]


@pytest.mark.parametrize(
    ("transforms", "why"),
    [
        (
            [("map", "robot", 0, (0, 0, 0)), ("map", "robot", 0, (1, 0, 0))],
            "robot has different poses with the stamp 0",
        ),
        (
            [("map", "robot", 0, (0, 0, 0)), ("odom", "robot", 1, (0, 0, 0))],
            "robot has poses in the frames 'map' and 'odom'",
        ),
        ([("map", "robot", 7, (float("nan"), 0, 0))], "the pose with the stamp 7.* has a number that is not finite"),
    ],
)
def test_poses_that_are_no_path_are_refused(tmp_path, transforms, why):
    with pytest.raises(IcyMoonError, match=why):
        read_bag_poses(write_transforms(tmp_path / "run", *transforms))


def test_a_pose_that_is_sent_twice_counts_once(tmp_path):
    bag = write_transforms(tmp_path / "run", *[("map", "robot", k, (k, 0, 0)) for k in (0, 1, 1)])
    assert len(read_bag_poses(bag).stamps) == 2
