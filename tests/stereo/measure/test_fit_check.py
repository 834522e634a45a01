"""The check of maps against images: sound ones pass, each fault is named, and where images do not tell, nothing is."""

from __future__ import annotations

import dataclasses

import numpy as np
import pairs
import pytest
from icymoon.stereo.measure.fit_check import (
    compute_ray_lengths,
    find_common_places,
    find_fault,
    find_misfit,
    make_true_places,
)
from icymoon.support.arrays import Array

RIG = pairs.camera(192, 144)
#: Ground that rises to the left, with a rock: no symmetry hides a fault.
SCENE = pairs.Scene(distance_m=2.5, slope_x=0.35, slope_y=0.5)


def seen(eye: str, scene: pairs.Scene = SCENE, noise: float = 0.03) -> tuple[Array, Array]:
    """Depth, and light with noise of each eye's own."""
    depth, light, _ = pairs.view(scene, RIG, eye)
    random = np.random.default_rng(["left", "right"].index(eye))
    return depth, light * (1 + noise * random.standard_normal(light.shape))


@pytest.fixture(scope="module")
def places():
    return find_common_places(seen("left")[1], seen("right")[1])


DEPTH = seen("left")[0]
DISPARITY = RIG.disparity(DEPTH)


@pytest.mark.parametrize("values", [DEPTH, np.where(np.arange(192) % 3 == 0, np.nan, DEPTH)], ids=["whole", "gaps"])
def test_a_sound_map_fits(places, values):
    assert find_fault(values, "depth", RIG, places) is None
    assert find_fault(RIG.disparity(values), "disparity", RIG, places) is None


FAULTS = {
    "ray": (DEPTH * compute_ray_lengths(RIG), "depth", 1),
    "upside_down": (DEPTH[::-1], "depth", 1),
    "mirrored": (DEPTH[:, ::-1], "depth", 1),
    "turned": (DISPARITY[::-1, ::-1], "disparity", 1),
    "disparity": (DISPARITY, "depth", 1),
    "depth": (DEPTH, "disparity", 1),
    "inverse": (1 / DEPTH, "depth", 1),
}


def factor_of(fault, kind: str) -> float:
    """The factor of a fault, which is there and of this kind."""
    assert fault is not None
    assert fault.kind == kind
    return fault.factor


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_named(places, name):
    values, kind, _ = FAULTS[name]
    fault = find_fault(values, kind, RIG, places)
    assert fault is not None
    assert fault.kind == name
    assert fault.share > 0.5


@pytest.mark.parametrize("factor", [1000.0, 256.0, 16.0, 2.0, 1.1, 80 / 85.333, 0.5, 1 / 0.3048, 1e-3])
@pytest.mark.parametrize("kind", ["depth", "disparity"])
def test_a_factor_is_measured(places, kind, factor):
    fault = find_fault((DEPTH if kind == "depth" else DISPARITY) * factor, kind, RIG, places)
    assert factor_of(fault, "factor") == pytest.approx(factor, rel=0.02)


@pytest.mark.parametrize("noise", [0.0, 0.03, 0.1])
@pytest.mark.parametrize("scene", [SCENE, pairs.Scene(distance_m=2.5, slope_x=0.35, slope_y=0.5, contrast=0.03)])
def test_a_sound_map_has_no_small_fault(scene, noise):
    depth = seen("left", scene, noise)[0]
    found = find_common_places(seen("left", scene, noise)[1], seen("right", scene, noise)[1])
    for values, kind in ((depth, "depth"), (RIG.disparity(depth), "disparity"), (1.01 * depth, "depth")):
        assert find_misfit(values, kind, RIG, found) is None


@pytest.mark.parametrize("factor", [0.8, 0.95, 1.07, 1.25])
@pytest.mark.parametrize("kind", ["depth", "disparity"])
def test_a_scale_that_is_off_by_a_little_is_noticed(places, kind, factor):
    fault = find_misfit((DEPTH if kind == "depth" else DISPARITY) * factor, kind, RIG, places)
    assert factor_of(fault, "scale") == pytest.approx(factor, rel=0.015)


@pytest.mark.parametrize("zoom", [0.6, 0.8, 1.25, 1.5])
def test_the_map_of_another_focal_length_is_noticed(places, zoom):
    """At the same place, so its depths in the middle are right."""
    rig = dataclasses.replace(RIG, focal_px=zoom * RIG.focal_px)
    fault = find_misfit(pairs.view(SCENE, rig, "left")[0], "depth", RIG, places)
    assert factor_of(fault, "zoom") == pytest.approx(zoom, rel=0.06)


def test_exchanged_images_and_a_map_of_the_other_eye_are_named(places):
    exchanged = find_common_places(seen("right")[1], seen("left")[1])
    fault = find_fault(DEPTH, "depth", RIG, exchanged)
    assert fault is not None
    assert fault.kind == "swapped"
    # The rock of the right eye stands elsewhere; most of the ground has nearly the same disparity in both eyes.
    steep = pairs.Scene(distance_m=1.5, slope_x=1.2, slope_y=0.3)
    fault = find_fault(
        seen("right", steep)[0], "depth", RIG, find_common_places(seen("left", steep)[1], seen("right", steep)[1])
    )
    assert fault is not None
    assert fault.kind == "right_eye"


def test_a_map_of_something_else_fits_in_no_way(places):
    other = np.random.default_rng(3).uniform(1, 9, (18, 24)).repeat(8, 0).repeat(8, 1)
    fault = find_fault(other, "depth", RIG, places)
    assert fault is not None
    assert fault.kind == "nothing"
    assert fault.stated_share < 0.25


@pytest.mark.parametrize(
    "light",
    [
        lambda eye: np.zeros((144, 192)),
        lambda eye: np.ones((144, 192)),
        lambda eye: np.random.default_rng(len(eye)).standard_normal((144, 192)) ** 2,
        lambda eye: np.full((144, 192), np.nan),
        lambda eye: seen(eye, noise=3.0)[1],
    ],
    ids=["black", "white", "noise", "no numbers", "far too dark"],
)
@pytest.mark.parametrize("values", [DEPTH, DEPTH[::-1], DEPTH * 1000], ids=["sound", "upside down", "millimetres"])
def test_images_without_common_places_accuse_nobody(light, values):
    assert find_fault(values, "depth", RIG, find_common_places(light("left"), light("right"))) is None


def test_a_horizon_alone_does_not_tell():
    """Its edge is found in both images, along two rows of tiles; the ground below is noise."""
    sky = pairs.Scene(distance_m=2.5, slope_x=0.35, slope_y=0.5, sky_rows=60, rock=False)
    found = find_common_places(*(seen(eye, sky, noise=2.0)[1] for eye in ("left", "right")))
    assert find_fault(seen("left", sky)[0][:, ::-1], "depth", RIG, found) is None


@pytest.mark.parametrize("kind", ["upside_down", "mirrored", "turned", "depth", "inverse"])
def test_a_prediction_is_held_against_the_truth(kind):
    known = make_true_places(np.where(np.arange(192) < 20, np.nan, DISPARITY))
    values = {
        "upside_down": DISPARITY[::-1],
        "mirrored": DISPARITY[:, ::-1],
        "turned": DISPARITY[::-1, ::-1],
        "depth": DEPTH,
        "inverse": 1 / DEPTH,
    }[kind]
    fault = find_fault(values, "disparity", RIG, known)
    assert fault is not None
    assert fault.kind == kind
    assert (
        find_fault(DISPARITY + np.random.default_rng(1).normal(0, 2, DISPARITY.shape), "disparity", RIG, known) is None
    )
