"""Marks of a scoop: how far apart and how high they are, and that they change no volume."""

import math

import numpy as np
import pytest
from icymoon.physics.excavation import dig_site as sites
from icymoon.physics.excavation.dig import ExcavationSeries
from icymoon.physics.excavation.scoop_cut import Pull
from icymoon.physics.excavation.scoop_marks import TEETH, make_marks
from icymoon.settings import description

FRICTION_DEG, WIDTH_M, LENGTH_M, DEPTH_M = 38.0, 0.12, 0.36, 0.05
DUG = {
    "path": "LINE",
    "states": 3,
    "bite_m": DEPTH_M,
    "length_m": LENGTH_M,
    "width_m": WIDTH_M,
    "start_y_m": 0.1,
    "cell_m": 0.004,
    "chips_m": 0.0,
}


def series(**changes):
    settings = description.merged(
        description.defaults(), description.check({"excavation": DUG | changes, "light": {"body": "EUROPA"}}, "test")
    )
    site = sites.make_site(settings)
    return ExcavationSeries(site, settings.excavation, 1, np.zeros((site.grid.rows, site.grid.columns)))


def floor_m(strength=1.0, depth_m=DEPTH_M, count=1200):
    """Depths (along, right) of a northward pull at the middles of ``count`` x ``count`` equal parts of its floor."""
    ends, depths = np.array([0.0, LENGTH_M]), np.array([depth_m, depth_m])
    pull = Pull(0.0, 0.0, 0.0, WIDTH_M, ends, depths, marks=make_marks(WIDTH_M, strength, FRICTION_DEG))
    part = (np.arange(count) + 0.5) / count
    return pull.find_depth_at(WIDTH_M * (part[None, :] - 0.5), LENGTH_M * part[:, None])


def find_strongest_period(values, length_m):
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    return length_m / int(np.argmax(power))


def test_grooves_are_as_far_apart_as_the_teeth_and_steps_as_long_as_the_blade_is_wide():
    depth = floor_m()
    assert find_strongest_period(depth[7], WIDTH_M) == pytest.approx(WIDTH_M / TEETH, rel=1e-9)
    assert find_strongest_period(depth.mean(axis=1), LENGTH_M) == pytest.approx(WIDTH_M, rel=1e-9)
    dug = series(marks=1.0).at(2).layers.ground
    rows, columns = np.nonzero(dug < -2 * DEPTH_M + 0.02)
    inside = dug[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    assert inside.shape == (90, 30)  # the whole floor, in cells of 4 mm
    assert find_strongest_period(inside[5], WIDTH_M) == pytest.approx(WIDTH_M / TEETH, rel=1e-9)
    assert find_strongest_period(inside.mean(axis=1), LENGTH_M) == pytest.approx(WIDTH_M, rel=1e-9)


@pytest.mark.parametrize("strength", [0.3, 1.0])
def test_flanks_of_grooves_are_as_steep_as_friction_times_the_strength(strength):
    depth = floor_m(strength)
    slope = np.abs(np.diff(depth, axis=1)).max() / (WIDTH_M / depth.shape[1])
    # Between two of 200 places on a period, a cosine is within 1e-4 of its greatest slope.
    assert slope == pytest.approx(strength * math.tan(math.radians(FRICTION_DEG)), rel=1e-3)
    step = -np.diff(depth.mean(axis=1)).min()
    groove = float(np.ptp(depth[0]))
    assert step == pytest.approx(2.0 * groove, rel=0.01)


def test_marks_change_no_volume():
    assert float(floor_m().mean()) == pytest.approx(DEPTH_M, rel=1e-12)
    plain, marked = series(), series(marks=1.0)
    # Edges lie between cells, and the 16 places of each cell cover whole periods evenly.
    for made in (plain, marked):
        taken = made.facts(2)["taken_by_state_m3"]
        np.testing.assert_allclose(taken, np.array([0, 1, 1]) * DEPTH_M * WIDTH_M * LENGTH_M, rtol=1e-9)
    assert marked.mass_error(2) < 1e-12


def test_marks_of_an_arc_change_its_volume_by_less_than_their_height():
    plain, marked = (series(path="ARC", radius_m=0.2, marks=strength) for strength in (0.0, 1.0))
    taken = [sum(each.facts(2)["taken_by_state_m3"]) for each in (plain, marked)]
    assert taken[1] == pytest.approx(taken[0], rel=0.02)
    assert marked.mass_error(2) < 1e-12
    assert (marked.at(2).layers.ground != plain.at(2).layers.ground).any()


def test_a_blade_in_or_over_the_ground_leaves_marks_as_low_as_it_is_deep():
    marks = make_marks(WIDTH_M, 1.0, FRICTION_DEG)
    assert float(floor_m(depth_m=0.2 * marks.height_m).min()) >= 0.0
    np.testing.assert_array_equal(floor_m(depth_m=-0.01), -0.01)
    assert series(marks=1.0, bite_m=0.0).facts(2)["taken_m3"] == 0.0


def test_the_deepest_place_and_the_walls_count_the_marks():
    marked = series(marks=1.0)
    height = make_marks(WIDTH_M, 1.0, FRICTION_DEG).height_m
    assert marked.site.deepest_m == pytest.approx(2 * DEPTH_M + height, rel=1e-12)
    assert 2 * DEPTH_M + 0.7 * height < marked.facts(2)["deepest_m"] < 2 * DEPTH_M + height


def test_without_marks_the_ground_is_the_same_array():
    assert make_marks(WIDTH_M, 0.0, FRICTION_DEG) is None
    np.testing.assert_array_equal(floor_m(0.0), DEPTH_M)


def test_grooves_between_the_cells_are_told():
    def advice(**changes):
        settings = description.merged(
            description.defaults(),
            description.check({"excavation": DUG | changes, "light": {"body": "EUROPA"}}, "test"),
        )
        return " ".join(sites.advise_on_excavation(settings))

    assert "2 cells apart" in advice(marks=0.5, cell_m=0.01)
    assert "cells apart" not in advice(marks=0.5, cell_m=0.004)
    assert "cells apart" not in advice(cell_m=0.01)
