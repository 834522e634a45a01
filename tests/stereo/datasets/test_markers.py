"""Numbers that stand for "unknown" in maps of others are found, and walls, coarse maps and plain planes have none."""

from __future__ import annotations

from dataclasses import replace

import cv2
import foreign
import numpy as np
import pairs
import pytest
from icymoon.stereo.datasets.markers import find_markers, is_possible
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.stereo.measure.fit_check import find_common_places
from icymoon.support.errors import IcyMoonError

RIG = pairs.camera(192, 144)
SCENE = pairs.Scene(distance_m=2.5, slope_x=0.35, slope_y=0.5)


def seen(eye, scene=SCENE):
    """Depth, and light with noise of each eye's own."""
    depth, light, _ = pairs.view(scene, RIG, eye)
    random = np.random.default_rng(["left", "right"].index(eye))
    return depth, light * (1 + 0.03 * random.standard_normal(light.shape))


def seen_with_places(scene=SCENE):
    depth, light = seen("left", scene)
    return depth, find_common_places(light, seen("right", scene)[1])


#: Pixels that have no truth in a data set, a block of textured ground in 2 % of the image.
GAP = np.zeros((144, 192), bool)
GAP[60:84, 20:43] = True


@pytest.mark.parametrize("far", [1e10, 65504.0, 1000.0, 30.0])
def test_one_far_depth_of_many_pixels_is_a_marker(far):
    depth, places = seen_with_places(pairs.Scene(distance_m=2.5, slope_x=0.35, slope_y=0.5, sky_rows=40))
    assert find_markers(np.where(np.isnan(depth), far, depth), "depth", RIG, places) == (far,)


@pytest.mark.parametrize("near", [1e-9, 0.001, 0.1, 0.5])
def test_one_near_depth_of_many_pixels_is_a_marker(near):
    depth, places = seen_with_places()
    assert find_markers(np.where(GAP, near, depth), "depth", RIG, places) == (near,)


@pytest.mark.parametrize("large", [1e5, 1e4, 255.99609375, 191.0])
def test_one_large_disparity_of_many_pixels_is_a_marker(large):
    """Below the width of the images too."""
    depth, places = seen_with_places()
    assert find_markers(np.where(GAP, large, RIG.disparity(depth)), "disparity", RIG, places) == (large,)


def test_both_ends_may_have_a_marker():
    depth, places = seen_with_places()
    values = np.where(GAP, 1e-3, depth)
    values[:10] = 1e6
    assert sorted(find_markers(values, "depth", RIG, places)) == [1e-3, 1e6]


@pytest.mark.parametrize("marker", [-1.0, -0.0625, -8.0])
def test_the_only_negative_disparity_is_a_marker(marker):
    """With ``doffs`` of 24 px it would be a depth like any other."""
    rig = replace(RIG, doffs_px=24.0)
    depth, places = seen_with_places()
    disparity = RIG.disparity(depth)
    assert disparity.min() > 1
    assert find_markers(np.where(GAP, marker, disparity), "disparity", rig, places) == (marker,)
    # Where ground has negative disparities too, there is no telling.
    assert find_markers(disparity - np.median(disparity), "disparity", rig, places) == ()


def test_a_wall_and_an_even_plane_have_no_marker():
    wall = pairs.Scene(distance_m=2.0, slope_x=0.0, slope_y=0.0)  # the largest depth to the bit, with a rock before it
    depth, places = seen_with_places(wall)
    beyond = pairs.Scene(distance_m=2.0, slope_x=0.0, slope_y=0.0, rock=False)
    for each in (depth, seen("left", beyond)[0], np.full_like(depth, np.nan)):
        assert find_markers(each, "depth", RIG, places) == ()
        assert find_markers(RIG.disparity(each), "disparity", RIG, places) == ()
    # A value that stands before the wall, where the images show the wall, leaves the wall alone.
    assert find_markers(np.where(np.arange(192) < 40, 0.5, depth), "depth", RIG, places) == (0.5,)
    # The wall is nearest, behind windows with a view: still a wall.
    assert find_markers(np.where(GAP, np.linspace(50, 90, 192), depth), "depth", RIG, places) == ()


@pytest.mark.parametrize("level", [1.0, 0.25])
def test_a_coarse_map_has_no_marker(level):
    """Levels of whole pixels, of which the lowest has twice the depth of the next, in images that tell nothing."""
    disparity = np.clip(np.round(np.linspace(1, 9, 192) / level) * level, level, None)[None].repeat(144, axis=0)
    places = find_common_places(np.zeros((144, 192)), np.zeros((144, 192)))
    assert find_markers(disparity, "disparity", RIG, places) == ()
    assert find_markers(RIG.focal_baseline_px_m / disparity, "depth", RIG, places) == ()


def test_few_pixels_make_no_marker():
    depth, places = seen_with_places()
    depth[0, :50] = 1e4
    assert find_markers(depth, "depth", RIG, places) == ()


def test_what_two_images_can_show():
    """Points further apart than the width are in one image at most."""
    disparity = np.array([[0.0, 2.999, 3.0, -2.999, -3.0, np.nan, np.inf]])[:, :3]
    np.testing.assert_array_equal(is_possible(disparity), [[True, True, False]])
    np.testing.assert_array_equal(
        is_possible(np.array([[-0.5, -2.0], [np.nan, np.inf]])), [[True, False], [True, False]]
    )


def unknown_block(value):
    """The truth of the folders in ``foreign`` with a block of another value."""
    values = foreign.constant()
    values[:, :4], values[20:40, 30:50] = np.nan, value
    return values


@pytest.mark.parametrize(
    ("kind", "marker", "words"),
    [
        ("disparity", 1e5, "the disparity 100000 px"),
        ("disparity", 60.0, "the disparity 60 px"),
        ("disparity", -1.0, "the disparity -1 px"),
        ("depth", 1e-3, "the depth 0.001 m"),
        ("depth", 1e6, "1e+06 m"),
    ],
)
def test_a_marker_is_unknown_and_told(tmp_path, kind, marker, words):
    toml = "doffs_px = 5" if marker == -1 else ""
    root = foreign.plain(tmp_path, f'{kind} = "truth/{{pair}}.npy"', toml, unknown_block(marker))
    if kind == "depth":
        (path,) = root.glob("truth/*.npy")
        np.save(path, np.where(unknown_block(marker) == np.float32(marker), marker, 70 / foreign.constant()))
    (source,) = find_sources([root])
    prepared = source.prepare({})
    assert np.isnan(prepared.truth[20:40, 30:50]).all()
    assert np.isfinite(prepared.truth[41:, 5:]).all()
    (note,) = (note for note in prepared.facts["notes"] if "counts as unknown" in note)
    assert words in note
    assert prepared.facts["warnings"] == []


def test_disparities_beyond_the_width_are_unknown_and_told(tmp_path):
    """Of values that differ, or in too few pixels for a marker."""
    values = foreign.constant()
    values[30, 20:60] = np.linspace(foreign.WIDTH, 400, 40)
    (source,) = find_sources([foreign.plain(tmp_path, 'disparity = "truth/{pair}.npy"', "", values)])
    prepared = source.prepare({})
    np.testing.assert_array_equal(np.isnan(prepared.truth), values != foreign.SHIFT_PX)
    (warning,) = prepared.facts["warnings"]
    assert "96 px and more apart in images of that width, which cannot be; these 0.65 % of the pixels" in warning


def test_a_map_without_any_possible_disparity_is_refused(tmp_path):
    """Of images that tell no factor."""
    root = foreign.plain(tmp_path, 'disparity = "truth/{pair}.npy"', "", foreign.constant(7 * 256))
    for path in (*root.glob("left/*"), *root.glob("right/*")):
        cv2.imwrite(str(path), np.full((foreign.HEIGHT, foreign.WIDTH), 99, np.uint8))
    with pytest.raises(IcyMoonError, match=r"no point is in both images of 96 px; correct them, or the steps"):
        find_sources([root])[0].prepare({})


def test_the_unknown_pixels_of_our_sceneflow_are_unknown(tmp_path):
    """1e5 px, in both eyes."""
    root = foreign.sceneflow(tmp_path)
    for path in root.glob("disparity/**/*.pfm"):
        foreign.write_pfm(path, unknown_block(1e5))
        foreign.write_pfm(path.parent.parent / "right" / path.name, unknown_block(1e5))
    for source in find_sources([root]):
        prepared = source.prepare({})
        assert np.isnan(prepared.truth[20:40, 30:50]).all()
        assert prepared.facts["warnings"] == []
