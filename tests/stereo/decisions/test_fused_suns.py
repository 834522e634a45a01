"""The study of several Suns: its Suns, its images, and its counts by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from icymoon.benchmarks.common.ray_grounds import CALIBRATION, ROW_SHAPE, draw_grounds
from icymoon.benchmarks.stereo import fused_suns as study
from icymoon.physics.light.sky import elevation_deg
from icymoon.stereo.decisions.scores import THRESHOLDS
from icymoon.stereo.decisions.stored_maps import TRUE_DEPTH
from icymoon.stereo.learning.grounds import build_ground, release_ground
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.report.row_log import RowLog


def make_row(safe, taken, unsafe):
    """A row whose cells all have the margin 0.5: ``taken`` cells, of which some are unsafe."""
    reached = [threshold <= 0.5 for threshold in THRESHOLDS]
    sites = {
        "cells": [100, safe, taken, taken - unsafe],
        "taken_from": [taken * each for each in reached],
        "unsafe_from": [unsafe * each for each in reached],
    }
    return {"numbers": {"sites": sites}}


def find_sun(image: Any) -> tuple[float, ...]:
    """The direction to the Sun of a prepared pair."""
    return tuple(image.pair.sun.direction)


def test_suns_are_of_one_day_and_as_high_as_in_training():
    random, last_in_the_morning = np.random.default_rng(0), 0
    for _ in range(30):
        suns = study.draw_suns(random)
        assert suns.shape == (4, 3)
        np.testing.assert_allclose(np.linalg.norm(suns, axis=1), 1.0)
        assert min(elevation_deg(sun) for sun in suns) > study.MIN_SUN_DEG - 2.0  # a step is 1.5 degrees
        assert max(elevation_deg(sun) for sun in suns) < 70
        assert len({tuple(sun) for sun in suns}) == 4
        last_in_the_morning += suns[-1, 0] > 0
    # Of 30 fair coins, fewer than 6 or more than 24 heads come up in less than 1 of 1000 runs; the seed is fixed.
    assert 5 < last_in_the_morning < 25


def test_shares_are_counted_by_hand():
    lost, unsafe = study.find_shares([make_row(20, 12, 2), make_row(0, 3, 3), make_row(10, 0, 0)])
    half = THRESHOLDS.index(0.5)
    assert lost[0, half:] == pytest.approx(0.5)
    assert lost[0, :half] == pytest.approx(1.0)
    assert np.isnan(lost[1]).all()
    assert lost[2] == pytest.approx(1.0)
    assert unsafe[:, -1] == pytest.approx([2 / 12, 1.0, 0.0])
    assert (unsafe[:, :half] == 0).all()


def test_the_margin_of_equal_risk_is_the_lowest_that_keeps_it():
    steps = np.zeros((2, len(THRESHOLDS)))
    steps[:, 60:] = 0.1
    steps[0, 80:] = 0.5  # in the mean 0.3
    steps[:, 90:] = 0.0  # lower margins look safer again, which does not count
    assert study.find_equal_margin(steps, 0.2) == 79
    assert study.find_equal_margin(steps, 0.3) == len(THRESHOLDS) - 1
    assert study.find_equal_margin(steps, 0.0) == 59


def test_a_mean_image_is_the_mean_of_the_images(monkeypatch):
    pairs: Any = [
        SimpleNamespace(left=np.full((2, 2), k, np.uint8), right=np.full((2, 2), 10 * k, np.uint8)) for k in (1, 3)
    ]
    monkeypatch.setattr(study, "replace", lambda pair, **images: SimpleNamespace(**images))
    mean = study.average_images(pairs)
    assert (mean.left == 2).all()
    assert (mean.right == 20).all()


@pytest.mark.left_to_ci
def test_arms_differ_in_what_they_should():
    """The first image is shared, the fixed pattern too; noise and light differ."""
    ground = build_ground(draw_grounds(0, 2, 0, 0)[CALIBRATION][1])
    try:
        workspace, images = study.look_under_suns(ground)
    finally:
        release_ground(ground)
    first = workspace.prepared
    assert [len(images[arm]) for arm in study.ARMS] == [1, 1, 4, 1, 4]
    assert images[study.ONE][0] is images[study.SAME][0] is images[study.SUNS][0] is first
    suns = [find_sun(image) for image in images[study.SUNS]]
    assert len(set(suns)) == 4
    assert {find_sun(image) for image in (*images[study.SAME], *images[study.FINER])} == {suns[0]}
    for image in (*images[study.SAME][1:], *images[study.SUNS][1:]):
        assert image.truth is first.truth
        assert (image.left != first.left).mean() > 0.3
    # More rays come nearer to the mean of four images than these come to each other.
    spread = np.std([image.left.astype(float) for image in images[study.SAME]], axis=0).mean()
    finer = np.abs(images[study.FINER][0].left - images[study.MEAN][0].left.astype(float)).mean()
    assert finer < spread


@pytest.mark.left_to_ci
def test_a_second_start_takes_the_rows_of_the_first(tmp_path):
    """Rows that are made again would have other CPU seconds."""
    recipe, methods = draw_grounds(0, 2, 0, 0)[CALIBRATION][1], parse_methods("bm")
    arms = [study.ONE, study.SAME, study.SUNS]
    logs = {arm: RowLog(tmp_path / f"{arm}.jsonl", ROW_SHAPE) for arm in arms}
    rows = study.make_rows(recipe, methods, logs, arms)
    assert [row["method"] for row in rows[study.ONE]] == [TRUE_DEPTH, "bm"]
    assert [len(rows[arm]) for arm in arms] == [2, 1, 1]
    assert study.make_rows(recipe, methods, logs, arms) == rows
