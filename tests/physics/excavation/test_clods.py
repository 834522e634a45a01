"""Clods of many sizes: how wide they are, how far they come, and what they leave as it is."""

import math

import numpy as np
import pytest
from icymoon.physics.excavation import clods
from icymoon.physics.excavation.dig_grid import ExcavationGrid

GRID = ExcavationGrid(-0.4, -0.4, 161, 161, 0.005)
REPOSE_DEG, HIGH_M = 38.0, 0.12
TANGENT = math.tan(math.radians(REPOSE_DEG))


def away_m():
    return np.hypot(GRID.east_m[None, :], GRID.north_m[:, None])


def cone():
    return np.maximum(HIGH_M - TANGENT * away_m(), 0.0)


def thrown(seed=0, largest_m=0.04, spoil=None, ground=None, sorting=0.0):
    spoil = cone() if spoil is None else spoil
    ground = np.zeros_like(spoil) if ground is None else ground
    return clods.add_clods(GRID, ground, spoil, largest_m, REPOSE_DEG, np.random.default_rng(seed), sorting)


def place_on_fine_cone(sorting, seed):
    """Distance from the apex and width of each clod, in metres, on cells fine enough for clods of 6 to 40 mm."""
    grid = ExcavationGrid(-0.3, -0.3, 301, 301, 0.002)
    spoil = np.maximum(HIGH_M - TANGENT * np.hypot(grid.east_m[None, :], grid.north_m[:, None]), 0.0)
    place, width = clods.place_clods(
        grid, np.zeros_like(spoil), spoil, 0.04, REPOSE_DEG, np.random.default_rng(seed), sorting
    )
    return np.hypot(*(place - 150.0).T) * grid.cell_m, width


def correlate_ranks(a, b):
    return float(np.corrcoef(np.argsort(np.argsort(a)), np.argsort(np.argsort(b)))[0, 1])


def test_the_sum_is_kept_for_any_heap():
    for spoil in (cone(), np.minimum(cone(), 0.002), np.where(away_m() < 0.006, 0.001, 0.0), np.zeros((161, 161))):
        for sorting in (0.0, 1.0):
            made = thrown(spoil=spoil, sorting=sorting)
            assert made.min() >= 0.0
            assert float(made.sum()) == pytest.approx(float(spoil.sum()), rel=1e-12, abs=0.0)


def test_few_clods_are_large_and_many_small():
    width = clods._draw_widths(0.0005, 4_000_000, 0.04, np.random.default_rng(1))
    assert 0.04 / 16.0 <= width[0] <= width[-1] <= 0.04
    # N(> D) falls as D^-2.5, so 2^2.5 times as many are wider than half a width; less what the law ends with.
    wider = [float((width > each).sum()) + len(width) / (16.0**2.5 - 1.0) for each in (0.004, 0.008, 0.016)]
    assert wider[0] / wider[1] == pytest.approx(2.0**2.5, rel=0.05)
    assert wider[1] / wider[2] == pytest.approx(2.0**2.5, rel=0.15)  # some hundreds are that wide


def test_a_clod_slides_as_far_as_its_friction_lets_it():
    # What it loses in height it loses to friction: h = mu (distance on the map), on any slope.
    friction = np.array([0.4, 0.6, 0.75, 1.05]) * TANGENT
    middle = 80
    start = np.full((4, 2), float(middle))
    start[:, 1] += 3.0
    rest = clods._slide_clods(cone() / GRID.cell_m, start, friction)
    came = np.hypot(*(rest - middle).T) * GRID.cell_m
    from_m = 3.0 * GRID.cell_m
    high = HIGH_M - TANGENT * from_m
    # Cells are steps of the slope, so that one is at its foot for a cell or two.
    np.testing.assert_allclose(came[:3] - from_m, high / friction[:3], rtol=0.06)
    assert came[3] == from_m  # more friction than slope


def test_large_clods_come_farther_than_small_ones():
    width = np.linspace(0.008, 0.04, 400)
    random = np.random.default_rng(3)
    start = np.full((400, 2), 80.0) + random.uniform(-3.0, 3.0, (400, 2))
    rest = clods._slide_clods(cone() / GRID.cell_m, start, TANGENT * clods._draw_friction(width, random))
    came = np.hypot(*(rest - 80.0).T) * GRID.cell_m
    foot = HIGH_M / TANGENT
    assert np.mean(came[-100:] > foot) > 0.5
    assert not (came[:25] > foot).any()  # up to 1 cm wide


def test_a_clod_is_a_convex_body_lower_than_wide():
    flat = np.zeros((161, 161))
    for seed in range(20):
        made = clods._raise_clods(
            flat, np.array([[80.2, 79.7]]), np.array([0.1]), GRID.cell_m, np.random.default_rng(seed)
        )
        assert 0.02 < made.max() < 0.1
        wide = (made > 0.0).any(axis=0).sum() * GRID.cell_m, (made > 0.0).any(axis=1).sum() * GRID.cell_m
        assert all(0.03 < each < 0.13 for each in wide)
        # Concave seen from below: no height lies under the mean of its neighbours, where all three belong to the clod.
        for axis in (0, 1):
            body = np.moveaxis(made, axis, 0)
            inside = (body[:-2] > 0.0) & (body[2:] > 0.0)
            assert (body[1:-1] - 0.5 * (body[:-2] + body[2:]))[inside].min() > -1e-12


def test_the_rim_of_the_patch_stays():
    wide = np.maximum(0.6 - TANGENT * away_m(), 0.0)  # up to the rim
    made, bare = thrown(spoil=wide), wide
    kept = made[0].sum() / bare[0].sum()
    for rim in (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1]):
        np.testing.assert_allclose(made[rim], kept * bare[rim], rtol=1e-12)


def test_no_more_clods_than_a_computer_takes():
    assert len(clods._draw_widths(0.001, 10**9, 0.04, np.random.default_rng(1))) == 20_000


def test_without_sorting_clods_lie_as_in_releases_without_it():
    made = thrown()
    # A sum with weights that differ everywhere, from the release before sorting; another draw differs by its size.
    weights = np.sin(np.arange(made.size)).reshape(made.shape)
    assert float((made * weights).sum()) == pytest.approx(-0.06417061324788428, rel=1e-9)


def test_sorted_clods_are_the_larger_the_farther_from_the_apex():
    unsorted, half, full = (correlate_ranks(*place_on_fine_cone(sorting, 1)) for sorting in (0.0, 0.5, 1.0))
    assert unsorted + 0.05 < half < full - 0.05
    away, width = place_on_fine_cone(1.0, 1)
    random = np.random.default_rng(0)
    by_chance = [abs(correlate_ranks(away, random.permutation(width))) for _ in range(500)]
    assert full > 3.0 * max(by_chance)


def test_fine_spoil_stays_at_the_top_and_few_clods_roll_beyond_the_foot():
    away, width = place_on_fine_cone(1.0, 2)
    foot = HIGH_M / TANGENT
    large = width > 0.02
    assert width[away < 0.5 * foot].max() < 0.02  # none of the large ones
    assert np.mean(away[large] > 0.95 * foot) > 0.9
    assert 0.0 < np.mean(away[large] > 1.2 * foot) < 2.0 * clods._OUTLIERS


def test_sorted_clods_lie_where_the_seed_places_them():
    np.testing.assert_array_equal(thrown(seed=3, sorting=0.7), thrown(seed=3, sorting=0.7))
    assert (thrown(seed=3, sorting=0.7) != thrown(seed=4, sorting=0.7)).any()


def test_an_initial_speed_climbs_to_its_height():
    # Half the square of the speed is a height, of which slope and friction take their shares. Friction then holds it.
    rise = 0.5 * np.arange(400.0)
    top = np.broadcast_to(rise[:, None], (400, 9)).copy()
    rest = clods._slide_clods(top, np.array([[50.0, 4.0]]), np.array([0.6]), np.array([[math.sqrt(2.0 * 60.0), 0.0]]))
    # 60 = (0.5 + 0.6) x; steps of up to a cell.
    assert rest[0, 0] - 50.0 == pytest.approx(60.0 / 1.1, abs=1.5)
