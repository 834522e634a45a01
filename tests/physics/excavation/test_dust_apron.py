"""The apron of dust round a heap: where grains land, against grains that are thrown one by one."""

import math

import numpy as np
import pytest
from icymoon.physics.excavation import dig_site as sites
from icymoon.physics.excavation import dust_apron
from icymoon.physics.excavation.clods import find_least_width_m
from icymoon.physics.excavation.dig import ExcavationSeries
from icymoon.physics.excavation.dig_grid import ExcavationGrid
from icymoon.settings import description
from icymoon.support.errors import IcyMoonError

DROP_M = 0.2
DUG = {"path": "LINE", "states": 4, "bite_m": 0.04, "length_m": 0.2, "cell_m": 0.005, "start_y_m": 0.1}
#: Nodes of Simpson's rule for the integral of exp(-x cosh u) / coshⁿ u over u > 0, another form of the function.
LONG = np.linspace(0.0, 30.0, 200_001)


def series(**changes):
    part = {"excavation": DUG | changes, "light": {"body": "EUROPA"}}
    settings = description.merged(description.defaults(), description.check(part, "test"))
    site = sites.make_site(settings)
    return ExcavationSeries(site, settings.excavation, 1, np.zeros((site.grid.rows, site.grid.columns)))


def integrate_bickley(order, x):
    values = np.exp(-x * np.cosh(LONG)) / np.cosh(LONG) ** order
    return float((values[0] + 4 * values[1:-1:2].sum() + 2 * values[2:-1:2].sum() + values[-1]) * LONG[1] / 3.0)


def integrate_ring(low, high, jump_m):
    edges = np.geomspace(max(low, 1e-6), high, 4001)
    middle = np.sqrt(edges[1:] * edges[:-1])
    return float(
        (math.pi * (edges[1:] ** 2 - edges[:-1] ** 2) * dust_apron.compute_landing_density(middle, jump_m)).sum()
    )


@pytest.mark.parametrize("jumps", [0.05, 1.0, 3.0])
def test_density_is_bickleys_function(jumps):
    found = float(dust_apron.compute_landing_density(np.array([0.1 * jumps]), 0.1)[0])
    assert found * 2 * math.pi * 0.1 * 0.1 * jumps == pytest.approx(integrate_bickley(1, jumps), rel=1e-6)


@pytest.mark.parametrize("gravity_m_s2", [0.113, 1.315])
def test_grains_land_where_thrown_grains_land(gravity_m_s2):
    random, count = np.random.default_rng(1), 400_000
    # Rebound of a half of the speed in the mean square; directions of Lambert's law.
    square = random.exponential(0.25 * 2 * gravity_m_s2 * DROP_M, count)
    up = np.sqrt(random.uniform(0.0, 1.0, count))  # cosine from the vertical
    flight_s = 2 * np.sqrt(square) * up / gravity_m_s2
    landed = np.sqrt(square * (1 - up**2)) * flight_s
    jump = dust_apron.find_mean_jump_m(DROP_M)
    for low, high in ((0.0, 0.02), (0.02, 0.06), (0.06, 0.12), (0.12, 0.3)):
        share = float(((landed > low) & (landed <= high)).mean())
        # Five standard deviations of a count.
        assert integrate_ring(low, high, jump) == pytest.approx(share, abs=5 * math.sqrt(share / count))


def test_all_grains_land_and_few_beyond_the_reach():
    jump, reach = dust_apron.find_mean_jump_m(DROP_M), dust_apron.find_reach_m(DROP_M)
    assert integrate_ring(0.0, 40 * jump, jump) == pytest.approx(1.0, abs=1e-4)
    beyond = 1.0 - integrate_ring(0.0, reach, jump)
    assert beyond == pytest.approx(integrate_bickley(2, reach / jump), abs=1e-4)
    assert beyond < 0.03


def test_dust_of_one_place_lies_round_it_and_keeps_its_volume():
    grid = ExcavationGrid(-0.4, -0.35, 161, 141, 0.005)
    landed = np.zeros((141, 161))
    landed[70, 80] = 0.02
    spread = dust_apron.spread_dust(grid, landed, DROP_M)
    assert float(spread.sum()) == pytest.approx(0.02, rel=1e-12)
    assert spread.min() == 0.0
    np.testing.assert_allclose(spread[:, 80 - 60 : 80 + 61], spread[:, 80 - 60 : 80 + 61][::-1, ::-1], atol=1e-15)
    away = np.hypot(*np.meshgrid(grid.east_m - grid.east_m[80], grid.north_m - grid.north_m[70]))
    assert spread[away > dust_apron.find_reach_m(DROP_M) + 0.005].max() == 0.0
    law = dust_apron.compute_landing_density(np.array([0.05, 0.1]), dust_apron.find_mean_jump_m(DROP_M))
    # The kernel's edge of the reach is subtracted, which changes the ratio by a few percent.
    assert spread[70, 90] / spread[70, 100] == pytest.approx(law[0] / law[1], rel=0.1)


def test_dust_of_nothing_and_from_no_height_stays():
    grid = ExcavationGrid(0.0, 0.0, 20, 20, 0.01)
    nothing = np.zeros((20, 20))
    np.testing.assert_array_equal(dust_apron.spread_dust(grid, nothing, DROP_M), nothing)
    heap = nothing.copy()
    heap[3, 4] = 0.1
    np.testing.assert_array_equal(dust_apron.spread_dust(grid, heap, 0.0), heap)


def test_a_dusty_heap_keeps_its_mass_and_has_an_apron():
    clean, dusty = series(), series(dust_share=0.2, drop_m=0.2)
    assert dusty.mass_error(3) < 1e-12
    assert dusty.facts(3)["spoil_m3"] == pytest.approx(clean.facts(3)["spoil_m3"], rel=1e-9)
    assert dusty.facts(3)["advice"] == clean.facts(3)["advice"]
    covered = [float((made.at(3).layers.spoil > 2e-4).sum()) for made in (clean, dusty)]
    assert covered[1] > 1.3 * covered[0]


def test_clods_drop_on_the_heap_and_not_on_the_dust():
    made = series(dust_share=0.2, drop_m=0.2, clods_m=0.03, clod_sizes="MANY")
    layers, bare = made.at(3).layers, made.bare[3]
    rough = np.abs(layers.spoil / layers.spoil.sum() - bare.spoil / bare.spoil.sum())
    thin = bare.spoil < 0.2 * find_least_width_m(0.005, 0.03)
    # A clod that rolled off the heap may lie on the dust; few do.
    assert float((rough[thin] * bare.spoil.sum() > 0.005).mean()) < 0.02
    assert float((rough[~thin] * bare.spoil.sum() > 0.005).mean()) > 0.1


def test_a_dusty_excavation_has_room_for_its_apron():
    made, clean = series(dust_share=0.1, drop_m=0.3), series()
    wider = made.site.grid.columns - clean.site.grid.columns
    assert wider * 0.005 == pytest.approx(2 * dust_apron.find_reach_m(0.3), rel=0.35)
    assert description.defaults()["excavation"]["dust_share"] == 0.0


@pytest.mark.parametrize("dust_share", [0.3, 0.9, 1.0])
def test_dust_that_hardly_flies_leaves_the_heap_beside_the_trench(dust_share):
    clean, dusty = series().facts(3), series(dust_share=dust_share, drop_m=0.001).facts(3)
    assert dusty["taken_by_state_m3"] == pytest.approx(clean["taken_by_state_m3"], rel=1e-12)
    assert dusty["advice"] == clean["advice"]


@pytest.mark.parametrize("dust_share", [0.3, 0.7])
def test_the_heap_among_its_dust_has_the_angle_of_friction(dust_share):
    made = series(dust_share=dust_share, drop_m=2.0, cell_m=0.01)
    spoil = made.at(3).layers.spoil
    east = np.abs(np.diff(spoil, axis=1))
    crest = np.unravel_index(spoil.argmax(), spoil.shape)[0]
    # Grains that fly a metre are spread evenly over the flanks.
    assert east[crest].max() / 0.01 == pytest.approx(math.tan(math.radians(38.0)), rel=0.03)


def test_an_apron_too_wide_for_its_cells_is_refused_with_the_height_of_the_drop():
    with pytest.raises(IcyMoonError, match=r"lower excavation\.drop_m, or dig less"):
        series(dust_share=0.3, drop_m=2.0, cell_m=0.002)
    with pytest.raises(IcyMoonError, match=r"raise excavation\.cell_m, or dig less"):
        series(drop_m=2.0, cell_m=0.0002)
