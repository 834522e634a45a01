"""Parts of walls that fail: volumes, slopes, and where they lie."""

import functools
import math

import numpy as np
import pytest
from icymoon.physics.excavation import dig_site as sites
from icymoon.physics.excavation.dig import ExcavationSeries
from icymoon.physics.excavation.dig_grid import ExcavationGrid
from icymoon.physics.excavation.scoop_cut import Pull
from icymoon.physics.excavation.wall_slump import find_failed_m, find_retreat_m, make_strength
from icymoon.settings import description

FRICTION_DEG, BULKING = 38.0, 1.4
#: Walls of up to 0.19 m stand; the trench is 0.12 m deep.
DUG = {
    "path": "LINE",
    "states": 3,
    "bite_m": 0.06,
    "length_m": 0.6,
    "width_m": 0.2,
    "start_y_m": 0.3,
    "cell_m": 0.005,
    "chips_m": 0.0,
    "cohesion_pa": 15.0,
    "heap_gap_m": 0.3,
    "slump": 1.0,
}


@functools.cache
def series(**changes):
    settings = description.merged(
        description.defaults(), description.check({"excavation": DUG | changes, "light": {"body": "EUROPA"}}, "test")
    )
    site = sites.make_site(settings)
    return ExcavationSeries(site, settings.excavation, 1, np.zeros((site.grid.rows, site.grid.columns)))


def apron(made):
    """The part of the last state within the longest retreat of the trench, without the heap: ground and spoil."""
    retreat = find_retreat_m(0.12, FRICTION_DEG)
    window = made.site.grid.window(-0.1 - retreat, -0.3 - retreat, 0.1 + retreat, 0.3 + retreat)
    layers = made.at(2).layers
    return layers.ground[window], layers.spoil[window]


def test_ground_that_breaks_off_lies_in_the_trench_with_its_mass():
    made, area = series(states=2, bite_m=0.12), 0.005**2
    facts, retreat = made.facts(1), find_retreat_m(0.12, FRICTION_DEG)
    window = made.site.grid.window(-0.1 - retreat, -0.3 - retreat, 0.1 + retreat, 0.3 + retreat)
    ground, spoil = (each[window] for each in (made.at(1).layers.ground, made.at(1).layers.spoil))
    assert facts["slid_m3"] > 1e-4
    assert -float(ground.sum()) * area == pytest.approx(0.12 * 0.2 * 0.6 + facts["slid_m3"], rel=1e-9)
    assert float(spoil.sum()) * area == pytest.approx(BULKING * facts["slid_m3"], rel=1e-9)
    assert facts["walls"] == "stand"


def test_what_broke_off_after_a_bite_is_dug_by_the_next_with_its_mass():
    made = series()
    facts, plain = made.facts(2), series(slump=0.0).facts(2)
    assert made.mass_error(2) < 1e-12
    assert facts["spoil_m3"] == pytest.approx(plain["spoil_m3"] + BULKING * facts["slid_m3"], rel=1e-9)
    assert facts["change_in_patch_by_state_m3"][-1] == pytest.approx(
        (BULKING - 1.0) * (0.12 * 0.2 * 0.6 + facts["slid_m3"]), rel=1e-9
    )


def test_an_apron_is_no_steeper_than_the_angle_of_friction():
    made = series()
    layers = made.at(2).layers
    top, thick = layers.top, layers.spoil > 1e-3
    for axis in (0, 1):
        slope = np.degrees(np.arctan(np.abs(np.diff(top, axis=axis)) / 0.005))
        # Both cells have spoil, and the lower one is not the foot of a bare face.
        both = np.logical_and(*(np.take(thick, np.arange(n, top.shape[axis] - 1 + n), axis) for n in (0, 1)))
        bare = np.maximum(*(np.take(layers.ground, np.arange(n, top.shape[axis] - 1 + n), axis) for n in (0, 1)))
        lower = np.minimum(*(np.take(top, np.arange(n, top.shape[axis] - 1 + n), axis) for n in (0, 1)))
        assert both.sum() > 100
        assert slope[both & (bare <= lower)].max() < FRICTION_DEG + 2.5  # as of spoil, see test_slide_to_repose


def test_the_edge_retreats_unevenly_and_no_farther_than_culmanns_wedge():
    ground, _ = apron(series())
    lost = ground < -1e-6
    rows = lost[40:-40]  # away from the ends
    retreat = 0.5 * (rows.sum(axis=1) * 0.005 - 0.2)
    assert retreat.max() <= find_retreat_m(0.12, FRICTION_DEG) + 0.005
    assert retreat.min() < 0.01 < 0.02 < retreat.max()
    series.cache_clear()
    np.testing.assert_array_equal(ground, apron(series())[0])


def test_a_wall_breaks_off_above_the_height_that_stands_on_culmanns_plane():
    grid = ExcavationGrid(-0.3025, -0.3025, 122, 122, 0.005)
    flat = np.zeros((122, 122))
    pull = Pull(0.0, -1.0, 0.0, 0.1, np.array([0.0, 2.0]), np.array([0.15, 0.15]))
    failed = find_failed_m(grid, flat, flat, [pull], np.full_like(flat, 0.09), FRICTION_DEG)
    out = np.abs(grid.east_m) - 0.05
    plane = -0.15 + 0.09 + out * math.tan(math.radians(45.0 + FRICTION_DEG / 2.0))
    expected = np.where(out > 0.0, np.maximum(-plane, 0.0), 0.0)
    np.testing.assert_allclose(failed, np.broadcast_to(expected, failed.shape), atol=1e-12)
    # A triangle of 6 cm by its retreat on both sides.
    area = float(failed[0].sum()) * 0.005
    assert area == pytest.approx(0.06 * find_retreat_m(0.06, FRICTION_DEG), rel=0.05)


def test_strength_is_between_its_ends_and_reaches_far_apart_values():
    grid = ExcavationGrid(0.0, 0.0, 200, 200, 0.01)
    strength = make_strength(grid, 0.12, 0.8, 7)
    assert 0.2 - 1e-12 <= strength.min() < 0.4
    assert 0.8 < strength.max() <= 1.0
    np.testing.assert_array_equal(make_strength(grid, 0.12, 0.0, 7), 1.0)


def test_without_slumps_or_with_strong_ground_nothing_changes():
    sound = series(slump=0.0)
    assert sound.facts(2)["slid_m3"] == 0.0
    strong, plain = series(slump=0.5, cohesion_pa=100.0), series(slump=0.0, cohesion_pa=100.0)
    np.testing.assert_array_equal(strong.at(2).layers.top, plain.at(2).layers.top)


def test_slumps_keep_away_from_the_rim_of_the_patch():
    moved = np.abs(series().at(2).layers.top)
    assert max(moved[0].max(), moved[-1].max(), moved[:, 0].max(), moved[:, -1].max()) == 0.0
