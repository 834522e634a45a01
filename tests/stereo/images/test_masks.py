"""Masks of polygons and hulls, and how they agree."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.stereo.images.masks import (
    compute_intersection_over_union,
    fill_hulls,
    fill_polygons,
    measure_distance_inside_hull_px,
)

SQUARE = np.array([[2.0, 3.0], [7.0, 3.0], [7.0, 9.0], [2.0, 9.0]])


def test_a_fine_fill_has_the_pixels_whose_middles_are_inside():
    mask = fill_polygons((12, 10), [SQUARE], finer=5)
    expected = np.zeros((12, 10), bool)
    expected[3:9, 2:7] = True
    assert np.array_equal(mask, expected)
    # A coarse one has those that an edge touches too, never fewer.
    assert (fill_polygons((12, 10), [SQUARE]) >= expected).all()


def test_fills_of_one_shape_agree():
    circle = 20 + 12.3 * np.stack([np.cos(np.linspace(0, 6.28, 90)), np.sin(np.linspace(0, 6.28, 90))], axis=1)
    fine = fill_polygons((40, 40), [circle], finer=5)
    assert fine.sum() == pytest.approx(math.pi * 12.3**2, rel=0.02)
    of_hull = fill_hulls((40, 40), [circle])
    assert compute_intersection_over_union(fill_polygons((40, 40), [circle]), of_hull) > 0.97
    assert compute_intersection_over_union(fine, of_hull) > 0.88  # half a pixel all around is 8 %


def test_overlap():
    one, other = np.zeros((4, 4), bool), np.zeros((4, 4), bool)
    assert math.isnan(compute_intersection_over_union(one, other))
    one[:2], other[1:3] = True, True
    assert compute_intersection_over_union(one, other) == pytest.approx(1 / 3)
    assert compute_intersection_over_union(one, one) == 1.0


def test_how_far_inside():
    assert measure_distance_inside_hull_px(np.array([4.0, 6.0]), SQUARE) == pytest.approx(2.0)
    assert measure_distance_inside_hull_px(np.array([0.0, 6.0]), SQUARE) == pytest.approx(-2.0)
