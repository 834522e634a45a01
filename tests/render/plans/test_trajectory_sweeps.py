"""Plans that follow a trajectory: its poses are those of the file, and what no camera can follow is one sentence."""

from __future__ import annotations

import re

import numpy as np
import pytest
from icymoon.physics.camera.blur import find_blur, find_pose_after
from icymoon.physics.camera.rotations import from_vector, quaternion
from icymoon.physics.light.directions import camera_axes
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.render.plans import trajectory_sweeps
from icymoon.render.plans.plan_file import read_plan
from icymoon.settings import rebuilt_parts
from icymoon.support.errors import IcyMoonError

HEAD = '[plan]\ntitle = "Test"\n[mesh]\nkind = "GRID"\n[terrain]\nrms_slope_deg = 5.0\n'
SWEEP = '[[sweep]]\nkind = "trajectory"\nfile = "poses.txt"\n'
#: Level, looking north; right is east.
NORTH = camera_axes(0.0, 0.0)


def line(stamp, position, rotation):
    w, x, y, z = quaternion(rotation)
    return " ".join(map(repr, map(float, (stamp, *position, x, y, z, w)))) + "\n"


def follow(tmp_path, text, plan=HEAD + SWEEP):
    (tmp_path / "poses.txt").write_text(text, encoding="utf-8")
    (tmp_path / "plan.toml").write_text(plan, encoding="utf-8")
    return read_plan(tmp_path / "plan.toml")


def rigs(tmp_path, text, plan=HEAD + SWEEP):
    return [pair.settings.rig for pair in follow(tmp_path, text, plan).pairs()]


def axes(rig):
    return camera_axes(rig.heading_deg, rig.pitch_deg, rig.roll_deg)


def test_each_pose_is_a_pair_with_its_place_turn_and_stamp(tmp_path):
    """To the seven digits of the settings."""
    random = np.random.default_rng(7)
    poses = [([k - 1.0, 0.5 * k, 4.0 + k], from_vector(random.normal(size=3))) for k in range(4)]
    text = "".join(line(100.5 + k, *pose) for k, pose in enumerate(poses))
    found = rigs(tmp_path, text)
    assert [(rig.frame, rig.stamp) for rig in found] == [(k, f"{100.5 + k:.9f}") for k in range(4)]
    for rig, (position, rotation) in zip(found, poses, strict=True):
        np.testing.assert_allclose([rig.x_m, rig.y_m, rig.z_m], position, rtol=1e-7)
        np.testing.assert_allclose(axes(rig), rotation, atol=1e-6)
        assert rig.height_from == "ZERO"


def test_the_height_above_the_ground_is_derived_and_the_scene_is_one(tmp_path):
    plan = follow(tmp_path, line(0, [1, 2, 3], NORTH) + line(1, [2, 2, 3], NORTH))
    pairs = plan.pairs()
    ground = make_terrain(pairs[0].settings, int(pairs[0].settings.dataset.seed))
    for pair in pairs:
        rig = pair.settings.rig
        assert rig.height_m == pytest.approx(3.0 - float(ground.heights(rig.x_m, rig.y_m)), abs=1e-2)
    assert rebuilt_parts.select_scene(pairs[0].settings) == rebuilt_parts.select_scene(pairs[1].settings)
    assert plan.describe_trajectories() == ["poses.txt: 2 poses in 1 s on a path of 1 m; cameras look 0 degrees down."]


def test_frames_of_one_pose_are_pairs_of_their_own(tmp_path):
    assert (
        len({pair.id for pair in follow(tmp_path, line(0, [0, 0, 3], NORTH) + line(1, [0, 0, 3], NORTH)).pairs()}) == 2
    )


def test_heights_may_be_above_the_ground(tmp_path):
    (rig,) = rigs(tmp_path, line(0, [1, 2, 0.75], NORTH), HEAD + SWEEP + 'heights = "GROUND"\n')
    assert (rig.height_m, rig.height_from, rig.z_m) == (0.75, "GROUND", 0.0)


def test_a_kitti_trajectory_begins_where_the_rig_stands(tmp_path):
    """Its axes are those of its first camera: here it goes a metre forward, along the pitched axis of the rig."""
    forward = "1 0 0 0 0 1 0 0 0 0 1 1\n"
    plan = HEAD + '[rig]\nx_m = 1.0\ny_m = 2.0\nheight_from = "ZERO"\nz_m = 5.0\npitch_deg = 30.0\nheading_deg = 90.0\n'
    first, second = rigs(tmp_path, "1 0 0 0 0 1 0 0 0 0 1 0\n" + forward, plan + SWEEP + "rate_hz = 10\n")
    np.testing.assert_allclose([first.x_m, first.y_m, first.z_m], [1, 2, 5], atol=1e-6)
    np.testing.assert_allclose([second.x_m, second.y_m, second.z_m], [1 + 3**0.5 / 2, 2, 4.5], atol=1e-6)
    assert (second.heading_deg, second.pitch_deg) == (pytest.approx(90.0), pytest.approx(30.0))
    assert [rig.stamp for rig in (first, second)] == ["0.000000000", "0.100000000"]


def test_axes_origin_and_steps_are_as_stated(tmp_path):
    """A robot that heads north, in a world of north, east, down, whose origin is 10 m above the site's zero."""
    text = "".join(f"{k} {20 + k} 30 5 0 0 0 1\n" for k in range(5))
    plan = HEAD + SWEEP + 'axes = "ROS"\nworld = "NED"\norigin_m = [20, 30, 10]\nevery = 2\n'
    plan = plan.replace("[terrain]", "[terrain]\nsize_m = 40.0")
    found = rigs(tmp_path, text, plan)
    assert [(rig.x_m, rig.y_m, rig.z_m, rig.frame) for rig in found] == [(0, 0, 5, 0), (0, 2, 5, 1), (0, 4, 5, 2)]
    # x forward, y left, z up, in axes north, east, down: it drives on its head.
    np.testing.assert_allclose(axes(found[0])[:, 2], [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(axes(found[0])[:, 1], [0, 0, 1], atol=1e-6)


def test_motion_blur_goes_on_to_the_neighbours(tmp_path):
    """A steady path: from a frame, the motion of its exposure leads to the next one after the step between them.

    Speeds have seven digits, so it ends within 1e-6 of the way.
    """
    velocity, turn = np.array([0.3, -0.2, 0.1]), np.array([0.1, 0.2, -0.05])
    poses = [([0, 0, 5] + velocity * t, NORTH @ from_vector(turn * t)) for t in (0.0, 0.5, 1.0)]
    text = "".join(line(0.5 * k, *pose) for k, pose in enumerate(poses))
    pairs = follow(tmp_path, text, HEAD + "[rig]\nmotion_exposure_s = 0.02\n" + SWEEP).pairs()
    for k in (0, 1):
        blur = find_blur(pairs[k].settings)
        assert blur is not None
        assert blur.exposure_s == pytest.approx(0.02)
        position, rotation = poses[k]
        after = find_pose_after(blur, 0.5)
        np.testing.assert_allclose(rotation @ after[:3, 3] + position, poses[k + 1][0], atol=1e-6)
        np.testing.assert_allclose(rotation @ after[:3, :3], poses[k + 1][1], atol=1e-6)


def test_a_readout_alone_moves_too_and_then_needs_an_exposure(tmp_path):
    text = line(0, [0, 0, 5], NORTH) + line(1, [1, 0, 5], NORTH)
    fixed = "[sensor]\nauto_exposure = false\nexposure_s = 0.001\n"
    pairs = follow(tmp_path, text, HEAD + "[rig]\nreadout_s = 0.02\n" + fixed + SWEEP).pairs()
    for pair in pairs:
        blur = find_blur(pair.settings)
        assert (blur.readout_s, blur.exposure_s) == (0.02, 0.001)
        assert np.linalg.norm(blur.velocity_m_s) == pytest.approx(1.0)
    with pytest.raises(IcyMoonError, match=r"set rig\.motion_exposure_s"):
        follow(tmp_path, text, HEAD + "[rig]\nreadout_s = 0.02\n" + SWEEP).pairs()


def test_without_an_exposure_nothing_moves(tmp_path):
    pairs = follow(tmp_path, line(0, [0, 0, 5], NORTH) + line(1, [1, 0, 5], NORTH)).pairs()
    assert [find_blur(pair.settings) for pair in pairs] == [None, None]


WRONG = {
    "a missing file": ("", 'file = "absent.txt"', ("absent.txt", "cannot be read")),
    "no file": ("", "", ("lacks file",)),
    "another key": (line(0, [0, 0, 5], NORTH), 'file = "poses.txt"\nevry = 2', ("evry", "every")),
    "axes": (line(0, [0, 0, 5], NORTH), 'file = "poses.txt"\naxes = "OPENCVS"', ("OPENCVS", "'OPENCV'")),
    "a step": (line(0, [0, 0, 5], NORTH), 'file = "poses.txt"\nevery = 0', ("every", "above 0")),
    "a rate": (
        line(0, [0, 0, 5], NORTH),
        'file = "poses.txt"\nrate_hz = 1e12',
        ("rate_hz is 1e+12", "nine decimals; lower it"),
    ),
    "half a step": (line(0, [0, 0, 5], NORTH), 'file = "poses.txt"\nevery = 1.5', ("every", "whole number")),
    "an origin": (line(0, [0, 0, 5], NORTH), 'file = "poses.txt"\norigin_m = [1, 2]', ("origin_m", "three numbers")),
    "equal stamps": (
        line(0, [0, 0, 5], NORTH) + line(1, [0, 0, 5], NORTH) * 2,
        'file = "poses.txt"',
        ("lines 2 and 3", "the same stamp", "rate_hz"),
    ),
    "stamps out of order": (
        line(1, [0, 0, 5], NORTH) + line(0, [0, 0, 5], NORTH),
        'file = "poses.txt"',
        ("lines 1 and 2", "not in the order of time"),
    ),
    "a pose under the ground": (
        line(0, [0, 0, 5], NORTH) + line(1, [0, 0, -5], NORTH),
        'file = "poses.txt"',
        ("line 2", "under the ground", "origin_m"),
    ),
    "a pose beyond the ground": (line(0, [999, 0, 5], NORTH), 'file = "poses.txt"', ("line 1", "beyond the ground")),
    "no stamps": ("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2, 'file = "poses.txt"', ("no stamps", "rate_hz")),
    "an origin of a first pose": (
        line(0, [0, 0, 5], NORTH),
        'file = "poses.txt"\nworld = "FIRST"\norigin_m = [0, 0, 0]',
        ("origin_m", "leave"),
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_followed_is_one_sentence_with_its_line(tmp_path, name):
    text, table, told = WRONG[name]
    with pytest.raises(IcyMoonError) as refused:
        follow(tmp_path, text, HEAD + f'[[sweep]]\nkind = "trajectory"\n{table}\n').pairs()
    said = str(refused.value)
    assert re.match(r".*plan\.toml, line \d+: ", said), said
    assert said.endswith((".", "?"))
    for each in told:
        assert each in said, said


def test_ground_that_is_made_for_one_site_is_refused(tmp_path):
    with pytest.raises(IcyMoonError, match=r"mesh\.kind is GRADED.*set mesh\.kind to GRID"):
        rigs(tmp_path, line(0, [0, 0, 5], NORTH) + line(1, [1, 0, 5], NORTH), HEAD.replace("GRID", "GRADED") + SWEEP)


def test_more_poses_than_a_plan_has_pairs_are_refused_with_a_step(tmp_path, monkeypatch):
    monkeypatch.setattr(trajectory_sweeps, "MAX_PAIRS", 2)
    text = "".join(line(k, [0, 0, 5], NORTH) for k in range(3))
    with pytest.raises(IcyMoonError, match=r"line 9: .*poses\.txt has 3 poses, more than 2; state every"):
        rigs(tmp_path, text)
    assert len(rigs(tmp_path, text, HEAD + SWEEP + "every = 2\n")) == 2


def test_a_gap_is_told(tmp_path):
    text = "".join(line(t, [0, 0, 5], NORTH) for t in (0, 1, 2, 3, 30))
    (said,) = follow(tmp_path, text).describe_trajectories()
    assert "1 gap of up to 27 s (the first after line 4), where the camera is assumed to stand still" in said


@pytest.mark.parametrize(
    ("turns", "more", "wanted"),
    [
        ([(0, 20, 0), (90, 45, 10)], "", "; cameras look from 20 degrees down to 45 degrees down"),
        (
            [(30, -40, 0), (0, 30, 0)],
            "",
            "from 40 degrees up to 30 degrees down; 1 looks above the horizon (the first in line 1); check axes",
        ),
        (
            [(0, 45, 0), (0, 45, 180)],
            "",
            "; cameras look 45 degrees down; 1 stands upside down (the first in line 2); check axes",
        ),
        (
            [(0, 45, 0)] * 2,
            'world = "NED"\n',
            "; 2 look above the horizon (the first in line 1); 2 stand upside down (the first in line 1); check axes",
        ),
        ([(0, -45, 180)], 'world = "FIRST"\n', "on a path of 0 m."),
    ],
)
def test_where_cameras_look_is_told_before_a_render(tmp_path, turns, more, wanted):
    """Wrong axes, or w first in a quaternion, turn cameras to the sky or on their heads."""
    text = "".join(line(k, [0, 0, 5], camera_axes(*turn)) for k, turn in enumerate(turns))
    (said,) = follow(tmp_path, text, HEAD + SWEEP + more).describe_trajectories()
    assert wanted in said


def test_a_trajectory_beside_other_views_is_refused(tmp_path):
    panorama = '[[sweep]]\nkind = "panorama"\nheadings = [0, 90]\n'
    with pytest.raises(IcyMoonError, match="heading_deg"):
        rigs(tmp_path, line(0, [0, 0, 5], NORTH), HEAD + panorama + SWEEP)
