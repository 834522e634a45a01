"""Where the arm gets: nowhere twice as far as it is long, and anywhere while there is none."""

from __future__ import annotations

import numpy as np
from icymoon.settings.description import defaults, merged
from icymoon.stereo.decisions.joint_margin import find_joint_margins_deg, has_arm

EAST, NORTH = np.meshgrid(np.linspace(-4, 4, 81), np.linspace(4, -4, 81))
ARM = merged(defaults(), {"lander": {"kind": "PARAMETRIC"}})


def test_without_a_lander_all_known_ground_is_in_reach():
    height = np.zeros(EAST.shape)
    height[3, 4] = np.nan
    found = find_joint_margins_deg(defaults(), 0.0, EAST, NORTH, height)
    assert not has_arm(defaults())
    assert np.isnan(found).sum() == 1
    assert np.nanmin(found) > 90


def test_reach_ends_at_the_length_of_the_arm_and_moves_with_its_ground():
    found = find_joint_margins_deg(ARM, 0.0, EAST, NORTH, np.zeros(EAST.shape))
    arm = ARM.arm
    shoulder = np.array([ARM.rig.baseline_m / 2 - arm.shoulder_y_m, arm.shoulder_x_m])  # the rig looks north
    far = np.hypot(EAST - shoulder[0], NORTH - shoulder[1])
    longest = arm.offset_m + arm.upper_m + arm.fore_m
    reached = np.isfinite(found)
    assert 0.05 < reached.mean() < 0.5
    assert far[reached].max() < longest
    assert np.nanmin(found) < 0 < 60 < np.nanmax(found)  # beyond a limit, and far from all
    lifted = find_joint_margins_deg(ARM, 2.5, EAST, NORTH, np.full(EAST.shape, 2.5))
    np.testing.assert_allclose(lifted, found, atol=1e-9)
