"""The rig of two camera models: what was written is read again, and what no rig here is, is refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from icymoon.commands.camera import read_rectified_rig, read_rig
from icymoon.commands.cli import main
from icymoon.formats.cahvor import make_cahvor_text, make_model_from_pinhole, make_pds_text
from icymoon.formats.calibrations.options import Stated
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.settings.description import defaults, merged
from icymoon.support.errors import IcyMoonError

RIG = merged(
    defaults(),
    {
        "rig": {
            "width_px": 640,
            "height_px": 480,
            "baseline_m": 0.3,
            "principal_x_px": 3.0,
            "distortion_k1": -0.125,
            "distortion_k2": 0.03125,
        }
    },
).rig
K = (-0.125, 0.03125, 0.0, 0.0, 0.0)
TURN = np.array([[0.6, 0.8, 0], [0, 0, -1], [-0.8, 0.6, 0]])


def written(tmp_path, at=(0.3, 0, 0), turn=0.0, text=make_cahvor_text):
    camera = StereoCamera.from_settings(RIG)
    matrix = np.array(camera.matrix)
    matrix[:2, 2] -= 0.5
    paths = []
    for name, place, angle in (("left", (0, 0, 0), 0.0), ("right", at, turn)):
        c, s = np.cos(angle), np.sin(angle)
        rotation = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) @ TURN
        model = make_model_from_pinhole(matrix, rotation, np.array(place) @ TURN + np.array([5, 6, 7]), (640, 480), K)
        paths.append(tmp_path / f"{name}.txt")
        paths[-1].write_text(text(model), encoding="utf-8")
    return paths


@pytest.mark.parametrize("text", [make_cahvor_text, lambda model: make_pds_text(model, "SITE")])
def test_the_rig_is_that_of_its_models(tmp_path, text, capsys):
    left, right = written(tmp_path, text=text)
    found, notes = read_rig(left, right)
    assert notes == []
    wanted = {key: value for key, value in RIG.items() if key in found.rig}
    assert found.rig == pytest.approx(wanted, rel=1e-6, abs=1e-6)
    assert len(wanted) == 12
    assert main(["camera", str(left), str(right)]) == 0
    printed = capsys.readouterr().out
    assert "baseline_m = 0.3" in printed
    assert "principal_y_px = 0.0\n" in printed, "what is in the middle is printed so, without rounding errors"


@pytest.mark.parametrize(
    ("at", "turn", "words"),
    [
        ((0.3, 0, 0), 0.02, r"1\.15 degrees"),
        ((0.3, 0.1, 0), 0.0, "side by side"),
        ((0.3, 0, 0.1), 0.0, "side by side"),
        ((-0.3, 0.1, 0), 0.0, "side by side"),
        ((0, 0.3, 0), 0.0, "0.3 m above the other.* rotate the images of both eyes by 90"),
        ((0.01, -0.3, 0), 0.0, "0.3 m above the other"),
        ((0, 0, 0), 0.0, "have the same position"),
        ((300.0, 0, 0), 0.0, r"right\.txt: the eyes are 300 m .* the vector C is in metres; .* divide it by 1000"),
    ],
)
def test_what_is_no_rig_here_is_refused(tmp_path, at, turn, words):
    with pytest.raises(IcyMoonError, match=words):
        read_rig(*written(tmp_path, at, turn))


#: Two cameras as ROS calibrates them, of a pair of 0.2 m.
ROS = """image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [{f}, 0., 320.5, 0., {f}, 240.25,
         0., 0., 1.]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.3, 0.1, 0.001, -0.002, 0.05]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]
projection_matrix:
  rows: 3
  cols: 4
  data: [{f}, 0., 320.5, {shift}, 0., {f}, 240.25, 0., 0., 0., 1., 0.]
"""


def ros_pair(folder, **right):
    for name, changes in (("left", {"shift": "0.0"}), ("right", {"shift": "-100.0", **right})):
        text = ROS.format(**{"f": "500.", "model": "plumb_bob", **changes})
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    return folder / "left.yaml", folder / "right.yaml"


def test_a_calibration_of_ros_is_a_rig(tmp_path):
    found, notes = read_rig(*ros_pair(tmp_path))
    assert notes == []
    rig = found.rig
    assert (rig.width_px, rig.height_px) == (640, 480)
    assert rig.focal_length_mm / rig.sensor_width_mm * 640 == pytest.approx(500)
    assert rig.baseline_m == pytest.approx(0.2)
    assert (rig.principal_x_px, rig.principal_y_px) == (pytest.approx(1.0), pytest.approx(0.75))
    assert [rig[f"distortion_{name}"] for name in ("k1", "k2", "p1", "p2", "k3")] == [-0.3, 0.1, 0.001, -0.002, 0.05]


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("plumb_bob", "double_sphere", "rational_polynomial, equidistant are supported"),
        ("-100.0", "0.0", "no baseline"),
        ("image_width: 640", "image_width: -640", "image_width"),
        ("image_width: 640", f"image_width: {'9' * 5000}", "image_width"),
        ("image_width: 640\n", "", "image_width"),
        ("-0.3, 0.1,", "-0.3, nan,", "distortion_coefficients"),
        ("data: [-0.3", "data: [[-0.3", "a bracket is not closed"),
        ("camera_name", "camera_matrix", "again"),
        ("image_width: 640", "!!python/object:os.system", "is not a key"),
        ("image_width: 640", "%YAML:1.0\n---\nimage_width: 640", "several kinds, ros, opencv"),
        ("500., 240.25, 0., 0., 0., 1., 0.]", "500., 240.25, 0.", "projection_matrix"),
        ("cols: 4\n  data: [500., 0.", "cols: 4\n  data: [0., 0.", "no focal length"),
        ("0., 500., 240.25,\n", "0., -500., 240.25,\n", "camera_matrix has no focal length"),
        ("plumb_bob", "rational_polynomial", "distortion_coefficients has not 8 or 12 or 14 numbers"),
        ("data: [1., 0., 0., 0., 1.", "data: [2., 0., 0., 0., 1.", "rectification_matrix is not a rotation"),
        ("camera_name: narrow_stereo", "roi: {x_offset: 1, width: 9}", "9 x 0 px at (1, 0)"),
        ("camera_name: narrow_stereo", "roi:\n  x_offset: 600\n  width: 60\n  height: 60", "60 x 60 px at (600, 0)"),
        ("camera_name: narrow_stereo", "roi:\n  x_offset: 8", "0 x 0 px at (8, 0)"),
        ("camera_name: narrow_stereo", "binning_x: -2", "binning_x is '-2'"),
        ("camera_name: narrow_stereo", "binning_x: 99", "binning_x of 99"),
    ],
)
def test_what_is_no_calibration_of_ros_is_a_sentence(tmp_path, capsys, before, after, words):
    check_refused(tmp_path, capsys, before, after, words)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("0., 500., 240.25", "0., 700., 240.25", "not square, also in projection_matrix (fx 500, fy 700 px)"),
        ("camera_name: narrow_stereo", "binning_x: 2\nbinning_y: 2", "write the same binning_x, binning_y and roi"),
    ],
)
def test_what_one_camera_for_both_eyes_cannot_be_is_a_sentence(tmp_path, capsys, before, after, words):
    check_refused(tmp_path, capsys, before, after, words, "--alike")


def check_refused(folder, capsys, before, after, words, *options):
    left, right = ros_pair(folder)
    text = right.read_text(encoding="utf-8")
    assert before in text
    right.write_text(text.replace(before, after), encoding="utf-8")
    assert main(["camera", str(left), str(right), *options]) == 1
    shown = capsys.readouterr().err
    assert words in shown
    assert "right.yaml" in shown
    assert len(shown.splitlines()) == 1


def change(path, *pairs):
    text = path.read_text(encoding="utf-8")
    for before, after in pairs:
        assert before in text
        text = text.replace(before, after)
    path.write_text(text, encoding="utf-8")


def test_eyes_in_the_wrong_order_are_named(tmp_path):
    """Whichever file has the baseline; the fix works."""
    folders = [tmp_path / name for name in ("ros", "shifted", "cahvor")]
    for folder in folders:
        folder.mkdir()
    first, second, third = ros_pair(folders[0]), ros_pair(folders[1], shift="100.0")[::-1], written(folders[2])
    for left, right in (first, second, third):
        with pytest.raises(IcyMoonError) as caught:
            read_rig(right, left)
        found, _ = read_rig(left, right)
        assert str(caught.value) == (
            f"{left} stands {found.rig.baseline_m:.4g} m to the left of {right}, so it is the left eye; give it first."
        )


def test_one_file_is_no_pair(tmp_path):
    (left, _), (of_jpl, _) = ros_pair(tmp_path), written(tmp_path)
    for path, words in ((left, "states no baseline"), (of_jpl, "have the same position")):
        with pytest.raises(IcyMoonError, match=words):
            read_rig(path, path)


def test_a_pair_of_ros_one_above_the_other_has_its_own_sentence(tmp_path):
    left, right = ros_pair(tmp_path)
    change(right, ("-100.0, 0., 500., 240.25, 0.,", "0., 0., 500., 240.25, -100.,"))
    with pytest.raises(IcyMoonError, match=r"0\.2 m above the other.* rotate the images of both eyes by 90 degrees"):
        read_rig(left, right)


def test_a_baseline_in_millimetres_is_doubted(tmp_path):
    left, right = ros_pair(tmp_path, shift="-60000.0")
    with pytest.raises(
        IcyMoonError,
        match=r"right\.yaml: the eyes are 120 m .* times the baseline in metres; .* divide it by 1000 in",
    ):
        read_rig(left, right)
    left, right = ros_pair(tmp_path, shift="-30000.0")
    found, (note,) = read_rig(left, right)
    assert found.rig.baseline_m == 60
    assert "The eyes are 60 m apart" in note
    assert note.endswith("in metres; if it is in millimetres, divide it by 1000 in the file.")


@pytest.mark.parametrize("name", ["left", "right"])
def test_pixels_that_are_no_squares_give_the_rig_of_the_rectified_images(tmp_path, name):
    left, right = ros_pair(tmp_path)
    for path in (left, right):
        change(
            path,
            ("cols: 4\n  data: [500., 0., 320.5", "cols: 4\n  data: [480., 0., 330."),
            ("0., 500., 240.25, 0.", "0., 480., 238., 0."),
        )
    assert read_rig(left, right)[0].rig.distortion_k1 == -0.3
    change(tmp_path / f"{name}.yaml", ("0., 500., 240.25,\n", "0., 500.6, 240.25,\n"))
    found, (note,) = read_rig(left, right)
    rig = found.rig
    assert rig.focal_length_mm / rig.sensor_width_mm * 640 == pytest.approx(480)
    assert (rig.principal_x_px, rig.principal_y_px) == (pytest.approx(10.5), pytest.approx(-1.5))
    assert rig.baseline_m == pytest.approx(100 / 480)
    assert [rig[f"distortion_{name}"] for name in ("k1", "k2", "p1", "p2", "k3")] == [0.0] * 5
    assert "rig of the rectified images" in note
    assert "(fx 500, fy 500.6 px)" in note


def size_and_lens(rig):
    focal = rig.focal_length_mm / rig.sensor_width_mm * rig.width_px
    return (
        rig.width_px,
        rig.height_px,
        focal,
        rig.principal_x_px + rig.width_px / 2 - 0.5,
        rig.principal_y_px + rig.height_px / 2 - 0.5,
        rig.baseline_m,
    )


ROI = "roi:\n  x_offset: 100\n  y_offset: 60\n  height: 300\n  width: 401\n  do_rectify: false\n"


@pytest.mark.parametrize(
    ("more", "size", "focal", "centre"),
    [
        ("binning_x: 2\nbinning_y: 2\n" + ROI.replace("401", "400"), (200, 150), 250.0, (110.25, 90.125)),
        ("binning_x: 2\nbinning_y: 2\n", (320, 240), 250.0, (160.25, 120.125)),
        ("binning_x: 0\nbinning_y: 0\n" + ROI, (401, 300), 500.0, (220.5, 180.25)),
        ("binning_x: 2\nbinning_y: 2\n" + ROI, (200, 150), 250.0, (110.25, 90.125)),
    ],
)
@pytest.mark.parametrize("rectified", [False, True])
def test_images_that_are_a_binned_part_give_the_rig_of_them(tmp_path, more, size, focal, centre, rectified):
    """K and P move with the corner, then shrink, as in ROS' image_geometry; distortion and baseline stay."""
    left, right = ros_pair(tmp_path)
    for path in (left, right):
        change(path, ("camera_name: narrow_stereo\n", more))
    if rectified:
        turn(right, 0.01)
    found, notes = read_rig(left, right)
    assert size_and_lens(found.rig) == pytest.approx((*size, focal, *centre, 0.2))
    assert found.rig.distortion_k1 == (0.0 if rectified else -0.3)
    assert len(notes) == 1 + rectified
    assert notes[-1].endswith(f"images have {size[0]} x {size[1]} px.")


def test_no_binning_and_a_roi_of_all_are_as_none(tmp_path):
    left, right = ros_pair(tmp_path)
    plain = read_rig(left, right)
    change(left, ("camera_name: narrow_stereo\n", "binning_x: 1\nroi:\n  x_offset: 0\n  width: 640\n  height: 480\n"))
    change(right, ("camera_name: narrow_stereo\n", "roi:\n  x_offset: 0\n  width: 0\n  height: 0\n"))
    assert read_rig(left, right) == plain


def test_binning_of_one_axis_alone_has_a_fix_that_works(tmp_path):
    left, right = ros_pair(tmp_path)
    for path in (left, right):
        change(path, ("camera_name: narrow_stereo\n", "binning_x: 2\nbinning_y: 1\n"))
    with pytest.raises(IcyMoonError, match=r"fx 250, fy 500 px.*; bin as many pixels along x as along y, and set "):
        read_rig(left, right)
    for path in (left, right):
        change(path, ("binning_y: 1", "binning_y: 2"))
    assert read_rig(left, right)[0].rig.width_px == 320


def turn(path, degrees, axis=1):
    """Give an eye a rotation into the axes of the pair, about y or z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    rotation = [c, 0, s, 0, 1, 0, -s, 0, c] if axis == 1 else [c, s, 0, -s, c, 0, 0, 0, 1]
    change(path, ("data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]", f"data: {[float(x) for x in rotation]}"))


@pytest.mark.parametrize(
    ("degrees", "axis", "eyes", "words"),
    [
        (0.01, 1, ["right"], "the eyes are rotated relative to each other by 0.01 degrees."),
        (15.0, 1, ["left"], "the eyes are rotated relative to each other by 15 degrees."),
        (2.0, 2, ["left", "right"], "0.007271 m below and 0 m before it, so they are not side by side."),
        (2.0, 1, ["left", "right"], "0 m below and 0.007271 m before it, so they are not side by side."),
    ],
)
def test_eyes_that_are_not_parallel_give_the_rig_of_the_rectified_images(tmp_path, degrees, axis, eyes, words):
    """As those of every real head are not."""
    left, right = ros_pair(tmp_path)
    for path in (left, right):
        change(
            path,
            ("cols: 4\n  data: [500., 0., 320.5", "cols: 4\n  data: [480., 0., 330."),
            ("0., 500., 240.25, 0.", "0., 480., 238., 0."),
        )
    for name in eyes:
        turn(tmp_path / f"{name}.yaml", degrees, axis)
    found, (note,) = read_rig(left, right)
    assert size_and_lens(found.rig) == pytest.approx((640, 480, 480.0, 330.0, 238.0, 100 / 480))
    assert [found.rig[f"distortion_{name}"] for name in ("k1", "k2", "p1", "p2", "k3")] == [0.0] * 5
    assert "rig of the rectified images" in note
    assert note.endswith(words)
    with pytest.raises(IcyMoonError, match=r"left\.yaml stands .* so it is the left eye; give it first"):
        read_rig(right, left)


@pytest.mark.parametrize(("model", "count"), [("rational_polynomial", 8), ("equidistant", 4)])
def test_another_lens_gives_the_rig_of_the_rectified_images(tmp_path, model, count):
    left, right = ros_pair(tmp_path)
    change(right, ("plumb_bob", model), ("[-0.3, 0.1, 0.001, -0.002, 0.05]", str([0.1] * count)))
    found, (note,) = read_rig(left, right)
    assert size_and_lens(found.rig) == pytest.approx((640, 480, 500.0, 320.5, 240.25, 0.2))
    assert found.rig.distortion_k1 == 0
    assert note.endswith(f"no distortion: the lens model is {model}.")


def test_a_fifth_coefficient_that_is_left_out_is_0(tmp_path):
    left, right = ros_pair(tmp_path)
    for path in (left, right):
        change(path, (", 0.05]", "]"))
    found, notes = read_rig(left, right)
    assert notes == []
    assert [found.rig[f"distortion_{name}"] for name in ("k1", "k2", "p1", "p2", "k3")] == [-0.3, 0.1, 0.001, -0.002, 0]


def test_two_kinds_of_calibration_are_refused(tmp_path, capsys):
    left, _ = ros_pair(tmp_path)
    _, right = written(tmp_path)
    assert main(["camera", str(left), str(right)]) == 1
    assert "several kinds, ros, cahv; give files of one kind" in capsys.readouterr().err


def test_eyes_that_differ_are_averaged_and_reported(tmp_path):
    camera = StereoCamera.from_settings(RIG)
    paths = []
    for name, along, more in (("left", 0.0, 0.0), ("right", 0.3, 4.0)):
        matrix = np.array(camera.matrix) + np.array([[more, 0, 3 * more], [0, more, -more], [0, 0, 0]])
        model = make_model_from_pinhole(matrix, np.eye(3), np.array([along, 0, 0]), (640, 480), K)
        paths.append(tmp_path / f"{name}.cahvor")
        paths[-1].write_text(make_cahvor_text(model), encoding="utf-8")
    found, (note,) = read_rig(*paths)
    focal = found.rig.focal_length_mm / found.rig.sensor_width_mm * 640
    assert focal == pytest.approx(camera.focal_px + 2, rel=1e-6)
    assert found.rig.principal_x_px == pytest.approx(3.0 + 6 + 0.5, abs=1e-6)
    assert f"{camera.focal_px:.2f} and {camera.focal_px + 4:.2f} px" in note


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (
            "data: [500., 0., 320.5, 0., 500., 240.25,\n",
            "data: [540., 0., 320.5, 0., 540., 240.25,\n",
            "40 px in focal",
        ),
        ("320.5, 0., 500., 240.25,\n", "360.5, 0., 500., 240.25,\n", "40 px in principal point"),
        ("data: [-0.3,", "data: [-0.2,", "50 px in distortion"),
    ],
)
def test_unlike_lenses_give_the_rig_of_the_rectified_images(tmp_path, before, after, words):
    """Rectified images have one lens, whatever the lenses were."""
    left, right = ros_pair(tmp_path)
    change(right, (before, after))
    found, (note,) = read_rig(left, right)
    assert size_and_lens(found.rig) == pytest.approx((640, 480, 500.0, 320.5, 240.25, 0.2))
    assert found.rig.distortion_k1 == 0
    assert "rig of the rectified images" in note
    assert words in note


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (
            "data: [500., 0., 320.5, -100.0, 0., 500.,",
            "data: [501., 0., 320.5, -100.0, 0., 501.,",
            "500.00 and 501.00 px",
        ),
        ("-100.0, 0., 500., 240.25,", "-100.0, 0., 500., 241.25,", "240.25 and 241.25 px"),
    ],
)
def test_projections_of_no_rectified_pair_are_refused(tmp_path, before, after, words):
    """The reason is of projection_matrix, which alone could serve where the lenses differ."""
    left, right = ros_pair(tmp_path)
    change(right, ("data: [-0.3,", "data: [-0.2,"), (before, after))
    with pytest.raises(IcyMoonError, match=rf"50 px in distortion, .* does not make a rectified pair: .*{words}"):
        read_rig(left, right)


def test_eyes_of_two_kinds_of_camera_are_refused(tmp_path):
    with pytest.raises(
        IcyMoonError, match=r"differ by 100 px in focal length, .* not make a rectified pair: .*calibrate both"
    ):
        read_rig(*ros_pair(tmp_path, f="600.", shift="-120.0"))
    paths = []
    for name, along, more in (("left", 0.0, 0.0), ("right", 0.3, 100.0)):
        matrix = np.array(StereoCamera.from_settings(RIG).matrix) + np.diag([more, more, 0])
        model = make_model_from_pinhole(matrix, np.eye(3), np.array([along, 0, 0]), (640, 480), K)
        paths.append(tmp_path / f"{name}.cahvor")
        paths[-1].write_text(make_cahvor_text(model), encoding="utf-8")
    with pytest.raises(IcyMoonError, match=r"differ by 100 px in focal length, .* rectify their images first"):
        read_rig(*paths)


def test_toed_in_models_lead_to_the_rectified_ones_beside_them(tmp_path):
    """As the export ``cahvor`` writes them."""
    left, right = written(tmp_path, turn=0.02)
    sensors = [path.rename(path.with_name(f"{path.stem}_sensor.cahvor")) for path in (left, right)]
    with pytest.raises(IcyMoonError, match=r"by 1\.15 degrees; rectify their images first\."):
        read_rig(*sensors)
    rectified = [path.rename(path.with_suffix(".cahvor")) for path in written(tmp_path)]
    told = r"give left.cahvor and right.cahvor beside.* set rig.toe_in_deg, to half"
    with pytest.raises(IcyMoonError, match=told) as raised:
        read_rig(*sensors)
    # Rectified images have no distortion, so the sentence states the lens of the sensors.
    stated = dict(re.findall(r"rig\.(distortion_\w+) = (-?[\d.e-]+\d)", str(raised.value)))
    bent = {key: value for key, value in RIG.items() if key.startswith("distortion_") and value}
    assert {key: float(value) for key, value in stated.items()} == pytest.approx(bent, rel=1e-5)
    assert bent
    assert read_rig(*rectified)[0].rig["baseline_m"] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("cam0:\n  cam_overlaps: [1]\n  camera_model: pinhole\n", "is a camchain of Kalibr"),
        ("%YAML:1.0\n---\nimage_width: 640\n", "is a calibration of OpenCV, not of ROS"),
    ],
)
def test_files_that_are_like_a_calibration_of_ros_are_named(tmp_path, text, what):
    path = tmp_path / "left.yaml"
    path.write_text(text)
    with pytest.raises(IcyMoonError, match=rf"{what}.*; give .*projection_matrix\."):
        read_rig(path, path, kind="ros")


@pytest.mark.parametrize("letters", ["dkrp", "DKRP"])
def test_a_message_camera_info_is_a_calibration(tmp_path, letters):
    """As ROS 2 and ROS 1 print it: lists with dashes, or in brackets, a header before and an end behind."""
    wanted = read_rig(*ros_pair(tmp_path))
    d, k, r, p = letters
    for name, shift in (("left", 0.0), ("right", -100.0)):
        (tmp_path / f"{name}.yaml").write_text(
            "header:\n  stamp:\n    sec: 17\n    nanosec: 5\n  frame_id: 'eye'\nheight: 480\nwidth: 640\n"
            f'distortion_model: "plumb_bob"\n{d}:\n- -0.3\n- 0.1\n- 0.001\n- -0.002\n- 0.05\n'
            f"{k}: [500.0, 0.0, 320.5, 0.0, 500.0, 240.25, 0.0, 0.0, 1.0]\n"
            f"{r}:\n  - 1.0\n  - 0.0\n  - 0.0\n  - 0.0\n  - 1.0\n  - 0.0\n  - 0.0\n  - 0.0\n  - 1.0\n"
            f"{p}: [500.0, 0.0, 320.5, {shift}, 0.0, 500.0, 240.25, 0.0, 0.0, 0.0, 1.0, 0.0]\n"
            "binning_x: 0\nbinning_y: 0\nroi:\n  x_offset: 0\n  y_offset: 0\n  height: 0\n  width: 0\n"
            "  do_rectify: false\n---\n",
            encoding="utf-8",
        )
    assert read_rig(tmp_path / "left.yaml", tmp_path / "right.yaml") == wanted


def camchain(folder, turn=0.0, size="[640, 480]", model="radtan"):
    """Two eyes of Kalibr, 0.2 m apart, the right one turned about y by radians."""
    c, s = np.cos(turn), np.sin(turn)
    path = folder / "camchain.yaml"
    eye = (
        f"  camera_model: pinhole\n  distortion_coeffs: [-0.3, 0.1, 0.001, -0.002]\n  distortion_model: {model}\n"
        "  intrinsics: [500.0, 500.0, 320.5, 240.25]\n  resolution: "
    )
    pose = [[c, 0, -s, -0.2 * c], [0, 1, 0, 0], [s, 0, c, -0.2 * s], [0, 0, 0, 1]]
    rows = "".join(f"  - {[float(value) for value in row]}\n" for row in pose)
    path.write_text(f"cam0:\n{eye}[640, 480]\ncam1:\n  T_cn_cnm1:\n{rows}{eye}{size}\n", encoding="utf-8")
    return path


def test_a_parallel_pair_of_another_format_is_a_rig(tmp_path):
    found, notes = read_rig(camchain(tmp_path))
    assert notes == []
    assert size_and_lens(found.rig) == pytest.approx((640, 480, 500, 320.5, 240.25, 0.2))
    assert [found.rig[f"distortion_{name}"] for name in ("k1", "k2", "p1", "p2", "k3")] == [-0.3, 0.1, 0.001, -0.002, 0]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"turn": 0.02}, "the eyes are rotated relative to each other by 1.15 degrees"),
        ({"model": "equidistant"}, "the lens model is equidistant"),
    ],
)
def test_what_a_rig_lacks_is_told(tmp_path, changes, words):
    """The rig of the rectified images is that of the mean focal length, and the baseline stays."""
    found, (note,) = read_rig(camchain(tmp_path, **changes))
    assert note == (
        "This is the rig of the rectified images, with the focal length and the principal point of the mean of both "
        f"eyes and no distortion: {words}."
    )
    assert size_and_lens(found.rig) == pytest.approx((640, 480, 500, 320.5, 240.25, 0.2))
    assert found.rig["distortion_k1"] == 0.0


def test_eyes_of_two_sizes_are_refused(tmp_path):
    with pytest.raises(IcyMoonError, match="have images of 640 x 480 px and 320 x 240 px"):
        read_rig(camchain(tmp_path, size="[320, 240]"))


def test_a_calibration_is_shown(tmp_path, capsys):
    assert main(["camera", str(camchain(tmp_path, 0.02)), "--show"]) == 0
    printed = capsys.readouterr().out
    for words in (
        "cam0: 640 x 480 px, Brown-Conrady, 5 coefficients\n",
        "fx = 500, fy = 500, skew = 0 px\n",
        "cx = 320.5, cy = 240.25 px from the centre of the first pixel\n",
        "k1 = -0.3, k2 = 0.1, p1 = 0.001, p2 = -0.002, k3 = 0\n",
        "0.2 m from cam0, turned by 1.14592 degrees from it\n",
        "0.2 m to the right, ",
    ):
        assert words in printed


def test_the_field_of_view_of_a_fisheye_may_be_more_than_a_half_turn(tmp_path, capsys):
    """f a = 320 px from the middle at both borders: a = 2 rad, so 229.18 degrees."""
    path = tmp_path / "a.yml"
    path.write_text("K: [160.0, 0, 319.5, 0, 160.0, 239.5, 0, 0, 1]\nD: [0, 0, 0, 0]\n", encoding="utf-8")
    words = ["camera", str(path), "--format", "opencv", "--size", "640x480", "--lens", "fisheye", "--show"]
    assert main(words) == 0
    assert "field of view 229.2 x 171.9 degrees" in capsys.readouterr().out


def test_a_calibration_is_converted_and_is_the_same_rig(tmp_path, capsys):
    path, out = camchain(tmp_path, 0.02), [str(tmp_path / f"{eye}.cameramodel") for eye in ("l", "r")]
    assert main(["camera", str(path), "--to", "mrcal", "--out", *out]) == 0
    assert capsys.readouterr().out == f"# mrcal: {', '.join(out)}\n"
    first, second = (read_rig(*paths) for paths in ((path,), tuple(map(Path, out))))
    assert first[0].rig == pytest.approx(second[0].rig, rel=1e-12)
    assert first[1] == second[1]


def test_two_of_many_cameras_are_chosen(tmp_path, capsys):
    path = camchain(tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text + text[text.index("cam1") :].replace("cam1", "cam2"), encoding="utf-8")
    with pytest.raises(IcyMoonError, match=r"there are 3 cameras, .* name two of them by --cameras"):
        read_rig(path)
    assert read_rig(path, names="cam0, cam2")[0].rig.baseline_m == pytest.approx(0.4)
    with pytest.raises(IcyMoonError, match="--cameras: 'cam7' is not in the calibration; did you mean 'cam"):
        read_rig(path, names="cam0,cam7")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--to", "mrcal"], "--to mrcal needs files to write"),
        (["--out", "x"], "add --to with a format"),
        (["--to", "cahv", "--out", "x", "y"], "no lens equal to Brown-Conrady"),
    ],
)
def test_a_conversion_that_cannot_be_is_a_sentence(tmp_path, capsys, words, told):
    assert main(["camera", str(camchain(tmp_path)), *words]) == 1
    assert told in capsys.readouterr().err


@pytest.mark.parametrize("size", ["640", "640x", "0x480", "640x480x3", "640x99999999999", "-1x4"])
def test_a_size_that_is_none_is_refused(tmp_path, capsys, size):
    with pytest.raises(SystemExit):
        main(["camera", str(camchain(tmp_path)), f"--size={size}"])
    assert "is not a size" in capsys.readouterr().err


def opencv_file(path, bent=0.0, right_px=0.0, turn=0.0, unlike=1.0):
    """A calibration in OpenCV's YAML: f = 300 px, and what makes it none of rectified images."""
    from icymoon.formats.calibrations.registry import write_calibration
    from icymoon.physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
    from icymoon.physics.camera.lens_models import Brown
    from icymoon.physics.camera.rotations import from_vector

    lens = Brown((bent, 0.0, 0.0, 0.0, 0.0))
    left = CalibratedCamera(640, 480, 300.0, 300.0, 310.0, 240.0, lens)
    right = CalibratedCamera(
        640, 480, 300.0 * unlike, 300.0 * unlike, 310.0 + right_px, 240.0, lens,
        rotation=from_vector(np.array([0.0, turn, 0.0])), translation_m=np.array([-0.2, 0.0, 0.0]),
    )  # fmt: skip
    write_calibration(CalibratedRig((left, right)), [path], "opencv")
    return path


def test_the_rig_of_rectified_images_keeps_both_principal_points(tmp_path):
    settings, rig, _ = read_rectified_rig(opencv_file(tmp_path / "a.yml", right_px=31.0))
    camera = StereoCamera.from_settings(merged(defaults(), settings).rig)
    assert (camera.focal_px, camera.cx_px, camera.cy_px) == pytest.approx((300.0, 310.5, 240.5), rel=1e-6)
    assert camera.baseline_m == pytest.approx(0.2)
    assert [each.cx_px for each in rig.cameras] == [310.0, 341.0]
    assert rig.relative_pose()[1] == pytest.approx([-0.2, 0, 0])


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ({"bent": -0.1}, "has distortion .* leave out --rectified"),
        ({"turn": 0.02}, r"1\.15 degrees; give the calibration of the rectified images"),
        ({"unlike": 1.01}, "the same focal length"),
    ],
)
def test_a_calibration_of_images_that_are_not_rectified_is_refused(tmp_path, fault, words):
    with pytest.raises(IcyMoonError, match=words):
        read_rectified_rig(opencv_file(tmp_path / "a.yml", **fault))


def test_of_ros_the_rectified_camera_is_the_projection_matrix(tmp_path):
    from icymoon.formats.calibrations.registry import read_calibration, write_calibration

    rig = read_calibration([opencv_file(tmp_path / "a.yml", bent=-0.1, turn=0.02, right_px=5.0)]).rig
    files = [tmp_path / "l.yaml", tmp_path / "r.yaml"]
    write_calibration(rig, files, "ros")
    settings, pinholes, _ = read_rectified_rig(*files)
    camera = StereoCamera.from_settings(merged(defaults(), settings).rig)
    assert camera.cx_px == pytest.approx(313.0, abs=1e-4), "the mean of both, as projection_matrix states"
    assert settings.rig.distortion_k1 == 0
    assert pinholes.relative_pose()[1] == pytest.approx([-0.2, 0, 0], abs=1e-6)


def swapped(folder):
    path = camchain(folder)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("-0.2", "0.2"), encoding="utf-8")
    return path


def test_swapped_eyes_of_one_file_are_exchanged_by_their_names(tmp_path, capsys):
    path = swapped(tmp_path)
    told = r"camchain\.yaml: cam1 stands 0\.2 m to the left of cam0, .*; add --cameras cam1,cam0\."
    with pytest.raises(IcyMoonError, match=told):
        read_rig(path)
    assert read_rig(path, names="cam1,cam0")[0].rig.baseline_m == pytest.approx(0.2)
    with pytest.raises(IcyMoonError, match=r"cam0 stands .* add --cameras cam0,cam1"):
        read_rig(camchain(tmp_path), names="cam1,cam0")


def test_the_warning_of_swapped_eyes_is_shown_and_written(tmp_path, capsys):
    path, out = swapped(tmp_path), str(tmp_path / "out.yaml")
    for words in (["--show"], ["--to", "opencv", "--out", out]):
        assert main(["camera", str(path), *words]) == 0
        assert "# cam1 stands 0.2 m to the left of cam0" in capsys.readouterr().out
        assert main(["camera", str(path), "--cameras", "cam1,cam0", *words]) == 0
        assert "stands" not in capsys.readouterr().out
    left, right = ros_pair(tmp_path)
    assert main(["camera", str(right), str(left), "--show"]) == 0
    assert "so it is the left eye; give it first." in capsys.readouterr().out


def test_names_choose_eyes_of_two_files(tmp_path):
    left, right = ros_pair(tmp_path)
    with pytest.raises(IcyMoonError, match=r"left stands .* add --cameras left,right"):
        read_rig(left, right, names="right,left")
    assert read_rig(right, left, names="left,right")[0].rig.baseline_m == pytest.approx(0.2)
    with pytest.raises(IcyMoonError, match="'left' occurs more than once"):
        read_rig(left, right, names="left,left")


def test_what_files_state_is_refused_for_settings_too(tmp_path):
    for paths in (ros_pair(tmp_path), written(tmp_path), (camchain(tmp_path),)):
        with pytest.raises(IcyMoonError, match="states metres; leave out --unit mm"):
            read_rig(*paths, stated=Stated("mm"))
        with pytest.raises(IcyMoonError, match="images have 640 x 480 px in the file; leave out --size"):
            read_rig(*paths, stated=Stated(sizes=((320, 240),)))


@pytest.mark.parametrize(("t", "unit", "fix"), [
    (120.0, "m", "state --unit cm or mm or in.$"),
    (110.0e6, "m", "no unit makes that the baseline of a rig, so correct it"),
    (12000.0, "cm", "no unit makes that"),
])  # fmt: skip
def test_a_baseline_that_is_too_long_has_a_fix_that_works(tmp_path, t, unit, fix):
    path = tmp_path / "a.yml"
    eye = "M{0}: [500.0, 0, 319.5, 0, 500.0, 239.5, 0, 0, 1]\nD{0}: [0, 0, 0, 0, 0]\n"
    path.write_text(f"{eye.format(1)}{eye.format(2)}R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [-{t}, 0, 0]\n", "utf-8")
    sizes = ((640, 480),)
    with pytest.raises(IcyMoonError, match=fix):
        read_rig(path, stated=Stated(unit, sizes), kind="opencv")
    if "--unit" in fix and unit == "m":
        found, _ = read_rig(path, stated=Stated("mm", sizes), kind="opencv")
        assert found.rig.baseline_m == pytest.approx(t / 1000)


def test_one_camera_is_no_rig(tmp_path):
    with pytest.raises(IcyMoonError, match="there is 1 camera, but a rig needs two"):
        read_rig(camchain(tmp_path), names="cam0")


def test_the_field_of_a_lens_that_turns_back_ends_there(tmp_path, capsys):
    """x (1 - x² / 3) is largest at x = 1, so 45 degrees to both sides, at 2 f / 3 of the image."""
    path = tmp_path / "a.yml"
    path.write_text(f"K: [300.0, 0, 319.5, 0, 300.0, 239.5, 0, 0, 1]\nD: [{-1 / 3!r}, 0, 0, 0, 0]\n", "utf-8")
    assert main(["camera", str(path), "--format", "opencv", "--size", "640x480", "--show"]) == 0
    printed = capsys.readouterr().out
    across, down = re.search(r"field of view ([\d.]+) x ([\d.]+) degrees .* turns back", printed).groups()
    # The last of the places 0.25 px apart is up to 2 sqrt(0.25 / 300) rad before the turn, on each side.
    assert 90 - 2 * 3.4 < float(across) == float(down) <= 90
    assert re.search(r"  \d\d\.\d% of the pixels see nothing", printed)


def test_what_is_read_is_not_overwritten(tmp_path, capsys):
    path = camchain(tmp_path)
    before = path.read_bytes()
    out = tmp_path / "x" / ".." / "camchain.yaml"
    (tmp_path / "x").mkdir()
    assert main(["camera", str(path), "--to", "kalibr", "--out", str(out)]) == 1
    assert "is also an input and would be overwritten" in capsys.readouterr().err
    assert path.read_bytes() == before
    assert main(["camera", str(path), "--to", "mrcal", "--out", str(tmp_path / "a"), str(tmp_path / "a")]) == 1
    assert "twice; name a file for each camera" in capsys.readouterr().err
    model = str(tmp_path / "model")
    assert main(["camera", str(path), "--to", "colmap", "--out", model]) == 0
    assert main(["camera", model, "--to", "colmap", "--out", model]) == 1
    assert "would be overwritten" in capsys.readouterr().err
