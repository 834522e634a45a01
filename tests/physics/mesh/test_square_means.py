"""Means over squares are those of the surface between pixels, from blocks in any order, and a map goes over into
another without a step."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from icymoon.physics.mesh.blend_maps import LevelMeans, blend_maps
from icymoon.physics.mesh.nested_rings import Level
from icymoon.physics.mesh.square_means import Squares, SquareSums

AT = np.linspace(20.0, 60.0, 9) + 0.37


def measure(values, half, at=AT, cuts=(0, 100)):
    squares = Squares(at, at, (half, half))
    sums = SquareSums(squares, squares.widened(4.0))
    for start, stop in pairwise(cuts):
        for left, right in pairwise(cuts):
            sums.add(values[start:stop, left:right], start, left)
    return sums


@pytest.mark.parametrize("half", [1 / 32, 0.4, 1.7, 4.2])
def test_a_plane_keeps_its_heights(half):
    row, column = np.mgrid[:100, :100]
    found = measure(1000.0 + 3.0 * column - 2.0 * row, half)
    np.testing.assert_allclose(found.means, 1000.0 + 3.0 * AT[None, :] - 2.0 * AT[:, None], atol=1e-6)
    assert found.wide_share.min() == pytest.approx(1.0)


def test_a_square_of_whole_pixels_has_their_mean():
    """From centre to centre, by the trapezium rule, which is exact on a surface that is bilinear between centres."""
    values = np.random.default_rng(1).normal(size=(100, 100))
    found = measure(values, 6.0, np.array([40.0, 55.0]))
    weights = np.ones(13)
    weights[[0, -1]] = 0.5
    wanted = (values[34:47, 49:62] * np.outer(weights, weights)).sum() / 144.0
    assert found.means[0, 1] == pytest.approx(wanted, rel=1e-12)


def test_blocks_add_up_to_the_whole():
    values = np.random.default_rng(2).normal(size=(100, 100))
    values[30:37, 40:44] = np.nan
    whole, parts = measure(values, 3.3), measure(values, 3.3, cuts=(0, 7, 31, 41, 90, 100))
    np.testing.assert_allclose(parts.means, whole.means, atol=1e-12)
    np.testing.assert_allclose(parts.wide_share, whole.wide_share, atol=1e-12)


def test_missing_pixels_do_not_count():
    values = np.full((100, 100), 5.0)
    values[:, 50:] = np.nan
    found = measure(values, 2.0, np.array([30.0, 49.5, 70.0]))
    np.testing.assert_allclose(found.means[:, :2], 5.0)
    assert np.isnan(found.means[:, 2]).all()
    # Half of a square at an edge is known.
    np.testing.assert_allclose(found.wide_share, [[1.0, 0.5, 0.0]] * 3, atol=1e-12)


LEVELS = [Level(40.0, 1.0, 0, 80)]


def edge_of_map(level, at_m, heights):
    """A map west of ``at_m`` with squares of 16 m for its share."""
    share = np.clip(0.5 + (at_m - level.axis_m) / 16.0, 0.0, 1.0)
    there = level.axis_m <= at_m
    return LevelMeans(np.where(there, heights, np.nan), np.broadcast_to(share, (81, 81)))


def test_the_mean_offset_is_evened_out_over_the_band_and_nothing_steps():
    (level,) = LEVELS
    x = np.broadcast_to(level.axis_m, (81, 81))
    fine, coarse = edge_of_map(level, 10.0, 0.1 * x + 7.0), LevelMeans(0.1 * x - 23.0, np.ones((81, 81)))
    blended = blend_maps(LEVELS, [fine], [coarse])
    assert blended.offset_m == pytest.approx(30.0)
    assert blended.apart_m == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(blended.heights_m[0], 0.1 * x + 7.0, atol=1e-9)


def test_the_fine_map_counts_alone_beyond_the_band_and_the_coarse_one_beyond_the_edge():
    (level,) = LEVELS
    bumpy = np.random.default_rng(3).normal(size=(81, 81))
    fine, coarse = edge_of_map(level, 10.0, bumpy), LevelMeans(np.full((81, 81), 4.0), np.ones((81, 81)))
    blended = blend_maps(LEVELS, [fine], [coarse])
    inside, beyond = level.axis_m <= 2.0, level.axis_m > 10.0
    np.testing.assert_array_equal(blended.heights_m[0][:, inside], bumpy[:, inside])
    np.testing.assert_allclose(blended.heights_m[0][:, beyond], 4.0 + blended.offset_m)


def test_a_small_gap_is_filled_and_a_wide_one_is_the_coarse_maps():
    heights, share = np.full((81, 81), 2.0), np.ones((81, 81))
    heights[10, 10] = np.nan
    heights[40:60, 40:60], share[40:60, 40:60] = np.nan, 0.2
    share[39, 30:70] = 0.9
    blended = blend_maps(LEVELS, [LevelMeans(heights, share)], [LevelMeans(np.full((81, 81), 9.0), np.ones((81, 81)))])
    assert blended.heights_m[0][10, 10] == pytest.approx(2.0)
    assert blended.offset_m == pytest.approx(-7.0)
    np.testing.assert_allclose(blended.heights_m[0], 2.0)
    alone = blend_maps(LEVELS, [LevelMeans(heights, share)], None)
    assert np.isnan(alone.heights_m[0]).sum() == 400
    assert alone.offset_m is None
