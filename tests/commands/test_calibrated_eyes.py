"""Two calibrated cameras as settings of a rig that has both, from the files of other programs."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from heads import HEADS
from icymoon.commands import camera
from icymoon.commands.calibrated_eyes import find_why_calibrated
from icymoon.commands.calibration_advice import check_baseline
from icymoon.commands.camera import read_eyes, read_rig
from icymoon.commands.cli import main
from icymoon.formats.calibrations.options import Stated
from icymoon.formats.calibrations.registry import FORMATS, write_calibration
from icymoon.physics.camera.calibrated_camera import CalibratedRig
from icymoon.physics.camera.eyes import make_camera_with_eyes
from icymoon.physics.camera.lens_models import Brown
from icymoon.physics.camera.rotations import from_vector
from icymoon.settings.description import defaults, merged
from icymoon.settings.toml_text import read_toml
from icymoon.support.errors import IcyMoonError


def files_of(folder, rig, kind):
    names = [f"{eye}{FORMATS[kind].suffix}" for eye in ("left", "right")] if FORMATS[kind].each else ["both.yaml"]
    paths = [folder / name for name in names]
    write_calibration(rig, paths, kind)
    return paths


def camera_from(settings):
    return make_camera_with_eyes(merged(defaults(), settings))


def coefficients_of(camera):
    assert isinstance(camera.lens, Brown)
    return camera.lens.coefficients


@pytest.mark.parametrize(
    ("name", "kind"),
    [("nearly alike", "opencv"), ("nearly alike", "ros"), ("nearly alike", "mrcal"), ("nearly alike", "kalibr")],
)
def test_each_format_gives_both_eyes_as_they_are(tmp_path, name, kind):
    rig = HEADS[name]
    if kind == "kalibr":  # which has four coefficients
        rig = CalibratedRig(tuple(
            replace(camera, lens=Brown((*coefficients_of(camera)[:4], 0.0))) for camera in rig.cameras
        ))  # fmt: skip
    found, notes = read_eyes(*files_of(tmp_path, rig, kind))
    assert any(note.startswith("Each eye is rendered as it is: the eyes differ by up to 2.8") for note in notes)
    eyes = CalibratedRig(camera_from(found).eyes)
    for k, (own, wanted) in enumerate(zip(eyes.cameras, rig.cameras, strict=True)):
        np.testing.assert_allclose(own.matrix, wanted.matrix, atol=1e-5)
        np.testing.assert_allclose(coefficients_of(own), coefficients_of(wanted), rtol=1e-6)
        np.testing.assert_allclose(eyes.relative_pose(k)[0], rig.relative_pose(k)[0], atol=1e-6)
        np.testing.assert_allclose(eyes.relative_pose(k)[1], rig.relative_pose(k)[1], atol=1e-6)


def test_the_rectified_pair_is_turned_as_by_opencv(tmp_path):
    rig = HEADS["nearly alike"]
    left, right = rig.cameras
    rotation, translation = rig.relative_pose()
    order = (left.matrix, np.array(coefficients_of(left)), right.matrix, np.array(coefficients_of(right)))
    first, second, *_ = cv2.stereoRectify(*order, left.size_px, rotation, translation[:, None])
    found, _ = read_eyes(*files_of(tmp_path, rig, "opencv"))
    eyes = camera_from(found).eyes
    np.testing.assert_allclose(eyes[0].rotation.T, first, atol=1e-6)
    np.testing.assert_allclose(eyes[1].rotation.T, second, atol=1e-6)
    assert found.rig.baseline_m == pytest.approx(np.linalg.norm(translation))


def test_what_is_printed_is_a_file_of_settings(tmp_path, capsys):
    assert main(["camera", str(*files_of(tmp_path, HEADS["nearly alike"], "opencv"))]) == 0
    printed = capsys.readouterr().out
    (tmp_path / "rig.toml").write_text(printed, encoding="utf-8")
    found = read_toml(tmp_path / "rig.toml")
    assert found["rig"]["eyes"] == "CALIBRATED"
    assert found["left_eye"]["fx_px"] == pytest.approx(98.31)
    assert found["right_eye"]["cx_px"] == pytest.approx(45.1)
    assert "skew_px" not in found["left_eye"]
    assert found["right_eye"]["lens"] == "BROWN"


def test_alike_gives_one_camera_for_both_as_before(tmp_path, capsys):
    paths = files_of(tmp_path, HEADS["nearly alike"], "opencv")
    wanted, _ = read_rig(*paths)
    assert main(["camera", "--alike", str(*paths)]) == 0
    printed = capsys.readouterr().out
    assert "eye" not in "".join(line for line in printed.splitlines() if not line.startswith("#"))
    assert f"baseline_m = {wanted.rig.baseline_m}" in printed


def test_eyes_that_one_camera_can_stand_for_have_no_tables(tmp_path):
    left, _ = HEADS["nearly alike"].cameras
    rig = CalibratedRig((left, left.placed(np.eye(3), np.array([-0.2, 0.0, 0.0]))))
    assert find_why_calibrated(rig) == ""
    found, notes = read_eyes(*files_of(tmp_path, rig, "opencv"))
    assert list(found) == ["rig"]
    assert notes == ["The baseline is in m, as stated."]
    assert found.rig.distortion_k1 == pytest.approx(-0.11)


@pytest.mark.parametrize(
    ("shift", "words"),
    [
        ((0.2, 0.0, 0.0), "stands 0.2 m to the left of .*left.*, so it is the left eye; give it first"),
        ((0.0, -0.2, 0.0), "one eye is above the other"),
        ((-200.0, 0.0, 0.0), "divide it by 1000 in the file"),
    ],
)
def test_eyes_that_are_no_pair_are_one_sentence(tmp_path, shift, words):
    left, right = HEADS["nearly alike"].cameras
    rig = CalibratedRig((left, right.placed(np.eye(3), np.array(shift))))
    with pytest.raises(IcyMoonError, match=words):
        read_eyes(*files_of(tmp_path, rig, "mrcal"))


def test_files_of_ros_in_the_wrong_order_are_exchanged_eyes(tmp_path):
    """The first file has the baseline then, and the second one none."""
    left, right = files_of(tmp_path, HEADS["nearly alike"], "ros")
    with pytest.raises(IcyMoonError, match=r"left\.yaml stands 0\.\d+ m to the left of .*right\.yaml.*; give it first"):
        read_eyes(right, left)


def test_a_lens_that_folds_the_image_is_named_with_its_file(tmp_path):
    left, right = HEADS["nearly alike"].cameras
    rig = CalibratedRig((left, replace(right, lens=Brown((-0.9, 0.0, 0.0, 0.0, 0.0)))))
    paths = files_of(tmp_path, rig, "mrcal")
    with pytest.raises(IcyMoonError, match=r"right\.cameramodel: right_eye\.k1 to k6 fold the image over itself"):
        read_eyes(*paths)


def test_a_long_baseline_is_doubted():
    assert check_baseline(0.3, "a.cameramodel", "the translation is", "mrcal", Stated()) == []
    (note,) = check_baseline(30.0, "a.cameramodel", "the translation is", "mrcal", Stated())
    assert "divide it by 1000 in the file" in note


def test_a_short_baseline_is_doubted():
    """A T of 0.12 in metres that is taken for millimetres; an endoscope's eyes are 4 mm apart."""
    (note,) = check_baseline(0.00012, "a.yml", "the translation is", "opencv", Stated("mm"))
    assert note == (
        "The eyes are 0.00012 m apart, since the translation is in mm; if it is in another unit, state --unit m or in."
    )
    assert check_baseline(0.004, "a.yml", "the translation is", "opencv", Stated("mm")) == []


@pytest.mark.parametrize(("scale", "words"), [(0.01, "divide it by the pixel pitch"), (1e3, "or the images' own size")])
@pytest.mark.parametrize("alike", [True, False])
def test_a_focal_length_that_is_not_in_pixels_is_one_sentence(tmp_path, scale, words, alike):
    left, right = HEADS["nearly alike"].cameras
    right = left.placed(np.eye(3), np.array([-0.2, 0.0, 0.0])) if alike else right
    cameras = [
        replace(each, fx_px=scale * each.fx_px, fy_px=scale * each.fy_px, lens=Brown()) for each in (left, right)
    ]
    with pytest.raises(IcyMoonError, match=rf"the focal length is .* px for images of 96 x 72 px.*{words}"):
        read_eyes(*files_of(tmp_path, CalibratedRig(tuple(cameras)), "mrcal"))


def test_alike_lenses_that_fold_the_image_are_one_sentence(tmp_path):
    left = replace(HEADS["nearly alike"].cameras[0], lens=Brown((-0.9, 0.0, 0.0, 0.0, 0.0)), fx_px=50.0, fy_px=50.0)
    rig = CalibratedRig((left, replace(left, name="right").placed(np.eye(3), np.array([-0.2, 0.0, 0.0]))))
    with pytest.raises(IcyMoonError, match=r"both\.yaml: the distortion \(k1 = -0\.9, .*see nothing; calibrate again"):
        read_eyes(*files_of(tmp_path, rig, "opencv"))


def test_a_calibration_is_read_once(tmp_path, monkeypatch):
    left, _ = HEADS["nearly alike"].cameras
    rig = CalibratedRig((left, replace(left, name="right").placed(np.eye(3), np.array([-0.2, 0.0, 0.0]))))
    paths, read = files_of(tmp_path, rig, "opencv"), []
    kept = camera.read_calibration
    monkeypatch.setattr(camera, "read_calibration", lambda *given: read.append(given) or kept(*given))
    for reader in (read_rig, read_eyes):
        reader(*paths, stated=Stated(sizes=((96, 72),)))
        assert len(read) == 1
        read.clear()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nearly alike", "the eyes differ by up to"),
        ("verged and rolled", "images have 96 x 72 and 128 x 64 px"),
        ("fisheye and CAHVORE", "images have 96 x 72 and 90 x 80 px"),
    ],
)
def test_the_reason_for_two_cameras_is_stated(name, words):
    assert words in find_why_calibrated(HEADS[name])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"fx_px": 97.0}, "pixels are not square"),
        ({"skew_px": 0.1}, "pixels are not square"),
        ({"lens": (0.1,) * 8}, "the lens is Brown-Conrady, 8 coefficients"),
        ({"turn": (0.0, 0.01, 0.0)}, "rotated relative to each other by 0.573 degrees"),
        ({"aside": 0.01}, "0.01 m below"),
    ],
)
def test_each_difference_is_a_reason(changes, words):
    left, _ = HEADS["nearly alike"].cameras
    changes = dict(changes)
    turn, aside = from_vector(np.array(changes.pop("turn", (0.0, 0.0, 0.0)))), changes.pop("aside", 0.0)
    if "lens" in changes:
        left = replace(left, lens=Brown(changes.pop("lens")))
    left = replace(left, **changes)
    right = left.placed(turn, -turn @ np.array([0.2, aside, 0.0]))
    assert words in find_why_calibrated(CalibratedRig((left, right)))
