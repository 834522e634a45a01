"""The poses of the rows of a rolling shutter, and what follows from them."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.camera.blur import MOTION, find_blur
from icymoon.physics.camera.optical_flow import find_flow
from icymoon.physics.camera.rolling_shutter import (
    RollingShutter,
    find_rolling_shutter,
    move_to_middle,
    place_in_world,
    project_points,
)
from icymoon.physics.camera.rotations import from_vector
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.settings.description import check, defaults, merged
from icymoon.support.errors import IcyMoonError

CAMERA = StereoCamera(64, 48, 60.0, 31.0, 25.5, 0.25)
VELOCITY, TURN = np.array([0.3, -0.4, 0.2]), np.array([5.0, -8.0, 20.0])
SHUTTER = RollingShutter(0.4, 48, VELOCITY, TURN)
#: A plane of the world, n · X = d.
NORMAL, DISTANCE = np.array([0.1, 0.6, 1.0]), 4.0


def described(rig, **topics):
    return merged(defaults(), check({"rig": {"motion_exposure_s": 0.01} | rig, **topics}, "test"))


def plane_depth(poses):
    """Planar depth (H, W) of the plane, by the pose of each row."""
    v, u = np.mgrid[: CAMERA.height_px, : CAMERA.width_px] + 0.5
    rays = np.stack([(u - CAMERA.cx_px) / CAMERA.focal_px, (v - CAMERA.cy_px) / CAMERA.focal_px, np.ones_like(u)], -1)
    along = np.einsum("rij,rcj,i->rc", poses[:, :3, :3], rays, NORMAL)
    return rays, (DISTANCE - poses[:, :3, 3] @ NORMAL)[:, None] / along


def test_the_first_and_the_last_row_are_half_a_readout_before_and_after_the_middle():
    poses = SHUTTER.list_poses(np.eye(4))
    assert len(poses) == 48
    for row, time in ((0, -0.2), (47, 0.2)):
        np.testing.assert_allclose(poses[row, :3, :3], from_vector(np.radians(TURN) * time), atol=1e-12)
        np.testing.assert_allclose(poses[row, :3, 3], VELOCITY * time, atol=1e-12)
    np.testing.assert_allclose(poses[23] + poses[24], 2 * np.eye(4), atol=1e-3)  # on both sides of the middle
    with_margin = SHUTTER.list_poses(np.eye(4), margin=3)
    np.testing.assert_allclose(with_margin[3:-3], poses, atol=1e-12)
    np.testing.assert_allclose(with_margin[0, :3, 3], VELOCITY * (-0.2 - 3 * 0.4 / 47), atol=1e-12)


def test_the_right_eye_stands_the_baseline_to_the_right_of_the_left_one_in_each_row():
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = from_vector(np.array([0.3, -2.0, 1.0])), (5.0, -3.0, 2.0)
    beside = pose.copy()
    beside[:3, 3] += 0.25 * pose[:3, 0]
    left, right = SHUTTER.list_poses(pose), SHUTTER.list_poses(beside, 0.25)
    np.testing.assert_allclose(right[:, :3, :3], left[:, :3, :3], atol=1e-12)
    np.testing.assert_allclose(right[:, :3, 3], left[:, :3, 3] + 0.25 * left[:, :3, 0], atol=1e-12)


def test_a_vertical_edge_leans_by_speed_times_readout_times_focal_length_over_depth():
    """Of an edge that a camera passes sideways, the last row shows that much farther left than the first one."""
    speed, depth = 0.7, 3.0
    shutter = RollingShutter(0.05, 48, np.array([speed, 0.0, 0.0]), np.zeros(3))
    edge = np.stack([np.zeros(200), np.linspace(-1.6, 1.6, 200), np.full(200, depth)], axis=1)
    place, far = project_points(edge, CAMERA, shutter)
    lean = np.interp([0.5, 47.5], place[:, 1], place[:, 0])
    assert lean[0] - lean[1] == pytest.approx(speed * 0.05 * CAMERA.focal_px / depth, rel=1e-9)
    np.testing.assert_allclose(far, depth, rtol=1e-12)


def test_points_project_into_the_row_that_saw_them():
    poses = SHUTTER.list_poses(np.eye(4))
    rays, depth = plane_depth(poses)
    points = move_to_middle(rays * depth[..., None], SHUTTER).reshape(-1, 3)
    np.testing.assert_allclose(points @ NORMAL, DISTANCE, rtol=1e-12)
    row = np.arange(len(points)) // CAMERA.width_px
    same = place_in_world((rays * depth[..., None]).reshape(-1, 3), poses, row)
    np.testing.assert_allclose(points, same, atol=1e-12)
    place, far = project_points(points, CAMERA, SHUTTER)
    v, u = np.mgrid[:48, :64] + 0.5
    np.testing.assert_allclose(place, np.stack([u.ravel(), v.ravel()], -1), atol=1e-7)
    np.testing.assert_allclose(far, depth.ravel(), rtol=1e-9)


def test_what_moves_as_fast_as_rows_are_read_has_no_place():
    """At 3 m, 60 px of focal length and 0.1 s a row, 50 m/s are a hundred rows for each row."""
    shutter = RollingShutter(4.7, 48, np.array([0.0, 50.0, 0.0]), np.zeros(3))
    place, _ = project_points(np.array([[0.0, 0.3, 3.0], [0.0, 0.0, -3.0]]), CAMERA, shutter)
    assert np.isnan(place).all()
    assert np.isnan(project_points(np.full((1, 3), np.nan), CAMERA, SHUTTER)[0]).all()


def test_flow_between_rolling_frames_returns_to_the_pixel():
    """Within what bilinear flow loses between pixels, 1e-3 px; with one pose a frame it would be off by 0.46 px."""
    first, second = np.eye(4), np.eye(4)
    second[:3, :3], second[:3, 3] = from_vector(np.array([0.01, -0.02, 0.05])), (0.1, 0.05, 0.1)
    depths = [plane_depth(SHUTTER.list_poses(pose))[1] for pose in (first, second)]
    forward = find_flow(CAMERA, depths[0], first, depths[1], second, SHUTTER, SHUTTER)
    backward = find_flow(CAMERA, depths[1], second, depths[0], first, SHUTTER, SHUTTER)
    v, u = np.mgrid[:48, :64]
    at = np.stack([u, v], -1) + forward.flow_px
    inner = forward.visible & (at >= 0).all(-1) & (at < (63, 47)).all(-1)
    assert inner.mean() > 0.5
    left, top = np.floor(at[inner]).astype(int).T
    a, b = ((at[inner] - np.stack([left, top], -1)).T)[..., None]
    back = sum(
        backward.flow_px[top + j, left + i] * (a if i else 1 - a) * (b if j else 1 - b) for i in (0, 1) for j in (0, 1)
    )
    np.testing.assert_allclose(back, -forward.flow_px[inner], atol=1e-3)
    still = find_flow(CAMERA, depths[0], first, depths[1], second)
    assert np.abs(still.flow_px - forward.flow_px)[inner].max() > 0.3


def test_without_readout_or_without_motion_all_rows_have_one_pose_and_the_pair_keeps_its_name():
    moving = {"speed_right_m_s": 0.5}
    assert find_rolling_shutter(described(moving).rig) is None
    assert find_rolling_shutter(described({"readout_s": 0.1}).rig) is None
    assert find_blur(described({"readout_s": 0.1})) is None
    assert "readout_s" not in find_blur(described(moving)).to_json()
    assert find_blur(described(moving | {"readout_s": 0.1})).to_json()["readout_s"] == 0.1
    names = [expand_headings(described(moving | more))[0].id for more in ({}, {"readout_s": 0.0}, {"readout_s": 0.1})]
    assert names[0] == names[1] != names[2]
    for key in MOTION:
        found = find_rolling_shutter(described({key: 3.0, "readout_s": 0.1}).rig)
        assert (found.rows, found.readout_s) == (480, 0.1)


@pytest.mark.parametrize(
    ("rig", "fix"),
    [
        ({"toe_in_deg": 1.0}, "set rig.toe_in_deg to 0"),
        ({"distortion_k1": -0.1}, "set rig.distortion_k1 to 0"),
        ({"distortion_p2": 1e-4}, "set rig.distortion_p2 to 0"),
        ({"eyes": "CALIBRATED"}, "set rig.eyes to ALIKE"),
        ({"roll_deg_s": 100.0, "readout_s": 0.9}, "a readout of 0.9 s"),
    ],
)
def test_rows_without_exact_truth_are_refused_with_a_fix_that_works(rig, fix):
    rolling = {"speed_right_m_s": 0.5, "readout_s": 0.1}
    settings = described(rolling | rig)
    for refuse in (find_blur, expand_headings):
        with pytest.raises(IcyMoonError, match=fix):
            refuse(settings)
    find_blur(described(rolling | rig | {"readout_s": 0.0}))


def test_truth_by_cycles_is_refused_before_anything_is_rendered():
    settings = described({"speed_right_m_s": 0.5, "readout_s": 0.1}, quality={"truth_by": "CYCLES"})
    with pytest.raises(IcyMoonError, match=r"set quality\.truth_by to RAYS"):
        expand_headings(settings)
    expand_headings(merged(settings, {"rig": {"readout_s": 0.0}}))
    expand_headings(merged(settings, {"quality": {"truth_by": "RAYS"}}))
