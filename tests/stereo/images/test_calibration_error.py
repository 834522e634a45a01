"""Errors of the assumed calibration: what they do to images and depths by the geometry of the rig, and by OpenCV."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pairs
import pytest
from icymoon.physics.camera.calibration_error import make_assumed_camera, make_assumed_eye, make_rectifying_map
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.settings.description import defaults, merged
from icymoon.settings.pair_ids import make_pair_id
from icymoon.stereo.cli import main
from icymoon.stereo.images.develop import develop
from icymoon.stereo.images.exr import read_view
from icymoon.stereo.images.lens import make_rectification
from icymoon.stereo.matchers import match
from icymoon.stereo.measure.prepare_pair import prepare_pair
from icymoon.stereo.measure.row_metrics import disparity_to_depth, measure_row_numbers
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")

RIG = pairs.camera()
BARREL = {"distortion_k1": -0.12, "distortion_k2": 0.02, "distortion_p1": 0.001, "distortion_p2": -0.0005}
ALL = {
    "right_yaw_deg": 0.7,
    "right_pitch_deg": -0.4,
    "right_roll_deg": 1.1,
    "right_column_px": 2.5,
    "right_row_px": -1.25,
    "right_focal_percent": 0.9,
    "focal_percent": -1.5,
    "baseline_percent": 2.0,
    "right_k1": 0.004,
    "k1": -0.01,
}


def erring(**values):
    return defaults().calibration_error | values


def place_of_content(rig=RIG, **values):
    """Normalised x and y of the sensor's pixels, and of where they appear in the right rectified image: along the
    assumed eye's rays. The map goes the other way, and is compared with OpenCV's below."""
    eye = make_assumed_eye(rig, defaults().rig, erring(**values), "right")
    v, u = np.indices((rig.height_px, rig.width_px))
    rays = eye.unproject(np.stack([u, v], axis=-1)) @ eye.rotation
    x, y = (u + 0.5 - rig.cx_px) / rig.focal_px, (v + 0.5 - rig.cy_px) / rig.focal_px
    return x, y, rays[..., 0] / rays[..., 2], rays[..., 1] / rays[..., 2]


def test_yaw_moves_what_is_seen_by_the_tangent_of_the_angle_and_so_disparity():
    """A direction at angle a to the axis appears at a + e: by f e (1 + x²) to first order, and by the tangent exactly.
    Disparity is the column in the left image minus that, so it falls, and things seem farther away."""
    for degrees in (0.05, -0.3, 5.0):
        e = np.radians(degrees)
        x, y, seen_x, seen_y = place_of_content(right_yaw_deg=degrees)
        np.testing.assert_allclose(seen_x, np.tan(np.arctan(x) + e), atol=1e-12)
        np.testing.assert_allclose(seen_y, y * np.hypot(1, np.tan(np.arctan(x) + e)) / np.hypot(1, x), atol=1e-12)
        # The next term is e² x (1 + x²).
        np.testing.assert_allclose(seen_x - x, e * (1 + x**2), atol=1.2 * e**2 * np.max(np.abs(x) * (1 + x**2)))


def test_pitch_lowers_rows_by_the_tangent_and_roll_by_the_column_times_the_sine():
    e = np.radians(0.4)
    _, y, _, seen_y = place_of_content(right_pitch_deg=0.4)
    np.testing.assert_allclose(seen_y, np.tan(np.arctan(y) + e), atol=1e-12)
    middle = RIG.height_px // 2
    assert RIG.focal_px * (seen_y - y)[middle, 3] == pytest.approx(RIG.focal_px * np.tan(e), rel=1e-3)
    x, y, seen_x, seen_y = place_of_content(right_roll_deg=0.4)
    np.testing.assert_allclose(seen_y, x * np.sin(e) + y * np.cos(e), atol=1e-12)
    np.testing.assert_allclose(seen_x, x * np.cos(e) - y * np.sin(e), atol=1e-12)


def test_the_principal_point_shifts_and_the_right_focal_length_magnifies():
    x, y, seen_x, seen_y = place_of_content(right_column_px=1.5, right_row_px=-0.5)
    np.testing.assert_allclose(RIG.focal_px * (seen_x - x), -1.5, atol=1e-9)
    np.testing.assert_allclose(RIG.focal_px * (seen_y - y), 0.5, atol=1e-9)
    x, y, seen_x, seen_y = place_of_content(right_focal_percent=2.0)
    np.testing.assert_allclose(seen_x * 1.02, x, atol=1e-12)
    np.testing.assert_allclose(seen_y * 1.02, y, atol=1e-12)


@pytest.mark.parametrize("eye", ["left", "right"])
@pytest.mark.parametrize("toe_in", [0.0, 3.0])
@pytest.mark.parametrize("lens", [{}, BARREL])
def test_the_map_is_opencvs_for_the_assumed_calibration(eye, toe_in, lens):
    """OpenCV's maps are float32, with an error of 3e-5 px here, and its intermediate steps are no worse."""
    camera, rig = replace(RIG, toe_in_deg=toe_in, cx_px=131.0, cy_px=70.5), defaults().rig | lens
    right = eye == "right"
    focal = RIG.focal_px * (1 - 0.015)
    own = focal * (1.009 if right else 1)
    matrix = np.array([[own, 0, 130.5 + 2.5 * right], [0, own, 70.0 - 1.25 * right], [0, 0, 1]])
    k1 = lens.get("distortion_k1", 0.0) - 0.01 + 0.004 * right
    k = np.array([k1, *(lens.get(f"distortion_{name}", 0.0) for name in ("k2", "p1", "p2", "k3"))])
    turned = cv2.Rodrigues(np.radians([0.0, toe_in * (-1 if right else 1), 0.0]))[0]
    error = cv2.Rodrigues(np.radians([0.4, 0.7, 1.1]))[0] if right else np.eye(3)
    back = turned @ error  # from the assumed eye's axes to the rectified rig's
    rectified = np.array([[focal, 0, 130.5], [0, focal, 70.0], [0, 0, 1]])
    columns, rows = cv2.initUndistortRectifyMap(matrix, k, back, rectified, (256, 144), cv2.CV_32FC1)
    found = make_rectifying_map(camera, rig, erring(**ALL), eye)
    np.testing.assert_allclose(found, np.stack([columns, rows], axis=-1), atol=2e-4)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return pairs.write_pair(tmp_path_factory.mktemp("pairs") / "aaa", pairs.Scene(rock=False))


def develop_with(folder, **errors):
    pair = read_pair(folder)
    left, right = (read_view(pair.image(eye)) for eye in ("left", "right"))
    return develop(pair, left, right, merged(pair.settings, {"calibration_error": errors}))


def test_without_an_error_nothing_changes(folder):
    plain, zero = develop_with(folder), develop_with(folder, **dict.fromkeys(ALL, 0.0))
    for eye in ("left", "right"):
        np.testing.assert_array_equal(zero.seen(eye), plain.seen(eye))
    assert not zero.is_rectified
    assert not [text for text in zero.warnings if "calibration" in text]
    settings = defaults()
    assert make_pair_id(merged(settings, {"calibration_error": ALL})) == make_pair_id(settings)
    assert make_assumed_camera(RIG, erring()) == RIG
    for toed in (RIG, replace(RIG, toe_in_deg=2.0)):
        for rig in (settings.rig, settings.rig | BARREL):
            for eye in ("left", "right"):
                known = make_rectification(toed, rig, erring(), eye)
                assert (known is None) == (toed is RIG and rig is settings.rig)
                if known is not None:
                    # What the general formula gives without an error, which is otherwise not asked.
                    np.testing.assert_allclose(make_rectifying_map(toed, rig, erring(), eye), known, atol=1e-4)


def test_the_right_eyes_error_moves_its_image_alone(folder):
    plain, moved = develop_with(folder), develop_with(folder, right_column_px=3.0, right_row_px=2.0)
    np.testing.assert_array_equal(moved.left, plain.left)
    np.testing.assert_array_equal(moved.right[:-2, :-3], plain.right[2:, 3:])
    assert not moved.right[-2:].any()  # nothing is known there
    np.testing.assert_array_equal(moved.detected_right, plain.right)
    assert any(
        "calibration_error.right_column_px +3, calibration_error.right_row_px +2" in text for text in moved.warnings
    )


@pytest.mark.parametrize("error", [{"baseline_percent": 2.0}, {"focal_percent": -3.0}])
def test_baseline_and_focal_lengths_scale_depth_and_nothing_else(folder, error):
    prepared, plain = prepare_pair(folder, {"calibration_error": error}), prepare_pair(folder, {})
    np.testing.assert_array_equal(prepared.right, plain.right)
    np.testing.assert_array_equal(prepared.truth, plain.truth)
    true = plain.pair.camera.disparity(plain.truth)
    factor = 1 + next(iter(error.values())) / 100
    np.testing.assert_allclose(disparity_to_depth(prepared, true), factor * plain.truth, rtol=1e-12)
    row = measure_row_numbers(prepared, true)
    assert row["abs_rel"] == pytest.approx(abs(factor - 1), rel=1e-9)
    assert row["epe_px"] == 0.0


def test_matched_disparities_fall_by_what_yaw_takes(folder):
    """On a smooth plane, at 0.5 degrees: 1.19 px in the middle and 2.2 px at the right edge. The median over a band of
    columns is within 0.1 px, twice what SGBM is off without an error."""
    truth = RIG.disparity(prepare_pair(folder, {}).truth)
    disparity, _, _ = match("sgbm", *develop_with(folder, right_yaw_deg=0.5).for_matchers())
    columns = np.arange(RIG.width_px) + 0.5
    for band in (slice(100, 130), slice(200, 230)):
        right_x = (columns[None, band] - truth[20:-20, band] - RIG.cx_px) / RIG.focal_px
        fall = RIG.focal_px * (np.tan(np.arctan(right_x) + np.radians(0.5)) - right_x)
        off = (disparity - truth)[20:-20, band] + fall
        assert abs(np.nanmedian(off)) < 0.1


@pytest.mark.parametrize("error", [{"right_column_px": 900.0}, {"right_row_px": -200.0}])
def test_an_error_that_leaves_nothing_is_one_sentence(folder, error):
    with pytest.raises(IcyMoonError, match=rf"calibration_error\.{next(iter(error))} .*right eye would be empty"):
        develop_with(folder, **error)


def test_five_degrees_of_everything_is_still_an_image(folder):
    images = develop_with(folder, right_yaw_deg=5.0, right_pitch_deg=-5.0, right_roll_deg=5.0, k1=-0.2)
    assert images.right.any()
    assert (images.right == 0).mean() < 0.5


def test_it_is_evaluated_without_a_render_and_said(folder, tmp_path, capsys):
    out = tmp_path / "out"
    words = [
        "evaluate",
        str(folder),
        "--methods",
        "bm",
        "--out",
        str(out),
        "--set",
        "calibration_error.baseline_percent=10",
    ]
    assert main(words) == 0
    assert "calibration_error.baseline_percent +10" in capsys.readouterr().err
    report = json.loads((out / "report.json").read_text())
    assert report["provenance"]["response_overrides"] == {"calibration_error.baseline_percent": 10.0}
    assert report["rows"][0]["abs_rel"] == pytest.approx(0.1, abs=0.02)
    assert "calibration_error.baseline_percent +10" in (out / "report.html").read_text()
    with np.load(out / report["rows"][0]["images"]["disparity"]) as stored:
        assert stored["focal_baseline_px_m"] == pytest.approx(1.1 * RIG.focal_baseline_px_m)


def test_exports_refuse_images_that_do_not_fit_their_truth(folder, tmp_path, capsys):
    words = ["export", str(folder), "--format", "kitti", "--out", str(tmp_path / "k")]
    assert main([*words, "--set", "calibration_error.right_yaw_deg=0.1"]) == 1
    assert "calibration_error.right_yaw_deg is 0.1" in capsys.readouterr().err
