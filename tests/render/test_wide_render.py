"""Wide eyes rendered by Cycles' fisheye camera: edges of rocks are where rays have them, and no pixel is dark."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from heads import head_settings
from icymoon.nodes.build_scene import build_scene
from icymoon.physics.camera.blur import find_blur, find_pose_after
from icymoon.physics.camera.eyes import make_camera_with_eyes
from icymoon.rays.stereo_truth import CalibratedEye, trace_eyes
from icymoon.render import ray_truth
from icymoon.render.pairs.pair_folder import EYES, read_pair
from icymoon.render.plans.planned_pair import PlannedPair, expand_headings
from icymoon.render.scene_source import ScenesFromSettings
from icymoon.render.worker import render_from, render_pairs
from icymoon.settings.description import merged
from icymoon.settings.pair_ids import make_pair_id
from icymoon.stereo.images.lens import make_lens
from icymoon.stereo.images.views import read_eye, read_sensor_truth
from icymoon.support.labels import SEMANTIC_NAMES
from rendering import add_shining_ball, empty_scene

#: Rocks that shine on black ground, so that an image is the share of each pixel that rocks cover.
SHINING: dict[str, dict[str, object]] = {
    "terrain": {"size_m": 10.0, "resolution": 17, "rms_slope_deg": 0.0},
    "mesh": {"kind": "GRID"},
    "quality": {"samples": 256, "noise_threshold": 0.0, "threads": 2, "diffuse_bounces": 0},
    "surface": {"model": "LAMBERT", "grain_amplitude_m": 0.0, "albedo": 0.0},
    "rock_surface": {"model": "LAMBERT", "grain_amplitude_m": 0.0, "albedo": 0.0, "emitted_w_m2_sr": 1.0},
    "rocks": {"own_surface": True, "coverage": 0.1, "smallest_m": 0.4},
    "light": {"sun_irradiance_wm2": 0.0, "planet": False},
}
ROCK = next(number for number, name in SEMANTIC_NAMES.items() if name == "rock")
#: Subpixels along a side of a pixel, by whose rays its covered share is known to 1 / 16 px at a straight edge.
FINE = 8


@pytest.fixture
def covered(monkeypatch):
    """The share of each pixel that rocks cover, by eye, from the scene as its truth is traced."""
    found = {}
    trace = ray_truth.trace_truth

    def keep(stage, asked, camera, poses, clip_m, *more):
        if asked[1] == "SENSORS":
            found.update(covered_shares(stage, camera, poses, clip_m))
        return trace(stage, asked, camera, poses, clip_m, *more)

    monkeypatch.setattr(ray_truth, "trace_truth", keep)
    return found


def finer(own):
    """The same camera with ``FINE`` subpixels along each side of a pixel."""
    beside = (FINE - 1) / 2
    return replace(
        own, width_px=FINE * own.width_px, height_px=FINE * own.height_px, fx_px=FINE * own.fx_px,
        fy_px=FINE * own.fy_px, cx_px=FINE * own.cx_px + beside, cy_px=FINE * own.cy_px + beside,
    )  # fmt: skip


def covered_shares(stage, camera, poses, clip_m):
    eyes = {
        eye: CalibratedEye(finer(own), camera.focal_px, poses[eye][:3, :3], poses[eye][:3, 3])
        for eye, own in zip(EYES, camera.eyes, strict=True)
    }
    found = trace_eyes(stage, eyes, camera.baseline_m, *clip_m)
    return {
        eye: (truth.label == ROCK).reshape(truth.label.shape[0] // FINE, FINE, -1, FINE).mean(axis=(1, 3))
        for eye, truth in found.items()
    }


def edge_offsets(seen, covered, reach=3):
    """By how many px along rows each edge of ``seen`` is off that of ``covered``, for edges between ``reach`` pixels
    that are free of rock and as many that are full of it."""
    window = 2 * reach + 1
    found, true = (np.lib.stride_tricks.sliding_window_view(image, window, axis=1) for image in (seen, covered))
    free, full = ((true == value) for value in (0.0, 1.0))
    is_edge = [
        first[..., :reach].all(axis=-1) & last[..., -reach:].all(axis=-1)
        for first, last in ((free, full), (full, free))
    ]
    return (found - true).sum(axis=-1)[is_edge[0] | is_edge[1]]


@pytest.mark.long
def test_edges_of_rocks_through_a_fisheye_are_where_rays_have_them(tmp_path, covered):
    settings = merged(head_settings("180 degrees", pitch_deg=55.0, height_m=1.5), SHINING)
    planned = PlannedPair(make_pair_id(settings), settings, 0.0)
    with ScenesFromSettings(lambda warning: None) as source:
        render_from(source, [planned], tmp_path, lambda kind, **facts: None)
    pair = read_pair(planned.folder(tmp_path))
    assert pair.camera.panorama == make_camera_with_eyes(settings).panorama is not None
    for eye, own in zip(EYES, pair.camera.eyes, strict=True):
        stated = pair.data["eyes"][eye]
        assert stated["rendered_as"] == "FISHEYE"
        assert stated["fisheye"]["px_per_rad"] >= own.fx_px
        light, view = read_eye(pair, eye)
        assert light.radiance.shape[:2] == pair.camera.light_px[::-1]
        seen = make_lens(pair.camera, pair.settings.rig, eye).distort(light.radiance[..., 0])
        truth, shares = read_sensor_truth(pair, eye), covered[eye]
        assert ((truth.semantic == ROCK) != (shares > 0.5)).mean() < 0.05
        for image, share in ((seen, shares), (seen.T, shares.T)):
            offsets = edge_offsets(image, share)
            assert len(offsets) > 10
            assert np.abs(offsets).max() < 0.25
            assert abs(offsets.mean()) < 0.03
        # The ground and the sky are black here, and rocks are seen to the border of the circle.
        assert np.abs(seen[shares == 1.0] - 1.0).max() < 0.5
        assert view.radiance.shape[:2] == (settings.rig.height_px, settings.rig.width_px)


#: A ball that shines, 72 degrees off the axis of a rig that looks 20 degrees down, and its radius, in metres.
BALL, RADIUS = np.array([1.2, 0.35, 0.8]), 0.1
BLACK: dict[str, dict[str, object]] = {
    **{topic: SHINING[topic] for topic in ("terrain", "mesh", "surface", "light")},
    "quality": {"samples": 64, "noise_threshold": 0.0, "threads": 2, "diffuse_bounces": 0},
    "rocks": {"coverage": 0.0},
    "dataset": {"headings": 1},
}


def spot(folder, **more):
    """The mean column and row of the ball's light in the left eye's fisheye image, their variances in px², and its
    settings, camera and place in the eye's axes."""
    settings = merged(head_settings("180 degrees", pitch_deg=20.0, height_m=1.0), BLACK, more)
    built = build_scene(empty_scene(), settings)
    add_shining_ball(built, BALL, RADIUS, 1e4)
    (path,) = render_pairs(built, expand_headings(settings), folder, 1, 0.0, lambda *a, **k: None)
    pair = read_pair(path)
    level = read_eye(pair, "left")[0].radiance.mean(axis=-1)
    level = np.where(level > 5.0, level, 0.0)  # what the ball lights of the ground
    rows, columns = np.mgrid[: level.shape[0], : level.shape[1]]
    at = np.stack([columns, rows], axis=-1)
    mean = (level[..., None] * at).sum(axis=(0, 1)) / level.sum()
    variance = (level[..., None] * (at - mean) ** 2).sum(axis=(0, 1)) / level.sum()
    eye = np.array(pair.data["poses_rectified_to_world"]["left"])
    return mean, variance, settings, pair.camera, (BALL - eye[:3, 3]) @ eye[:3, :3]


@pytest.mark.long
def test_a_fisheye_image_is_blurred_by_motion_and_by_focus_along_rays(tmp_path):
    """Motion adds the variance of the path of the ball's centre. Focus adds a quarter of the squared radius of the
    disc of a thin lens that faces the ray, at the distance along the ray; the planar distance is the one in focus."""
    mean, sharp, _, camera, place = spot(tmp_path / "sharp")
    np.testing.assert_allclose(mean, camera.panorama.show(place), atol=0.2)

    motion = {"speed_right_m_s": 1.0, "speed_down_m_s": 1.5, "turn_right_deg_s": 30.0, "motion_exposure_s": 0.2}
    mean, moved, settings, camera, place = spot(tmp_path / "moves", rig=motion)
    blur = find_blur(settings)
    poses = [find_pose_after(blur, seconds) for seconds in np.linspace(-0.1, 0.1, 101)]
    places = np.array([(place - pose[:3, 3]) @ pose[:3, :3] for pose in poses])
    path, away = camera.panorama.show(places), np.linalg.norm(places, axis=1)
    aside = np.arccos(places[:, 2] / away)
    # Pixels that the ball covers: its solid angle, stretched around the axis.
    weights = aside / np.sin(aside) / away**2
    np.testing.assert_allclose(mean, np.average(path, axis=0, weights=weights), atol=0.2)
    spread = np.average((path - np.average(path, axis=0, weights=weights)) ** 2, axis=0, weights=weights)
    np.testing.assert_allclose(moved - sharp, spread, rtol=0.1)

    focus = {"rig": {"focus_distance_m": float(place[2])}, "sensor": {"f_number": 0.5, "auto_exposure": False}}
    mean, blurred, settings, camera, _ = spot(tmp_path / "focus", **focus)
    aperture_m = 1e-3 * settings.rig.focal_length_mm / 0.5
    disc_px = camera.panorama.px_per_rad * aperture_m * (1 / place[2] - 1 / np.linalg.norm(place))
    # The ball is beside the axis along rows, so columns are radial.
    assert blurred[0] - sharp[0] == pytest.approx((disc_px / 2) ** 2 / 4, rel=0.15)
