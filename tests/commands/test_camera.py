"""The rig of two camera models: what was written is read again, and what no rig here is, is refused."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.commands.camera import read_rig
from icymoon.commands.cli import main
from icymoon.errors import IcyMoonError
from icymoon.formats.cahvor import cahvor_text, from_pinhole, pds_text
from icymoon.render.pairs.pair_folder import StereoCamera
from icymoon.settings.description import defaults, merged

RIG = merged(defaults(), {"rig": {"width_px": 640, "height_px": 480, "baseline_m": 0.3, "principal_x_px": 3.0,
                                  "distortion_k1": -0.125, "distortion_k2": 0.03125}}).rig
K = (-0.125, 0.03125, 0.0, 0.0, 0.0)
TURN = np.array([[0.6, 0.8, 0], [0, 0, -1], [-0.8, 0.6, 0]])


def written(tmp_path, at=(0.3, 0, 0), turn=0.0, text=cahvor_text):
    camera = StereoCamera.from_settings(RIG)
    matrix = np.array(camera.matrix)
    matrix[:2, 2] -= 0.5
    paths = []
    for name, place, angle in (("left", (0, 0, 0), 0.0), ("right", at, turn)):
        c, s = np.cos(angle), np.sin(angle)
        rotation = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) @ TURN
        model = from_pinhole(matrix, rotation, np.array(place) @ TURN + np.array([5, 6, 7]), (640, 480), K)
        paths.append(tmp_path / f"{name}.txt")
        paths[-1].write_text(text(model), encoding="utf-8")
    return paths


@pytest.mark.parametrize("text", [cahvor_text, lambda model: pds_text(model, "SITE")])
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


@pytest.mark.parametrize(("at", "turn", "words"), [
    ((0.3, 0, 0), 0.02, r"1\.15 degrees"), ((0.3, 0.1, 0), 0.0, "side by side"), ((0.3, 0, 0.1), 0.0, "side by side"),
    ((-0.3, 0.1, 0), 0.0, "side by side"), ((0, 0.3, 0), 0.0, "0.3 m above the other.* turn the images of both by 90"),
    ((0.01, -0.3, 0), 0.0, "0.3 m above the other"), ((0, 0, 0), 0.0, "at one place"),
    ((300.0, 0, 0), 0.0, r"right\.txt: its eye is 300 m .* the vector C is in metres, .* divide by 1000")])
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


@pytest.mark.parametrize(("before", "after", "words"), [
    ("plumb_bob", "rational_polynomial", "rational_polynomial"), ("-100.0", "0.0", "no baseline"),
    ("image_width: 640", "image_width: -640", "image_width"),
    ("image_width: 640", f"image_width: {'9' * 5000}", "image_width"), ("image_width: 640\n", "", "image_width"),
    ("-0.3, 0.1,", "-0.3, nan,", "distortion_coefficients"), ("data: [-0.3", "data: [[-0.3", "float"),
    ("camera_name", "camera_matrix", "twice"), ("image_width: 640", "!!python/object:os.system", "no key"),
    ("image_width: 640", "%YAML:1.0\n---\nimage_width: 640", "YAML of OpenCV"),
    ("500., 240.25, 0., 0., 0., 1., 0.]", "500., 240.25, 0.", "projection_matrix"),
    ("cols: 4\n  data: [500., 0.", "cols: 4\n  data: [0., 0.", "no focal length"),
    ("0., 500., 240.25", "0., 700., 240.25", "no squares, in projection_matrix too (fx 500, fy 700 px)"),
    ("0., 500., 240.25,\n", "0., -500., 240.25,\n", "camera_matrix has no focal length")])
def test_what_is_no_calibration_of_ros_is_a_sentence(tmp_path, capsys, before, after, words):
    left, right = ros_pair(tmp_path)
    text = right.read_text(encoding="utf-8")
    assert before in text
    right.write_text(text.replace(before, after), encoding="utf-8")
    assert main(["camera", str(left), str(right)]) == 1
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
        assert str(caught.value) == (f"{left} stands {found.rig.baseline_m:.4g} m to the left of {right}, so it is the "
                                     "left eye; give it first.")


def test_one_file_is_no_pair(tmp_path):
    (left, _), (of_jpl, _) = ros_pair(tmp_path), written(tmp_path)
    for path, words in ((left, "states no baseline"), (of_jpl, "at one place")):
        with pytest.raises(IcyMoonError, match=words):
            read_rig(path, path)


def test_a_pair_of_ros_one_above_the_other_has_its_own_sentence(tmp_path):
    left, right = ros_pair(tmp_path)
    change(right, ("-100.0, 0., 500., 240.25, 0.,", "0., 0., 500., 240.25, -100.,"))
    with pytest.raises(IcyMoonError, match=r"0\.2 m above the other.* turn the images of both by 90 degrees"):
        read_rig(left, right)


def test_a_baseline_in_millimetres_is_doubted(tmp_path):
    left, right = ros_pair(tmp_path, shift="-60000.0")
    with pytest.raises(IcyMoonError, match=r"right\.yaml: its eye is 120 m .* is -fx times the baseline in metres, .* "
                                           r"divide by 1000\."):
        read_rig(left, right)
    left, right = ros_pair(tmp_path, shift="-30000.0")
    found, (note,) = read_rig(left, right)
    assert found.rig.baseline_m == 60
    assert "The eyes are 60 m apart" in note
    assert "If it is in millimetres, set rig.baseline_m to 0.06." in note


@pytest.mark.parametrize("name", ["left", "right"])
def test_pixels_that_are_no_squares_give_the_rig_of_the_rectified_images(tmp_path, name):
    left, right = ros_pair(tmp_path)
    for path in (left, right):
        change(path, ("cols: 4\n  data: [500., 0., 320.5", "cols: 4\n  data: [480., 0., 330."),
               ("0., 500., 240.25, 0.", "0., 480., 238., 0."))
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


def test_two_kinds_of_calibration_are_refused(tmp_path, capsys):
    left, _ = ros_pair(tmp_path)
    _, right = written(tmp_path)
    assert main(["camera", str(left), str(right)]) == 1
    assert "two kinds" in capsys.readouterr().err


def test_eyes_that_differ_are_averaged_and_reported(tmp_path):
    camera = StereoCamera.from_settings(RIG)
    paths = []
    for name, along, more in (("left", 0.0, 0.0), ("right", 0.3, 4.0)):
        matrix = np.array(camera.matrix) + np.array([[more, 0, 3 * more], [0, more, -more], [0, 0, 0]])
        model = from_pinhole(matrix, np.eye(3), np.array([along, 0, 0]), (640, 480), K)
        paths.append(tmp_path / f"{name}.cahvor")
        paths[-1].write_text(cahvor_text(model), encoding="utf-8")
    found, (note,) = read_rig(*paths)
    focal = found.rig.focal_length_mm / found.rig.sensor_width_mm * 640
    assert focal == pytest.approx(camera.focal_px + 2, rel=1e-6)
    assert found.rig.principal_x_px == pytest.approx(3.0 + 6 + 0.5, abs=1e-6)
    assert f"{camera.focal_px:.2f} and {camera.focal_px + 4:.2f} px" in note


def test_eyes_of_two_kinds_of_camera_are_refused(tmp_path):
    with pytest.raises(IcyMoonError, match=r"differ by 100 px in focal length"):
        read_rig(*ros_pair(tmp_path, f="600.", shift="-120.0"))
