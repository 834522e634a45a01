"""A rolling shutter: each row of image and truth is where the pose at its own time says."""

from __future__ import annotations

import json

import numpy as np
import pytest
from icymoon.nodes.build_scene import build_scene
from icymoon.render.pairs.pair_folder import EYES
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.stereo.decisions.dem import back_project_depth
from icymoon.stereo.images.disparity_and_occlusion import find_scene_depth
from icymoon.stereo.images.exr import read_depth, read_light
from icymoon.stereo.measure.prepare_pair import load_pair
from rendering import complete, empty_scene, render

WIDTH, HEIGHT, FOCAL_PX, DEPTH_M = 64, 48, 64 * 32 / 60, 2.0
#: A plane two metres below the camera that ends at its left eye: an edge down the middle of the image.
EDGE = {
    "terrain": {"rms_slope_deg": 0.0, "size_m": 8.0, "resolution": 5},
    "surface": {"grain_amplitude_m": 0.0, "albedo_variation": 0.0, "specular": 0.0},
    "light": {"sun_elevation_deg": 90.0, "sun_angular_diameter_deg": 0.0},
    "rig": {"pitch_deg": 90.0, "height_m": 2.0, "x_m": 4.0, "width_px": WIDTH, "height_px": HEIGHT},
    "quality": {"samples": 64, "diffuse_bounces": 0},
}
ROLLING = {"rig": {"motion_exposure_s": 1e-4, "readout_s": 0.5}}


def find_edges(pair, eye: str) -> np.ndarray:
    """The column of the edge in each row of the rendered image, px, from the light left of it."""
    light = read_light(pair.image(eye), eye).radiance.mean(axis=2, dtype=np.float64)
    share = pair.camera.cropped(light / np.median(light[light > 0.5 * light.max()]))
    lit = share.sum(axis=1)
    return lit if share[:, 0].mean() > 0.5 else WIDTH - lit


def expect_edges(pair, eye: str) -> np.ndarray:
    """The same from the pose of each row, by ``pair.json`` alone: where the line x = 4 m, z = 0 is in the row."""
    blur, rows = pair.data["blur"], pair.camera.height_px
    pose = np.array(pair.data["poses_rectified_to_world"]["left"])
    columns = []
    for row in range(rows):
        time = blur["readout_s"] * (row / (rows - 1) - 0.5)
        turn = np.radians(blur["turn_deg_s"]) * time
        move = np.eye(4)
        angle = np.linalg.norm(turn)
        if angle:
            x, y, z = turn / angle
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            move[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        move[:3, 3] = np.array(blur["velocity_m_s"]) * time
        beside = np.eye(4)
        beside[0, 3] = pair.camera.baseline_m if eye == "right" else 0.0
        seen = np.linalg.inv(pose @ move @ beside)
        # The line through the edge, and the point of it that projects into the middle of the row.
        here, along = seen @ [4.0, 0.0, 0.0, 1.0], seen @ [0.0, 1.0, 0.0, 0.0]
        slope = (row + 0.5 - pair.camera.cy_px) / pair.camera.focal_px
        far = (slope * here[2] - here[1]) / (along[1] - slope * along[2])
        point = here + far * along
        columns.append(pair.camera.cx_px + pair.camera.focal_px * point[0] / point[2])
    return np.array(columns)


@pytest.mark.parametrize(
    "motion",
    [
        {"speed_right_m_s": 0.8},
        pytest.param({"speed_right_m_s": 0.8, "motion_exposure_s": 0.3, "readout_s": 0.2}, marks=pytest.mark.long),
        {"turn_right_deg_s": 20.0, "roll_deg_s": -30.0, "speed_down_m_s": 0.5, "overscan": 0.1, "roll_deg": 180.0},
    ],
    ids=["speed", "long exposure", "turn upside down with margins"],
)
def test_each_row_of_image_and_truth_is_where_the_pose_of_the_row_says(tmp_path, motion):
    """64 samples of a pixel, or of the pixels that an exposure blurs, find an edge within 0.06 to 0.12 px (one standard
    deviation); the mean of 48 rows within 0.02 px. Half the time of a row is 0.03 to 0.07 px."""
    pair, built = render(tmp_path, EDGE, ROLLING, {"rig": motion})
    assert not built.edited
    noise = 0.12 if "motion_exposure_s" in motion else 0.06
    for eye in EYES:
        expected = expect_edges(pair, eye)
        off = find_edges(pair, eye) - expected
        assert np.abs(off).max() < 5 * noise
        assert abs(off.mean()) < 4 * noise / np.sqrt(HEIGHT)
        lean = np.polyfit(np.linspace(-0.5, 0.5, HEIGHT), off, 1)[0]
        assert abs(lean) < 4 * noise * np.sqrt(12 / HEIGHT)
        # Truth is at the centres of pixels, and exact: the edge is between the last pixel of ground and the next.
        depth = pair.camera.cropped(find_scene_depth(read_depth(pair.truth(eye), eye)))
        ground = np.isfinite(depth)
        columns = np.arange(WIDTH) + 0.5
        ahead = columns < expected[:, None] if ground[:, 0].all() else columns > expected[:, None]
        np.testing.assert_array_equal(ground, ahead)
    if motion == {"speed_right_m_s": 0.8}:  # the law of a vertical edge: speed times readout times f / Z
        assert np.ptp(expected) == pytest.approx(0.8 * 0.5 * FOCAL_PX / DEPTH_M, rel=1e-5)


def test_truth_lies_on_the_ground_by_the_poses_of_rows_and_equals_itself_in_both_eyes(tmp_path):
    """A plane seen at a slant by a rig that moves and turns. In single precision depth is within 1e-6 of itself."""
    moving = {
        "rig": {"pitch_deg": 55.0, "x_m": 0.0, "speed_forward_m_s": 0.6, "turn_down_deg_s": 12.0, "roll_deg_s": 25.0},
        "terrain": {"size_m": 400.0},
        "quality": {"samples": 1},
    }
    pair, _ = render(tmp_path, EDGE, ROLLING, moving)
    columns = np.arange(WIDTH) + 0.5
    disparity = {}
    for eye in EYES:
        depth = find_scene_depth(read_depth(pair.truth(eye), eye))
        points, _ = back_project_depth(depth, pair.camera, pair.row_poses(eye))
        assert len(points) == WIDTH * HEIGHT
        assert np.abs(points[:, 2] / depth.ravel()).max() < 2e-6
        still, _ = back_project_depth(depth, pair.camera, pair.rectified_pose(eye))
        assert np.abs(still[:, 2]).max() > 0.1
        disparity[eye] = pair.camera.disparity(depth)
    for left, right in zip(disparity["left"], disparity["right"], strict=True):
        at = columns - left
        inner = at >= 0.5
        assert np.abs(np.interp(at, columns, right) - left)[inner].max() < 1e-4  # linear in a row of a plane
    loaded = load_pair(pair.folder, {})
    assert loaded.check.contradictions == 0
    assert json.loads((pair.folder / "pair.json").read_text())["blur"]["truth"].endswith(
        "in the middle of each row's exposure."
    )


def test_a_render_without_readout_is_the_same_to_the_last_bit(tmp_path):
    """Also after one with a rolling shutter, which leaves nothing behind in the scene of the render."""
    quick = {"quality": {"samples": 2}, "rig": {"speed_right_m_s": 0.8, "readout_s": 0.0}}
    before, _ = render(tmp_path / "before", EDGE, ROLLING, quick)
    settings = [complete(EDGE, ROLLING, quick, {"rig": {"readout_s": readout}}) for readout in (0.5, 0.0)]
    built = build_scene(empty_scene(), settings[0])
    pairs = [pair for each in settings for pair in expand_headings(each)]
    assert pairs[1].id == before.id != pairs[0].id
    render_pairs(built, pairs, tmp_path / "after", 1, 0.0, lambda *a, **k: None)
    for eye in EYES:
        after = read_light(pairs[1].folder(tmp_path / "after") / f"{eye}.exr", eye).radiance
        np.testing.assert_array_equal(after, read_light(before.image(eye), eye).radiance)
