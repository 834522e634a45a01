"""Depth of field, motion blur, toe-in and overscan: what the render makes of them, against optics and geometry."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.blur import blur_of, confusion_px, motion_px
from icymoon.render.pair import EYES
from icymoon.stereo.exr import read_light, read_truth
from rendering import render

#: A plane two metres below the camera that ends at its left eye: an edge down the middle of the image.
EDGE = {"terrain": {"rms_slope_deg": 0.0, "size_m": 8.0, "resolution": 5},
        "surface": {"grain_amplitude_m": 0.0, "albedo_variation": 0.0, "specular": 0.0},
        "light": {"sun_elevation_deg": 90.0, "sun_angular_diameter_deg": 0.0},
        "rig": {"pitch_deg": 90.0, "height_m": 2.0, "x_m": 4.0, "width_px": 96, "height_px": 24},
        "quality": {"samples": 64, "diffuse_bounces": 0}}
FOCUS = {"rig": {"focus_distance_m": 0.1}, "sensor": {"f_number": 1.6}}
MOTION = {"rig": {"speed_right_m_s": 0.8, "motion_exposure_s": 0.5}}


def spread(pair) -> tuple[float, float]:
    """Where the edge is in the left image, px, and the standard deviation of the light's spread over it."""
    profile = read_light(pair.image("left"), "left").radiance.mean(axis=(0, 2), dtype=np.float64)
    line = np.diff(profile) / (profile[-1] - profile[0])
    at = np.arange(1, len(profile))
    middle = float((line * at).sum())
    return middle, float(np.sqrt((line * (at - middle)**2).sum()))


def truths(pair) -> list[np.ndarray]:
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
    diameter = 4 * np.sqrt(sigma**2 - sharp[2]**2)
    expected = 96 * 32 / 60 * 0.032 / 1.6 * (1 / 0.1 - 1 / 2)
    assert confusion_px(2.0, pair.settings["rig"], blur_of(pair.settings)) == pytest.approx(expected)
    assert diameter == pytest.approx(expected, rel=0.05)
    assert middle == pytest.approx(sharp[1], abs=0.2)
    check_truth(pair, sharp)
    assert pair.data["blur"]["f_number"] == pytest.approx(1.6)


@pytest.mark.parametrize(("motion", "length"), [
    ({"speed_right_m_s": 0.8}, 96 * 32 / 60 * 0.8 * 0.5 / 2.0),
    ({"turn_right_deg_s": 20.0}, 96 * 32 / 60 * 2 * np.tan(np.radians(5.0)))])
def test_motion_blur_is_as_long_as_the_way_of_a_point_and_about_the_instant_of_truth(tmp_path, sharp, motion, length):
    pair, _ = render(tmp_path, EDGE, MOTION, {"rig": {"speed_right_m_s": 0.0} | motion})
    middle, sigma = spread(pair)
    found = np.sqrt(12 * (sigma**2 - sharp[2]**2))  # of a line of even light
    assert motion_px(0.0, 0.0, 2.0, pair.settings["rig"], blur_of(pair.settings)) == pytest.approx(length, rel=1e-6)
    assert found == pytest.approx(length, abs=0.5)
    assert middle == pytest.approx(sharp[1], abs=0.2)
    check_truth(pair, sharp)
