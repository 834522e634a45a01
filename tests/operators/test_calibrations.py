"""Read Calibration and Write Calibration: what the shell reads and writes, in the window's scene."""

from __future__ import annotations

from dataclasses import replace

import bpy
import cv2
import numpy as np
import pytest
from heads import HEADS, head_settings
from icymoon.commands.camera import read_eyes
from icymoon.formats.calibrations.registry import FORMATS, read_calibration, write_calibration
from icymoon.operators import calibrations
from icymoon.physics.camera.calibrated_camera import CalibratedRig
from icymoon.physics.camera.eyes import EYE_TOPICS, make_camera_with_eyes
from icymoon.physics.camera.lens_models import Brown
from icymoon.physics.camera.rig_cameras import make_calibrated_rig
from icymoon.settings.blender import scene_properties
from icymoon.settings.description import defaults, merged
from rendering import empty_scene


@pytest.fixture
def scene():
    return empty_scene()


def settings_of(scene):
    return scene_properties.read_settings(scene.icymoon)


def put(folder, name, kind):
    paths = [folder / f"{eye}{FORMATS[kind].suffix}" for eye in ("left", "right")[: 1 + FORMATS[kind].each]]
    write_calibration(HEADS[name], paths, kind)
    return paths


def read(paths, **options):
    files = [{"name": path.name} for path in paths]
    return bpy.ops.icymoon.read_calibration(directory=str(paths[0].parent), files=files, **options)


def test_two_cameras_that_differ_are_the_eyes_of_the_scene(scene, tmp_path):
    paths = put(tmp_path, "nearly alike", "mrcal")
    assert read(paths) == {"FINISHED"}
    found, _ = read_eyes(*paths)
    for topic in ("rig", *EYE_TOPICS):
        for key, value in found[topic].items():
            assert settings_of(scene)[topic][key] == (pytest.approx(value) if isinstance(value, float) else value), key


def test_a_pinhole_pair_leaves_nothing_of_the_eyes_before(scene, tmp_path):
    """A rig is read over one with other lenses, toe-in and overscan."""
    scene_properties.write_settings(scene.icymoon, head_settings("verged and rolled"))
    scene.icymoon.rig.toe_in_deg, scene.icymoon.rig.distortion_k3 = 2.0, 0.1
    left = replace(HEADS["nearly alike"].cameras[1], name="left").placed(np.eye(3), np.zeros(3))
    right = replace(left, name="right").placed(np.eye(3), np.array([-0.2, 0.0, 0.0]))
    write_calibration(CalibratedRig((left, right)), [tmp_path / "pair.yaml"], "opencv")
    assert read([tmp_path / "pair.yaml"]) == {"FINISHED"}
    rig = settings_of(scene).rig
    assert (rig.eyes, rig.toe_in_deg, rig.overscan) == ("ALIKE", 0.0, 0.0)
    assert rig.distortion_k3 == pytest.approx(0.001)
    assert rig.baseline_m == pytest.approx(0.2)


def test_a_lens_before_leaves_no_number_in_the_next_one(scene, tmp_path):
    scene_properties.write_settings(scene.icymoon, head_settings("verged and rolled"))
    assert read(put(tmp_path, "nearly alike", "opencv")) == {"FINISHED"}
    assert settings_of(scene).left_eye.k4 == 0.0
    assert settings_of(scene).right_eye.skew_px == 0.0


def test_options_are_those_of_the_shell(scene, tmp_path):
    """A baseline in mm and no size of the images, as OpenCV's sample stereo_calib writes them."""
    path, (left, right) = tmp_path / "stereo.yml", HEADS["nearly alike"].cameras
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, camera in (("1", left), ("2", right)):
        storage.write(f"M{key}", camera.matrix)
        assert isinstance(camera.lens, Brown)
        storage.write(f"D{key}", np.array([camera.lens.coefficients]))
    storage.write("R", right.rotation)
    storage.write("T", 1000 * right.translation_m[:, None])
    storage.release()
    with pytest.raises(RuntimeError, match="Image Size") as caught:
        read([path], unit="mm")
    assert "--" not in str(caught.value)
    with pytest.raises(RuntimeError, match="'wide' is not a size; write it as 640x480"):
        read([path], size="wide")
    assert read([path], unit="mm", size="96x72") == {"FINISHED"}
    assert settings_of(scene).rig.baseline_m == pytest.approx(np.linalg.norm(right.centre_m))
    assert read([path], unit="mm", size="96x72", alike=True) == {"FINISHED"}
    assert settings_of(scene).rig.eyes == "ALIKE"


def test_files_in_the_order_of_the_right_eye_are_exchanged(scene, tmp_path):
    assert read(put(tmp_path, "nearly alike", "ros")[::-1], exchange=True) == {"FINISHED"}
    assert settings_of(scene).left_eye.fx_px == pytest.approx(98.31)


def test_a_file_that_is_no_calibration_is_one_sentence_and_changes_nothing(scene, tmp_path):
    before = settings_of(scene)
    (tmp_path / "a.yaml").write_text("objects: [1, 2]\n", encoding="utf-8")
    with pytest.raises(RuntimeError, match=r"a\.yaml: is not a known calibration.*state its format by Format\."):
        bpy.ops.icymoon.read_calibration(filepath=str(tmp_path / "a.yaml"))
    exchanged = put(tmp_path, "nearly alike", "mrcal")[::-1]
    with pytest.raises(RuntimeError, match="so it is the left eye; tick Exchange Files"):
        read(exchanged)
    assert settings_of(scene) == before


@pytest.mark.parametrize("kind", FORMATS)
def test_what_is_written_is_the_rig_of_the_scene(scene, tmp_path, kind):
    """An alike pair with k1 and toe-in, which every format holds but one that has no distortion of a turned axis."""
    scene.icymoon.rig.distortion_k1, scene.icymoon.rig.toe_in_deg = -0.1, 1.5
    assert bpy.ops.icymoon.write_calibration(filepath=str(tmp_path / "rig.x"), kind=kind) == {"FINISHED"}
    paths = calibrations.list_calibration_files(tmp_path / "rig.x", kind)
    assert all(path.exists() for path in paths)
    there, wanted = read_calibration(paths).rig, make_calibrated_rig(settings_of(scene))
    rays = np.array([[0.1, -0.2, 1.0], [-0.3, 0.2, 1.0], [0.0, 0.0, 1.0]]) * 4
    for found, own in zip(there.from_first().cameras, wanted.cameras, strict=True):
        np.testing.assert_allclose(found.project(rays), own.project(rays), atol=1e-6)
    assert make_calibrated_rig(settings_of(scene)).cameras[1].centre_m[0] > 0.9 * settings_of(scene).rig.baseline_m


def test_calibrated_eyes_are_written_and_read_again(scene, tmp_path):
    scene_properties.write_settings(scene.icymoon, head_settings("fisheye and CAHVORE"))
    with pytest.raises(RuntimeError, match=r"Kalibr has no lens like CAHVORE.*choose"):
        bpy.ops.icymoon.write_calibration(filepath=str(tmp_path / "head"), kind="kalibr")
    scene_properties.write_settings(scene.icymoon, head_settings("nearly alike"))
    before = make_camera_with_eyes(merged(defaults(), settings_of(scene)))
    assert bpy.ops.icymoon.write_calibration(filepath=str(tmp_path / "head"), kind="mrcal") == {"FINISHED"}
    scene_properties.write_settings(scene.icymoon, head_settings("verged and rolled"))
    assert read(calibrations.list_calibration_files(tmp_path / "head", "mrcal")) == {"FINISHED"}
    after = make_camera_with_eyes(merged(defaults(), settings_of(scene)))
    for first, second in zip(before.eyes, after.eyes, strict=True):
        np.testing.assert_allclose(second.matrix, first.matrix, rtol=1e-6)
        np.testing.assert_allclose(second.rotation, first.rotation, atol=1e-6)


def test_one_file_has_one_name_and_two_files_have_an_eye_each(tmp_path):
    assert calibrations.list_calibration_files(tmp_path / "a", "opencv") == [tmp_path / "a.yaml"]
    assert calibrations.list_calibration_files(tmp_path / "a.lbl", "cahv") == [
        tmp_path / "a_left.cahvor",
        tmp_path / "a_right.cahvor",
    ]
    assert calibrations.list_calibration_files(tmp_path / "a", "colmap") == [tmp_path / "a"]
