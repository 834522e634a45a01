"""Loose material against its laws: a straight slope, a cone, and no gram lost."""

import math

import numpy as np
import pytest
from icymoon.physics.excavation.dig_grid import make_covering_grid
from icymoon.physics.excavation.heap import SpoilHeap, cone_size_m
from icymoon.physics.gravity.slide_to_repose import GroundLayers, _list_disjoint_pairs, relax_slopes

REPOSE = 38.0
TANGENT = math.tan(math.radians(REPOSE))


def slopes_deg(top, cell):
    north, east = np.gradient(top, cell)
    return np.degrees(np.arctan(np.hypot(north, east)))


@pytest.mark.parametrize(("down", "right"), [(1, 0), (1, 1), (1, -1), (2, 1), (2, -1)])
def test_pairs_are_disjoint_and_complete(down, right):
    cells = np.arange(9 * 7).reshape(9, 7)
    found = []
    for a, b in _list_disjoint_pairs(cells.shape, down, right):
        both = np.concatenate([cells[a].ravel(), cells[b].ravel()])
        assert len(np.unique(both)) == len(both)
        found += list(zip(cells[a].ravel().tolist(), cells[b].ravel().tolist(), strict=True))
    wanted = {(j * 7 + i, (j + down) * 7 + i + right) for j in range(9 - down) for i in range(7) if 0 <= i + right < 7}
    assert len(found) == len(wanted)
    assert set(found) == wanted


def test_a_wall_becomes_a_straight_slope_through_its_middle():
    # What is missing above the middle lies below it, so a straight slope meets the wall's place at half its height.
    cell, height = 0.005, 0.1
    ground = np.repeat(np.where(np.arange(120) < 60, height, 0.0)[None, :], 8, axis=0)
    layers = GroundLayers(ground.copy(), np.zeros_like(ground))
    relax_slopes(layers, cell, REPOSE, stood_m=np.full_like(ground, height))
    profile = layers.top[4]
    slope = -np.diff(profile) / cell
    on_it = (profile[1:] < 0.8 * height) & (profile[1:] > 0.2 * height)
    # Sweeps end at 3 % of a cell's rise.
    np.testing.assert_allclose(slope[on_it], TANGENT, rtol=0.08)
    assert np.interp(0.5 * height, profile[::-1], np.arange(120)[::-1] + 0.5) == pytest.approx(60.0, abs=1.0)
    assert layers.top.sum() == pytest.approx(ground.sum(), rel=1e-12)


def test_a_block_becomes_a_cone():
    cell, grid = 0.005, make_covering_grid(-0.3, -0.3, 0.3, 0.3, 0.005)
    spoil = np.zeros((grid.rows, grid.columns))
    spoil[50:71, 50:71] = 0.25
    volume = spoil.sum() * cell**2
    layers = GroundLayers(np.zeros_like(spoil), spoil)
    relax_slopes(layers, cell, REPOSE)
    height, radius = cone_size_m(volume, REPOSE)
    # 16 directions make a cone of 16 sides, a few per cent off, and sweeps end at 3 % of a cell's rise.
    assert layers.spoil.max() == pytest.approx(height, rel=0.05)
    area = (layers.spoil > 0.02 * height).sum() * cell**2
    assert math.sqrt(area / math.pi) == pytest.approx(radius, rel=0.05)
    assert layers.spoil.sum() * cell**2 == pytest.approx(volume, rel=1e-12)


def test_no_slope_stays_steeper_than_the_angle_of_repose():
    random = np.random.default_rng(3)
    spoil = np.zeros((80, 80))
    spoil[30:50, 30:50] = random.uniform(0.05, 0.15, (20, 20))
    layers = GroundLayers(np.zeros_like(spoil), spoil)
    relax_slopes(layers, 0.005, REPOSE)
    # 16 directions: a slope between two of them may be 1 / cos 13.3° steeper by its tangent, so 38.8°, and the end of
    # the sweeps adds up to 1°.
    assert slopes_deg(layers.top, 0.005).max() < 40.5


def test_spoil_on_standing_ground_leaves_the_ground_as_it_is():
    ground = np.where(np.arange(40)[None, :] < 20, 0.2, 0.0) * np.ones((30, 1))
    spoil = np.where((np.arange(40)[None, :] > 14) & (np.arange(40)[None, :] < 20), 0.05, 0.0) * np.ones((30, 1))
    layers = GroundLayers(ground.copy(), spoil.copy())
    relax_slopes(layers, 0.005, REPOSE)
    np.testing.assert_array_equal(layers.ground, ground)
    assert layers.spoil.min() >= 0
    assert layers.spoil[:, 20:].sum() > 0.01  # it fell over the edge
    assert layers.spoil.sum() == pytest.approx(spoil.sum(), rel=1e-12)


def test_ground_that_slides_grows_and_keeps_its_mass():
    ground = np.where(np.arange(80)[None, :] < 40, 0.1, 0.0) * np.ones((20, 1))
    layers = GroundLayers(ground.copy(), np.zeros_like(ground))
    relax_slopes(layers, 0.005, REPOSE, 1.5, np.full_like(ground, 0.1))
    lost = (ground - layers.ground).sum()
    assert lost > 1.0
    assert layers.spoil.sum() / 1.5 == pytest.approx(lost, rel=1e-12)


def test_gentle_ground_stays_as_it_is():
    layers = GroundLayers(np.zeros((20, 20)) + 0.5 * 0.005 * np.arange(20), np.full((20, 20), 0.01))
    before = layers.copy()
    assert relax_slopes(layers, 0.005, REPOSE, 1.4, np.full((20, 20), 0.3)) == (0, True)
    np.testing.assert_array_equal(layers.top, before.top)


def test_a_heap_has_its_volume_and_grows():
    grid = make_covering_grid(-0.4, -0.4, 0.4, 0.4, 0.005)
    heap = SpoilHeap((-0.1, 0.0), (0.1, 0.05), REPOSE)
    small, large = (heap.thickness(grid, v) for v in (0.002, 0.003))
    assert small.sum() * 0.005**2 == pytest.approx(0.002, rel=1e-12)
    assert (large - small).min() > -1e-6
    # Its volume is made exact, which makes it up to 3 % higher on cells of 5 mm.
    assert slopes_deg(large, 0.005).max() < REPOSE + 1.0


def test_only_ground_that_may_slide_does_so_however_steep_the_rest_is():
    # A slope steeper than friction, which stood: a cut at its foot would have all of it slide, sweep after sweep.
    ground = np.repeat(1.5 * TANGENT * 0.005 * np.arange(120)[None, :], 8, axis=0)
    dug = ground.copy()
    dug[:, 20:30] -= 0.05
    slides = np.zeros(ground.shape, bool)
    slides[:, 12:38] = True
    layers = GroundLayers(dug.copy(), np.zeros_like(ground))
    relax_slopes(layers, 0.005, REPOSE, 1.0, ground, slides)
    np.testing.assert_array_equal(layers.ground[~slides], dug[~slides])
    assert (layers.ground[slides] < dug[slides] - 1e-3).any()
    assert layers.top.sum() == pytest.approx(dug.sum(), rel=1e-12)


def test_spoil_on_steep_rough_ground_comes_to_rest():
    # Rougher and steeper than any terrain here: 400 sweeps between neighbours were not enough.
    random = np.random.default_rng(5)
    north = np.arange(70)[:, None] * np.ones((1, 60))
    ground = 0.8 * 0.005 * north + random.normal(0.0, 0.03, (70, 60))
    spoil = np.where((north > 40) & (north < 60), 0.1, 0.0)
    layers = GroundLayers(ground.copy(), spoil.copy())
    _, rests = relax_slopes(layers, 0.005, REPOSE)
    assert rests
    np.testing.assert_array_equal(layers.ground, ground)
    assert layers.spoil.sum() == pytest.approx(spoil.sum(), rel=1e-12)
    # Where both of two neighbours have spoil to give, none is steeper than it may be, but for the end of the sweeps.
    drop = np.diff(layers.top, axis=0)
    upper = np.where(drop > 0, layers.spoil[1:], layers.spoil[:-1])
    assert np.abs(drop)[upper > 1e-3].max() < 1.1 * TANGENT * 0.005


def test_strides_end_where_neighbours_end(monkeypatch):
    # Both ways to rest fulfil the same limits; where they leave a heap differs by less than a stride.
    from icymoon.physics.gravity import slide_to_repose as module

    ground = np.add.outer(0.8 * 0.005 * np.arange(60), np.zeros(40))
    spoil = np.zeros_like(ground)
    spoil[35:45, 10:30] = 0.06
    ends = []
    for sweeps in (10, 20_000):
        monkeypatch.setattr(module, "_MAX_SWEEPS", sweeps)
        layers = GroundLayers(ground.copy(), spoil.copy())
        assert relax_slopes(layers, 0.005, REPOSE)[1]
        ends.append(layers.top)
    assert np.abs(ends[0] - ends[1]).max() < max(module._STRIDES) * 0.005
    assert ends[0].sum() == pytest.approx(ends[1].sum(), rel=1e-12)


def test_sweeps_that_end_early_are_known(monkeypatch):
    from icymoon.physics.gravity import slide_to_repose as module

    monkeypatch.setattr(module, "_MAX_SWEEPS", 10)
    monkeypatch.setattr(module, "_MAX_CYCLES", 0)
    layers = GroundLayers(np.zeros((60, 60)), np.zeros((60, 60)))
    layers.spoil[25:35, 25:35] = 0.5
    assert not relax_slopes(layers, 0.005, REPOSE)[1]
