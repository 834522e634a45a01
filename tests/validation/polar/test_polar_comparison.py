"""What the comparison states beside its numbers: how outlines of rocks and tips of shadows agree with themselves."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.validation.polar.data_set import ROCK, Polygon, Terrain, View
from icymoon.validation.polar.label_agreement import compare_rock_labels
from icymoon.validation.polar_comparison import _compare_labelled_tips


def test_copied_outlines_do_not_agree_with_themselves():
    square = np.array([[400.0, 300.0], [600.0, 300.0], [600.0, 400.0], [400.0, 400.0]])
    view = View("A", "L")

    def again(*drawn):
        terrain = Terrain(
            "07",
            (),
            {(view, azimuth): (Polygon(ROCK, each),) for azimuth, each in zip((30, 180, 270), drawn, strict=True)},
        )
        return compare_rock_labels(terrain, "A")

    assert again(square, square, square) == []
    # A fifth of its width to the right: 160 of 240 columns are in both. The third is a copy of the first.
    assert again(square, square + np.array([40.0, 0.0]), square) == pytest.approx([2 / 3] * 2, abs=0.01)


def test_tips_of_two_eyes_and_of_two_positions():
    a, b = (View("A", "L"), View("A", "R")), (View("B", "L"), View("B", "R"))
    reaches = {(a[0], 30, 0): 1.02, (a[1], 30, 0): 1.0, (b[0], 30, 0): 1.111, (b[1], 30, 0): 1.111, (a[0], 30, 1): 1.0}
    eyes, positions = _compare_labelled_tips(reaches)
    assert eyes == pytest.approx(0.01)  # between 0.02 and 0
    assert positions == pytest.approx(1 - 1.01 / 1.111)
    assert np.isnan(_compare_labelled_tips({(a[0], 30, 0): 1.0})).all()
