"""The equidistant image of wide eyes, beside OpenCV's fisheye, and which eyes need it."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from heads import FLOWN, HEADS, head_settings
from icymoon.physics.camera.eyes import (
    eyes_json,
    find_overscan_of_eyes,
    find_rays_in_rig,
    make_camera_with_eyes,
    measure_dark_shares,
)
from icymoon.physics.camera.panorama import Panorama, make_panorama
from icymoon.physics.scene_checks import advise_on_scene
from icymoon.settings.description import defaults, merged


def test_rays_are_shown_where_opencv_has_them():
    panorama = Panorama(300, 90.0)
    rays = np.random.default_rng(1).normal(size=(200, 3))
    rays = rays[rays[:, 2] > 0.05]
    matrix = np.array([[90.0, 0, 149.5], [0, 90.0, 149.5], [0, 0, 1]])
    expected, _ = cv2.fisheye.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), matrix, np.zeros(4))
    np.testing.assert_allclose(panorama.show(rays), expected[:, 0], atol=1e-9)


def test_an_angle_is_a_distance_up_to_the_opposite_direction():
    panorama = Panorama(600, 90.0)
    for angle in (0.0, 1e-9, 1.0, math.pi / 2, 2.0, 3.1):
        ray = np.array([0.6 * math.sin(angle), -0.8 * math.sin(angle), math.cos(angle)])
        expected = 90.0 * angle * np.array([0.6, -0.8]) + 299.5
        np.testing.assert_allclose(panorama.show(7.0 * ray), expected, atol=1e-6)
    assert np.isnan(panorama.show(np.full(3, np.nan))).all()
    assert np.isnan(panorama.show(np.array([0.0, 0.0, -1.0]))).all(), "which is no pixel in the middle"


def test_a_panorama_is_as_wide_as_it_must_be_and_never_wider_than_a_sphere():
    found = make_panorama(100.0, 1.0)
    assert found.size_px == 206
    assert found.field_rad == pytest.approx(2.06)
    assert make_panorama(100.0, 5.0).field_rad <= 2 * math.pi
    assert make_panorama(100.0, 5.0).field_rad == pytest.approx(2 * math.pi, abs=0.02)


@pytest.mark.parametrize("name", [*HEADS, *FLOWN])
def test_a_pinhole_is_chosen_where_it_shows_all_with_bearable_overscan(name):
    camera = make_camera_with_eyes(head_settings(name))
    assert (camera.panorama is None) == (find_overscan_of_eyes(camera) <= 1.0)
    assert (camera.panorama is None) == (name not in ("120 degrees, verged and rolled", "180 degrees"))
    assert measure_dark_shares(camera) == (0.0, 0.0)


@pytest.mark.parametrize("name", ["120 degrees, verged and rolled", "180 degrees"])
def test_every_ray_is_in_the_panorama_with_the_neighbours_of_its_spline(name):
    camera = make_camera_with_eyes(head_settings(name))
    for own in camera.eyes:
        pixels = np.stack(np.meshgrid(np.arange(own.width_px), np.arange(own.height_px)), axis=-1).astype(float)
        rays = find_rays_in_rig(own, pixels)
        where = camera.panorama.show(rays)
        assert (where >= 2).all()
        assert (where <= camera.panorama.size_px - 3).all()
        # In its middle the panorama has at least the pixels of the eye.
        centre = np.array([[own.cx_px, own.cy_px], [own.cx_px + 1, own.cy_px], [own.cx_px, own.cy_px + 1]])
        shown = camera.panorama.show(find_rays_in_rig(own, centre) @ own.rotation.T)
        assert np.linalg.norm(shown[1:] - shown[0], axis=1).min() > 0.999


def test_it_is_named_in_the_pair_and_in_the_advice():
    settings = head_settings("180 degrees")
    camera = make_camera_with_eyes(settings)
    stated = eyes_json(camera, settings.rig)["right"]
    assert stated["rendered_as"] == "FISHEYE"
    assert stated["fisheye"]["size_px"] == camera.panorama.size_px
    told = [each for each in advise_on_scene(settings) if each.startswith("eyes:")]
    assert len(told) == 1
    assert f"{camera.panorama.size_px} x {camera.panorama.size_px} px" in told[0]
    assert (
        eyes_json(make_camera_with_eyes(head_settings("nearly alike")), settings.rig)["left"]["rendered_as"]
        == "PINHOLE"
    )


def test_an_overscan_that_shows_all_keeps_the_pinhole():
    """Eyes that need between 1 and the largest overscan are a matter of what is set."""
    eyes = {
        topic: {"lens": "FISHEYE", "fx_px": 200.0, "fy_px": 200.0, "width_px": 640, "height_px": 480}
        for topic in ("left_eye", "right_eye")
    }
    settings = merged(defaults(), eyes, {"rig": {"eyes": "CALIBRATED", "focal_length_mm": 14.0}})
    needed = find_overscan_of_eyes(make_camera_with_eyes(settings))
    assert needed > 1.0
    assert make_camera_with_eyes(settings).panorama is not None
    if needed < 2.0:
        assert make_camera_with_eyes(merged(settings, {"rig": {"overscan": needed + 0.01}})).panorama is None


def test_an_eye_that_sees_all_around_needs_the_whole_sphere():
    eye = {"lens": "FISHEYE", "fx_px": 40.0, "fy_px": 40.0, "width_px": 300, "height_px": 300, "cx_px": 149.5,
           "cy_px": 149.5}  # fmt: skip
    settings = merged(defaults(), {"left_eye": eye, "right_eye": eye, "rig": {"eyes": "CALIBRATED"}})
    camera = make_camera_with_eyes(settings)
    assert camera.panorama.field_rad == pytest.approx(2 * math.pi, abs=0.05)
    assert max(measure_dark_shares(camera)) == pytest.approx(1 - math.pi * (40 * math.pi) ** 2 / 300**2, abs=0.02)
