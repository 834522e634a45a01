"""Optical flow against the laws of planes: homographies, and the way back."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.camera.optical_flow import find_flow
from icymoon.physics.camera.rotations import from_vector
from icymoon.physics.camera.stereo_camera import StereoCamera

CAMERA = StereoCamera(64, 48, 60.0, 31.0, 25.5, 0.1)
K = np.array(CAMERA.matrix)
#: A plane of the world, n · X = d, below cameras that look along +z with y down.
NORMAL, DISTANCE = np.array([0.1, 0.6, 1.0]), 4.0
MOTIONS = {
    "still": (np.zeros(3), np.zeros(3)),
    "to the right": (np.array([0.2, 0.0, 0.0]), np.zeros(3)),
    "forward": (np.array([0.0, 0.0, 0.5]), np.zeros(3)),
    "a turn": (np.zeros(3), np.array([0.02, -0.05, 0.1])),
    "both": (np.array([0.1, -0.2, 0.3]), np.array([-0.03, 0.04, 0.05])),
}


def posed(position, vector):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = from_vector(vector), position
    return pose


def rays():
    v, u = np.mgrid[: CAMERA.height_px, : CAMERA.width_px] + 0.5
    return np.stack([(u - CAMERA.cx_px) / CAMERA.focal_px, (v - CAMERA.cy_px) / CAMERA.focal_px, np.ones_like(u)], -1)


def plane_depth(pose, normal=NORMAL, distance=DISTANCE):
    """Planar depth of a plane of the world."""
    return (distance - normal @ pose[:3, 3]) / (rays() @ pose[:3, :3].T @ normal)


@pytest.mark.parametrize("name", MOTIONS)
def test_flow_of_a_plane_is_its_homography(name):
    """x' ~ K (R + t nᵀ / d) K⁻¹ x, with R and t from the first camera to the second, n and d in the first."""
    first, second = posed(np.zeros(3), np.zeros(3)), posed(*MOTIONS[name])
    turn = second[:3, :3].T
    homography = K @ (turn + np.outer(-turn @ second[:3, 3], NORMAL) / DISTANCE) @ np.linalg.inv(K)
    v, u = np.mgrid[: CAMERA.height_px, : CAMERA.width_px] + 0.5
    x, y, w = np.moveaxis(np.stack([u, v, np.ones_like(u)], -1) @ homography.T, -1, 0)
    found = find_flow(CAMERA, plane_depth(first), first, plane_depth(second), second)
    np.testing.assert_allclose(found.flow_px, np.stack([x / w - u, y / w - v], -1), atol=1e-9)
    # A plane hides nothing, so what is not seen has left the image.
    inside = (x / w >= 0) & (x / w <= CAMERA.width_px) & (y / w >= 0) & (y / w <= CAMERA.height_px)
    np.testing.assert_array_equal(found.visible, inside)


@pytest.mark.parametrize("name", MOTIONS)
def test_forward_then_backward_returns_to_the_pixel(name):
    """From where a point is seen, the depth of the plane there leads back; between pixels the way back is interpolated,
    which bends by less than 1e-3 px over one."""
    first, second = posed(np.zeros(3), np.zeros(3)), posed(*MOTIONS[name])
    depths = plane_depth(first), plane_depth(second)
    forward = find_flow(CAMERA, depths[0], first, depths[1], second)
    backward = find_flow(CAMERA, depths[1], second, depths[0], first)
    rows, columns = np.mgrid[: CAMERA.height_px, : CAMERA.width_px]
    u, v = columns + forward.flow_px[..., 0], rows + forward.flow_px[..., 1]
    inner = forward.visible & (u >= 0) & (v >= 0) & (u < CAMERA.width_px - 1) & (v < CAMERA.height_px - 1)
    left, top = np.floor(u[inner]).astype(int), np.floor(v[inner]).astype(int)
    a, b = (u[inner] - left)[:, None], (v[inner] - top)[:, None]
    back = (
        backward.flow_px[top, left] * (1 - a) * (1 - b)
        + backward.flow_px[top, left + 1] * a * (1 - b)
        + backward.flow_px[top + 1, left] * (1 - a) * b
        + backward.flow_px[top + 1, left + 1] * a * b
    )
    assert inner.mean() > 0.5
    np.testing.assert_allclose(back, -forward.flow_px[inner], atol=1e-3)


def test_far_from_the_origin_flow_keeps_its_digits():
    away = np.array([4.0e4, -3.0e4, 0.0])
    first, second = posed(np.zeros(3), np.zeros(3)), posed(*MOTIONS["both"])
    depths = plane_depth(first), plane_depth(second)
    near = find_flow(CAMERA, depths[0], first, depths[1], second).flow_px
    for pose in (first, second):
        pose[:3, 3] += away
    np.testing.assert_allclose(find_flow(CAMERA, depths[0], first, depths[1], second).flow_px, near, atol=1e-7)


def test_what_a_nearer_wall_covers_is_hidden_and_the_wall_is_not():
    """A wall 2 m away, left of the axis, before a wall at 4 m: a camera a metre to the right sees it 30 px further left
    and the far wall 15 px, so 15 px of that come into view at its edge; on the way back they are hidden."""
    first, second = posed(np.zeros(3), np.zeros(3)), posed(np.array([1.0, 0.0, 0.0]), np.zeros(3))
    columns = np.arange(CAMERA.width_px) + 0.5
    row = np.where(columns < 60, 2.0, 4.0)  # in the first image
    other = np.where(columns < 30, 2.0, 4.0)
    depth, other_depth = (np.tile(each, (CAMERA.height_px, 1)) for each in (row, other))
    back = find_flow(CAMERA, other_depth, second, depth, first)
    np.testing.assert_allclose(back.flow_px[..., 0], 60.0 / other_depth, atol=1e-9)
    expected = np.where(columns < 30, True, (columns + 15 >= 60) & (columns + 15 <= 64))
    np.testing.assert_array_equal(back.visible, np.tile(expected, (CAMERA.height_px, 1)))


def test_sky_has_no_flow_and_hides_nothing():
    pose = posed(np.zeros(3), np.zeros(3))
    depth = plane_depth(pose)
    sky = depth.copy()
    sky[:10] = np.nan
    found = find_flow(CAMERA, sky, pose, depth, pose)
    assert np.isnan(found.flow_px[:10]).all()
    assert not found.visible[:10].any()
    assert find_flow(CAMERA, depth, pose, sky, pose).visible[:9].all()


def test_a_point_behind_the_other_camera_is_nowhere():
    first, second = posed(np.zeros(3), np.zeros(3)), posed(np.array([0.0, 0.0, 10.0]), np.zeros(3))
    found = find_flow(CAMERA, plane_depth(first), first, np.full((48, 64), np.nan), second)
    assert np.isnan(found.flow_px).all()
    assert not found.visible.any()
