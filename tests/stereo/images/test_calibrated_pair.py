"""A pair of calibrated eyes from its files to its images, its export and its measurement."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pairs
import pytest
from heads import HEADS, head_settings, plane_seen, write_head
from icymoon.formats.cahvor import FIT_LIMIT_PX, read_model
from icymoon.formats.calibrations.registry import read_calibration
from icymoon.physics.camera.eyes import make_camera_with_eyes
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.settings.description import merged
from icymoon.stereo.cli import main
from icymoon.stereo.images.develop import develop
from icymoon.stereo.images.views import read_eye, read_sensor_truth
from icymoon.support.errors import IcyMoonError

EYES = ("left", "right")
QUIET = {
    "shot_noise": False,
    "read_noise_e": 0.0,
    "dark_current_e_s": 0.0,
    "bits": 16,
    "auto_percentile": 1.0,
    "full_well_e": 1e6,
}


def developed(folder, **sensor):
    pair = read_pair(folder)
    (left, left_view), (right, right_view) = (read_eye(pair, eye) for eye in EYES)
    return (
        pair,
        (left_view, right_view),
        develop(pair, left, right, merged(pair.settings, {"sensor": {**QUIET, **sensor}})),
    )


@pytest.mark.parametrize("name", HEADS)
def test_sensors_show_what_their_rays_meet_and_rectified_images_what_the_rig_would(tmp_path, name):
    # A plane that is seen from before, so that its waves are nowhere shorter than 5 px.
    scene = pairs.Scene(rock=False, slope_y=0.1)
    pair, views, images = developed(write_head(tmp_path / "pair", name, scene))
    scale = 1 / images.saturation_radiance * (2**16 - 1)
    for eye, own, view in zip(EYES, pair.camera.eyes, views, strict=True):
        _, _, light = plane_seen(scene, own, pair.camera.focal_px)
        seen = getattr(images, f"detected_{eye}")
        assert seen.shape == light.shape == own.size_px[::-1]
        inner = np.s_[4:-4, 4:-4]
        off = (seen / scale - light)[inner] / light.std()
        assert np.std(off) < 0.03  # of waves of 5 px and more, and up to 1.4 times as long to a sensor
        assert abs(off.mean()) < 2e-3
        rectified = getattr(images, eye)
        assert rectified.shape == (pair.camera.height_px, pair.camera.width_px)
        known = rectified > 0
        assert known.mean() > 0.5
        back = (rectified / scale - view.radiance[..., 0])[known] / light.std()
        # Linear interpolation blurs a sensor's image, most where the sensor is coarser than the rig.
        assert np.sqrt(np.median(back**2)) < 0.25
        assert np.corrcoef(rectified[known], view.radiance[..., 0][known])[0, 1] > 0.9


def test_a_colour_sensor_has_its_mosaic_at_the_size_of_each_eye(tmp_path):
    pair, _, images = developed(write_head(tmp_path / "pair", "verged and rolled"), colour="BAYER", deposit_share=0.1,
                                prnu=0.01, shot_noise=True, brackets=2)  # fmt: skip
    for eye, own in zip(EYES, pair.camera.eyes, strict=True):
        assert getattr(images, f"detected_{eye}").shape == own.size_px[::-1]
        assert getattr(images.frames[1], eye).shape == own.size_px[::-1]
        assert images.seen(eye).shape == (pair.camera.height_px, pair.camera.width_px, 3)
        assert images.blocked[eye].shape == (pair.camera.height_px, pair.camera.width_px)


@pytest.mark.parametrize("name", HEADS)
def test_the_export_of_raw_images_has_their_truth_and_rectifies_as_we_do(tmp_path, name):
    folder = write_head(tmp_path / "0123456789ab", name)
    assert main(["export", str(folder), "--format", "raw", "--out", str(tmp_path / "out")]) == 0
    out = tmp_path / "out" / "0123456789ab"
    pair = read_pair(folder)
    stated = json.loads((out / "calibration.json").read_text(encoding="utf-8"))
    for eye, own in zip(EYES, pair.camera.eyes, strict=True):
        depth, _, _ = plane_seen(pairs.Scene(rock=False), own, pair.camera.focal_px)
        np.testing.assert_allclose(np.load(out / f"depth_{eye}.npy"), depth, rtol=1e-6)
        assert np.load(out / f"normal_{eye}.npy").shape == (*depth.shape, 3)
        image = cv2.imread(str(out / f"{eye}.png"), cv2.IMREAD_UNCHANGED)
        assert image.shape == depth.shape
        maps = np.load(out / f"rectification_{eye}.npz")
        assert maps["map_x"].shape == maps["map_y"].shape == (pair.camera.height_px, pair.camera.width_px)
        matrix = np.array(stated["eyes"][eye]["K"])
        np.testing.assert_allclose(matrix[:2, 2] - 0.5, own.matrix[:2, 2])
        assert stated["eyes"][eye]["width_px"] == own.width_px
    assert "fisheye" not in name or not (out / "opencv.yaml").exists()
    written = {"nearly alike": ["opencv", "mrcal"], "verged and rolled": [], "fisheye and CAHVORE": []}[name]
    assert list(stated["files"]) == written
    for kind in written:
        found = read_calibration([out / file for file in stated["files"][kind]]).rig
        for k, (own, wanted) in enumerate(zip(found.cameras, pair.camera.eyes, strict=True)):
            np.testing.assert_allclose(own.matrix, wanted.matrix, rtol=1e-12)
            wanted_turn = pair.camera.eyes[1].rotation @ pair.camera.eyes[0].rotation.T
            np.testing.assert_allclose(found.relative_pose(k)[0], wanted_turn if k else np.eye(3), atol=1e-12)
            assert np.linalg.norm(found.relative_pose(k)[1]) == pytest.approx(k * pair.camera.baseline_m)


def test_a_matcher_measures_the_rectified_pair(tmp_path):
    folder = write_head(tmp_path / "pairs" / "0123456789ab", "nearly alike")
    assert main(["evaluate", str(folder), "--methods", "sgbm", "--out", str(tmp_path / "out")]) == 0
    (line,) = (tmp_path / "out" / "results.jsonl").read_text(encoding="utf-8").splitlines()
    row = json.loads(line)
    assert row["method"] == "sgbm"
    assert row["coverage"] > 0.8
    assert row["epe_px"] < 0.2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda data: data["eyes"]["left"]["lens"].update(coefficients=[0.0] * 5), r"eyes\.left\.lens\.coefficients"),
        (
            lambda data: data["eyes"]["right"].update(width_px=99),
            r"eyes\.right\.width_px is 99, .* give 96",
        ),
        (lambda data: data["eyes"]["right"]["R"][0].reverse(), r"eyes\.right\.R\[0\]\[0\]"),
        (lambda data: data["files"].pop("left_raw_truth.exr"), "files lacks left_raw_truth.exr"),
        (lambda data: data["settings"]["rig"].update(eyes="ALIKE"), "eyes|files has left_raw_truth.exr"),
        (
            lambda data: data["settings"]["left_eye"].update(lens="CAHVORE", r0=-2.0),
            "no camera follows from its settings",
        ),
    ],
)
def test_statements_that_the_settings_contradict_are_refused(tmp_path, change, words):
    folder = write_head(tmp_path / "pair", "nearly alike")
    data = json.loads((folder / "pair.json").read_text(encoding="utf-8"))
    change(data)
    (folder / "pair.json").write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(IcyMoonError, match=words):
        read_pair(folder)


def test_truth_of_another_size_than_the_sensor_is_refused(tmp_path):
    pair = read_pair(write_head(tmp_path / "pair", "nearly alike"))
    read_sensor_truth(pair, "left")
    other = replace(pair, camera=make_camera_with_eyes(head_settings("verged and rolled")))
    with pytest.raises(IcyMoonError, match=r"right_raw_truth\.exr is 96 x 72 px, but its camera has 128 x 64 px"):
        read_sensor_truth(other, "right")


def write_placed_head(folder, name):
    """A head with its pose in the world: 3 m up, looking north and level."""
    write_head(folder, name)
    data = json.loads((folder / "pair.json").read_text(encoding="utf-8"))
    pose = np.array([[1.0, 0, 0, 5.0], [0, 0, 1.0, -2.0], [0, -1.0, 0, 3.0], [0, 0, 0, 1.0]])
    along = pose.copy()
    along[:3, 3] += pose[:3, 0] * data["camera"]["baseline_m"]
    data |= {"poses_rectified_to_world": {"left": pose.tolist(), "right": along.tolist()}, "edited_by_hand": True}
    (folder / "pair.json").write_text(json.dumps(data), encoding="utf-8")
    return folder, pose


def test_the_export_of_rover_models_has_those_of_the_sensors(tmp_path):
    """A lens of Brown and Conrady is fitted by CAHVOR; points in the world are where the eyes themselves have them."""
    folder, pose = write_placed_head(tmp_path / "0123456789ab", "nearly alike")
    assert main(["export", str(folder), "--format", "cahvor", "--out", str(tmp_path / "out")]) == 0
    out = tmp_path / "out" / "0123456789ab"
    for eye, own in zip(EYES, make_camera_with_eyes(head_settings("nearly alike")).eyes, strict=True):
        model = read_model(out / f"{eye}_sensor.cahvor")
        assert (model.width_px, model.height_px) == own.size_px
        assert cv2.imread(str(out / f"{eye}_sensor.png")).shape[:2] == own.size_px[::-1]
        pixels = np.stack(np.meshgrid(np.arange(0.0, 96, 5), np.arange(0.0, 72, 5)), axis=-1).reshape(-1, 2)
        points = (4.0 * own.unproject(pixels) - own.translation_m) @ own.rotation
        seen = model.project(points @ pose[:3, :3].T + pose[:3, 3])
        assert np.abs(seen - pixels).max() < FIT_LIMIT_PX


def test_a_sensor_whose_lens_no_rover_has_is_refused_by_that_export(tmp_path, capsys):
    folder, _ = write_placed_head(tmp_path / "0123456789ab", "fisheye and CAHVORE")
    assert main(["export", str(folder), "--format", "cahvor", "--out", str(tmp_path / "out")]) == 1
    told = " ".join(capsys.readouterr().err.split())
    assert "CAHVORE has no lens equal to Kannala-Brandt fisheye (camera left); export raw" in told
