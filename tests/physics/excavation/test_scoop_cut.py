"""What a scoop takes, against the volumes of prisms and of segments of a circle."""

import math

import numpy as np
import pytest
from icymoon.physics.excavation.dig_grid import ExcavationGrid, make_covering_grid
from icymoon.physics.excavation.scoop_cut import Pull, fit_plane, measure_cut_depth_m
from icymoon.physics.excavation.scoop_paths import make_pulls
from icymoon.settings import description
from icymoon.settings.topics.scene import Settings

CELL = 0.0025


def complete(part: dict) -> Settings:
    return description.merged(description.defaults(), description.check(part, "test"))


def flat(half=0.3):
    grid = make_covering_grid(-half, -half, half, half, CELL)
    return grid, np.zeros((grid.rows, grid.columns))


def volume(grid, top, pulls, plane=(0.0, 0.0, 0.0)):
    return float(measure_cut_depth_m(grid, top, np.array(plane), pulls).sum()) * grid.cell_m**2


def prism(heading=0.0, x=0.0, y=0.0):
    return Pull(x, y, heading, 0.08, np.array([0.0, 0.25]), np.array([0.1, 0.1]))


def test_a_turned_prism_has_its_volume():
    # Edges cross the cells anywhere: 4 x 4 places in each leave 5 parts in 1e4 at 45°, where they line up, 2 % without.
    grid, top = flat()
    errors = [volume(grid, top, [prism(heading, 0.0011, -0.0007)]) / 0.002 - 1 for heading in (17.0, 31.0, 45.0, 73.0)]
    assert np.abs(errors).max() < 5e-4


def test_a_prism_along_the_axes_has_its_volume_to_a_part_of_a_cell():
    # The edges lie between subsamples: at most an eighth of a cell is missed at each edge.
    grid, top = flat()
    most = CELL / 8 * 2 * (1 / 0.08 + 1 / 0.25)
    assert abs(volume(grid, top, [prism(0.0, 0.0003, 0.0004)]) / 0.002 - 1) < most


def test_an_arc_has_the_volume_of_a_segment_of_a_circle():
    excavation = complete(
        {
            "excavation": {
                "path": "ARC",
                "length_m": 0.0,
                "bite_m": 0.05,
                "radius_m": 0.25,
                "states": 2,
                "start_y_m": 0.0,
                "heading_deg": 30.0,
            }
        }
    ).excavation
    grid, top = flat()
    ((pull,),) = make_pulls(excavation)
    half = math.acos(1 - 0.05 / 0.25)
    segment = 0.25**2 * (half - math.sin(half) * math.cos(half))
    # The depth at the middle of a subsample stands for the subsample: second order, 1e-3 at these sizes.
    assert volume(grid, top, [pull]) == pytest.approx(0.08 * segment, rel=1e-3)


def test_a_second_pull_through_the_same_place_takes_nothing():
    grid, top = flat()
    first = measure_cut_depth_m(grid, top, np.zeros(3), [prism(20.0)])
    # A cell that was cut in part is at its mean height, above the blade in the part that was cut.
    again = measure_cut_depth_m(grid, top - first, np.zeros(3), [prism(20.0)])
    inside = first == first.max()
    assert np.abs(again[inside]).max() < 1e-15


def test_a_bite_on_a_slope_is_as_deep_as_on_level_ground():
    grid, top = flat()
    top = top + 0.3 * grid.east_m[None, :] - 0.1 * grid.north_m[:, None]
    plane = fit_plane(grid, top, [prism(40.0)])
    np.testing.assert_allclose(plane, [0.0, 0.3, -0.1], atol=1e-12)
    assert volume(grid, top, [prism(40.0)], plane) == pytest.approx(0.002, rel=3e-4)


def test_a_blade_above_the_ground_takes_nothing():
    grid, top = flat()
    pull = Pull(0.0, 0.0, 0.0, 0.08, np.array([0.0, 0.25]), np.array([-0.01, -0.01]))
    assert volume(grid, top, [pull]) == 0.0


def test_a_value_between_vertices_is_bilinear():
    grid = ExcavationGrid(0.0, 0.0, 3, 3, 0.5)
    values = np.add.outer(2.0 * grid.north_m, 3.0 * grid.east_m)
    x, y = np.array([0.1, 0.7, 2.0]), np.array([0.3, 0.9, 0.0])
    np.testing.assert_allclose(grid.interpolate(values, x, y, np.full(3, -1.0)), [0.9, 3.9, -1.0])
