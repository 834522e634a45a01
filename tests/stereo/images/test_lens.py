"""Lens distortion against OpenCV, and images and truth that stay together through it."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pairs
import pytest
from icymoon.errors import IcyMoonError
from icymoon.physics.camera.lens_distortion import distort, overscan_needed, refuse_folds, undistort
from icymoon.render.pairs.pair_folder import StereoCamera, read_pair
from icymoon.settings.description import defaults, merged
from icymoon.stereo.cli import main
from icymoon.stereo.images.develop import develop
from icymoon.stereo.images.exr import read_view
from icymoon.stereo.images.lens import lens_of
from icymoon.stereo.matchers import match

pytestmark = pytest.mark.filterwarnings("error")

BARREL = (-0.12, 0.02, 0.001, -0.0005, 0.003)
GRID = np.stack(np.meshgrid(np.linspace(-0.9, 0.9, 37), np.linspace(-0.7, 0.7, 29)), axis=-1)
QUIET = {"shot_noise": False, "read_noise_e": 0.0, "dark_current_e_s": 0.0}


def lens_settings(k=BARREL):
    return {f"distortion_{name}": value for name, value in zip(("k1", "k2", "p1", "p2", "k3"), k, strict=True)}


def test_the_model_is_opencvs():
    points = np.concatenate([GRID.reshape(-1, 2), np.ones((GRID.size // 2, 1))], axis=1)
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), np.array(BARREL))
    np.testing.assert_allclose(distort(GRID, BARREL).reshape(-1, 2), expected[:, 0], atol=1e-12)


@pytest.mark.parametrize("k", [BARREL, (0.3, 0.1, 0.0, 0.0, 0.0), (0.0, 0.0, 0.01, 0.01, 0.0), (0.0,) * 5])
def test_taking_distortion_away_is_its_inverse(k):
    np.testing.assert_allclose(undistort(distort(GRID, k), k), GRID, atol=1e-9)


def test_beyond_the_fold_there_is_nothing_and_a_folded_image_is_refused():
    strong = (-0.5, 0.0, 0.0, 0.0, 0.0)  # r (1 - r²/2) turns back at r = 0.816, where it is 0.544
    assert np.isnan(undistort(np.array([[0.6, 0.0]]), strong)).all()
    np.testing.assert_allclose(undistort(np.array([[0.5, 0.0]]), strong), [[0.618, 0.0]], atol=1e-3)
    refuse_folds(GRID * 0.5, strong)
    with pytest.raises(IcyMoonError, match=r"rig\.distortion_k1"):
        refuse_folds(GRID, strong)


def develop_with(folder, k, **sensor):
    pair = read_pair(folder)
    left, right = (read_view(pair.image(eye)) for eye in ("left", "right"))
    settings = merged(pair.settings, {"rig": lens_settings(k), "sensor": QUIET | {"bits": 12} | sensor})
    return pair, left, develop(pair, left, right, settings)


def test_rectified_images_lie_on_the_truth_and_distorted_ones_do_not(tmp_path):
    folder = pairs.write_pair(tmp_path / "pair", pairs.Scene(rock=False))
    pair, _, plain = develop_with(folder, (0.0,) * 5)
    assert plain.detected_left is plain.left
    _, left, images = develop_with(folder, BARREL)
    inner = (slice(20, -20), slice(70, -20))
    scale = float(plain.left[inner].mean())
    off = np.abs(images.left[inner].astype(float) * plain.exposure_s / images.exposure_s - plain.left[inner])
    assert np.median(off) < 0.02 * scale  # twice interpolated, and no more
    bent = np.abs(images.detected_left[inner].astype(float) * plain.exposure_s / images.exposure_s - plain.left[inner])
    assert np.median(bent) > 5 * np.median(off)
    disparity, _, _ = match("sgbm", *images.for_matchers())
    error = disparity - pair.camera.disparity(left.depth)
    assert np.abs(np.nanmedian(error[inner])) < 0.05


def test_opencv_rectifies_the_detected_image_with_the_calibration(tmp_path):
    folder = pairs.write_pair(tmp_path / "set" / "pairs" / "aaa")
    arguments = [f"--set=rig.{key}={value}" for key, value in lens_settings().items()]
    assert main(["develop", str(folder), "--out", str(tmp_path / "out"), *arguments]) == 0
    out = tmp_path / "out" / "aaa"
    said = json.loads((out / "images.json").read_text())
    matrix = np.array(said["camera"]["K"])
    matrix[:2, 2] -= 0.5  # OpenCV counts from pixel centres
    bent, flat = (cv2.imread(str(out / name), cv2.IMREAD_UNCHANGED) for name in ("left_distorted.png", "left.png"))
    k = np.array([said["distortion"][name] for name in ("k1", "k2", "p1", "p2", "k3")])
    assert np.abs(cv2.undistort(bent, matrix, k)[5:-5, 5:-5].astype(int) - flat[5:-5, 5:-5]).max() <= 3
    # The depth beside it is that of the ray that each of its pixels is.
    depth = np.load(out / "left_distorted_depth.npy")
    truth = read_view(folder / "left.exr").depth
    points = np.array([[[100.0, 40.0]], [[200.0, 120.0]]])
    for (u, v), (x, y) in zip(points[:, 0].astype(int), cv2.undistortPoints(points, matrix, k, P=matrix)[:, 0],
                              strict=True):
        assert depth[v, u] == np.float32(truth[round(float(y)), round(float(x))])
    assert main(["develop", str(folder), "--out", str(tmp_path / "out")]) == 0
    assert sorted(p.name for p in out.iterdir()) == ["images.json", "left.png", "right.png"]


def test_where_the_render_does_not_reach_is_dark_and_without_truth(tmp_path):
    pair = read_pair(pairs.write_pair(tmp_path / "pair"))
    lens = lens_of(pair.camera, defaults().rig | lens_settings(), "left")
    truth = lens.truth_of_sensor(np.ones((144, 256)))
    assert np.isnan(truth[0, 0])
    assert truth[72, 128] == 1.0
    assert lens.distort(np.ones((144, 256)))[0, 0] == 0.0
    assert lens_of(pair.camera, defaults().rig, "left") is None


@pytest.mark.parametrize("k", [BARREL, (-0.2, 0.05, 0.0, 0.0, 0.0), (0.0, 0.0, 0.02, -0.03, 0.0)])
@pytest.mark.parametrize("shift", [0.0, 9.5])
def test_the_overscan_that_is_needed_lights_every_pixel_and_less_does_not(k, shift):
    rig = defaults().rig | lens_settings(k) | {"width_px": 200, "height_px": 160, "principal_y_px": shift}
    needed = overscan_needed(rig)
    assert 0 < needed < 0.5

    def darkest(overscan):
        camera = StereoCamera.from_settings(rig | {"overscan": overscan})
        return lens_of(camera, rig, "left").distort(np.ones(camera.rendered_px[::-1])).min()

    assert darkest(needed) == pytest.approx(1.0, abs=1e-5)
    assert darkest(max(0.0, needed - 1.01 / 160)) == 0.0


def test_a_lens_that_sees_less_needs_no_overscan_and_beyond_a_fold_none_helps():
    assert overscan_needed(defaults().rig) == 0.0
    assert overscan_needed(defaults().rig | lens_settings((0.1, 0.0, 0.0, 0.0, 0.0))) == 0.0
    assert overscan_needed(defaults().rig | lens_settings((-0.3, 0.0, 0.0, 0.0, 0.0))) is None


@pytest.mark.parametrize("toe_in", [0.0, 5.0, 45.0])
def test_rectification_of_turned_eyes_is_the_homography_of_the_turn(toe_in):
    camera = replace(pairs.camera(), toe_in_deg=toe_in)
    assert (lens_of(camera, defaults().rig, "left") is None) == (toe_in == 0)
    for eye in ("left", "right") if toe_in else ():
        lens = lens_of(camera, defaults().rig, eye)
        matrix = np.array(camera.matrix)
        matrix[:2, 2] -= 0.5
        turn = matrix @ camera.eye_rotation(eye) @ np.linalg.inv(matrix)
        v, u = np.indices((144, 256)).astype(float)
        expected = np.stack([u, v, np.ones_like(u)], axis=-1) @ turn.T
        ahead = expected[..., 2] > 1e-3
        np.testing.assert_allclose(lens.rectified_in_sensor[ahead], (expected[..., :2] / expected[..., 2:])[ahead],
                                   rtol=1e-4, atol=1e-3)
        assert np.isnan(lens.rectified_in_sensor[expected[..., 2] < -1e-3]).all()
        assert lens.sees.mean() == pytest.approx(1.0, abs=1.2 * np.tan(np.radians(toe_in)) + 0.05)
        assert lens.sees.any()
