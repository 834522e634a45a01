"""Depth of field, motion blur, toe-in and overscan: what the render makes of them, against optics and geometry."""

from __future__ import annotations

import json

import bpy
import cv2
import numpy as np
import pytest
from icymoon.nodes.build_scene import build_scene
from icymoon.operators import sidebar_text
from icymoon.physics.camera.blur import circle_of_confusion_px, find_blur, motion_blur_px
from icymoon.physics.camera.lens_distortion import find_overscan
from icymoon.render.pairs.pair_folder import EYES
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.progress import SampleCounter
from icymoon.render.render_pair import check_camera
from icymoon.render.worker import render_pairs
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.export.layouts import export
from icymoon.stereo.images.exr import read_light, read_truth
from icymoon.stereo.matchers import match
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.prepare_pair import load_pair
from icymoon.stereo.reexpose import reexpose
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from rendering import complete, empty_scene, render

#: A plane two metres below the camera that ends at its left eye: an edge down the middle of the image.
EDGE = {
    "terrain": {"rms_slope_deg": 0.0, "size_m": 8.0, "resolution": 5},
    "surface": {"grain_amplitude_m": 0.0, "albedo_variation": 0.0, "specular": 0.0},
    "light": {"sun_elevation_deg": 90.0, "sun_angular_diameter_deg": 0.0},
    "rig": {"pitch_deg": 90.0, "height_m": 2.0, "x_m": 4.0, "width_px": 96, "height_px": 24},
    "quality": {"samples": 64, "diffuse_bounces": 0},
}
FOCUS = {"rig": {"focus_distance_m": 0.1}, "sensor": {"f_number": 1.6}}
MOTION = {"rig": {"speed_right_m_s": 0.8, "motion_exposure_s": 0.5}}


def spread(pair) -> tuple[float, float]:
    """Where the edge is in the left image, px, and the standard deviation of the light's spread over it."""
    profile = read_light(pair.image("left"), "left").radiance.mean(axis=(0, 2), dtype=np.float64)
    line = np.diff(profile) / (profile[-1] - profile[0])
    at = np.arange(1, len(profile))
    middle = float((line * at).sum())
    return middle, float(np.sqrt((line * (at - middle) ** 2).sum()))


def truths(pair) -> list[Array]:
    found = []
    for eye in EYES:
        truth = read_truth(pair.truth(eye), eye)
        found += [truth.depth, truth.normal, truth.instance, truth.semantic]
    return found


@pytest.fixture(scope="module")
def sharp(tmp_path_factory, registered):
    pair, _ = render(tmp_path_factory.mktemp("sharp"), EDGE)
    return pair, *spread(pair), truths(pair)


def check_truth(pair, sharp) -> None:
    """Blurred or not, the truth is the same to the last bit."""
    assert {f"{eye}_truth.exr" for eye in EYES} < set(pair.data["files"])
    for ours, theirs in zip(truths(pair), sharp[3], strict=True):
        assert np.array_equal(ours, theirs, equal_nan=True)
    assert "pinhole" in pair.data["blur"]["truth"]


def test_the_disc_of_confusion_is_that_of_the_thin_lens(tmp_path, sharp):
    assert sharp[0].data["blur"] is None
    assert sorted(sharp[0].data["files"]) == ["left.exr", "right.exr"]
    pair, _ = render(tmp_path, EDGE, FOCUS)
    middle, sigma = spread(pair)
    # A disc of even light spreads an edge by a quarter of its diameter; what a pixel itself spreads comes on top.
    diameter = 4 * np.sqrt(sigma**2 - sharp[2] ** 2)
    expected = 96 * 32 / 60 * 0.032 / 1.6 * (1 / 0.1 - 1 / 2)
    assert circle_of_confusion_px(2.0, pair.settings.rig, find_blur(pair.settings)) == pytest.approx(expected)
    assert diameter == pytest.approx(expected, rel=0.05)
    assert middle == pytest.approx(sharp[1], abs=0.2)
    check_truth(pair, sharp)
    assert pair.data["blur"]["f_number"] == pytest.approx(1.6)


@pytest.mark.parametrize(
    ("motion", "length"),
    [
        ({"speed_right_m_s": 0.8}, 96 * 32 / 60 * 0.8 * 0.5 / 2.0),
        ({"turn_right_deg_s": 20.0}, 96 * 32 / 60 * 2 * np.tan(np.radians(5.0))),
    ],
)
def test_motion_blur_is_as_long_as_the_way_of_a_point_and_about_the_instant_of_truth(tmp_path, sharp, motion, length):
    pair, _ = render(tmp_path, EDGE, MOTION, {"rig": {"speed_right_m_s": 0.0} | motion})
    middle, sigma = spread(pair)
    found = np.sqrt(12 * (sigma**2 - sharp[2] ** 2))  # of a line of even light
    assert motion_blur_px(0.0, 0.0, 2.0, pair.settings.rig, find_blur(pair.settings)) == pytest.approx(length, rel=1e-6)
    assert found == pytest.approx(length, abs=0.5)
    assert middle == pytest.approx(sharp[1], abs=0.2)
    check_truth(pair, sharp)


def plane_points(pair, depth: Array, eye: str, poses: str, margin: bool) -> Array:
    """World coordinates (H, W, 3) of what the pixels of an eye see, by the calibration in pair.json alone."""
    camera, pose = pair.camera, np.array(pair.data[poses][eye])
    v, u = (n + 0.5 for n in np.indices(depth.shape))
    if margin:
        u, v = u - camera.margin_x_px, v - camera.margin_y_px
    matrix = np.array(pair.data["eyes"][eye]["K"])
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(matrix).T
    return (rays * depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]


TEXTURED = {
    "terrain": {"rms_slope_deg": 0.0, "size_m": 40.0, "resolution": 41},
    "light": {"sun_elevation_deg": 60.0},
    "surface": {
        "grain_amplitude_m": 0.0,
        "specular": 0.0,
        "albedo": 0.9,
        "albedo_variation": 1.0,
        "albedo_patch_m": 0.05,
    },
    "rig": {"width_px": 360, "height_px": 240},
    "quality": {"samples": 12, "diffuse_bounces": 0},
    "sensor": {"shot_noise": False, "read_noise_e": 0.0},
}


@pytest.fixture(scope="module")
def toed(tmp_path_factory, registered):
    return render(
        tmp_path_factory.mktemp("toed"),
        TEXTURED,
        {
            "rig": {
                "toe_in_deg": 4.0,
                "overscan": 0.05,
                "distortion_k1": -0.05,
                "heading_deg": 30.0,
                "principal_x_px": 7.0,
            }
        },
    )[0]


@pytest.mark.long
def test_toed_in_eyes_see_where_their_poses_say(toed):
    left, right = (np.array(toed.data["poses_camera_to_world"][eye]) for eye in EYES)
    # Each is turned toward the other by 4 degrees, about its own vertical, the left one to the right.
    assert np.degrees(np.arccos(left[:3, 2] @ right[:3, 2])) == pytest.approx(8.0, abs=1e-4)
    assert left[:3, 2] @ np.array(toed.data["poses_rectified_to_world"]["left"])[:3, 0] == pytest.approx(
        np.sin(np.radians(4.0)), abs=1e-6
    )
    for eye in EYES:
        taken = read_truth(toed.truth_of_image(eye), eye).depth
        assert taken.shape == (240 + 2 * 12, 360 + 2 * 18)
        on_ground = plane_points(toed, taken, eye, "poses_camera_to_world", margin=True)
        # A thousandth of a pixel is some 0.01 mm here.
        assert np.nanmax(np.abs(on_ground[..., 2][taken < 4])) < 1e-4
        rectified = read_truth(toed.truth(eye), eye).depth
        on_ground = plane_points(toed, rectified, eye, "poses_rectified_to_world", margin=True)
        assert np.nanmax(np.abs(on_ground[..., 2][rectified < 4])) < 1e-4


@pytest.mark.long
def test_eyes_that_are_toed_in_by_six_degrees_count_in_the_averages(tmp_path):
    """What the one eye does not see is no surface that the other one sees through, and nothing that it shows."""
    pair, _ = render(tmp_path / "data", {"rig": {"toe_in_deg": 6.0}, "light": {"sun_elevation_deg": 2.0}})
    loaded = load_pair(pair.folder, {})
    unseen = np.isnan(loaded.depth["right"])
    assert 0.05 < unseen.mean() < 0.6  # 6 degrees of a field of view of 86
    assert loaded.check.contradictions < 1e-3
    assert (loaded.views["right"].semantic[unseen] == 255).all()
    assert (loaded.views["right"].instance[unseen] == 0).all()
    assert not loaded.visible["right"][unseen].any()
    report = evaluate([pair.folder], parse_methods("bm"), tmp_path / "out")
    assert not report["suspect"]
    assert report["summary"][0]["pairs"] == 1
    export([pair.folder], "png8", tmp_path / "png8")
    labels = cv2.imread(str(tmp_path / "png8" / pair.folder.name / "semantic_right.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(labels == 255, unseen)
    export([pair.folder], "kitti", tmp_path / "kitti")
    disparity = cv2.imread(str(tmp_path / "kitti/training/disp_occ_0/000000_10.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(disparity == 0, np.isnan(loaded.depth["left"]))


@pytest.mark.long
def test_rectified_toed_in_images_lie_on_the_truth_of_the_parallel_rig(toed):
    loaded = load_pair(toed.folder, {})
    assert loaded.check.ok
    assert abs(loaded.check.photometric_offset_px) < 0.05
    left, right = loaded.images.for_matchers()
    found, _, _ = match("sgbm", left, right, {})
    both = np.isfinite(found) & loaded.visible["left"]
    # What parallel eyes of the same rig see of the plane, worked out without Blender.
    rig, camera = toed.settings["rig"], toed.camera
    pitch = np.radians(rig["pitch_deg"])
    v = (np.arange(240) + 0.5 - camera.cy_px) / camera.focal_px
    expected = camera.disparity(rig["height_m"] / (np.sin(pitch) + v * np.cos(pitch)))[:, None]
    true = np.where(np.isfinite(loaded.depth["left"]), camera.disparity(loaded.depth["left"]), np.nan)
    assert np.nanmax(np.abs(true - expected)) < 0.05
    assert np.nanmax(np.abs(true - expected)) < 2e-3
    assert both.mean() > 0.5
    assert np.median(np.abs(found - expected)[both]) < 0.1
    assert abs(np.median((found - expected)[both])) < 0.05
    # What is said to be seen by both eyes is where both have an image.
    rows, columns = np.nonzero(loaded.visible["left"])
    there = np.clip(np.rint(columns - true[rows, columns]).astype(int), 0, camera.width_px - 1)
    assert np.isfinite(loaded.depth["right"][rows, there]).all()
    # An eye that is turned to the right does not see the left border of what a parallel one sees.
    assert not np.isfinite(loaded.depth["left"][:, :10]).any()
    assert np.isfinite(loaded.depth["left"][:, -10:]).any()


KEYS = ("M1", "D1", "M2", "D2", "R", "T", "E", "F", "R1", "R2", "P1", "P2", "Q")


@pytest.mark.long
def test_opencv_rectifies_the_raw_export_with_its_calibration(toed, tmp_path):
    for kind in ("raw", "png8"):
        assert export([toed.folder], kind, tmp_path / kind) == []
    folder = tmp_path / "raw" / toed.folder.name
    held = {}
    for name in ("intrinsics.yml", "extrinsics.yml"):
        storage = cv2.FileStorage(str(folder / name), cv2.FILE_STORAGE_READ)
        held |= {key: storage.getNode(key).mat() for key in KEYS if not storage.getNode(key).empty()}
    assert tuple(held) == KEYS
    size = (360, 240)
    turns = cv2.stereoRectify(held["M1"], held["D1"], held["M2"], held["D2"], size, held["R"], held["T"])[:2]
    for k, eye in enumerate(EYES, 1):
        # OpenCV, too, turns each eye by half of the angle between them.
        np.testing.assert_allclose(turns[k - 1], held[f"R{k}"], atol=1e-9)
        image = cv2.imread(str(folder / f"{eye}.png"), cv2.IMREAD_UNCHANGED)
        assert (image > 0).mean() > 0.999  # the overscan covers what the barrel sees
        maps = cv2.initUndistortRectifyMap(held[f"M{k}"], held[f"D{k}"], held[f"R{k}"], held[f"P{k}"], size, cv2.CV_32F)
        flat = cv2.remap(image, *maps, cv2.INTER_LINEAR)
        ours = cv2.imread(str(tmp_path / "png8" / toed.folder.name / f"{eye}.png"), cv2.IMREAD_UNCHANGED)
        inner = np.isfinite(load_pair(toed.folder, {}).depth[eye])
        assert np.percentile(np.abs(flat.astype(int) - ours)[inner], 99.9) <= 2
    said = json.loads((folder / "calibration.json").read_text())
    poses = said["poses_camera_to_world"]
    between = np.linalg.inv(poses["right"]) @ np.array(poses["left"])
    np.testing.assert_allclose(between[:3, :3], held["R"], atol=1e-6)
    np.testing.assert_allclose(between[:3, 3:], held["T"], atol=1e-6)
    # A pixel of the left sensor, by its depth, lands on its epipolar line in the right one.
    depth = np.load(folder / "depth_left.npy")
    for row, column in ((80, 300), (190, 220), (220, 345)):
        here = cv2.undistortPoints(np.array([[[column, row]]], float), held["M1"], held["D1"])[0, 0]
        there = held["R"] @ (np.array([*here, 1.0]) * depth[row, column]) + held["T"][:, 0]
        pixels = [held["M1"] @ [*here, 1.0], held["M2"] @ there / there[2]]
        line = held["F"] @ pixels[0]
        assert abs(pixels[1] @ line) / np.hypot(*line[:2]) < 1e-6
        # And it is the same point of the ground; the nearest rendered pixel is up to 0.7 px away, some 5 mm.
        pose = np.array(poses["left"])
        assert abs((pose[:3, :3] @ (np.array([*here, 1.0]) * depth[row, column]) + pose[:3, 3])[2]) < 0.01


def test_with_overscan_no_pixel_of_the_sensor_is_dark_and_truth_stays_what_it_was(tmp_path):
    barrel = {"rig": {"distortion_k1": -0.1, "distortion_k2": 0.01, "width_px": 180, "height_px": 120}}
    plain, _ = render(tmp_path / "plain", TEXTURED, barrel)
    needed = find_overscan(plain.settings.rig)
    assert 0.02 < needed < 0.2
    wide, _ = render(tmp_path / "wide", TEXTURED, barrel, {"rig": {"overscan": needed}})
    dark = {}
    for name, pair in (("plain", plain), ("wide", wide)):
        (folder,) = reexpose([pair.folder], tmp_path / f"{name} images", {})
        image = cv2.imread(str(folder / "left_distorted.png"), cv2.IMREAD_UNCHANGED)
        depth = np.load(folder / "left_distorted_depth.npy")
        dark[name] = (image == 0).mean(), np.isnan(depth).mean()
    assert dark["plain"][0] > 0.01 < dark["plain"][1]
    assert dark["wide"] == (0.0, 0.0)
    ours, theirs = load_pair(wide.folder, {}), load_pair(plain.folder, {})
    for eye in EYES:
        # The same rays, but for the last bit of their directions.
        np.testing.assert_allclose(ours.depth[eye], theirs.depth[eye], rtol=2e-5)
    assert abs(ours.check.photometric_offset_px) < 0.05
    assert ours.pair.camera.rendered_px > (180, 120)


@pytest.mark.long
@pytest.mark.parametrize(
    "rig",
    [
        *(
            pytest.param(rig, marks=pytest.mark.heavy)
            for rig in ({"toe_in_deg": 45.0, "overscan": 0.3}, {"focus_distance_m": 0.033}, {"speed_right_m_s": 1000.0})
        ),
        {
            "speed_forward_m_s": -1000.0,
            "turn_down_deg_s": 80.0,
            "roll_deg_s": -30.0,
            "toe_in_deg": 20.0,
            "focus_distance_m": 0.5,
        },
    ],
    ids=["toe-in", "focus", "speed", "all"],
)
def test_at_the_extremes_there_is_an_image_without_nan_and_the_truth_is_that_of_the_pinhole(tmp_path, rig):
    small = {"quality": {"samples": 2}, "rig": {"width_px": 48, "height_px": 36}, "sensor": {"f_number": 0.5}}
    pair, _ = render(tmp_path / "extreme", small, {"rig": {"motion_exposure_s": 1.0} | rig})
    plain, _ = render(tmp_path / "plain", small)
    for response in (
        {"exposure_s": 1e-6, "full_well_e": 1.0, "read_noise_e": 0.0},
        {"exposure_s": 1000.0},
        {"temperature_k": 0.0, "bits": 16},
        {"temperature_k": 500.0},
    ):
        loaded = load_pair(pair.folder, {"sensor": {"auto_exposure": False} | response})
        for eye in EYES:
            assert np.isfinite(loaded.views[eye].radiance).all()
            assert loaded.views[eye].radiance.min() >= 0
            image = getattr(loaded.images, eye)
            assert image.max() < 2**loaded.images.bits
    for eye in EYES:
        ours, theirs = (each.camera.cropped(read_truth(each.truth(eye), eye).depth) for each in (pair, plain))
        np.testing.assert_allclose(ours, theirs, rtol=2e-5 if rig.get("overscan") else 0)
    evaluate([pair.folder], parse_methods("bm"), tmp_path / "out")
    assert "NaN" not in (tmp_path / "out" / "report.json").read_text()


def test_panel_and_build_say_what_truth_is_of_and_the_panel_how_blurred_and_how_dark():
    size = {"rig": {"width_px": 640, "height_px": 480}}
    assert sidebar_text.list_camera_notes(complete(size)) == ()
    moving = complete(
        size,
        FOCUS,
        {"rig": {"focus_distance_m": 2.0, "speed_right_m_s": 1.0, "motion_exposure_s": 0.01, "distortion_k1": -0.1}},
    )
    lines = sidebar_text.list_camera_notes(moving)
    assert "truth is sharp" in " ".join(lines)
    # 2.23 m deep in the middle: 341.3 px x 0.032 m / 1.6 x (1/2 - 1/2.23) and 341.3 px x 0.01 m / 2.23 m.
    assert "Middle focus 0.352 px, motion 1.53 px" in lines
    assert lines[-1] == "Overscan 0.151 needed"
    enough = complete({"rig": {"distortion_k1": -0.1, "overscan": 0.4}})
    assert sidebar_text.list_camera_notes(enough)[-1] == "Overscan 0.141 needed, and set"
    assert (
        max(len(part) for line in lines for part in sidebar_text.wrap_lines(line, icon=True)) <= sidebar_text.LINE - 4
    )
    assert any("pinhole in the middle" in text for text in build_scene(empty_scene(), moving).warnings)
    unknown = complete({"rig": {"roll_deg_s": 1.0}})
    assert "Stereo Camera ▸ Exposure" in " ".join(sidebar_text.list_camera_notes(unknown))
    with pytest.raises(IcyMoonError, match="motion_exposure_s"):
        expand_headings(unknown)


def test_the_built_camera_is_the_same_after_a_render_and_nothing_is_left_behind(tmp_path):
    extreme = {
        "rig": {
            "toe_in_deg": 5.0,
            "overscan": 0.2,
            "focus_distance_m": 1.0,
            "roll_deg_s": 5.0,
            "motion_exposure_s": 0.1,
        },
        "quality": {"samples": 1},
    }
    _, built = render(tmp_path, extreme)
    assert not built.edited
    check_camera(built)
    assert len(bpy.data.cameras) == len([o for o in bpy.data.objects if o.type == "CAMERA"]) == 1
    assert not bpy.data.actions
    counter = SampleCounter(4, truths=2)
    shown = [counter.read(f"Sample {k}/{n}") for n in (4, 4, 1, 1, 1, 1) for k in range(n + 1)]
    assert [f for f in shown if f is not None][-1] == 1.0


@pytest.mark.long
def test_an_image_that_is_larger_than_blender_renders_is_refused(tmp_path):
    settings = complete({"rig": {"width_px": 16384, "height_px": 4, "overscan": 2.0}})
    built = build_scene(empty_scene(), settings)
    with pytest.raises(IcyMoonError, match=r"rig\.overscan"):
        render_pairs(built, expand_headings(settings), tmp_path, 1, 0.0, lambda *a, **k: None)
    assert not list(tmp_path.glob("pairs/*"))
