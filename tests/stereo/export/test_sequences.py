"""Sequences that are exported: read back by other readers, and held against the plane that their frames show."""

from __future__ import annotations

import json
from decimal import Decimal

import cv2
import numpy as np
import pairs
import pytest
from icymoon.formats.trajectories import read_trajectory
from icymoon.physics.camera.rotations import from_quaternion, from_vector
from icymoon.physics.light.directions import camera_angles
from icymoon.settings.description import defaults, merged
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.stereo.export.layouts import export
from icymoon.stereo.measure.prepare_pair import list_distinct_pairs
from icymoon.stereo.measure.sequences import sort_by_time

RIG = pairs.camera(96, 72)
PLANE = pairs.Scene(rock=False)
#: Where the first camera stands, and its axes.
START, TURN = np.array([100.0, -20.0, 5.0]), from_vector(np.array([2.0, 0.5, -0.3]))
#: Its way to each frame, in its axes, of which the plane keeps the same slopes.
STEPS = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.2], [0.1, -0.05, 0.3]])
STAMPS = ("1305031102.175304000", "1305031102.200000000", "1305031103.000000001")
#: Names of the folders, which have another order.
NAMES = ("c" * 12, "a" * 12, "b" * 12)


def pose(k):
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = TURN, START + TURN @ STEPS[k]
    return found


def scene(k):
    """The plane of the first frame as the camera of another one sees it."""
    x, y, z = STEPS[k]
    return pairs.Scene(rock=False, distance_m=PLANE.distance_m - z - PLANE.slope_x * x - PLANE.slope_y * y)


def write_frame(root, k, stamp=None, name="", **light):
    heading, pitch, roll = camera_angles(TURN)
    x, y, z = pose(k)[:3, 3].tolist()
    rig = {"frame": k, "stamp": STAMPS[k] if stamp is None else stamp, "x_m": x, "y_m": y, "z_m": z}
    rig |= {"height_from": "ZERO", "heading_deg": heading, "pitch_deg": pitch, "roll_deg": roll}
    settings = merged(defaults(), {"rig": rig, "light": light})
    folder = pairs.write_pair(root / "pairs" / (name or NAMES[k]), scene(k), RIG, settings=settings)
    data = json.loads((folder / "pair.json").read_text())
    right = pose(k)
    right[:3, 3] += TURN[:, 0] * RIG.baseline_m
    data["settings"]["rig"] |= rig
    data["poses_rectified_to_world"] = {"left": pose(k).tolist(), "right": right.tolist()}
    (folder / "pair.json").write_text(json.dumps(data))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("set")
    for k in range(3):
        write_frame(root, k)
    return root


def exported(dataset, tmp_path, kind):
    assert export([dataset], kind, tmp_path / kind) == []
    return tmp_path / kind


def test_frames_are_in_the_order_of_time_and_scenes_apart(dataset, tmp_path):
    assert [folder.name for folder in sort_by_time(list_distinct_pairs([dataset]))] == list(NAMES)
    assert [source.name for source in find_sources([dataset])] == list(NAMES)
    for k in range(2):
        write_frame(tmp_path, k, name=f"{k}" * 12, sun_elevation_deg=10.0)
        write_frame(tmp_path, k, name=f"{9 - k}" * 12, sun_elevation_deg=20.0)
    write_frame(tmp_path, 2, stamp="", name="5" * 12)
    order = [folder.name[0] for folder in sort_by_time(list_distinct_pairs([tmp_path]))]
    assert order == ["0", "1", "5", "9", "8"]


def test_tum_gives_the_poses_back(dataset, tmp_path):
    root = exported(dataset, tmp_path, "tum") / "0000"
    lines = [line.split() for line in (root / "groundtruth.txt").read_text().splitlines() if line[0] != "#"]
    assert tuple(line[0] for line in lines) == STAMPS
    numbers = np.array([[float(word) for word in line[1:]] for line in lines])
    for k, row in enumerate(numbers):
        np.testing.assert_allclose(row[:3], pose(k)[:3, 3], atol=1e-12)
        np.testing.assert_allclose(from_quaternion(row[[6, 3, 4, 5]]), TURN, atol=1e-12)
    again = read_trajectory(root / "groundtruth.txt").poses
    np.testing.assert_allclose(again.position_m, numbers[:, :3])
    assert again.stamp == tuple(map(Decimal, STAMPS))
    for name in ("rgb", "depth"):
        listed = [line.split() for line in (root / f"{name}.txt").read_text().splitlines() if line[0] != "#"]
        assert [(line[0], line[1]) for line in listed] == [(stamp, f"{name}/{stamp}.png") for stamp in STAMPS]
    depth = cv2.imread(str(root / "depth" / f"{STAMPS[1]}.png"), cv2.IMREAD_UNCHANGED) / 5000.0
    np.testing.assert_allclose(depth, pairs.view(scene(1), RIG, "left")[0], atol=1.01e-4)
    fx, fy, cx, cy, baseline = map(float, (root / "calibration.txt").read_text().splitlines()[1].split())
    assert (fx, fy, cx, cy, baseline) == (RIG.focal_px, RIG.focal_px, RIG.cx_px - 0.5, RIG.cy_px - 0.5, RIG.baseline_m)
    assert cv2.imread(str(root / "rgb" / f"{STAMPS[0]}.png")).shape == (72, 96, 3)
    assert (root / "frames.csv").read_text().splitlines()[1] == f"000000,{STAMPS[0]},{NAMES[0]}"


def test_kitti_has_poses_from_the_first_camera_and_times_from_zero(dataset, tmp_path):
    root = exported(dataset, tmp_path, "kitti-odometry")
    poses = np.loadtxt(root / "poses" / "00.txt").reshape(-1, 3, 4)
    np.testing.assert_allclose(poses[:, :, 3], STEPS, atol=1e-9)
    np.testing.assert_allclose(poses[:, :, :3], np.tile(np.eye(3), (3, 1, 1)), atol=1e-9)
    times = np.loadtxt(root / "sequences" / "00" / "times.txt")
    np.testing.assert_allclose(times, [0.0, 0.024696, 0.824696001], rtol=0, atol=1e-12)  # nine decimals, as stamps have
    lines = (root / "sequences" / "00" / "calib.txt").read_text().splitlines()
    left, right = (np.array(lines[k].split()[1:], float).reshape(3, 4) for k in (2, 3))
    assert right[0, 3] == pytest.approx(-RIG.focal_px * RIG.baseline_m)
    np.testing.assert_array_equal(left[:, :3], right[:, :3])
    assert len(list((root / "sequences" / "00" / "image_3").glob("*.png"))) == 3


def test_flow_is_read_by_opencv_and_is_that_of_the_plane(dataset, tmp_path):
    """A point at depth Z moves by the way of the camera. Depth files have 24 bits, so within 1e-5 px."""
    root = exported(dataset, tmp_path, "flow") / "0000"
    assert sorted(path.name for path in (root / "forward").iterdir()) == ["000000.flo", "000001.flo"]
    assert sorted(path.name for path in (root / "backward").iterdir()) == ["000001.flo", "000002.flo"]
    v, u = np.mgrid[:72, :96] + 0.5
    for way, here, there in (("forward", 0, 1), ("backward", 2, 1)):
        depth = pairs.view(scene(here), RIG, "left")[0]
        x, y, z = STEPS[there] - STEPS[here]
        moved_u = RIG.focal_px * ((u - RIG.cx_px) / RIG.focal_px * depth - x) / (depth - z) + RIG.cx_px
        moved_v = RIG.focal_px * ((v - RIG.cy_px) / RIG.focal_px * depth - y) / (depth - z) + RIG.cy_px
        wanted = np.stack([moved_u - u, moved_v - v], -1)
        found = cv2.readOpticalFlow(str(root / way / f"{here:06d}.flo"))
        np.testing.assert_allclose(found, wanted, atol=1e-5)
        in_both = (moved_u >= 0) & (moved_u <= 96) & (moved_v >= 0) & (moved_v <= 72)
        for kind, shown in (("occ", np.ones_like(u, bool)), ("noc", in_both)):
            image = cv2.imread(str(root / f"{way}_{kind}" / f"{here:06d}.png"), cv2.IMREAD_UNCHANGED)
            known, rows, columns = np.moveaxis(image.astype(float), -1, 0)
            np.testing.assert_array_equal(known == 1, shown)
            steps = np.stack([columns, rows], -1)[shown]
            np.testing.assert_allclose((steps - 32768) / 64, wanted[shown], atol=1 / 128 + 1e-5)


def test_a_bag_has_the_stamps(dataset, tmp_path):
    pytest.importorskip("rosbags", reason="pip install icymoon[ros]")
    from rosbags.rosbag2 import Reader

    with Reader(exported(dataset, tmp_path, "ros2") / "pairs") as reader:
        times = [time for _, time, _ in reader.messages()]
    assert sorted(set(times)) == [int(stamp.replace(".", "")) for stamp in STAMPS]
    assert times == sorted(times)


@pytest.mark.parametrize("kind", ["tum", "kitti-odometry", "flow"])
def test_a_pair_that_is_no_frame_is_a_sentence(tmp_path, kind):
    write_frame(tmp_path, 0, stamp="")
    (failure,) = export([tmp_path], kind, tmp_path / kind)
    assert "is not a frame of a sequence; export pairs of a plan" in failure
