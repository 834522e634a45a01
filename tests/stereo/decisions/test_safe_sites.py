"""The map of a scene that is made by hand: level ground with a rock, a steep side, a rough strip, a hole, a shadow."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from icymoon.stereo.decisions.dem import Dem, Grid
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.decisions.safe_sites import (
    SAFE,
    choose_site,
    find_lit_cells,
    find_rocks,
    judge_pads,
    judge_sites,
    measure_layers,
)

CELL, RULE = 0.02, read_rules().site
SIZE = 160
#: Codes of ``Sites.failed``.
UNKNOWN, STEEP, ROUGH, ROCKS, REACH, DARK = range(1, 7)  # in the order in which the rules are asked


def scene(height):
    """The sites of heights on a square, all in reach and in light."""
    dem = Dem(Grid(CELL, height.shape[0], height.shape[1], 0.0, 0.0), height, np.isfinite(height).astype(int))
    return dem, np.full(height.shape, 90.0), np.ones(height.shape)


def layers_of(height):
    dem, margin, lit = scene(height)
    return measure_layers(dem, margin, lit, RULE)


def level():
    return np.zeros((SIZE, SIZE))


def test_level_ground_is_safe_but_for_its_border():
    sites = judge_sites(layers_of(level()), RULE)
    assert sites.safe[10:-10, 10:-10].all()
    assert (sites.failed[0] == UNKNOWN).all()
    assert sites.margin[80, 80] == 1.0


def test_each_rule_fails_where_it_is_broken():
    height, (dem, margin, lit) = level(), scene(level())
    row, column = np.mgrid[:SIZE, :SIZE]
    height[:, 120:] = np.tan(np.radians(20.0)) * CELL * (column[:, 120:] - 119)  # 20 degrees in the east
    height[130:, :60] += np.where((row + column)[130:, :60] % 2, 0.02, -0.02)  # 2 cm RMS in the south-west
    height[40:44, 40:44] = 0.1  # a rock
    height[90:106, 20:36] = np.nan  # a hole
    margin[:20, 60:80] = 5.0
    margin[20:30, 60:80] = np.nan
    lit[:, 90:110] = 0.0
    sites = judge_sites(measure_layers(replace(dem, height_m=height), margin, lit, RULE), RULE)
    for place, code in (
        ((80, 140), STEEP),
        ((145, 30), ROUGH),
        ((98, 28), UNKNOWN),
        ((12, 70), REACH),
        ((25, 70), REACH),
        ((60, 100), DARK),
        ((60, 70), SAFE),
    ):
        assert sites.failed[place] == code, place
    assert np.isneginf(sites.margin[25, 70])
    # Just beside the rock its own roughness fails too; a rock of one cell is too small for that.
    assert not sites.safe[42, 42]
    assert not sites.safe[42, 46]


def test_a_rock_of_a_cell_is_kept_away_from_by_its_distance():
    height = level()
    height[80, 80] = 0.04
    sites = judge_sites(layers_of(height), RULE)
    row, column = np.mgrid[:SIZE, :SIZE]
    far = CELL * np.hypot(row - 80, column - 80)
    inside = (slice(10, -10), slice(10, -10))
    assert ((sites.failed == ROCKS) == (far < RULE.rock_distance_m - 1e-6))[inside].all()


@pytest.mark.parametrize("slope", [0.0, 0.2])
def test_rocks_are_found_on_slopes_and_their_ground_is_not(slope):
    _row, column = np.mgrid[:SIZE, :SIZE]
    height, true = slope * CELL * column + 0.0, np.zeros((SIZE, SIZE), bool)
    true[50:62, 50:58] = true[100:104, 110:114] = True
    height[true] += 0.05
    assert (find_rocks(height, CELL, RULE) == true).all()


def test_rocks_are_found_beside_taller_ones():
    """A rock of 2 m lifts the plane of the ground above one of 10 cm, and that one lifts it above one of 4 cm."""
    height = level()
    for column, tall_m in ((70, 2.0), (77, 0.1), (84, 0.04)):
        height[70:80, column : column + 6] = tall_m
    assert (find_rocks(height, CELL, RULE) == (height > 0)).all()


def test_a_lower_rule_takes_no_more_cells():
    random = np.random.default_rng(5)
    height = level() + random.normal(0, 0.004, (SIZE, SIZE)) + 0.1 * np.sin(np.mgrid[:SIZE, :SIZE][0] / 9)
    layers = layers_of(height)
    wide = judge_sites(layers, RULE).safe
    for key, value in (("slope_deg", 8.0), ("roughness_m", 0.004), ("rock_distance_m", 0.3), ("known_share", 1.0)):
        strict = judge_sites(layers, replace(RULE, **{key: value})).safe
        assert not (strict & ~wide).any()
    assert 0 < wide.sum() < wide.size


def test_margins_rank_sites_that_are_known_as_a_whole():
    """Two thirds of the limit remain at 5 of 15 degrees, and half of the room from 0.9 to 1 at a share of 0.95."""
    height = np.tan(np.radians(5.0)) * CELL * np.mgrid[:SIZE, :SIZE][1]
    layers = layers_of(height)
    assert judge_sites(layers, RULE).margin[80, 80] == pytest.approx(2 / 3)
    for key, share, margin in (
        ("known_share", 0.95, 0.5),
        ("lit_share", 0.9, 0.5),
        ("known_share", 0.9, 0.0),
        ("known_share", 0.81, -0.1),  # below the limit the unit is the limit, as for all rules
        ("lit_share", 0.4, -0.5),
    ):
        found = judge_sites(replace(layers, **{key: np.full(height.shape, share)}), RULE)
        assert found.margin[80, 80] == pytest.approx(margin)
        assert found.safe[80, 80] == (margin >= 0)
    whole = replace(RULE, known_share=1.0)
    assert judge_sites(layers, whole).margin[80, 80] == pytest.approx(2 / 3)


def test_light_that_is_not_asked_loses_no_site():
    layers = layers_of(level())
    night = replace(layers, lit_share=np.zeros((SIZE, SIZE)))
    assert not judge_sites(night, RULE).safe.any()
    asked_nothing = judge_sites(night, replace(RULE, lit_share=0.0))
    assert (asked_nothing.safe == judge_sites(layers, RULE).safe).all()
    unknown = replace(layers, lit_share=np.full((SIZE, SIZE), np.nan))
    assert (judge_sites(unknown, replace(RULE, lit_share=0.0)).safe == asked_nothing.safe).all()


def test_the_choice_is_the_best_and_of_equals_the_nearest_to_the_middle():
    sites = judge_sites(layers_of(level()), RULE)
    assert choose_site(sites, np.ones((SIZE, SIZE), bool)) == (79, 79)
    best = replace(sites, margin=np.minimum(sites.margin, 0.4))
    best.margin[30, 40] = 0.5
    assert choose_site(best, np.ones((SIZE, SIZE), bool)) == (30, 40)
    assert choose_site(best, np.zeros((SIZE, SIZE), bool)) is None


@pytest.mark.parametrize(
    ("toward", "step"), [((1, 0), (0, -1)), ((0, 1), (1, 0)), ((-1, 0), (0, 1)), ((0, -1), (-1, 0))]
)
def test_a_wall_casts_a_shadow_of_its_height_over_the_tangent(toward, step):
    height = level()
    height[78:82, 78:82] = 0.2
    up = np.tan(np.radians(30.0))
    sun = np.array([*toward, up]) / np.hypot(1, up)
    lit = find_lit_cells(height, CELL, sun)
    shadow = lit == 0.0
    cells = int(0.2 / up / CELL)  # 17.3
    assert shadow.sum() == 4 * cells
    row, column = np.nonzero(shadow)
    assert np.sign(row.mean() - 79.5) == step[0]
    assert np.sign(column.mean() - 79.5) == step[1]


@pytest.mark.parametrize(("elevation_deg", "cells"), [(85.0, 0), (80.0, 1), (70.0, 3), (30.0, 17)])
def test_a_shadow_begins_at_the_next_cell(elevation_deg, cells):
    """A rock of 20 cm and one cell: 0.2 m / tan(elevation), in whole cells of 2 cm."""
    height, elevation = level(), np.radians(elevation_deg)
    height[80, 80] = 0.2
    lit = find_lit_cells(height, CELL, np.array([np.cos(elevation), 0.0, np.sin(elevation)]))
    assert np.argwhere(lit == 0.0).tolist() == [[80, column] for column in range(80 - cells, 80)]


@pytest.mark.parametrize("shape", [(3, 40), (40, 3)])
@pytest.mark.parametrize("toward", [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
def test_a_shadow_ends_with_the_map(shape, toward):
    """A rock that is much taller than the map is wide: all cells behind it are dark, those beside it are not."""
    height = np.zeros(shape)
    height[1, 1] = 50.0
    lit = find_lit_cells(height, CELL, np.array([*toward, 0.5]) / np.hypot(1, 0.5))
    row, column = np.indices(shape)
    ahead = (column - 1) * toward[0] - (row - 1) * toward[1]
    beside = (column - 1) * toward[1] + (row - 1) * toward[0]
    np.testing.assert_array_equal(lit == 0.0, (beside == 0) & (ahead < 0))


def _march(height, toward):
    """Light by rays in steps of a fiftieth of a cell over the bilinear surface; True where nothing stands before it."""
    level = float(np.hypot(*toward[:2]))
    row_step, column_step, rise = -toward[1] / level, toward[0] / level, toward[2] / level * CELL
    rows, columns = (each.astype(float) for each in np.indices(height.shape))
    lit = np.ones(height.shape, bool)
    for way in np.arange(1, 50 * max(height.shape)) / 50:
        row, column = rows + row_step * way, columns + column_step * way
        inside = (row >= 0) & (row <= len(height) - 1) & (column >= 0) & (column <= height.shape[1] - 1)
        if not inside.any():
            break
        r, c = (
            np.clip(np.floor(each), 0, size - 2).astype(int)
            for each, size in zip((row, column), height.shape, strict=True)
        )
        u, v = row - r, column - c
        above = (1 - u) * ((1 - v) * height[r, c] + v * height[r, c + 1])
        above += u * ((1 - v) * height[r + 1, c] + v * height[r + 1, c + 1])
        lit &= ~inside | (above <= height + rise * way + 1e-12)
    return lit


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize("azimuth_deg", [0.0, 17.0, 45.0, 70.0, 123.0, 200.0, 261.0, 338.0])
def test_light_on_rough_ground_is_that_of_a_ray_march(azimuth_deg):
    random = np.random.default_rng(int(azimuth_deg))
    rough = random.standard_normal((60, 70)) + np.cumsum(random.standard_normal((60, 70)), axis=1) / 3
    height = 0.08 * cv2.GaussianBlur(rough, (0, 0), 2.0)  # waves of some cells, as a map of ground has them
    azimuth, elevation = np.radians(azimuth_deg), np.radians(20.0)
    sun = np.array([np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
    marched = _march(height, sun)
    assert 0.2 < marched.mean() < 0.9
    # Between rows and columns the bilinear surface bulges a little. Rounding to whole cells differed by 2 to 6 %.
    assert np.mean((find_lit_cells(height, CELL, sun) == 1.0) != marched) < 0.01


def test_a_hole_in_the_map_casts_no_shadow():
    height = level()
    height[60:70, 60:70] = np.nan
    height[0, 0] = 1.0  # so that shadows are looked for
    lit = find_lit_cells(height, CELL, np.array([0.8, 0.0, 0.6]))
    assert np.isnan(lit[60:70, 60:70]).all()
    assert (lit[50:80][np.isfinite(height[50:80])] == 1.0).all()


def test_light_from_above_and_from_below():
    height = np.random.default_rng(2).random((30, 30))
    assert (find_lit_cells(height, CELL, np.array([0.0, 0.0, 1.0])) == 1.0).all()
    assert (find_lit_cells(height, CELL, np.array([0.8, 0.0, -0.6])) == 0.0).all()
    height[3, 4] = np.nan
    assert np.isnan(find_lit_cells(height, CELL, np.array([0.6, 0.0, 0.8]))[3, 4])


def test_pads_stand_on_level_ground_without_rocks():
    _row, column = np.mgrid[:SIZE, :SIZE]
    height = np.tan(np.radians(12.0)) * CELL * np.maximum(column - 100.0, 0)
    height[40:44, 40:44] = 0.4
    height[100:140, 20:60] = np.nan
    dem, _, _ = scene(height)
    found = judge_pads(dem, 0.3, 20.0, 0.3, 0.9)
    assert found[120, 40] == 1
    assert found[80, 70] == 0
    assert found[42, 42] == 3
    assert found[42, 47] != 0
    assert judge_pads(dem, 0.3, 10.0, 0.3, 0.9)[80, 140] == 2
    assert found[80, 140] == 0
