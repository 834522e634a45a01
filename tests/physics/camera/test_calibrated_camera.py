"""Calibrated cameras against OpenCV and mrcal over whole images, both ways, and at the ends of their lenses.

OpenCV projects in closed form. Its inverse iterates; ours is held to its own forward direction, at 1e-6 px.
"""

from __future__ import annotations

import json
import math
from typing import Any

import cv2
import numpy as np
import pytest
from icymoon.physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig, rectifying_rotations
from icymoon.physics.camera.lens_models import Brown, Cahvore, Fisheye
from icymoon.physics.camera.rotations import from_quaternion, from_vector, quaternion, to_vector
from icymoon.support.version import ROOT

#: What is asked for, px.
EQUAL_PX = 1e-6
POSE = {"rotation": from_vector(np.array([0.3, -0.5, 0.2])), "translation_m": np.array([0.4, -0.1, 2.0])}
LENSES: dict[str, Any] = {
    "pinhole": Brown(),
    "5": Brown((-0.28, 0.09, 4e-4, -3e-4, -0.012)),
    "8": Brown((3.1, 0.9, -4e-4, 7e-4, 0.02, 3.3, 1.3, 0.08)),
    "12": Brown((3.1, 0.9, -4e-4, 7e-4, 0.02, 3.3, 1.3, 0.08, 2e-3, -1e-3, -3e-3, 5e-4)),
    "fisheye": Fisheye((-0.013, 0.021, -0.009, 0.0017)),
    "fisheye without coefficients": Fisheye(),
    "CAHVOR": Cahvore((0.02, -0.01, math.sqrt(1 - 0.0005)), (0.001, -0.2, 0.05)),
    **{
        f"CAHVORE {linearity}": Cahvore(
            (0.02, -0.01, math.sqrt(1 - 0.0005)), (0.001, -0.02, 0.005), (0.001, 0.002, 0.003), linearity
        )
        for linearity in (-0.5, 0.0, 0.37, 1.0)
    },
}


def camera(lens, **more) -> CalibratedCamera:
    return CalibratedCamera(**{"width_px": 640, "height_px": 480, "fx_px": 410.0, "fy_px": 395.0, "cx_px": 301.25,
                               "cy_px": 262.5, "lens": lens, **POSE, **more})  # fmt: skip


def pixels_of(one: CalibratedCamera, columns: int = 65, rows: int = 49):
    """Pixels (n, 2) over the image, its borders included."""
    grid = np.meshgrid(np.linspace(-0.5, one.width_px - 0.5, columns), np.linspace(-0.5, one.height_px - 0.5, rows))
    return np.stack(grid, axis=-1).reshape(-1, 2)


def points_at(one: CalibratedCamera, directions):
    """Points (n, 3) in reference axes along directions in the camera's, at distances from 0.1 to 50 m."""
    distances = np.geomspace(0.1, 50, len(directions))[:, None]
    return (directions * distances - one.translation_m) @ one.rotation


def coefficients_of(one: CalibratedCamera):
    assert not isinstance(one.lens, Cahvore)
    return np.array(one.lens.coefficients)


def by_opencv(one: CalibratedCamera, points):
    """Where OpenCV projects points (n, 3)."""
    turn, _ = cv2.Rodrigues(one.rotation)
    numbers = coefficients_of(one)
    if isinstance(one.lens, Fisheye):
        matrix = one.matrix.copy()
        alpha, matrix[0, 1] = matrix[0, 1] / matrix[0, 0], 0.0
        found, _ = cv2.fisheye.projectPoints(points[:, None], turn, one.translation_m, matrix, numbers, None, alpha)
    else:
        found, _ = cv2.projectPoints(points[:, None], turn, one.translation_m, one.matrix, numbers)
    return found[:, 0]


@pytest.mark.parametrize("name", LENSES)
def test_a_pixel_is_seen_where_its_ray_goes(name):
    one = camera(LENSES[name], skew_px=1.5)
    pixels = pixels_of(one)
    directions = one.unproject(pixels)
    assert np.isfinite(directions).all(), "the whole image sees something"
    assert np.abs(np.linalg.norm(directions, axis=1) - 1).max() < 1e-14
    assert np.abs(one.project(points_at(one, directions)) - pixels).max() < EQUAL_PX


@pytest.mark.parametrize("name", [name for name in LENSES if not name.startswith("CAHV")])
def test_opencv_projects_alike(name):
    one = camera(LENSES[name], skew_px=2.5 if "fisheye" in name else 0.0)
    points = points_at(one, one.unproject(pixels_of(one)))
    assert np.abs(by_opencv(one, points) - one.project(points)).max() < 1e-9
    assert np.abs(by_opencv(one, points) - pixels_of(one)).max() < EQUAL_PX


@pytest.mark.parametrize("name", ["5", "8", "12"])
def test_opencv_finds_the_same_rays_of_pixels(name):
    """Iterated to convergence; by default OpenCV stops after five steps."""
    one = camera(LENSES[name])
    pixels = pixels_of(one)
    ends = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-14)
    # In OpenCV 5 the other function takes the criteria.
    undistort = vars(cv2).get("undistortPointsIter", vars(cv2)["undistortPoints"])
    found = undistort(pixels[:, None], one.matrix, coefficients_of(one), R=None, P=None, criteria=ends)
    ours = one.unproject(pixels)
    assert np.abs(found[:, 0] - ours[:, :2] / ours[:, 2:]).max() * one.fx_px < EQUAL_PX


def test_opencv_finds_the_same_rays_of_a_fisheye():
    one = camera(LENSES["fisheye"])
    pixels = pixels_of(one)
    ends = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-14)
    found = cv2.fisheye.undistortPoints(pixels[:, None], one.matrix, coefficients_of(one), None, None, None, ends)
    ours = one.unproject(pixels)
    assert np.abs(found[:, 0] - ours[:, :2] / ours[:, 2:]).max() * one.fx_px < EQUAL_PX


GOLDEN = json.loads((ROOT / "tests" / "data" / "mrcal.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", [name for name in GOLDEN["cases"] if name != "CAHV"])
def test_mrcal_projects_alike_both_ways(name):
    """Pixels of mrcal 2.2 of random points, see ``tests/data/make_mrcal.py``."""
    fx, fy, cx, cy, *more = GOLDEN["cases"][name]["data"]
    if name.startswith("BROWN"):
        lens: Any = Brown(tuple(more))
    else:
        alpha, beta = more[:2]
        axis = (math.sin(alpha) * math.cos(beta), math.sin(beta), math.cos(alpha) * math.cos(beta))
        linearity = float(name.partition("_")[2] or 1.0)
        lens = Cahvore(axis, tuple(more[2:5]), tuple(more[5:]) or None, linearity)
    one = CalibratedCamera(640, 480, fx, fy, cx, cy, lens)
    points, wanted = np.array(GOLDEN["points_camera"]), np.array(GOLDEN["cases"][name]["pixels"])
    inside = np.abs(wanted - [320, 240]).max(axis=1) < 400
    assert np.abs(one.project(points) - wanted)[inside].max() < 1e-9
    along = points / np.linalg.norm(points, axis=1, keepdims=True)
    assert np.abs(one.unproject(wanted) - along)[inside].max() < 1e-9


def test_nothing_is_seen_beyond_a_fold():
    """r (1 - 0.3 r^2) turns back at r = 1.054, where it is 0.703: what is beyond has no pixel, and no ray."""
    one = CalibratedCamera(2000, 2000, 1000.0, 1000.0, 1000.0, 1000.0, Brown((-0.3, 0, 0, 0, 0)))
    at = np.array([[1.05, 0, 1], [1.06, 0, 1], [1.8, 0, 1], [0, 0, -1.0], [0, 0, 0]])
    assert np.isfinite(one.project(at)).all(axis=1).tolist() == [True, False, False, False, False]
    rays = one.unproject(np.array([[1702.0, 1000.0], [1703.5, 1000.0]]))
    assert np.isfinite(rays).all(axis=1).tolist() == [True, False]
    assert 0.1 < one.dark_share() < 0.9


def test_nothing_is_seen_beyond_a_pole():
    """1 - 0.5 r^2 below the line is 0 at r = 1.414; beyond it the quotient is negative, then grows again."""
    one = CalibratedCamera(2000, 2000, 100.0, 100.0, 1000.0, 1000.0, Brown((0, 0, 0, 0, 0, -0.5, 0, 0)))
    found = one.project(np.array([[1.41, 0, 1], [1.42, 0, 1], [30.0, 0, 1]]))
    assert np.isfinite(found).all(axis=1).tolist() == [True, False, False]


def test_a_fisheye_sees_behind_itself():
    """200 degrees: the image's edge at 100 degrees is shown at f a. Straight behind has no place."""
    one = CalibratedCamera(1000, 1000, 300.0, 300.0, 500.0, 500.0, Fisheye())
    angle = math.radians(100)
    pixel = one.project(np.array([[math.sin(angle), 0, math.cos(angle)]]))
    assert pixel == pytest.approx(np.array([[500 + 300 * angle, 500]]), abs=1e-9)
    assert one.unproject(pixel)[0] == pytest.approx([math.sin(angle), 0, math.cos(angle)], abs=1e-12)
    assert np.isnan(one.project(np.array([[0, 0, -1.0]]))).all()
    assert one.project(np.array([[0, 0, 1.0]])).tolist() == [[500.0, 500.0]]


def test_a_strong_lens_is_inverted_where_newton_alone_fails():
    """Corners of a wide lens: from the point itself Newton's method leaps beyond the fold."""
    lens = Brown((-0.35, 0.13, 0.0, 0.0, -0.018))
    one = CalibratedCamera(1280, 960, 500.0, 500.0, 640.0, 480.0, lens)
    angles = np.linspace(0, 55, 56)
    points = np.stack([np.tan(np.radians(angles)), np.zeros(56), np.ones(56)], axis=1)
    pixels = one.project(points)
    shown = np.isfinite(pixels[:, 0])
    assert shown.sum() > 40
    found = one.unproject(pixels[shown])
    assert np.abs(found[:, 0] / found[:, 2] - points[shown, 0]).max() < 1e-9


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"fx_px": -410.0}, "fx is -410 px"),
        ({"fy_px": 0.0}, "fy is 0 px"),
        ({"fx_px": math.nan}, "fx is nan px"),
        ({"cx_px": math.inf}, "cx is inf px"),
        ({"skew_px": math.nan}, "the skew is nan"),
        ({"width_px": 0}, "a width of 0"),
        ({"height_px": 10**6}, "a height of 1000000"),
        ({"rotation": np.diag([1.0, 1.0, -1.0])}, "mirrored"),
        ({"rotation": np.eye(3) * 1.001}, "off from 1 by 0.002"),
        ({"rotation": np.full((3, 3), math.nan)}, "no finite numbers"),
        ({"rotation": np.eye(4)}, "3 x 3"),
        ({"translation_m": np.array([0, math.nan, 0])}, "three numbers"),
    ],
)
def test_what_is_no_camera_is_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        camera(Brown(), **changes)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Brown((0.1, 0.2, 0.3, 0.4)), "5 or 8 or 12 coefficients, not 4"),
        (lambda: Brown((math.nan, 0, 0, 0, 0)), "not a finite number"),
        (lambda: Fisheye((0.1,) * 5), "4 coefficients, not 5"),
        (lambda: Cahvore((0.0, 0.0, -1.0), (0.0,) * 3), "point forward"),
        (lambda: Cahvore((0.0, 0.0, 1.0), (-1.5, 0, 0)), "mirrors"),
        (lambda: CalibratedRig(()), "at least one"),
    ],
)
def test_what_is_no_lens_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_a_rotation_with_rounded_numbers_becomes_one():
    rounded = np.round(POSE["rotation"], 7)
    found = camera(Brown(), rotation=rounded).rotation
    assert np.abs(found @ found.T - np.eye(3)).max() < 1e-14
    assert np.abs(found - rounded).max() < 1e-6


@pytest.mark.parametrize("degrees", [0.0, 1e-9, 1.0, 90.0, 179.9999999, 180.0])
def test_rotations_come_back_from_vectors_and_quaternions(degrees):
    vector = np.array([0.6, -0.48, 0.64]) * math.radians(degrees)
    turned = from_vector(vector)
    assert np.abs(turned - cv2.Rodrigues(vector)[0]).max() < 1e-14
    assert np.abs(from_vector(to_vector(turned)) - turned).max() < 1e-14
    assert np.abs(from_quaternion(3 * quaternion(turned)) - turned).max() < 1e-14


def test_a_quaternion_without_length_is_refused():
    with pytest.raises(ValueError, match="length 0"):
        from_quaternion(np.zeros(4))


def rig(shift=(-0.3, 0.01, 0.02), turn=(0.02, -0.05, 0.01)) -> CalibratedRig:
    left = camera(LENSES["5"])
    rotation = from_vector(np.array(turn))
    right = camera(LENSES["8"], fx_px=800.0, width_px=1280, rotation=rotation @ left.rotation,
                   translation_m=rotation @ left.translation_m + np.array(shift))  # fmt: skip
    return CalibratedRig((left, right))


def test_the_pose_of_one_eye_from_the_other():
    pair = rig()
    rotation, translation = pair.relative_pose()
    assert np.abs(rotation - from_vector(np.array([0.02, -0.05, 0.01]))).max() < 1e-14
    assert translation == pytest.approx([-0.3, 0.01, 0.02], abs=1e-14)
    again = pair.from_first()
    assert np.array_equal(again.cameras[0].rotation, np.eye(3))
    assert again.cameras[1].centre_m == pytest.approx(-rotation.T @ translation, abs=1e-14)
    point = np.array([[0.3, 0.2, 5.0]])
    seen = [one.project((point - pair.cameras[0].translation_m) @ pair.cameras[0].rotation) for one in pair.cameras]
    for one, wanted in zip(again.cameras, seen, strict=True):
        assert np.abs(one.project(point) - wanted).max() < 1e-9


@pytest.mark.parametrize("turn", [(0.02, -0.05, 0.01), (0.0, 0.785, 0.0), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("shift", [(-0.3, 0.01, 0.02), (0.3, -0.02, 0.01), (-0.3, 0.0, 0.0)])
def test_eyes_are_rectified_as_opencv_does(turn, shift):
    pair = rig(shift, turn)
    left, right = pair.cameras
    none = np.zeros(5)
    rotation, translation = pair.relative_pose()
    apart = translation.reshape(3, 1)  # OpenCV 5 takes a column alone
    wanted = cv2.stereoRectify(left.matrix, none, right.matrix, none, left.size_px, rotation, apart)[:2]
    for found, other in zip(rectifying_rotations(pair), wanted, strict=True):
        assert np.abs(found - other).max() < 1e-12


@pytest.mark.parametrize(("shift", "words"), [((0, 0, 0), "the same position"), ((0.1, 0.3, 0), "above the other")])
def test_eyes_that_have_no_rectified_pair_are_refused(shift, words):
    with pytest.raises(ValueError, match=words):
        rectifying_rotations(rig(shift, (0, 0, 0)))


def test_a_pinhole_is_a_lens_without_coefficients():
    assert [len(lens.shortened()) for lens in (LENSES["pinhole"], LENSES["5"], LENSES["8"], LENSES["12"])] == [
        0,
        5,
        8,
        12,
    ]
    assert Brown((-0.1, 0, 0, 0, 0, 0, 0, 0)).shortened() == (-0.1, 0, 0, 0, 0)
    assert [LENSES[name].name for name in ("pinhole", "5")] == ["pinhole", "Brown-Conrady, 5 coefficients"]
