"""The disparities that matchers search: from the rig, from the truth, as stated."""

import numpy as np
import pairs
import pytest
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset, preset_names
from icymoon.stereo.matchers import match
from icymoon.stereo.matchers.search_range import SearchRange, find_known_ranges, find_rig_range, find_true_range
from icymoon.support.errors import IcyMoonError

#: What the shipped rigs search: the least and the greatest disparity, px.
RIGS = {
    "rigs/europa_lander": (144, 815),
    "rigs/gallery": (0, 191),
    "rigs/guiss": (0, 143),
    "rigs/mars2020_navcam": (0, 319),
    "rigs/mer_navcam": (0, 287),
    "rigs/mer_pancam": (96, 783),
    "rigs/mast_and_arm": (48, 335),
    "rigs/trinocular": (0, 159),
}
SEARCHING = ("bm", "sgbm", "sgbm_wls", "jplv")
RANGES = {"auto": SearchRange(16, 63, "rig"), "truth": SearchRange(32, 47, "truth")}
STATED = {"bm": {"disparities": 32, "min_disparity": 16}, "jplv": {"max_disparity": 47, "min_disparity": 16}}


def settings_of(name, **changes):
    return merged(defaults(), load_preset(name), {"source": {"kind": "MESH"}}, changes)


def searched(method, options=None, ranges=None, shape=(120, 256)):
    image = np.random.default_rng(0).integers(0, 255, shape).astype(np.uint8)
    return match(method, image, image, options, None, ranges)[2]


def test_no_more_than_1024_disparities_are_searched_unless_they_are_stated():
    """They begin at the least, and the share of the truth beyond them is missed."""
    disparity = np.linspace(100.0, 3000.0, 4001)[None]
    found = find_true_range(disparity)
    assert found == SearchRange(96, 96 + 1023, "truth")
    assert found.missed(disparity) == pytest.approx((3000.0 - 1119.5) / 2900.0, abs=1e-3)
    whole = find_true_range(np.clip(disparity, 100.0, 1100.0))
    assert whole.missed(np.clip(disparity, 100.0, 1100.0)) == 0.0


def test_the_range_of_the_truth_leaves_a_neighbour_to_either_side():
    """A fit between disparities needs one: of 16.5 to 46.5 these are 15 and 48, in blocks of 16."""
    assert find_true_range(np.array([[16.5, 46.5] + [np.nan] * 200])) == SearchRange(0, 63, "truth")
    assert find_true_range(np.array([[17.5, 45.5] + [np.nan] * 200])) == SearchRange(16, 47, "truth")


def test_no_disparity_is_as_wide_as_the_image():
    assert find_true_range(np.full((1, 80), 300.0)) == SearchRange(64, 79, "truth")


def test_half_a_pixel_beside_a_searched_disparity_is_not_missed():
    found = SearchRange(16, 47, "truth")
    assert found.missed(np.array([15.5, 47.5, np.nan])) == 0.0
    assert found.missed(np.array([15.4, 47.6, 20.0, 30.0])) == 0.5


def test_the_far_end_is_that_of_the_rig_with_described_ground_too():
    level = settings_of("rigs/europa_lander", source={"kind": "PROCEDURAL"}, terrain={"rms_slope_deg": 0.0})
    described, of_rig = find_rig_range(level), find_rig_range(level, described=False)
    assert (described.source, of_rig.source) == ("settings", "rig")
    assert described.least_px == of_rig.least_px == 144


@pytest.mark.parametrize(("by_hand", "source"), [(False, "settings"), (True, "rig")])
def test_settings_say_nothing_of_what_was_edited_by_hand(by_hand, source):
    level = settings_of("rigs/guiss", source={"kind": "PROCEDURAL"}, terrain={"rms_slope_deg": 0.0})
    assert find_known_ranges(level, None, by_hand)["auto"].source == source


def test_every_shipped_rig_has_its_range():
    assert {
        name: (found.least_px, found.most_px)
        for name in preset_names("rigs")
        if (found := find_rig_range(settings_of(name)))
    } == RIGS


def test_described_ground_sets_the_near_end():
    """Level ground needs little more than its own disparities; a slope that rises ahead and rocks need more."""
    level = {"source": {"kind": "PROCEDURAL"}, "terrain": {"rms_slope_deg": 0.0}}
    found = find_rig_range(settings_of("rigs/guiss", **level))
    assert (found.least_px, found.most_px, found.source) == (0, 79, "settings")  # its ground is at 64 px
    assert find_rig_range(settings_of("rigs/guiss", **level), described=False) == SearchRange(0, 143, "rig")
    rising = {"terrain": {"rms_slope_deg": 0.0, "regional_slope_deg": 45.0, "regional_slope_azimuth_deg": 180.0}}
    assert find_rig_range(settings_of("rigs/guiss", **level | rising)).most_px > found.most_px
    rocks = merged(
        settings_of("rigs/guiss", **level),
        {"rocks": {"coverage": 0.3, "smallest_m": 0.6, "largest_m": 0.8, "clear_radius_m": 0.5}},
    )
    assert find_rig_range(rocks).most_px > found.most_px


@pytest.mark.parametrize("method", SEARCHING)
def test_each_matcher_searches_what_it_is_told(method):
    option = "max_disparity" if method == "jplv" else "disparities"
    for options, expected in (
        ({}, RANGES["auto"]),
        ({option: "auto"}, RANGES["auto"]),
        ({option: "truth"}, RANGES["truth"]),
        (STATED.get(method, STATED["bm"]), SearchRange(16, 47, "stated")),
        ({option: "64"}, SearchRange(0, 64 if method == "jplv" else 63, "stated")),
        ({"min_disparity": 0}, SearchRange(0, 63, "rig")),
    ):
        info = searched(method, options, RANGES)
        assert info["search"] == expected
        assert info["options"]["min_disparity"] == expected.least_px
    assert searched(method)["search"] == SearchRange(0, 95, "fixed")
    with pytest.raises(IcyMoonError, match=f"{method}.{option} is truth, but the true disparity is unknown"):
        searched(method, {option: "truth"})
    with pytest.raises(IcyMoonError, match=f"{method}.{option} must be auto or truth or a whole number, not 'wide'"):
        searched(method, {option: "wide"})


def test_the_share_of_what_is_missed():
    seen = np.array([[9.4, 9.6, 20.0], [40.4, 40.6, np.nan]])
    assert SearchRange(10, 40, "stated").missed(seen) == pytest.approx(2 / 5)
    assert SearchRange(10, 40, "stated").missed(np.full((2, 2), np.nan)) is None


def test_the_range_of_the_truth_encloses_it():
    seen = np.full((40, 300), np.nan)
    seen[10, 200:202] = 33.2, 150.9
    assert find_true_range(seen) == SearchRange(32, 159, "truth")
    assert find_true_range(seen).missed(seen) == 0
    assert find_known_ranges(None, np.full((4, 4), np.nan)) == {}


def test_a_range_is_no_wider_than_the_image():
    wide = find_true_range(np.full((4, 100), 500.0))
    assert wide.most_px < 112
    assert (wide.most_px + 1 - wide.least_px) % 16 == 0


def test_jplv_halves_the_images_as_often_as_the_range_needs():
    for most, level in ((254, 0), (255, 1), (800, 2)):
        image = (200, 1000) if level else (40, 400)
        assert searched("jplv", {"max_disparity": most}, shape=image)["options"]["pyramid_level"] == level


def test_the_range_of_the_rig_measures_what_a_fixed_one_cannot():
    """Near ground at half a metre, 68 px: 96 px reach it only from a camera as wide as this."""
    rig = pairs.camera(512, 160)
    scene = pairs.Scene(rock=False, distance_m=0.55, slope_y=0.3, contrast=0.2)
    (depth, left, _), (_, right, _) = pairs.view(scene, rig, "left"), pairs.view(scene, rig, "right")
    left, right = (np.rint(np.clip(light / 6, 0, 1) * 255).astype(np.uint8) for light in (left, right))
    truth = rig.disparity(depth)
    assert truth.min() > 96
    shared = np.where(truth < np.arange(512), truth, np.nan)
    auto = find_known_ranges(
        merged(defaults(), {"rig": {"height_m": 0.6}}, {"rig": pairs.described(rig)}), shared, True
    )
    found, valid, info = match("bm", left, right, {}, rig, auto)
    assert info["search"].missed(shared) == 0
    assert valid[np.isfinite(shared)].mean() > 0.8
    assert np.median(np.abs(found - truth)[valid]) < 0.1
    fixed = match("bm", left, right, {"disparities": 96}, rig)
    assert fixed[2]["search"].missed(shared) == 1
