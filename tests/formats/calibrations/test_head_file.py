"""Files of heads: conventions of poses, calibrations, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from camchains import make_camchain
from icymoon.formats.calibrations.head_file import list_head_files, read_head
from icymoon.physics.camera.calibrated_camera import CalibratedCamera
from icymoon.physics.camera.lens_models import Fisheye
from icymoon.support.errors import IcyMoonError

PINHOLE = """
[[camera]]
name = "one"
role = "mast"
model = "PINHOLE"
width_px = 64
height_px = 48
field_deg = 60
"""
CAMCHAIN = make_camchain((60.0, 62.0, 30.0, 25.0), (30.0, 31.0, 30.0, 25.0), (64, 48))


def _write(tmp_path, text):
    path = tmp_path / "head.toml"
    path.write_text(text, encoding="utf-8")
    return path


def _read(tmp_path, text):
    return read_head(_write(tmp_path, text)).cameras


def test_a_camera_stands_as_the_left_eye_unless_it_states_otherwise(tmp_path):
    (camera,) = _read(tmp_path, PINHOLE)
    assert (camera.name, camera.role, camera.model, camera.frame) == ("one", "mast", "PINHOLE", "RIG")
    np.testing.assert_array_equal(camera.pose, np.eye(4))
    (beside,) = _read(tmp_path, PINHOLE + "position_m = [0.1, 0.2, 0.3]\nforward = [1, 0, 0]\n")
    np.testing.assert_array_equal(beside.position_m, [0.1, 0.2, 0.3])
    # Looking to the right of the rig: its right is the rig's back, its down stays.
    np.testing.assert_allclose(beside.rotation, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-15)


@pytest.mark.parametrize("frame", ["GROUND", "ZERO"])
def test_on_the_site_a_camera_looks_north_and_up_is_up(tmp_path, frame):
    (camera,) = _read(tmp_path, PINHOLE + f'frame = "{frame}"\nposition_m = [1, 2, 3]\n')
    # Columns: right is east, down is down, ahead is north.
    np.testing.assert_allclose(camera.rotation, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-15)


def test_a_quaternion_turns_the_cameras_axes_to_those_of_the_frame(tmp_path):
    root = np.sqrt(0.5)
    (camera,) = _read(tmp_path, PINHOLE + f"quaternion_xyzw = [0, 0, {root}, {root}]\n")
    np.testing.assert_allclose(camera.rotation @ [1, 0, 0], [0, 1, 0], atol=1e-9)


def test_a_calibration_gives_lens_and_pose_beside_its_first_camera(tmp_path):
    (tmp_path / "chain.yaml").write_text(CAMCHAIN, encoding="utf-8")
    text = PINHOLE.replace('"PINHOLE"', '"CALIBRATED"\ncalibration = "chain.yaml"\ncamera = "cam1"')
    text = "\n".join(line for line in text.splitlines() if "px" not in line and "field" not in line)
    path = _write(tmp_path, text)
    (camera,) = read_head(path).cameras
    assert isinstance(camera.projection, CalibratedCamera)
    assert camera.projection.fy_px == 31.0
    # x1 = x0 + (-0.3, 0.1, 0), so the camera is at the opposite place.
    np.testing.assert_allclose(camera.position_m, [0.3, -0.1, 0.0], atol=1e-12)
    assert list_head_files(path) == [path, tmp_path / "chain.yaml"]
    assert _read(tmp_path, text + "\nposition_m = [1, 2, 3]\n")[0].position_m.tolist() == [1, 2, 3]
    with pytest.raises(IcyMoonError, match="has the cameras cam0, cam1; choose one by camera"):
        _read(tmp_path, text.replace('camera = "cam1"', ""))
    with pytest.raises(IcyMoonError, match=r"line 7 .*no camera 'cam7'"):
        _read(tmp_path, text.replace("cam1", "cam7"))


def test_a_camera_states_what_its_calibration_leaves_open(tmp_path):
    """Size, unit and lens of OpenCV's files, by keys of the head that the sentences name."""
    kind = "!!opencv-matrix\n  dt: d"
    matrix = f"camera_matrix: {kind}\n  rows: 3\n  cols: 3\n  data: [60., 0., 30., 0., 60., 25., 0., 0., 1.]\n"
    lens = f"distortion_coefficients: {kind}\n  rows: 1\n  cols: 4\n  data: [0.1, 0.02, 0.001, 0.002]\n"
    (tmp_path / "one.yml").write_text(f"%YAML:1.0\n---\n{matrix}{lens}", encoding="utf-8")
    head = '[[camera]]\nname = "one"\nmodel = "CALIBRATED"\ncalibration = "one.yml"\n'
    size = "width_px = 64\nheight_px = 48\n"
    for more, clause in (
        (size, "add lens brown or lens fisheye"),
        ('lens = "fisheye"\n', "add width_px and height_px"),
        (size + 'lens = "fish"\n', "line 7 .*did you mean 'fisheye'"),
    ):
        with pytest.raises(IcyMoonError, match=clause) as error:
            _read(tmp_path, head + more)
        assert "--" not in str(error.value)
    (camera,) = _read(tmp_path, head + size + 'lens = "fisheye"\n')
    assert camera.projection.lens == Fisheye((0.1, 0.02, 0.001, 0.002))
    assert camera.projection.size_px == (64, 48)


@pytest.mark.parametrize(
    ("text", "clause"),
    [
        (PINHOLE + PINHOLE.replace('"one"', '"ONE"'), "line 11: .*also the name of another camera"),
        (PINHOLE.replace("PINHOLE", "PINHOL"), "line 5 .*did you mean 'PINHOLE'"),
        (PINHOLE.replace("= 60", "= 0"), "line 8 .*from 0.1 to 170"),
        (PINHOLE.replace("= 60", "= 400"), "line 8 .*from 0.1 to 170"),
        (PINHOLE.replace("PINHOLE", "FISHEYE").replace("= 60", "= 400"), "line 8 .*from 1 to 360"),
        (
            PINHOLE.replace("PINHOLE", "EQUIRECTANGULAR").replace("= 60", "= 360"),
            "more than 180°; state height_px of 32",
        ),
        (PINHOLE.replace("= 60", '= "wide"'), "line 8 .*state a number"),
        (PINHOLE.replace("= 60", "= nan"), "line 8 .*state a number"),
        (PINHOLE.replace("= 64", "= 64.5"), "line 6 .*state a whole number"),
        (PINHOLE.replace("field_deg", "width_m"), "has no width_m"),
        (PINHOLE.replace("field_deg = 60", ""), "field_deg is missing"),
        (PINHOLE.replace("mast", "tail"), "role is 'tail', known are"),
        (PINHOLE.replace('"one"', '"../one"'), "not a name of a camera"),
        (PINHOLE.replace('"one"', '"con"'), "no file with a name of a device; take another name"),
        (PINHOLE.replace('"one"', f'"{41 * "a"}"'), "41 letters"),
        (PINHOLE.replace('name = "one"', ""), "name is missing"),
        (PINHOLE + 'frame = "ZERO"\n', "position_m is missing"),
        (PINHOLE + "position_m = [1, 2]\n", "state 3 numbers"),
        (PINHOLE + "position_m = [1, 2, 1e9]\n", "farther than 1000 km"),
        (PINHOLE + "forward = [0, 1, 0]\n", r"line 9 .*along up, which is \[0\.0, -1\.0, 0\.0\] by default"),
        (PINHOLE + "forward = [0, 1, 0]\nup = [0, 2, 0]\n", "line 9 .*forward is along up; state an up"),
        (PINHOLE + "forward = [0, 0, 0]\n", "line 9 .*forward has the length 0"),
        (PINHOLE + "up = [0, 0, 0]\n", "line 9 .*up has the length 0"),
        (PINHOLE + "quaternion_xyzw = [0, 0, 0, 0]\n", "it has the length 0; state one of the length 1"),
        (PINHOLE + "quaternion_xyzw = [0, 0, 0, 1]\nup = [0, 1, 0]\n", "leave up out"),
        ("", "has no cameras"),
        ("camera = []\n", "has no cameras"),
        ("camera = 3\n", "has no cameras"),
        ("[rig]\nwidth_px = 3\n", "a head has no 'rig'"),
        ("\x89PNG", "is not a TOML file"),
        (17 * PINHOLE, "at most 16 cameras, not 17"),
    ],
)
def test_what_is_no_head_is_refused_by_one_sentence(tmp_path, text, clause):
    with pytest.raises(IcyMoonError, match=clause) as error:
        _read(tmp_path, text)
    assert str(error.value).count("\n") == 0
    assert "head.toml" in str(error.value)


def test_a_file_that_is_not_there_is_refused_and_names_itself_alone(tmp_path):
    path = tmp_path / "none.toml"
    with pytest.raises(IcyMoonError, match=r"none\.toml cannot be read"):
        read_head(path)
    assert list_head_files(path) == [path]
