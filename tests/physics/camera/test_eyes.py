"""Calibrated eyes as settings and back, and what is no eye."""

from __future__ import annotations

import json

import numpy as np
import pytest
from heads import HEADS, head_settings
from icymoon.physics.camera.calibrated_camera import CalibratedRig
from icymoon.physics.camera.eyes import eyes_json, find_overscan_of_eyes, make_camera_with_eyes, measure_dark_shares
from icymoon.physics.scene_checks import advise_on_scene, find_reasons
from icymoon.settings.description import defaults, merged
from icymoon.settings.pair_ids import list_counted_values
from icymoon.settings.rebuilt_parts import select_camera, select_response


@pytest.mark.parametrize("name", HEADS)
def test_a_calibration_comes_back_from_its_settings(name):
    """Settings are in single precision: 4e-6 px of 100, and 1e-5 px for an angle of a few degrees."""
    rig = CalibratedRig(make_camera_with_eyes(head_settings(name)).eyes)
    for k, (found, wanted) in enumerate(zip(rig.cameras, HEADS[name].cameras, strict=True)):
        assert found.size_px == wanted.size_px
        pixels = np.stack(np.meshgrid(np.arange(5.0, 90, 10), np.arange(5.0, 60, 10)), axis=-1)
        points = wanted.unproject(pixels) * 3.0
        np.testing.assert_allclose(found.project(points @ found.rotation - found.rotation.T @ found.translation_m),
                                   pixels, atol=1e-4)  # fmt: skip
        rotation, translation = rig.relative_pose(k)
        np.testing.assert_allclose(rotation, HEADS[name].relative_pose(k)[0], atol=1e-6)
        np.testing.assert_allclose(translation, HEADS[name].relative_pose(k)[1], atol=1e-7)


@pytest.mark.parametrize("name", HEADS)
def test_the_proposed_overscan_lights_all_pixels_and_hardly_more(name):
    settings = head_settings(name)
    assert measure_dark_shares(make_camera_with_eyes(settings)) == (0.0, 0.0)
    assert not [said for said in advise_on_scene(settings) if "dark" in said]
    less = merged(settings, {"rig": {"overscan": settings.rig.overscan - 3 / 72}})
    assert max(measure_dark_shares(make_camera_with_eyes(less))) > 0
    told = f"rig.overscan to {settings.rig.overscan:g}"
    assert any("dark" in said and told in said for said in advise_on_scene(less))


def test_eyes_of_the_parallel_pair_itself_need_no_overscan_and_turn_nothing():
    settings = merged(defaults(), {"rig": {"eyes": "CALIBRATED"}})
    rig = make_camera_with_eyes(settings)
    for eye, along in zip(rig.eyes, (0.0, rig.baseline_m), strict=True):
        assert np.array_equal(eye.rotation, np.eye(3))
        assert eye.centre_m == pytest.approx([along, 0.0, 0.0])
        assert (eye.matrix[:2, 2] + 0.5).tolist() == [rig.cx_px, rig.cy_px]
        assert eye.fx_px == pytest.approx(rig.focal_px)
    assert find_overscan_of_eyes(rig) <= 1.01 / 480  # the pixel that a grid may miss


def test_alike_eyes_ignore_the_tables_and_keep_ids():
    changed = {"left_eye": {"fx_px": 99.0}}
    settings = merged(defaults(), changed)
    assert make_camera_with_eyes(settings) == make_camera_with_eyes(defaults())
    assert list_counted_values(defaults()) == list_counted_values(merged(defaults(), {}))
    assert "left_eye" not in json.dumps(list_counted_values(defaults()))
    assert list_counted_values(settings) != list_counted_values(defaults())


def test_eyes_are_of_the_camera_and_distortion_of_the_rig_does_not_count_beside_them():
    assert select_camera(defaults())["left_eye"].keys() == defaults().left_eye.keys()
    assert "left_eye" not in select_response(defaults())
    settings = merged(head_settings("nearly alike"), {"rig": {"distortion_k1": 0.3, "toe_in_deg": 5.0}})
    assert eyes_json(make_camera_with_eyes(settings), settings.rig) == eyes_json(
        make_camera_with_eyes(head_settings("nearly alike")), head_settings("nearly alike").rig
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"k1": -0.9, "k2": 0.0, "k3": 0.0}, "left_eye.k1 to k6 fold the image over itself"),
        ({"lens": "CAHVORE", "r1": -0.9}, "left_eye.r0, r1 and r2 fold the image over itself"),
        ({"lens": "CAHVORE", "r0": -1.5}, "left_eye is not a camera: R begins with -1.5"),
        ({"lens": "CAHVORE", "axis_x": 0.8, "axis_y": 0.8}, "point the optical axis to the side"),
        ({"turn_y_deg": 170.0}, "correct left_eye.turn_x_deg, left_eye.turn_y_deg and left_eye.turn_z_deg"),
    ],
)
def test_what_is_no_eye_is_one_sentence_with_its_setting(changes, words):
    settings = merged(head_settings("nearly alike"), {"left_eye": changes})
    (reason,) = [each for each in find_reasons(settings) if each.names[0].startswith("left_eye")]
    assert words in reason
    assert reason.endswith(".")
    assert not [each for each in find_reasons(merged(settings, {"rig": {"eyes": "ALIKE"}})) if "eye" in each.names[0]]


def test_a_fisheye_may_have_pixels_that_see_nothing():
    settings = merged(head_settings("fisheye and CAHVORE"), {"left_eye": {"k1": -0.3}})
    camera = make_camera_with_eyes(settings)
    assert 0 < camera.eyes[0].dark_share() < 0.5
    assert not [each for each in find_reasons(settings) if each.names[0].startswith("left_eye")]
    assert any("of the left eye stay dark" in said for said in advise_on_scene(settings))


def test_what_no_pinhole_shows_needs_an_infinite_overscan():
    settings = merged(head_settings("fisheye and CAHVORE"), {"left_eye": {"fx_px": 20.0, "fy_px": 20.0}})
    assert find_overscan_of_eyes(make_camera_with_eyes(settings)) == np.inf
    assert any("No pinhole shows all that the eyes see" in said for said in advise_on_scene(settings))
