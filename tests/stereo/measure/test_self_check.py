"""The check that both eyes of a pair agree: hard but sound pairs pass it, faults do not. Against the analytic scene.

Rates over rendered pairs are measured by ``python benchmarks selfcheck``.
"""

import dataclasses
import json
import re

import numpy as np
import pairs
import pytest
from icymoon.physics.camera.occlusion import find_matching_column
from icymoon.stereo.measure.eye_offsets import measure_light_offsets, measure_truth_offsets
from icymoon.stereo.measure.self_check import Eye, find_visibility, run_self_check

pytestmark = pytest.mark.filterwarnings("error")

RIG = pairs.camera()
SCENES = {
    "rock": pairs.Scene(),
    "sky": pairs.Scene(sky_rows=100),
    "far": pairs.Scene(distance_m=6.0),
    "steep": pairs.Scene(slope_x=1.0, slope_y=0.0, distance_m=1.5, rock=False),
}


def eyes(scene, rig=RIG):
    found = (pairs.view(scene, rig, eye) for eye in ("left", "right"))
    return tuple(Eye(light, depth, np.ones(depth.shape, bool)) for depth, light, _ in found)


def checked(left, right, rig=RIG):
    return run_self_check(left, right, find_visibility(left, right, rig), rig)


def each(pair, change):
    return tuple(change(eye, k) for k, eye in enumerate(pair))


def noisy(pair, noise, seed=0):
    random = np.random.default_rng(seed)
    return each(
        pair,
        lambda eye, _: dataclasses.replace(
            eye, grey=eye.grey * np.maximum(0, 1 + noise * random.standard_normal(eye.grey.shape))
        ),
    )


def toed(pair, columns):
    """Eyes that are turned in: the left one does not see the left border, the right one not the right border, and
    what they do not see is black."""

    def turned(eye, k):
        column = np.arange(eye.depth.shape[1])
        seen = np.broadcast_to(column >= columns if k == 0 else column < len(column) - columns, eye.depth.shape)
        return Eye(np.where(seen, eye.grey, 0.0), eye.depth, seen)

    return each(pair, turned)


def inward(pair, columns):
    """The same of the other borders, which the other eye sees best."""
    return tuple(
        dataclasses.replace(eye, seen=eye.seen[:, ::-1], grey=np.where(eye.seen[:, ::-1], own.grey, 0.0))
        for eye, own in zip(toed(pair, columns), pair, strict=True)
    )


def with_highlight(pair):
    """The Sun's reflection is at infinity: at the same place of both images, wherever the ground is."""

    def shining(eye, _):
        y, x = np.indices(eye.grey.shape)
        return dataclasses.replace(eye, grey=eye.grey + 15.0 * np.exp(-((x - 110) ** 2 + (y - 80) ** 2) / 600.0))

    return each(pair, shining)


def with_glints(pair, share=0.03):
    """Facets that shine into one eye only, ten times as bright as the ground."""
    random = np.random.default_rng(1)
    return each(
        pair,
        lambda eye, _: dataclasses.replace(eye, grey=np.where(random.random(eye.grey.shape) < share, 30.0, eye.grey)),
    )


def in_shadow(pair):
    """A Sun at the horizon: light on an edge of the scene, paths that found light by chance elsewhere."""
    random = np.random.default_rng(2)
    return each(
        pair,
        lambda eye, _: dataclasses.replace(
            eye,
            grey=np.where(
                np.arange(eye.grey.shape[0])[:, None] < 12,
                eye.grey,
                np.where(random.random(eye.grey.shape) < 0.01, 5.0, 0.0),
            ),
        ),
    )


def broken(pair):
    """Pixels of a render that are not finite."""

    def with_holes(eye, k):
        grey = eye.grey.copy()
        grey[30 + k, 40], grey[70, 120 + k] = np.nan, np.inf
        return dataclasses.replace(eye, grey=grey)

    return each(pair, with_holes)


HARD = {
    "as it is": lambda pair: pair,
    "2 % noise": lambda pair: noisy(pair, 0.02),
    "half noise": lambda pair: noisy(pair, 0.5),
    "toed in": lambda pair: toed(pair, 40),
    "turned out": lambda pair: inward(pair, 40),
    "highlight": with_highlight,
    "glints": with_glints,
    "shadow": in_shadow,
    "no number": broken,
    "all": lambda pair: toed(noisy(with_glints(with_highlight(pair)), 0.3), 30),
}


@pytest.mark.ci_takes(15)
@pytest.mark.parametrize("hard", HARD.values(), ids=HARD.keys())
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
def test_a_sound_pair_passes_however_hard_it_is(scene, hard):
    found = checked(*hard(eyes(scene)))
    assert found.ok, found.problems
    assert found.contradictions < 1e-3
    # Truth has no noise: what is left is rounding and the edges of the rock between two columns.
    assert abs(found.truth_offset_px) < 1e-3
    json.dumps(found.to_json(), allow_nan=False)


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
def test_what_is_right_is_measured_as_right(scene):
    found = checked(*eyes(scene))
    assert found.photometric_disagreement < 0.01
    assert abs(found.photometric_offset_px) < max(0.02, 4 * found.photometric_error_px)


def scaled(factor):
    return dataclasses.replace(RIG, baseline_m=RIG.baseline_m * factor)


def half_between(depth):
    return 2 / (1 / depth + 1 / np.roll(depth, 1, axis=1))


def other(eye, **values):
    return dataclasses.replace(eye, **values)


#: Faults of the truth: whatever the light, they are found by the truth alone.
TRUTH_FAULTS = {
    "f·B +1 %": lambda left, right: (left, right, scaled(1.01)),
    "f·B -1 %": lambda left, right: (left, right, scaled(0.99)),
    "reference constant": lambda left, right: (left, right, scaled(80 / 85.333)),
    "sign of the baseline": lambda left, right: (left, right, scaled(-1)),
    "swapped eyes": lambda left, right: (right, left, RIG),
    "wrong depth": lambda left, right: (
        other(left, depth=1.1 * left.depth),
        other(right, depth=1.1 * right.depth),
        RIG,
    ),
    "half a pixel": lambda left, right: (left, other(right, depth=half_between(right.depth)), RIG),
    "a row": lambda left, right: (left, other(right, depth=np.roll(right.depth, 1, axis=0)), RIG),
}


@pytest.mark.ci_takes(12)
@pytest.mark.parametrize("hard", [HARD["as it is"], HARD["all"], HARD["shadow"]], ids=["light", "hard", "dark"])
@pytest.mark.parametrize("fault", TRUTH_FAULTS.values(), ids=TRUTH_FAULTS.keys())
def test_a_fault_of_the_truth_is_found_in_any_light(fault, hard):
    # Its slope along the rows and the columns is what a shift and a row show by.
    found = checked(*fault(*hard(eyes(pairs.Scene(slope_x=0.3)))))
    assert not found.ok


LIGHT_FAULTS = {
    "half a pixel": (
        lambda left, right: (left, other(right, grey=(right.grey + np.roll(right.grey, 1, 1)) / 2)),
        r"\+0\.[456]\d px",
    ),
    "a pixel": (lambda left, right: (left, other(right, grey=np.roll(right.grey, -1, 1))), r"-(1\.0|0\.9)\d px"),
    "a row": (lambda left, right: (left, other(right, grey=np.roll(right.grey, 1, 0))), r"\+(1\.0|0\.9)\d rows"),
    "images swapped": (lambda left, right: (other(left, grey=right.grey), other(right, grey=left.grey)), "exchanged"),
    "another scene's depth": (
        lambda left, right: tuple(
            other(eye, depth=far.depth)
            for eye, far in zip((left, right), eyes(pairs.Scene(distance_m=3.0)), strict=True)
        ),
        "places",
    ),
}


@pytest.mark.parametrize(("fault", "problem"), LIGHT_FAULTS.values(), ids=LIGHT_FAULTS.keys())
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_images_that_do_not_belong_to_their_truth_are_found(fault, problem, noise):
    found = checked(*fault(*noisy(toed(eyes(SCENES["rock"]), 20), noise)))
    assert any(re.search(problem, each) for each in found.problems), found.problems


def test_one_eyes_depth_of_another_scene_is_found():
    left, right = eyes(SCENES["rock"])
    for distance in (1.2, 4.0):  # one before and one behind: either eye may see through the other's surface
        wrong = other(right, depth=eyes(pairs.Scene(distance_m=distance))[1].depth)
        assert "sees through" in " ".join(checked(left, wrong).problems)


def test_an_eye_that_sees_through_the_other_ones_surface_fails_it():
    """On a scene without texture the light determines nothing."""
    left, right = eyes(pairs.Scene(contrast=0.0))
    without_rock = eyes(pairs.Scene(contrast=0.0, rock=False))[1]
    assert checked(left, right).ok
    found = checked(left, without_rock)
    assert found.photometric_offset_px is None
    assert "sees through" in found.problems[0]


def test_what_an_eye_does_not_see_is_neither_sky_nor_ground():
    """A pixel that is not seen is not sky: the other eye does not see through it, and it is not visible in both."""
    pair = toed(eyes(pairs.Scene(rock=False)), 60)
    visible = find_visibility(pair[0], pair[1], RIG)
    column = find_matching_column(RIG.disparity(pair[0].depth))
    assert not visible["left"][column > 256 - 60].any()
    assert visible["left"][(column < 256 - 62) & (column > 1) & pair[0].seen].all()
    # As it was: unseen pixels without truth were taken for sky, through which the ground was seen.
    blind = each(pair, lambda eye, _: other(eye, depth=np.where(eye.seen, eye.depth, np.nan)))
    assert "sees through" in " ".join(checked(*blind).problems)
    assert checked(*pair).ok


@pytest.mark.parametrize("level", [0.0, 1e9])
def test_a_pair_that_determines_nothing_passes(level):
    pair = each(eyes(pairs.Scene()), lambda eye, _: other(eye, grey=0 * eye.grey + level))
    found = checked(*pair)
    assert found.ok
    assert (found.photometric_offset_px, found.photometric_disagreement) == (None, 0)
    sky = each(pair, lambda eye, _: other(eye, depth=np.full_like(eye.depth, np.nan)))
    found = checked(*sky)
    assert found.ok
    assert (found.photometric_disagreement, found.contradictions, found.truth_offset_px) == (None, None, None)
    one = Eye(np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1), bool))
    assert checked(one, one).ok
    unseen = each(eyes(pairs.Scene()), lambda eye, _: other(eye, seen=np.zeros(eye.seen.shape, bool)))
    assert checked(*unseen).ok


def test_the_fault_of_a_truth_is_named():
    """Injected faults are read back: f·B to a thousandth of the 1 %, shifts to a hundredth of a pixel."""
    left, right = (eye.depth for eye in eyes(pairs.Scene(slope_x=0.3)))
    assert measure_truth_offsets(left, right, scaled(1.01)).scale.value == pytest.approx(1 - 1 / 1.01, abs=1e-5)
    assert measure_truth_offsets(left, half_between(right), RIG).shift_px.value == pytest.approx(0.5, abs=0.01)
    assert measure_truth_offsets(left, np.roll(right, -1, 0), RIG).rows_px.value == pytest.approx(-1.0, abs=0.01)


def to_the_horizon(near, far_rows):
    """A pair whose upper rows, of each eye, show ground so far away that it has next to no disparity. Each eye meets
    other facets there."""
    random = np.random.default_rng(0)
    far = each(
        eyes(pairs.Scene(distance_m=3e3, rock=False)),
        lambda eye, _: other(eye, depth=eye.depth * (1 + 1e-3 * random.standard_normal(eye.depth.shape))),
    )
    rows = np.arange(RIG.height_px)[:, None] < far_rows
    return tuple(
        other(one, depth=np.where(rows, beyond.depth, one.depth), grey=np.where(rows, beyond.grey, one.grey))
        for one, beyond in zip(near, far, strict=True)
    )


@pytest.mark.parametrize("part", [0.0, 0.6, 0.9])
def test_a_wrong_baseline_is_found_in_what_is_near_however_much_is_far(part):
    """Far ground fits any baseline, so a check that follows most of the pixels would pass."""
    pair = to_the_horizon(eyes(SCENES["steep"]), round(part * RIG.height_px))
    assert checked(*pair).ok
    found = measure_truth_offsets(
        pair[0].depth, pair[1].depth, dataclasses.replace(RIG, baseline_m=1.01 * RIG.baseline_m)
    )
    assert found.scale.value == pytest.approx(0.01, rel=0.05)
    assert found.likeliest == "scale"


def test_a_number_that_single_precision_makes_is_none():
    """At 1e9 m neither slopes nor differences of disparity are more than roundings."""
    for distance_m in (1e7, 1e9):
        far = eyes(pairs.Scene(distance_m=distance_m, rock=False))
        assert checked(*each(far, lambda eye, _: other(eye, depth=np.float32(eye.depth).astype(np.float64)))).ok


def test_the_stated_error_of_the_light_is_its_spread():
    """Over independent noise, offsets spread by what each of them states, within the chance of 16 draws: the standard
    deviation of 16 has an error of 18 %, and the jackknife over 48 tiles, of which some are empty, errs too."""
    left, right = eyes(pairs.Scene(rock=False))
    column, visible = find_matching_column(RIG.disparity(left.depth)), find_visibility(left, right, RIG)["left"]
    found = [
        measure_light_offsets(a.grey, b.grey, column, visible).shift_px
        for a, b in (noisy((left, right), 0.5, seed) for seed in range(16))
    ]
    assert all(abs(each.value) < 5 * each.error for each in found)
    assert 0.5 < np.std([each.value for each in found]) / np.mean([each.error for each in found]) < 1.5


def test_disagreement_is_that_of_the_fetched_image():
    left, right = eyes(pairs.Scene())
    assert checked(left, right).photometric_disagreement < 0.01
    brighter = checked(left, other(right, grey=1.1 * right.grey))
    assert brighter.photometric_disagreement == pytest.approx(0.1 / 1.05, abs=0.01)
    assert brighter.ok
