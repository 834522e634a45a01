"""The truth in a pair, against geometry that is known without Blender."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from icymoon.render.pairs.pair_folder import find_changed_files
from icymoon.stereo.images.disparity_and_occlusion import find_visible_in_right
from icymoon.stereo.images.exr import read_view
from icymoon.stereo.matchers import match
from icymoon.support.arrays import Array
from icymoon.support.labels import FIRST_ROCK_INSTANCE, ROCK, TERRAIN, TERRAIN_INSTANCE
from rendering import render

FLAT = {"rms_slope_deg": 0.0}
PLAIN = {"grain_amplitude_m": 0.0, "albedo_variation": 0.0, "specular": 0.0}


def plane_depth(pair) -> Array:
    """Planar depth in metres of the plane z = 0 at every pixel centre, from the rig's settings alone."""
    rig, camera = pair.settings["rig"], pair.camera
    v = (np.arange(camera.height_px) + 0.5 - camera.cy_px) / camera.focal_px
    pitch = math.radians(rig["pitch_deg"])
    # A ray (u, v, 1) falls by sin(pitch) + v cos(pitch) per unit of planar depth.
    fall = math.sin(pitch) + v * math.cos(pitch)
    with np.errstate(divide="ignore"):
        depth = np.where(fall > 0, rig["height_m"] / fall, np.nan)
    return np.repeat(depth[:, None], camera.width_px, axis=1)


@pytest.mark.parametrize(("pitch", "right_px", "down_px"), [(45.84, 0.0, 0.0), (90.0, 12.5, -7.25), (36.0, 0.0, -20.0)])
def test_depth_of_a_plane_is_exact_in_both_eyes(tmp_path, pitch, right_px, down_px):
    pair, _ = render(
        tmp_path,
        {
            "terrain": {**FLAT, "size_m": 200.0, "resolution": 201},
            "surface": PLAIN,
            "rig": {
                "pitch_deg": pitch,
                "width_px": 160,
                "height_px": 120,
                "principal_x_px": right_px,
                "principal_y_px": down_px,
            },
        },
    )
    expected = plane_depth(pair)
    seen = expected < 60
    assert seen.mean() > 0.9
    for eye in ("left", "right"):
        depth = read_view(pair.image(eye)).depth
        # The bound that the project is held to; float32 intersection leaves about 1e-5.
        assert np.nanmax(np.abs(depth / expected - 1)[seen]) < 1e-4


def test_sky_has_no_depth_and_no_label(tmp_path):
    pair, _ = render(tmp_path, {"terrain": FLAT, "surface": PLAIN, "rig": {"pitch_deg": 0.0}})
    view = read_view(pair.image("left"))
    sky = np.isnan(view.depth)
    assert 0.4 < sky.mean() < 0.7
    assert np.all(view.semantic[sky] == 0)
    ground_near = np.array([np.roll(~sky, shift, axis=0) for shift in (-2, -1, 1, 2)]).any(axis=0)
    assert np.all(view.radiance[sky & ~ground_near] == 0)  # but for the pixel filter's reach
    assert np.all(view.semantic[~sky] == TERRAIN)
    assert np.all(view.instance[~sky] == TERRAIN_INSTANCE)


def test_radiance_of_a_lambert_plane_is_the_irradiance_over_pi(tmp_path):
    for elevation in (90.0, 30.0):
        pair, _ = render(
            tmp_path,
            {
                "terrain": FLAT,
                "surface": {**PLAIN, "albedo": 0.5},
                "quality": {"samples": 4},
                "light": {"sun_irradiance_wm2": 14.82, "sun_elevation_deg": elevation, "sun_angular_diameter_deg": 0.0},
            },
        )
        expected = 14.82 * math.sin(math.radians(elevation)) * 0.5 / math.pi
        radiance = read_view(pair.image("left")).radiance[40:]
        # A plane has no interreflection and the lamp no extent: nothing is left to chance.
        assert radiance.mean() == pytest.approx(expected, rel=1e-3)
        assert radiance.std() / radiance.mean() < 1e-3


@pytest.mark.long
def test_true_disparity_is_what_a_matcher_finds_and_the_right_image_warps_onto_the_left(tmp_path):
    pair, _ = render(
        tmp_path,
        {
            "terrain": FLAT,
            "quality": {"samples": 16},
            "surface": {**PLAIN, "albedo": 0.9, "albedo_variation": 1.0, "albedo_patch_m": 0.05},
            "light": {"sun_elevation_deg": 60.0},
            "rig": {"width_px": 640, "height_px": 480},
        },
    )
    left, right = (read_view(pair.image(eye)) for eye in ("left", "right"))
    disparity = pair.camera.disparity(left.depth)
    grey, other = (np.clip(v.radiance.mean(axis=2) / 4.0 * 255, 0, 255).astype(np.uint8) for v in (left, right))
    found, valid, _ = match("sgbm", grey, other, {})
    visible = find_visible_in_right(left.depth, right.depth, pair.camera)
    both = valid & visible
    assert both.mean() > 0.5
    error = found[both] - disparity[both]
    assert np.median(np.abs(error)) < 0.05
    assert abs(np.median(error)) < 0.05
    # Warp: sample the right image where the truth says the left pixel lies, linearly between columns.
    rows, columns = np.nonzero(visible)
    at = columns - disparity[visible]
    whole = np.floor(at).astype(int)
    whole = np.clip(whole, 0, pair.camera.width_px - 2)
    part = at - whole
    image = right.radiance.mean(axis=2)
    warped = image[rows, whole] * (1 - part) + image[rows, whole + 1] * part
    truth = left.radiance.mean(axis=2)[visible]
    shifted = np.roll(image, 3, axis=1)
    wrong = shifted[rows, whole] * (1 - part) + shifted[rows, whole + 1] * part
    agreement = np.median(np.abs(warped - truth) / truth)
    # Sampling noise and interpolation leave a few per cent; three columns off must be plainly worse.
    assert agreement < 0.05
    assert agreement < 0.5 * np.median(np.abs(wrong - truth) / truth)


def test_labels_and_normals_are_of_single_facets(tmp_path):
    pair, built = render(
        tmp_path,
        {"rocks": {"coverage": 0.2, "smallest_m": 0.2}, "quality": {"samples": 8}, "terrain": {"rms_slope_deg": 20.0}},
    )
    view = read_view(pair.image("left"))
    assert set(np.unique(view.semantic)) <= {0, TERRAIN, ROCK}
    assert {TERRAIN, ROCK} <= set(np.unique(view.semantic))
    blocks = FIRST_ROCK_INSTANCE + np.arange(built.rock_count)
    assert set(np.unique(view.instance)) <= {0, TERRAIN_INSTANCE, *blocks.tolist()}
    assert np.array_equal(view.semantic == ROCK, view.instance >= FIRST_ROCK_INSTANCE)
    lengths = np.linalg.norm(view.normal[view.semantic > 0], axis=1)
    assert np.abs(lengths - 1).max() < 5e-4  # rounded; an average over samples would be shorter at edges


def test_the_geometric_normal_ignores_bump(tmp_path):
    pair, _ = render(tmp_path, {"terrain": FLAT, "surface": {"grain_amplitude_m": 0.05}})
    view = read_view(pair.image("left"))
    ground = ~np.isnan(view.depth)
    assert np.abs(view.normal[ground] - [0, 0, 1]).max() < 1e-5
    assert view.radiance[ground].std() > 0.02  # the bump is there


def test_poses_and_checksums_describe_the_images(tmp_path):
    pair, built = render(
        tmp_path, {"rig": {"heading_deg": 30.0, "x_m": 1.0, "y_m": -2.0, "principal_x_px": 9.5, "principal_y_px": -4.0}}
    )
    assert find_changed_files(pair) == []
    left, right = (np.array(pair.data["poses_camera_to_world"][eye]) for eye in ("left", "right"))
    assert np.allclose(left[:3, :3] @ left[:3, :3].T, np.eye(3), atol=1e-6)
    assert np.allclose((right - left)[:3, 3], 0.25 * left[:3, 0], atol=1e-7)
    assert np.allclose(
        left[:3, 2] @ [math.sin(math.radians(30)), math.cos(math.radians(30)), 0],
        math.cos(math.radians(45.84)),
        atol=1e-5,
    )
    # A known point: the pixel's depth along the pose must land on the mesh's surface.
    view = read_view(pair.image("left"))
    v, u = 50, 40
    camera = pair.camera
    ray = np.array([(u + 0.5 - camera.cx_px) / camera.focal_px, (v + 0.5 - camera.cy_px) / camera.focal_px, 1.0])
    point = left[:3, 3] + left[:3, :3] @ ray * view.depth[v, u]
    hit, place, _, _ = built.terrain.closest_point_on_mesh(point.tolist())
    assert hit
    assert np.linalg.norm(np.array(place) - point) < 1e-4
    assert json.loads((pair.folder / "pair.json").read_text())["camera"]["focal_baseline_px_m"] == pytest.approx(
        96 * 32 / 60 * 0.25
    )
    pair.image("left").write_bytes(b"x")
    assert find_changed_files(pair) == ["left.exr"]


def test_rendering_is_no_edit_of_the_camera(tmp_path):
    """Three headings from a pose whose matrix does not come apart into the numbers it was made of."""
    pair, built = render(tmp_path, {"rig": {"pitch_deg": -50.0, "heading_deg": 90.0}, "dataset": {"headings": 3}})
    assert not built.edited
    assert not pair.data["edited_by_hand"]
