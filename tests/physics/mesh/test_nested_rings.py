"""A patch with rings of coarser cells: one mesh without a crack, whatever its numbers, that ground can end in."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from icymoon.physics.mesh.horizon import dip_deg, drop_m
from icymoon.physics.mesh.nested_rings import build_rings, count_cells, drop_unknown_vertices, plan_levels
from icymoon.physics.mesh.open_directions import find_open_directions

#: Cells of the patch, its side, the distance of the end and the width of the pixels, in metres.
PLANS = {
    "everywhere fine": (64, 20.0, 700.0, 0.1),
    "pixels far wider than the patch": (128, 20.0, 3000.0, 100.0),
    "smallest patch": (4, 1.0, 300.0, 1.0),
    "no surroundings": (8, 10.0, 5.0, 1.0),
    "less than a cell": (36, 10.0, 5.01, 1.0),
    "the site's patch": (100, 30.0, 1000.0, 5.0),
}


def plan(name):
    cells, size_m, reach_m, pixel_m = PLANS[name]
    return plan_levels(cells, size_m, reach_m, lambda _: pixel_m)


@pytest.mark.parametrize("name", PLANS)
def test_each_edge_inside_has_two_triangles_and_the_area_is_that_of_the_square(name):
    levels = plan(name)
    mesh = build_rings(levels)
    assert len(mesh.faces) == sum(level.triangles for level in levels)
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges[:, 0].astype(np.int64) * len(mesh.places) + edges[:, 1], return_counts=True)
    assert count.max() == 2
    border = mesh.places[np.stack(np.divmod(unique[count == 1], len(mesh.places)), axis=1)]
    assert len(border) == 4 * levels[-1].outer
    half = levels[-1].half_m
    assert np.isclose(np.abs(border).max(axis=2), half).all()
    a, b, c = (mesh.places[mesh.faces[:, k]] for k in range(3))
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert twice.min() > 0
    assert twice.sum() / 2 == pytest.approx((2 * half) ** 2, rel=1e-9)
    assert half >= PLANS[name][2] * (1 - 1e-9)
    assert np.unique(mesh.faces).size == len(mesh.places)


def test_cells_double_and_are_seen_under_small_angles():
    levels = plan("everywhere fine")
    for inner, outer in pairwise(levels):
        assert outer.cell_m == pytest.approx(2 * inner.cell_m)
        assert outer.cell_m <= inner.half_m / 16 * (1 + 1e-9)


def test_a_hundred_kilometres_about_twenty_metres_stay_small():
    """Pixels of 100 m about a patch of 1024 cells: rings that no pixel fills take few triangles."""
    levels = plan_levels(1024, 20.0, 1e5, lambda distance: 0.25 if distance < 50 else 100.0)
    assert sum(level.triangles for level in levels[1:]) < 3e6
    assert [count_cells(n) for n in (2, 5, 6, 481, 1025)] == [4, 4, 8, 480, 1024]


def test_triangles_without_a_height_are_left_out():
    levels = plan("the site's patch")
    mesh = build_rings(levels)
    east = mesh.places[:, 0] > 100.0
    positions, faces = drop_unknown_vertices(mesh, np.where(east, np.nan, 1.0))
    assert positions[:, 0].max() <= 100.0
    assert len(positions) == (~east).sum()
    assert np.unique(faces).size == len(positions)


@pytest.mark.parametrize("height_m", [2.0, 30.0])
def test_a_plain_on_a_sphere_ends_at_the_dip_of_the_horizon(height_m):
    """The highest vertex seen from an eye is under the horizontal by arccos(R / (R + h)): exact, except that no vertex
    need be at the horizon. There the dip changes with the square of the distance from it."""
    radius_m = 252100.0
    mesh = build_rings(plan_levels(64, 20.0, 3e4, lambda _: 1.0))
    away = np.hypot(*mesh.places.T)
    seen = np.degrees(np.arctan2(-drop_m(away, radius_m) - height_m, np.maximum(away, 1e-3))).max()
    wanted = -math.degrees(math.acos(radius_m / (radius_m + height_m)))
    assert wanted == pytest.approx(-dip_deg(height_m, radius_m), rel=1e-6)
    assert seen == pytest.approx(wanted, rel=1e-3)
    assert seen <= wanted * (1 - 1e-9)


def test_directions_end_where_there_is_no_ground():
    levels = plan("the site's patch")
    heights = [np.zeros((level.outer + 1,) * 2) for level in levels]
    azimuths = np.arange(0.0, 360.0, 10.0)
    assert not find_open_directions(levels, heights, (0.0, 0.0), azimuths, 900.0).any()
    assert find_open_directions(levels, heights, (0.0, 0.0), azimuths, 5000.0).all()
    for level, each in zip(levels, heights, strict=True):
        each[:, level.axis_m > 500.0] = np.nan
    ends = find_open_directions(levels, heights, (0.0, 0.0), azimuths, 900.0)
    # East of 500 m: directions whose sine is above 500/900.
    np.testing.assert_array_equal(ends, np.sin(np.radians(azimuths)) > 500.0 / 900.0)
