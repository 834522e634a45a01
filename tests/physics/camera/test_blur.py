"""Blur that is rendered: what is refused, what names a pair, what is told where a pair is developed otherwise."""

import json
import math

import numpy as np
import pairs
import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.physics.camera.blur import (
    MOTION,
    advise_on_blur,
    circle_of_confusion_px,
    find_blur,
    find_pose_after,
    motion_blur_px,
)
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.settings.description import check, defaults, merged
from icymoon.settings.topics.scene import Settings
from icymoon.stereo.cli import main
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")

FIXED = {"sensor": {"auto_exposure": False, "exposure_s": 0.01}}


def described(rig: dict, *more: dict) -> Settings:
    return merged(defaults(), check({"rig": rig}, "test"), *more)


def test_without_blur_there_is_none_and_the_response_does_not_name_the_pair():
    base = defaults()
    assert find_blur(base) is None
    assert advise_on_blur(base) == []
    same = merged(base, {"sensor": {"f_number": 2.0, "exposure_s": 3.0}})
    assert expand_headings(same)[0].id == expand_headings(base)[0].id


@pytest.mark.parametrize(
    ("rig", "one", "other", "same"),
    [
        ({"focus_distance_m": 2.0}, {"f_number": 8.0}, {"f_number": 4.0}, {"exposure_s": 1.0}),
        ({"roll_deg_s": 3.0}, {"exposure_s": 0.01}, {"exposure_s": 0.02}, {"f_number": 4.0}),
    ],
)
def test_what_of_the_response_is_in_the_light_names_the_pair(rig, one, other, same):
    base = described(rig, {"sensor": defaults().sensor | FIXED["sensor"]})
    name = [expand_headings(merged(base, {"sensor": values}))[0].id for values in (one, other, one | same)]
    assert name[0] == name[2] != name[1]


@pytest.mark.parametrize(
    ("rig", "sensor", "said"),
    [
        ({"focus_distance_m": 0.001}, {"f_number": 0.5}, "rig.focus_distance_m is 0.001 m"),
        ({"speed_down_m_s": 1000.0}, {}, "rig.motion_exposure_s"),
        ({"turn_right_deg_s": 100.0, "motion_exposure_s": 1000.0}, {}, "turns by 1e[+]05°"),
    ],
)
def test_blur_that_cannot_be_rendered_is_refused_in_a_sentence(rig, sensor, said):
    settings = described(rig, {"sensor": sensor})
    for refuse in (find_blur, expand_headings):
        with pytest.raises(IcyMoonError, match=said):
            refuse(settings)
    assert len(advise_on_blur(settings)) == 1


def test_focus_at_depth_and_at_infinity():
    rig = defaults().rig
    blur = find_blur(described({"focus_distance_m": 2.0}, {"sensor": {"f_number": 4.0}}))
    assert circle_of_confusion_px(2.0, rig, blur) == 0
    # f²/N over the pixel's width, of the inverse focus: the disc of what is infinitely far, a textbook's.
    assert circle_of_confusion_px(math.inf, rig, blur) == pytest.approx(0.032**2 / 4 / 2.0 / (0.06 / 640))
    assert motion_blur_px(0, 0, 2.0, rig, blur) == 0


@given(st.lists(st.floats(-1e4, 1e4), min_size=6, max_size=6), st.floats(1e-6, 1e3), st.floats(0.1, 1e3))
def test_whatever_moves_the_way_is_a_number(values, seconds, depth):
    settings = described(dict(zip(MOTION, values, strict=True)) | {"motion_exposure_s": seconds})
    try:
        blur = find_blur(settings)
    except IcyMoonError:
        return
    if blur is not None:
        assert motion_blur_px(10.0, -20.0, depth, settings["rig"], blur) >= 0


def test_the_signs_of_motion_are_those_that_its_settings_name():
    forward, right, down = [0, 0, 1.0], [1.0, 0, 0], [0, 1.0, 0]
    for key, of, toward in (
        ("turn_right_deg_s", forward, right),
        ("turn_down_deg_s", forward, down),
        ("roll_deg_s", right, down),
    ):
        pose = find_pose_after(find_blur(described({key: 30.0}, FIXED)), 1.0)
        np.testing.assert_allclose(
            pose[:3, :3] @ of, np.cos(np.pi / 6) * np.array(of) + 0.5 * np.array(toward), atol=1e-12
        )
        assert not pose[:3, 3].any()
    for key, toward in (("speed_right_m_s", right), ("speed_down_m_s", down), ("speed_forward_m_s", forward)):
        np.testing.assert_allclose(
            find_pose_after(find_blur(described({key: 2.0}, FIXED)), 3.0)[:3, 3], 6 * np.array(toward)
        )


@pytest.mark.long
def test_the_report_and_developed_images_say_what_truth_is_of_and_what_does_not_fit(tmp_path):
    settings = described({"focus_distance_m": 2.0, "speed_right_m_s": 0.1, "motion_exposure_s": 0.01})
    folder = pairs.write_pair(tmp_path / "set" / "pairs" / "one", settings=settings)
    fitting = ["--set", "sensor.auto_exposure=false", "--set", "sensor.exposure_s=0.01"]
    said = {}
    for name, more in (("auto", []), ("fits", fitting), ("wide", [*fitting, "--set", "sensor.f_number=4"])):
        assert main(["develop", str(folder), "--out", str(tmp_path / name), *more]) == 0
        said[name] = json.loads((tmp_path / name / "one" / "images.json").read_text())["warnings"]
    of_blur = [[text for text in said[name] if "saturated" not in text] for name in ("auto", "fits", "wide")]
    assert [len(texts) for texts in of_blur] == [2, 1, 2]
    assert "pinhole in the middle of the exposure" in said["fits"][0]
    assert said["auto"][1].startswith("Motion blur is that of 0.01 s")
    assert said["wide"][1].startswith("Depth of field is that of f/8")
    assert main(["evaluate", str(folder), "--methods", "bm", "--out", str(tmp_path / "report")]) == 0
    report = json.loads((tmp_path / "report" / "report.json").read_text())
    assert report["pairs"][0]["warnings"] == said["auto"]
    page = (tmp_path / "report" / "report.html").read_text()
    assert page.count("The images are blurred, truth is sharp") == 1
    assert "Warnings about the images" in page
    plain = pairs.write_pair(tmp_path / "plain")
    assert main(["evaluate", str(plain), "--methods", "bm", "--out", str(tmp_path / "sharp")]) == 0
    assert "Warnings about the images" not in (tmp_path / "sharp" / "report.html").read_text()


def test_a_camera_is_read_back_and_older_pairs_have_parallel_eyes_without_margins():
    rig = defaults().rig | {"overscan": 0.031, "toe_in_deg": 3.0}
    camera = StereoCamera.from_settings(rig)
    assert camera.rendered_px == (640 + 2 * 20, 480 + 2 * 15)
    stored = json.loads(json.dumps(camera.to_json()))
    assert StereoCamera.from_json(stored) == camera
    for key in ("margin_x_px", "margin_y_px", "toe_in_deg"):
        del stored[key]
    assert StereoCamera.from_json(stored) == camera.rectified


@pytest.mark.parametrize("toe_in", [0.0, 3.0, 45.0])
def test_a_point_is_where_the_calibration_of_each_eye_says(toe_in):
    camera = StereoCamera.from_settings(defaults().rig | {"toe_in_deg": toe_in})
    point = np.array([0.1, -0.2, 2.0])
    eyes = camera.eyes_json()
    for eye, at in (("left", [0, 0, 0]), ("right", [camera.baseline_m, 0, 0])):
        seen = np.array(eyes[eye]["R"]) @ point + eyes[eye]["t"]
        assert np.linalg.norm(seen) == pytest.approx(np.linalg.norm(point - at))
        # Turned in: the eye's axis leans toward the other one.
        axis = np.array(eyes[eye]["R"])[2]
        assert axis[0] == pytest.approx(math.sin(math.radians(toe_in)) * (1 if eye == "left" else -1))
