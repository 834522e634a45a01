"""Trajectories of other programs: their poses by hand, and what is no trajectory in one sentence."""

from __future__ import annotations

import re
from decimal import Decimal

import numpy as np
import pytest
from icymoon.formats.trajectories import read_trajectory
from icymoon.physics.camera.pose_sequence import CAMERA_IN
from icymoon.support.errors import IcyMoonError

#: A quarter turn about z takes x to y.
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
HALF = 0.5**0.5
TUM = f"# a comment\n1305031102.175304 1 2 3 0 0 {HALF} {HALF}\n\n1305031102.2 1 2 4 0 0 0 1\n"


def read(tmp_path, text, name="poses.txt", **options):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return read_trajectory(path, **options)


def test_tum_has_stamps_positions_and_quaternions_with_w_last(tmp_path):
    found = read(tmp_path, TUM)
    assert found.kind == "TUM"
    assert found.stamped
    assert found.poses.stamp == (Decimal("1305031102.175304"), Decimal("1305031102.2"))
    assert found.poses.line == (2, 4)
    np.testing.assert_allclose(found.poses.position_m, [[1, 2, 3], [1, 2, 4]])
    np.testing.assert_allclose(found.poses.rotation, [QUARTER, np.eye(3)], atol=1e-15)
    assert found.notes == ()


def test_kitti_has_matrices_and_stamps_of_their_own(tmp_path):
    text = "1 0 0 5 0 1 0 6 0 0 1 7\n0 -1 0 5 1 0 0 6 0 0 1 8\n"
    found = read(tmp_path, text)
    assert (found.kind, found.stamped) == ("KITTI", False)
    np.testing.assert_allclose(found.poses.rotation, [np.eye(3), QUARTER], atol=1e-12)
    np.testing.assert_allclose(found.poses.position_m, [[5, 6, 7], [5, 6, 8]])
    times = tmp_path / "times.txt"
    times.write_text("0.000000e+00\n1.036224e-01\n", encoding="utf-8")
    timed = read(tmp_path, text, times=times)
    assert timed.stamped
    assert timed.poses.stamp == (Decimal(0), Decimal("0.1036224"))
    times.write_text("0\n", encoding="utf-8")
    with pytest.raises(IcyMoonError, match=r"times\.txt: has 1 stamps, and .* has 2 poses; "):
        read(tmp_path, text, times=times)


@pytest.mark.parametrize(
    "text",
    [
        f"qw,qx,qy,qz,x,y,z,t\n{HALF},0,0,{HALF},1,2,3,0.5\n",
        f"t_s, x_m, y_m, z_m, qx, qy, qz, qw, other\n0.5, 1, 2, 3, 0, 0, {HALF}, {HALF}, word\n",
        "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n"
        f"500000000,1,2,3,{HALF},0,0,{HALF}\n",
    ],
)
def test_csv_has_named_columns(tmp_path, text):
    found = read(tmp_path, text, "poses.csv")
    assert found.kind == "CSV"
    assert found.poses.stamp == (Decimal("0.5"),)
    np.testing.assert_allclose(found.poses.position_m, [[1, 2, 3]])
    np.testing.assert_allclose(found.poses.rotation, [QUARTER], atol=1e-15)


def test_rotations_of_other_axes_are_of_the_camera_in_the_end(tmp_path):
    """A robot that drives east: its x is forward. Blender's camera of no rotation looks down, with its top north."""
    level = "0 0 0 1 0 0 0 1\n"
    robot = read(tmp_path, level, camera=CAMERA_IN["ROS"]).poses.rotation[0]
    np.testing.assert_allclose(robot.T, [[0, -1, 0], [0, 0, -1], [1, 0, 0]])  # right is south, down is down
    blender = read(tmp_path, level, camera=CAMERA_IN["OPENGL"]).poses.rotation[0]
    np.testing.assert_allclose(blender.T, [[1, 0, 0], [0, -1, 0], [0, 0, -1]])
    for axes in CAMERA_IN.values():
        assert np.linalg.det(axes) == pytest.approx(1.0)


def test_what_is_off_by_more_than_rounding_is_normalised_and_said(tmp_path):
    found = read(tmp_path, "0 0 0 0 0 0 0 1.000001\n1 0 0 0 0 0 0 1.05\n2 0 0 0 0 0 0.71 0.71\n")
    assert found.notes == ("2 quaternions normalised (line 2 is off by 0.05)",)
    np.testing.assert_allclose(found.poses.rotation, [np.eye(3), np.eye(3), QUARTER], atol=1e-15)
    skewed = read(tmp_path, "1.001 0 0 0 0 1 0 0 0 0 1 0\n")
    assert skewed.notes == ("1 matrix normalised (line 1 is off by 0.002)",)
    np.testing.assert_allclose(skewed.poses.rotation[0], np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no poses"),
        ("# nothing\n", "no poses"),
        ("0 0 0 0 0 0 0 0\n", "line 1 has a quaternion of length 0"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 2\n", "line 2 has a quaternion of length 2"),
        ("0 0 0 0 0 0 0 1\n1 0 0 nan 0 0 0 1\n", "line 2 has a number that is not finite"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 1\n", "line 2 has 7 words, not 8"),
        ("0 0 0 0 0 0 0 one\n", "line 1 has a word that is not a number"),
        ("nan 0 0 0 0 0 0 1\n", "line 1 has a number that is not finite"),
        ("9999999999999 0 0 0 0 0 0 1\n", "the stamp '9999999999999', which is not a number of seconds"),
        ("1 2 3\n", "its first line has 3 words"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n", "line 1 has a matrix that is not a rotation, mirrored or flat"),
        ("1 0 0 0 0 1.2 0 0 0 0 1 0\n", "line 1 has a matrix that is not a rotation, off by 0.44"),
        ("one\n", "its first line has 1 word, and"),
        ("0,1,2,3,0,0,0,1\n", "its first line has commas; state its format as CSV, or end its name in .csv"),
    ],
)
def test_what_is_no_trajectory_is_told_with_its_line(tmp_path, text, why):
    with pytest.raises(IcyMoonError) as refused:
        read(tmp_path, text)
    assert why in str(refused.value)
    assert re.fullmatch(r".*poses\.txt: is not .*; give lines of .*\.", str(refused.value))


def test_columns_that_are_missing_are_named(tmp_path):
    with pytest.raises(IcyMoonError, match="its first line names no column t, qw"):
        read(tmp_path, "x,y,z,qx,qy,qz\n", "poses.csv")


@pytest.mark.parametrize(
    ("names", "why"),
    [
        ("t,x,y,z,qx,qy,qz,qw,qw", "names qw twice"),
        ("t,x,y,x_m,z,qx,qy,qz,qw", "names x twice"),
        ("t,t_ns,x,y,z,qx,qy,qz,qw", "names the stamps t and t_ns, so leave one out"),
    ],
)
def test_columns_that_contradict_each_other_are_named(tmp_path, names, why):
    """One of them would be taken without a word."""
    with pytest.raises(IcyMoonError, match=why):
        read(tmp_path, f"{names}\n0,1,2,3,0,0,0,1,1\n", "poses.csv")


def test_columns_without_a_pose_may_repeat(tmp_path):
    found = read(tmp_path, "t,note,x,y,z,qx,qy,qz,qw,note\n0,a,1,2,3,0,0,0,1,b\n", "poses.csv")
    np.testing.assert_array_equal(found.poses.position_m, [[1, 2, 3]])
