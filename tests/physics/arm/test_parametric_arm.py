"""The arm held against a formula of its own: a yaw, and lengths added up in a plane."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.arm.kinematics import (
    Arm,
    Joint,
    find_joints_beyond_limits,
    find_tip,
    forward_kinematics,
    make_rigid_transform,
)
from icymoon.physics.arm.parametric_arm import (
    JOINTS,
    choose_inverse_solution,
    find_joint_margin,
    find_real_angles_rad,
    make_parametric_arm,
    read_commanded_rad,
    solve_inverse_kinematics,
)
from icymoon.settings.description import defaults, merged
from icymoon.settings.topics.scene import Settings
from icymoon.support.arrays import Array

RIG = {"x_m": 3.0, "y_m": -2.0, "heading_deg": 40.0}


def described(**arm: float) -> Settings:
    return merged(defaults(), {"rig": RIG, "lander": {"turn_deg": 15.0}, "arm": {"shoulder_y_m": 0.2, **arm}})


def random_joints(arm: Arm, count: int, seed: int = 7) -> Array:
    return np.random.default_rng(seed).uniform(arm.low, arm.high, (count, len(arm.joints)))


def add_up(settings: Settings, angles: Array, site_m: float) -> Array:
    """Place of the tip by sines and cosines alone: compass directions, and a sum in the plane of the arm."""
    a, rig = settings.arm, settings.rig
    yaw, q1, q2, q3, _ = angles
    out = (
        a.offset_m
        + a.upper_m * math.cos(q1)
        + a.fore_m * math.cos(q1 + q2)
        + (a.hand_m + a.scoop_length_m) * math.cos(q1 + q2 + q3)
    )
    up = (
        a.upper_m * math.sin(q1) + a.fore_m * math.sin(q1 + q2) + (a.hand_m + a.scoop_length_m) * math.sin(q1 + q2 + q3)
    )
    view = math.radians(rig.heading_deg)
    deck = view + math.radians(settings.lander.turn_deg)
    arm = deck - yaw  # compass directions are clockwise
    east = (
        rig.x_m
        + rig.baseline_m / 2 * math.cos(view)
        + a.shoulder_x_m * math.sin(deck)
        - a.shoulder_y_m * math.cos(deck)
        + out * math.sin(arm)
    )
    north = (
        rig.y_m
        - rig.baseline_m / 2 * math.sin(view)
        + a.shoulder_x_m * math.cos(deck)
        + a.shoulder_y_m * math.sin(deck)
        + out * math.cos(arm)
    )
    return np.array([east, north, site_m + a.shoulder_z_m + up])


def test_the_tip_is_where_the_lengths_add_up_to():
    settings = described()
    arm = make_parametric_arm(settings, 0.7)
    angles = random_joints(arm, 2000)
    error = max(np.linalg.norm(find_tip(arm, each) - add_up(settings, each, 0.7)) for each in angles)
    assert error < 1e-12  # metres: some tens of roundings of lengths of a few metres in double precision


def test_links_keep_their_lengths_and_stay_rigid():
    arm = make_parametric_arm(described())
    for angles in random_joints(arm, 50):
        poses = forward_kinematics(arm, angles)
        turns = poses[:, :3, :3]
        assert np.allclose(turns @ turns.transpose(0, 2, 1), np.eye(3), atol=1e-14)
        steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
        assert np.allclose(steps, [0.1, 1.0, 0.9, 0.15], atol=1e-7)  # settings are in single precision


def test_a_roll_turns_the_scoop_and_keeps_its_tip():
    arm = make_parametric_arm(described())
    straight, rolled = np.radians([20.0, 30.0, -70.0, -40.0, 0.0]), np.radians([20.0, 30.0, -70.0, -40.0, 90.0])
    assert np.allclose(find_tip(arm, straight), find_tip(arm, rolled), atol=1e-14)
    turn = forward_kinematics(arm, straight)[-1, :3, :3].T @ forward_kinematics(arm, rolled)[-1, :3, :3]
    assert np.allclose(turn, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-14)


@pytest.mark.parametrize("pitch_deg", [-90.0, -45.0, 10.0])
def test_inverse_kinematics_come_back_to_the_point(pitch_deg):
    arm = make_parametric_arm(described(), 0.3)
    x, y, z = np.random.default_rng(1).uniform((1.0, -4.0, -0.5), (6.0, 1.0, 1.5), (3000, 3)).T
    both, margins = solve_inverse_kinematics(arm, x, y, z, math.radians(pitch_deg))
    assert np.isfinite(margins).mean() > 0.2
    for joints in both:
        for k in np.flatnonzero(np.isfinite(joints[:, 2]))[:200]:
            assert np.linalg.norm(find_tip(arm, joints[k]) - (x[k], y[k], z[k])) < 1e-12
            pointing = forward_kinematics(arm, joints[k])[-1, :3, 0]
            assert pointing[2] == pytest.approx(math.sin(math.radians(pitch_deg)), abs=1e-12)


def test_what_inverse_returns_is_within_the_limits_and_the_margin_is_its_distance():
    arm = make_parametric_arm(described())
    x, y, z = np.random.default_rng(2).uniform((1.0, -4.0, -0.3), (6.0, 1.0, 0.3), (5000, 3)).T
    joints, margin = choose_inverse_solution(arm, x, y, z), find_joint_margin(arm, x, y, z)
    found = np.isfinite(joints[:, 0])
    assert 0.05 < found.mean() < 1.0
    assert np.array_equal(found, np.nan_to_num(margin, nan=-1.0) >= 0)
    least = np.minimum(joints[found] - arm.low, arm.high - joints[found])[:, :4].min(axis=1)
    assert np.allclose(least, margin[found], atol=1e-14)


def test_every_pose_within_the_limits_is_found_again_by_one_elbow_or_the_other():
    arm = make_parametric_arm(described())
    for angles in random_joints(arm, 300):
        place = find_tip(arm, angles)
        out = np.linalg.inv(arm.base)[:2] @ np.append(place, 1.0)
        wrist = forward_kinematics(arm, angles)[3, :3, 3]
        ahead = np.linalg.inv(arm.base)[:2] @ np.append(wrist, 1.0)
        forward_side = np.array([math.cos(angles[0]), math.sin(angles[0])])
        if out @ forward_side < 0 or ahead @ forward_side < arm.lengths_m[0]:
            continue  # the tip is behind the yaw axis: the closed form looks ahead only
        both = solve_inverse_kinematics(arm, place[0], place[1], place[2], angles[1] + angles[2] + angles[3])[0]
        error = np.abs((both[:, :4] - angles[:4] + np.pi) % (2 * np.pi) - np.pi).max(axis=1)
        assert error.min() < 1e-6  # near a stretched elbow the arc cosine loses half of the digits


def test_points_are_out_of_reach_beyond_the_stretched_arm_and_within_it_at_less():
    arm = make_parametric_arm(described())
    longest = sum(arm.lengths_m)
    for length, reached in ((longest + 1e-6, False), (longest - 1e-3, True)):
        place = arm.base @ [length, 0.0, 0.0, 1.0]
        assert np.isfinite(find_joint_margin(arm, place[0], place[1], place[2], 0.0)) == reached


def test_points_that_are_not_a_number_are_out_of_reach():
    assert np.isnan(find_joint_margin(make_parametric_arm(described()), np.nan, 0.0, 0.0))
    assert np.isnan(choose_inverse_solution(make_parametric_arm(described()), np.array([np.nan]), 0.0, 0.0)).all()


def test_a_fault_adds_to_the_commanded_angle():
    settings = described(elbow_offset_deg=2.5)
    difference = np.degrees(find_real_angles_rad(settings.arm) - read_commanded_rad(settings.arm))
    assert np.allclose(difference, [0.0, 0.0, 2.5, 0.0, 0.0], atol=1e-9)


def test_joints_beyond_their_limits_are_named_and_those_at_them_are_not():
    settings = described(yaw_deg=105.0, wrist_deg=-150.1)
    arm = make_parametric_arm(settings)
    assert [arm.joints[k].name for k in find_joints_beyond_limits(arm, read_commanded_rad(settings.arm))] == ["wrist"]


def test_the_default_pose_is_within_its_limits():
    settings = defaults()
    arm = make_parametric_arm(settings)
    assert find_joints_beyond_limits(arm, read_commanded_rad(settings.arm)) == []
    assert list(JOINTS) == [joint.name for joint in arm.joints]


def test_a_joint_that_slides_moves_its_link_along_the_axis():
    joints = (
        Joint("turn", "one", -1, make_rigid_transform(), np.array([0.0, 0.0, 1.0])),
        Joint(
            "slide", "two", 0, make_rigid_transform(place=(1.0, 0.0, 0.0)), np.array([1.0, 0.0, 0.0]), 0.0, 1.0, True
        ),
    )
    arm = Arm(joints, make_rigid_transform(place=(0.0, 0.0, 2.0)), np.zeros(3))
    assert np.allclose(find_tip(arm, np.array([np.pi / 2, 0.5])), [0.0, 1.5, 2.0], atol=1e-15)
