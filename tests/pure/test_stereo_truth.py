"""Visibility, the check that both eyes agree, and development, against the analytic scene."""

import dataclasses

import numpy as np
import pairs
import pytest
from icymoon.stereo.exr import read_view
from icymoon.stereo.selfcheck import photometric_disagreement, self_check
from icymoon.stereo.truth import scene_depth, visible_in_left, visible_in_right

pytestmark = pytest.mark.filterwarnings("error")

RIG = pairs.camera()


def depths(scene, rig=RIG):
    return pairs.view(scene, rig, "left")[0], pairs.view(scene, rig, "right")[0]


def hidden_behind_block(scene, depth):
    """Whether the right eye's ray to each left pixel's point passes the block: exact, no images."""
    columns, rows = np.arange(RIG.width_px) + 0.5, np.arange(RIG.height_px) + 0.5
    x, y = np.meshgrid((columns - RIG.cx_px) / RIG.focal_px, (rows - RIG.cy_px) / RIG.focal_px)
    near = 0.75 * scene.distance_m
    right_x = (x * depth - RIG.baseline_m) / depth
    return (np.abs(right_x * near + RIG.baseline_m) < 0.25) & (np.abs(y * near) < 0.25) & (depth > near * 1.0001)


def test_visibility_is_that_of_the_rays():
    scene = pairs.Scene()
    left, right = depths(scene)
    column = np.arange(RIG.width_px) - RIG.disparity(left)
    expected = (column >= -0.5) & ~hidden_behind_block(scene, left)
    wrong = visible_in_right(left, right, RIG) != expected
    assert (~expected).sum() > 1000
    assert wrong.sum(axis=1).max() <= 2  # the block's two edges fall between pixels


@pytest.mark.parametrize("slope", [0.0, 2.0, -2.0, 4.0])  # at 4 disparity grows by 2 px per column of the right image
def test_a_plane_hides_nothing_of_itself_however_steep(slope):
    scene = pairs.Scene(slope_x=slope, slope_y=0.0, block=False, distance_m=1.5)
    left, right = (np.where((d > 0.05) & (d < 50), d, np.nan) for d in depths(scene))
    column = np.arange(RIG.width_px) - RIG.disparity(left)
    inside = np.nan_to_num(column, nan=-9) >= -0.5
    assert inside.sum() > 3000
    np.testing.assert_array_equal(visible_in_right(left, right, RIG), inside)


def test_sky_is_not_visible_and_hides_nothing():
    left, right = depths(pairs.Scene(block=False, sky_rows=20))
    visible = visible_in_right(left, right, RIG)
    assert not visible[:20].any()
    assert visible[20:, 60:].all()
    assert visible_in_right(left, np.full_like(right, np.nan), RIG)[20:, 60:].all()
    assert not visible_in_right(np.full_like(left, np.nan), right, RIG).any()


def test_occlusion_of_the_right_eye_is_that_of_the_mirrored_scene():
    """Seen in a mirror, the right eye is a left eye."""
    left, right = depths(pairs.Scene(slope_x=0.2))
    visible = visible_in_left(left, right, RIG)
    np.testing.assert_array_equal(visible, visible_in_right(right[:, ::-1], left[:, ::-1], RIG)[:, ::-1])
    assert (~visible).sum() > 1000
    assert not visible[:, -15:].any()  # the right eye's right edge is beyond the left image


def test_what_both_eyes_see_is_as_many_pixels_in_either():
    """On a fronto-parallel scene a pixel of one eye is a pixel of the other."""
    scene = pairs.Scene(slope_x=0.0, slope_y=0.0, block=False)
    left, right = depths(scene)
    assert visible_in_right(left, right, RIG).sum() == visible_in_left(left, right, RIG).sum()


def eyes(scene):
    (left, light, _), (right, other, _) = pairs.view(scene, RIG, "left"), pairs.view(scene, RIG, "right")
    return light, other, left, right


def checked(light, other, left, right, rig=RIG):
    return self_check(light, other, left, right, visible_in_right(left, right, rig), rig)


SCENES = {"block": pairs.Scene(), "sky": pairs.Scene(sky_rows=100), "far": pairs.Scene(distance_m=6.0),
          "steep": pairs.Scene(slope_x=1.0, slope_y=0.0, distance_m=1.5, block=False)}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
def test_a_sound_pair_passes_its_self_check(scene):
    light, other, left, right = eyes(scene)
    found = checked(light, other, left, right)
    assert found.ok, found.problems
    assert found.photometric_disagreement < 0.01
    assert abs(found.photometric_offset_px) < 0.01
    assert found.contradictions < 1e-3


@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_noise_is_no_defect(noise):
    random = np.random.default_rng(0)
    light, other, left, right = eyes(SCENES["block"])
    found = checked(*(image * (1 + noise * random.standard_normal(image.shape)) for image in (light, other)), left,
                    right)
    assert found.ok
    assert found.photometric_disagreement > 0.5 * noise  # it is reported


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
@pytest.mark.parametrize("harm", [
    lambda *eyes: (*eyes, dataclasses.replace(RIG, baseline_m=RIG.baseline_m * 80 / 85.333)),
    lambda light, other, left, right: (other, light, right, left),
    lambda light, other, left, right: (light, other, left * 1.1, right * 1.1),
    lambda light, other, left, right: (light, np.roll(other, 1, axis=1), left, right),
], ids=["reference constant", "swapped eyes", "wrong depth", "shifted image"])
def test_a_defect_fails_the_self_check(scene, harm):
    found = checked(*harm(*eyes(scene)))
    assert not found.ok
    assert found.problems


def test_an_eye_that_sees_through_the_other_ones_surface_fails_it():
    """Photometry alone cannot tell on a scene without texture."""
    flat = pairs.Scene(contrast=0.0)
    light, other, left, right = eyes(flat)
    without_block = depths(dataclasses.replace(flat, block=False))[1]
    assert checked(light, other, left, right).ok
    found = checked(light, other, left, without_block)
    assert found.photometric_offset_px is None
    assert "sees through" in found.problems[0]


@pytest.mark.parametrize("level", [0.0, 1e9])
def test_where_nothing_can_be_told_nothing_is_wrong(level):
    light, other, left, right = eyes(pairs.Scene())
    found = checked(light * 0 + level, other * 0 + level, left, right)
    assert found.ok
    assert (found.photometric_offset_px, found.photometric_disagreement) == (None, 0)
    sky = np.full_like(left, np.nan)
    found = checked(light, other, sky, sky)
    assert found.ok
    assert (found.photometric_disagreement, found.contradictions) == (None, None)
    one = np.ones((1, 1))
    assert checked(one, one, one, one).ok


def test_photometric_disagreement_is_that_of_the_fetched_image():
    light, other, left, right = eyes(pairs.Scene())
    visible = visible_in_right(left, right, RIG)
    assert photometric_disagreement(light, other, left, visible, RIG) < 0.01
    assert photometric_disagreement(light, other * 1.1, left, visible, RIG) == pytest.approx(0.1 / 1.05, abs=0.01)
    assert np.isnan(photometric_disagreement(light, other, left, visible & False, RIG))


def test_the_planet_is_sky(tmp_path):
    view = read_view(pairs.write_pair(tmp_path / "pair") / "left.exr")
    semantic = np.zeros_like(view.semantic)
    semantic[:5] = 4
    depth = scene_depth(dataclasses.replace(view, semantic=semantic))
    assert np.isnan(depth[:5]).all()
    assert np.isfinite(depth[5:]).all()
