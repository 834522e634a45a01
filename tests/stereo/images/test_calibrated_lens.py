"""Images of calibrated eyes: the maps against OpenCV, and what warping costs against the light itself."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from heads import HEADS, head_settings
from icymoon.physics.camera.eyes import find_rays_in_rig, make_camera_with_eyes
from icymoon.physics.camera.lens_models import Cahvore, Fisheye
from icymoon.stereo.images.lens import make_lens

EYES = ("left", "right")
#: The eyes whose cameras OpenCV has.
OPENCV = [
    (name, eye)
    for name, rig in HEADS.items()
    for eye, own in zip(EYES, rig.cameras, strict=True)
    if not (isinstance(own.lens, Cahvore) or own.skew_px)
]


def rig_matrix(camera, margins=False):
    matrix = np.array(camera.matrix) - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    return matrix + np.array([[0, 0, camera.margin_x_px], [0, 0, camera.margin_y_px], [0, 0, 0]]) * margins


def lens_of(name, eye):
    settings = head_settings(name)
    camera = make_camera_with_eyes(settings)
    return camera, camera.own_eye(eye), make_lens(camera, settings.rig, eye)


@pytest.mark.parametrize(("name", "eye"), OPENCV)
def test_maps_that_rectify_are_opencvs(name, eye):
    camera, own, lens = lens_of(name, eye)
    size, turn, matrix = (camera.width_px, camera.height_px), own.rotation.T, own.matrix
    k, new = np.array(own.lens.coefficients), rig_matrix(camera)
    module = cv2.fisheye if isinstance(own.lens, Fisheye) else cv2
    expected = np.stack(module.initUndistortRectifyMap(matrix, k, turn, new, size, cv2.CV_32FC1), axis=-1)
    np.testing.assert_allclose(lens.rectified_in_sensor, expected, atol=1e-3)


@pytest.mark.parametrize(("name", "eye"), OPENCV)
def test_pixels_of_the_sensor_are_rendered_where_opencv_has_them(name, eye):
    camera, own, lens = lens_of(name, eye)
    place = lens.sensor_in_rendered[::7, ::5].reshape(-1, 1, 2).astype(np.float64)
    points = (place[:, 0] - rig_matrix(camera, True)[:2, 2]) / camera.focal_px
    rays = np.concatenate([points, np.ones_like(points[:, :1])], axis=1)
    turn, _ = cv2.Rodrigues(np.array(own.rotation))
    project = cv2.fisheye.projectPoints if isinstance(own.lens, Fisheye) else cv2.projectPoints
    order = (turn, np.zeros(3), own.matrix, np.array(own.lens.coefficients))
    found, _ = project(rays.reshape(-1, 1, 3), *order)
    rows, columns = np.mgrid[: own.height_px : 7, : own.width_px : 5]
    # Places are stored in single precision, 1e-5 px here.
    np.testing.assert_allclose(found.reshape(-1, 2), np.stack([columns, rows], -1).reshape(-1, 2), atol=1e-3)


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("name", HEADS)
def test_both_ways_through_the_sensor_lead_to_the_same_ray(name, eye):
    """Also for lenses that OpenCV lacks: rectified, sensor and rendered pixels of one ray, by the camera itself."""
    camera, own, lens = lens_of(name, eye)
    assert lens.sensor_in_rendered.shape == (own.height_px, own.width_px, 2)
    assert lens.rectified_in_sensor.shape == (camera.height_px, camera.width_px, 2)
    sees = lens.sees
    assert sees.mean() > 0.5
    rays = find_rays_in_rig(own, lens.rectified_in_sensor[sees].astype(np.float64))
    rays = rays / rays[:, 2:]
    rows, columns = np.nonzero(sees)
    back = rays[:, :2] * camera.focal_px + rig_matrix(camera)[:2, 2]
    np.testing.assert_allclose(back, np.stack([columns, rows], -1), atol=1e-4)
    margins = np.array([camera.margin_x_px, camera.margin_y_px])
    np.testing.assert_allclose(lens.rectified_in_rendered[sees], back + margins, atol=1e-4)


def light(rays, focal, period_px):
    """A texture of the plane z = 1 whose waves are this many pixels of the rig long, in three directions."""
    wave = 2 * np.pi * focal / period_px
    x, y = np.moveaxis(rays[..., :2] / rays[..., 2:], -1, 0)
    return 1 + (np.sin(wave * x) + np.sin(wave * y + 1) + np.sin(wave * (0.6 * x - 0.8 * y) + 2)) / 4


def warping_error(name, eye, period_px):
    """RMS of warped light less the light at the sensor's own rays, as a share of its contrast (RMS)."""
    camera, own, lens = lens_of(name, eye)
    width, height = camera.rendered_px
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    points = (pixels - rig_matrix(camera, True)[:2, 2]) / camera.focal_px
    points = np.concatenate([points, np.ones_like(points[..., :1])], axis=-1)
    warped = lens.distort(light(points, camera.focal_px, period_px).astype(np.float32))
    sensor = np.stack(np.meshgrid(np.arange(own.width_px), np.arange(own.height_px)), axis=-1)
    direct = light(find_rays_in_rig(own, sensor.astype(float)), camera.focal_px, period_px)
    inner = np.s_[4:-4, 4:-4]  # beyond the border of the render cubics have no neighbours
    seen = warped[inner] > 0
    return float(np.std((warped - direct)[inner][seen]) / np.std(direct[inner][seen]))


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("name", HEADS)
@pytest.mark.parametrize(("period_px", "most"), [(4, 0.02), (8, 1e-3), (16, 1e-4)])
def test_warping_costs_little_contrast_of_waves_that_the_render_has(name, eye, period_px, most):
    assert warping_error(name, eye, period_px) < most


def light_around(rays, px_per_rad, period_px):
    """A texture over all directions whose waves are this many pixels long where they are shortest."""
    unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    wave = 2 * np.pi * px_per_rad / period_px
    return 1 + sum(np.sin(wave * unit[..., axis] + axis) for axis in range(3)) / 4


def make_rays_of_pixels(panorama):
    """Directions of the pixels of a panorama; those beyond its circle see what is black."""
    grid = np.arange(panorama.size_px) - (panorama.size_px - 1) / 2
    x, y = np.meshgrid(grid, grid)
    angle = np.maximum(np.hypot(x, y), 1e-12) / panorama.px_per_rad
    side = np.sin(angle) / (angle * panorama.px_per_rad)
    return np.stack([x * side, y * side, np.cos(angle)], axis=-1), angle <= panorama.field_rad / 2


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("name", ["120 degrees, verged and rolled", "180 degrees"])
@pytest.mark.parametrize(("period_px", "most"), [(4, 0.02), (8, 1e-3), (16, 1e-4)])
def test_warping_a_panorama_costs_as_little(name, eye, period_px, most):
    camera, own, lens = lens_of(name, eye)
    rays, inside = make_rays_of_pixels(camera.panorama)
    texture = np.where(inside, light_around(rays, camera.panorama.px_per_rad, period_px), 0.0)
    warped = lens.distort(texture.astype(np.float32))
    sensor = np.stack(np.meshgrid(np.arange(own.width_px), np.arange(own.height_px)), axis=-1)
    direct = light_around(find_rays_in_rig(own, sensor.astype(float)), camera.panorama.px_per_rad, period_px)
    assert np.std(warped - direct) / np.std(direct) < most


@pytest.mark.parametrize("name", ["120 degrees, verged and rolled", "180 degrees"])
def test_the_rectified_light_is_taken_from_the_panorama(name):
    """Linear interpolation of waves of 24 px is off by 2 % of their height at most."""
    camera, _, lens = lens_of(name, "left")
    rays, _ = make_rays_of_pixels(camera.panorama)
    scale = camera.panorama.px_per_rad
    found = lens.rectify_radiance(light_around(rays, scale, 24).astype(np.float32))
    pixels = np.stack(np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px)), axis=-1)
    points = (pixels - rig_matrix(camera)[:2, 2]) / camera.focal_px
    expected = light_around(np.concatenate([points, np.ones_like(points[..., :1])], axis=-1), scale, 24)
    assert np.abs(found - expected).max() < 0.02
