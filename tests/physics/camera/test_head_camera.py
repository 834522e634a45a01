"""Projections of cameras beside the pair: closed forms, OpenCV, and there and back."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from icymoon.physics.camera.calibrated_camera import CalibratedCamera
from icymoon.physics.camera.head_camera import (
    Equirectangular,
    HeadCamera,
    Orthographic,
    Projection,
    camera_from_json,
    camera_json,
    is_plain,
    make_fisheye,
    make_pinhole,
    make_rays_of_pixels,
    show_points,
)
from icymoon.physics.camera.lens_models import Brown, Cahvore, Fisheye

PROJECTIONS: dict[str, Projection] = {
    "pinhole": make_pinhole(64, 48, 60.0),
    "fisheye": make_fisheye(64, 48, 190.0),
    "orthographic": Orthographic(64, 48, 4.0),
    "panorama": Equirectangular(128, 64, 360.0),
    "distorted": CalibratedCamera(64, 48, 60.0, 62.0, 30.0, 25.0, Brown((-0.2, 0.05, 0.001, -0.002, 0.0)), 0.3),
    "calibrated fisheye": CalibratedCamera(64, 48, 30.0, 31.0, 30.0, 25.0, Fisheye((0.01, -0.003, 0.0, 0.0))),
}


def _pixels(size: tuple[int, int]) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float)), -1)


@pytest.mark.parametrize("name", PROJECTIONS)
def test_a_point_on_the_ray_of_a_pixel_is_shown_at_that_pixel(name):
    projection = PROJECTIONS[name]
    pixels = _pixels(projection.size_px)
    origin, direction = make_rays_of_pixels(projection, pixels)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=-1), 1.0, rtol=1e-12)
    shown = show_points(projection, origin + 3.7 * direction)
    np.testing.assert_allclose(shown, pixels, atol=1e-9 if name != "distorted" else 1e-6)


def test_a_fisheye_is_opencvs():
    camera = make_fisheye(640, 480, 150.0)
    random = np.random.default_rng(1)
    points = random.normal(size=(200, 1, 3)) * [1.0, 1.0, 0.3] + [0.0, 0.0, 1.0]
    points = points[points[:, 0, 2] > 0.05]
    found, _ = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, np.zeros(4))
    np.testing.assert_allclose(show_points(camera, points), found, atol=1e-8)


def test_fields_are_those_across_the_width():
    """The outer border of the first and of the last pixel, half a pixel beyond their centres, spans the field."""
    borders = np.array([[-0.5, 23.5], [63.5, 23.5]])
    for projection, field in ((make_pinhole(64, 48, 60.0), 60.0), (make_fisheye(64, 48, 170.0), 170.0)):
        _, (left, right) = make_rays_of_pixels(projection, borders)
        assert np.degrees(np.arccos(left @ right)) == pytest.approx(field, abs=1e-9)
    origin, direction = make_rays_of_pixels(Orthographic(64, 48, 4.0), borders)
    assert origin[1, 0] - origin[0, 0] == pytest.approx(4.0)
    np.testing.assert_array_equal(direction, [[0.0, 0.0, 1.0]] * 2)


def test_a_panorama_has_ahead_in_the_middle_right_at_three_quarters_and_up_at_the_top():
    panorama = Equirectangular(360, 180, 360.0)
    shown = show_points(panorama, np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, -1, 1e-9], [0, 1, 1e-9]], float))
    expected = [[179.5, 89.5], [269.5, 89.5], [89.5, 89.5], [179.5, -0.5], [179.5, 179.5]]
    np.testing.assert_allclose(shown, expected, atol=1e-6)


def test_behind_an_orthographic_camera_nothing_is_shown():
    assert np.isnan(Orthographic(64, 48, 4.0).project(np.array([0.0, 0.0, -1.0]))).all()


@pytest.mark.parametrize("name", PROJECTIONS)
def test_the_rendered_image_shows_all_that_the_camera_sees(name):
    projection = PROJECTIONS[name]
    camera = HeadCamera("one", "mast", "MODEL", projection)
    rendered = camera.rendered
    assert is_plain(rendered)
    if is_plain(projection):
        assert rendered is projection
        return
    assert isinstance(rendered, CalibratedCamera)
    assert isinstance(projection, CalibratedCamera)
    _, direction = make_rays_of_pixels(projection, _pixels(projection.size_px))
    places = show_points(rendered, direction)
    # Splines ask for two pixels on either side.
    assert (places >= 1).all()
    assert (places <= np.array(rendered.size_px) - 2).all()
    assert max(rendered.fx_px, rendered.fy_px) >= max(projection.fx_px, projection.fy_px)


def test_a_narrow_lens_is_rendered_as_a_pinhole_and_a_wide_one_as_a_fisheye():
    for name, lens in (("distorted", Brown), ("calibrated fisheye", Fisheye)):
        rendered = HeadCamera("a", "mast", "M", PROJECTIONS[name]).rendered
        assert isinstance(rendered, CalibratedCamera)
        assert isinstance(rendered.lens, lens)


@pytest.mark.parametrize("name", [*PROJECTIONS, "cahvore"])
def test_an_entry_gives_the_same_camera_again(name):
    lens = Cahvore((0.0, 0.0, 1.0), (0.0, 0.01, 0.0), (0.001, 0.0, 0.0), 0.5)
    projection = PROJECTIONS.get(name) or CalibratedCamera(64, 48, 60.0, 60.0, 31.0, 24.0, lens)
    pose = np.eye(4)
    pose[:3, 3] = 1.0, 2.0, 3.0
    stated = json.loads(json.dumps(camera_json(HeadCamera("one", "arm", "M", projection), pose, "a.exr", "b.exr")))
    again = camera_from_json(stated)
    assert (again.name, again.role, again.model, again.frame) == ("one", "arm", "M", "ZERO")
    np.testing.assert_array_equal(again.pose, pose)
    pixels = _pixels(projection.size_px)
    for one, other in zip(
        make_rays_of_pixels(again.projection, pixels), make_rays_of_pixels(projection, pixels), strict=True
    ):
        np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "clause"),
    [
        ({"pose_camera_to_world": (2 * np.eye(4)).tolist()}, "not a rotation"),
        ({"K": [[1.0, 0.0]]}, "no K of 3 x 3"),
        ({"lens": {"model": "GLASS", "coefficients": []}}, "no lens"),
        ({"lens": {"model": "FISHEYE", "coefficients": "0"}}, "no lens"),
    ],
)
def test_an_entry_of_no_camera_is_refused(change, clause):
    stated = camera_json(HeadCamera("one", "arm", "PINHOLE", PROJECTIONS["pinhole"]), np.eye(4), "a.exr", "a.exr")
    with pytest.raises(ValueError, match=clause):
        camera_from_json({**stated, **change})
