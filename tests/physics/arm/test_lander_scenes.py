"""Shipped scenes with a lander: what the arm works on is where the cameras look and the arm reaches."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.arm.parametric_arm import find_joint_margin, make_parametric_arm
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.physics.light.directions import camera_axes
from icymoon.physics.terrain.standing_places import make_rocky_ground
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset, preset_names
from icymoon.settings.topics.scene import Settings

#: Degrees that the shipped rules of sites ask of every joint.
MARGIN_DEG = 10.0
LANDERS = [name for name in preset_names("scenes") if load_preset(name).get("lander", {}).get("kind", "NONE") != "NONE"]


def described(name: str) -> Settings:
    return merged(defaults(), load_preset(name))


def test_there_are_scenes_with_a_lander():
    assert {"scenes/workspace_europa_lander", "scenes/workspace_enceladus_orbilander"} <= set(LANDERS)


@pytest.mark.parametrize("name", LANDERS)
def test_the_workspaces_centre_is_seen_by_both_eyes_and_reached(name):
    settings = described(name)
    rig, workspace = settings.rig, settings.workspace
    ground = make_rocky_ground(settings)
    site_m, height_m = (
        float(ground.heights(np.array([x]), np.array([y]))[0])
        for x, y in ((rig.x_m, rig.y_m), (workspace.east_m, workspace.north_m))
    )
    axes, camera = camera_axes(rig.heading_deg, rig.pitch_deg), StereoCamera.from_settings(rig)
    left = np.array([rig.x_m, rig.y_m, site_m + rig.height_m])
    for eye in (left, left + rig.baseline_m * axes[:, 0]):
        x, y, z = axes.T @ (np.array([workspace.east_m, workspace.north_m, height_m]) - eye)
        column, row = camera.focal_px * x / z + camera.cx_px, camera.focal_px * y / z + camera.cy_px
        assert z > 0
        # Not at the rim: in the middle half of the image, so that the ground around it is seen as well.
        assert camera.width_px / 4 < column < 3 * camera.width_px / 4
        assert camera.height_px / 4 < row < 3 * camera.height_px / 4
    margin = find_joint_margin(make_parametric_arm(settings, site_m), workspace.east_m, workspace.north_m, height_m)
    assert math.degrees(float(margin)) > MARGIN_DEG


@pytest.mark.parametrize("name", LANDERS)
def test_cells_of_the_workspace_are_written_and_finer_than_the_scoop(name):
    settings = described(name)
    assert 0.0 < settings.workspace.cell_m <= settings.arm.scoop_width_m / 4
