"""Wide eyes rendered by Cycles' fisheye camera: edges of rocks are where rays have them, and no pixel is dark."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from heads import head_settings
from icymoon.physics.camera.eyes import camera_of
from icymoon.rays.stereo_truth import CalibratedEye, trace_eyes
from icymoon.render import ray_truth
from icymoon.render.pairs.pair_folder import EYES, read_pair
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.render.scene_source import ScenesFromSettings
from icymoon.render.worker import render_from
from icymoon.settings.description import merged
from icymoon.settings.pair_ids import make_pair_id
from icymoon.stereo.images.lens import make_lens
from icymoon.stereo.images.views import read_eye, read_sensor_truth
from icymoon.support.labels import SEMANTIC_NAMES

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
    assert pair.camera.panorama == camera_of(settings).panorama is not None
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
