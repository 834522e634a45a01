"""Visibility against the analytic scene."""

import dataclasses

import numpy as np
import pairs
import pytest
from icymoon.stereo.images.disparity_and_occlusion import find_scene_depth, find_visible_in_left, find_visible_in_right
from icymoon.stereo.images.exr import read_view

pytestmark = pytest.mark.filterwarnings("error")

RIG = pairs.camera()


def depths(scene, rig=RIG):
    return pairs.view(scene, rig, "left")[0], pairs.view(scene, rig, "right")[0]


def hidden_behind_rock(scene, depth):
    """Whether the right eye's ray to each left pixel's point passes the rock: exact, no images."""
    columns, rows = np.arange(RIG.width_px) + 0.5, np.arange(RIG.height_px) + 0.5
    x, y = np.meshgrid((columns - RIG.cx_px) / RIG.focal_px, (rows - RIG.cy_px) / RIG.focal_px)
    near = 0.75 * scene.distance_m
    right_x = (x * depth - RIG.baseline_m) / depth
    return (np.abs(right_x * near + RIG.baseline_m) < 0.25) & (np.abs(y * near) < 0.25) & (depth > near * 1.0001)


def test_visibility_is_that_of_the_rays():
    scene = pairs.Scene()
    left, right = depths(scene)
    column = np.arange(RIG.width_px) - RIG.disparity(left)
    expected = (column >= -0.5) & ~hidden_behind_rock(scene, left)
    wrong = find_visible_in_right(left, right, RIG) != expected
    assert (~expected).sum() > 1000
    assert wrong.sum(axis=1).max() <= 2  # the two edges of the rock fall between pixels


@pytest.mark.parametrize("slope", [0.0, 2.0, -2.0, 4.0])  # at 4 disparity grows by 2 px per column of the right image
def test_a_plane_hides_nothing_of_itself_however_steep(slope):
    scene = pairs.Scene(slope_x=slope, slope_y=0.0, rock=False, distance_m=1.5)
    left, right = (np.where((d > 0.05) & (d < 50), d, np.nan) for d in depths(scene))
    column = np.arange(RIG.width_px) - RIG.disparity(left)
    inside = np.nan_to_num(column, nan=-9) >= -0.5
    assert inside.sum() > 3000
    np.testing.assert_array_equal(find_visible_in_right(left, right, RIG), inside)


def test_sky_is_not_visible_and_hides_nothing():
    left, right = depths(pairs.Scene(rock=False, sky_rows=20))
    visible = find_visible_in_right(left, right, RIG)
    assert not visible[:20].any()
    assert visible[20:, 60:].all()
    assert find_visible_in_right(left, np.full_like(right, np.nan), RIG)[20:, 60:].all()
    assert not find_visible_in_right(np.full_like(left, np.nan), right, RIG).any()


def test_occlusion_of_the_right_eye_is_that_of_the_mirrored_scene():
    """Seen in a mirror, the right eye is a left eye."""
    left, right = depths(pairs.Scene(slope_x=0.2))
    visible = find_visible_in_left(left, right, RIG)
    np.testing.assert_array_equal(visible, find_visible_in_right(right[:, ::-1], left[:, ::-1], RIG)[:, ::-1])
    assert (~visible).sum() > 1000
    assert not visible[:, -15:].any()  # the right eye's right edge is beyond the left image


def test_what_both_eyes_see_is_as_many_pixels_in_either():
    """On a fronto-parallel scene a pixel of one eye is a pixel of the other."""
    scene = pairs.Scene(slope_x=0.0, slope_y=0.0, rock=False)
    left, right = depths(scene)
    assert find_visible_in_right(left, right, RIG).sum() == find_visible_in_left(left, right, RIG).sum()


def test_the_planet_is_sky(tmp_path):
    view = read_view(pairs.write_pair(tmp_path / "pair") / "left.exr")
    semantic = np.zeros_like(view.semantic)
    semantic[:5] = 4
    depth = find_scene_depth(dataclasses.replace(view, semantic=semantic))
    assert np.isnan(depth[:5]).all()
    assert np.isfinite(depth[5:]).all()
