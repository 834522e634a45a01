"""Confidences of any matcher: matchers that err in a known way are found out, and right ones are not."""

from dataclasses import replace

import numpy as np
import pairs
import pytest
from icymoon.stereo.check_plugin import make_textured_pair
from icymoon.stereo.matchers import check_options, match
from icymoon.stereo.matchers.black_box_confidence import (
    RUNS,
    SWEPT_PX,
    compute_black_box_confidence,
    find_left_right_error,
    find_sweep_error,
    mirror_camera,
    shift_left,
)
from icymoon.stereo.measure.confidence_metrics import MEASURES, OWN

SHAPE = 6, 40
RANDOM = np.random.default_rng(0)
IMAGE = RANDOM.integers(0, 256, SHAPE, np.uint8)
RIG = replace(pairs.camera(40, 6), cx_px=13.0, doffs_px=4.0)


def test_the_right_image_is_matched_as_the_left_one():
    """A matcher that is right in both eyes about two planes, one hidden part beside the step."""
    left = np.full(SHAPE, 3.0)
    left[:, 20:] = 7.0  # columns 13 to 16 of the left plane lie behind the near one
    right = np.full(SHAPE, 3.0)
    right[:, 13:] = 7.0
    asked = []

    def run(image, other, camera):
        asked.append((image, other, camera))
        return right[:, ::-1]

    error = find_left_right_error(run, IMAGE, IMAGE // 2, left, RIG)
    np.testing.assert_array_equal(asked[0][0][:, ::-1], IMAGE // 2)
    np.testing.assert_array_equal(asked[0][1][:, ::-1], IMAGE)
    assert (error[:, 20:] == 0).all()
    assert (error[:, 3:16] == 0).all()
    assert (error[:, 16:20] == 4).all()
    assert (error[:, :3] > 100).all()  # outside the right image


def test_an_answer_that_is_missing_is_not_trusted():
    missing = find_left_right_error(lambda *_: np.full(SHAPE, np.nan), IMAGE, IMAGE, np.full(SHAPE, 2.0))
    assert (missing > 100).all()
    unmeasured = find_left_right_error(lambda *_: np.full(SHAPE, 2.0), IMAGE, IMAGE, np.full(SHAPE, np.nan))
    assert (unmeasured > 100).all()


def test_the_mirrored_rig_sees_a_point_of_the_right_image_at_its_mirrored_place():
    """A point in the axes of the left eye; the right eye is B along x, and mirrored x is the other way."""
    x, z = 0.7, 4.0
    right_column = RIG.focal_px * (x - RIG.baseline_m) / z + RIG.cx_px + RIG.doffs_px
    left_column = RIG.focal_px * x / z + RIG.cx_px
    mirrored = mirror_camera(RIG)
    assert mirrored.focal_px * (RIG.baseline_m - x) / z + mirrored.cx_px == pytest.approx(40 - right_column)
    # As its right eye, the left one has the principal point plus the same difference.
    assert mirrored.focal_px * -x / z + mirrored.cx_px + mirrored.doffs_px == pytest.approx(40 - left_column)
    assert mirror_camera(mirrored) == RIG


def test_a_sweep_trusts_what_moves_as_the_image_does():
    disparity = np.full(SHAPE, 5.0)
    shifts = iter(SWEPT_PX)
    follows = find_sweep_error(lambda *_: disparity + next(shifts), IMAGE, IMAGE, disparity)
    np.testing.assert_allclose(follows, 0, atol=1e-12)
    stays = find_sweep_error(lambda *_: disparity, IMAGE, IMAGE, disparity)
    np.testing.assert_allclose(np.exp(-stays), np.mean(np.exp(-np.array(SWEPT_PX))))
    assert np.isfinite(find_sweep_error(lambda *_: np.full(SHAPE, np.nan), IMAGE, IMAGE, disparity)).all()


def test_a_shift_is_linear_between_pixels_and_keeps_the_border():
    ramp = np.repeat(np.arange(0, 80, 2, dtype=np.uint8)[None], 3, axis=0)
    np.testing.assert_array_equal(shift_left(ramp, 0.5)[0, :-1], ramp[0, :-1] + 1)
    np.testing.assert_array_equal(shift_left(ramp, 3.0)[0], [*ramp[0, 3:], *[78] * 3])
    colour = np.stack([ramp, ramp // 2, ramp], axis=-1)
    np.testing.assert_array_equal(shift_left(colour, 2.25)[..., 0], shift_left(ramp, 2.25))


def test_errors_of_a_matcher_get_less_confidence():
    """The half of a plane where both eyes have noise of their own, so nothing can be matched, but SGBM answers."""
    left, right, truth = make_textured_pair(48, 96)
    for image in (left, right):
        image[24:] = RANDOM.integers(0, 256, (24, 96))
    options = check_options("sgbm", {"disparities": 32, "uniqueness": 0, "left_right": -1, "speckle_window": 0})
    disparity, valid, _ = match("sgbm", left, right, options)
    wrong = valid & ~(np.abs(disparity - truth) < 1)
    found = compute_black_box_confidence("left_right", "sgbm", left, right, disparity, options)
    assert ((found >= 0) & (found <= 1)).all()
    assert (found[~valid] == 0).all()
    assert found[valid & ~wrong].mean() > found[wrong].mean() + 0.2


def test_the_measures_that_need_runs_are_all_but_the_matchers_own():
    assert {OWN, *RUNS} == set(MEASURES)
