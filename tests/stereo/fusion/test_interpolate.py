"""The interpolation of points: exact on planes, and the same as one that is computed without each point."""

from dataclasses import replace

import numpy as np
import pytest
from icymoon.stereo.fusion.interpolate import interpolate
from icymoon.support.errors import IcyMoonError

SHAPE = (24, 32)


def plane(column, row):
    return 9.0 + 0.03 * column - 0.11 * row


def scatter(count, whole=False, seed=3):
    random = np.random.default_rng(seed)
    if whole:
        row, column = np.divmod(random.permutation(SHAPE[0] * SHAPE[1])[:count], SHAPE[1])
        return column.astype(float), row.astype(float)
    return random.uniform(0, SHAPE[1] - 1, count), random.uniform(0, SHAPE[0] - 1, count)


@pytest.mark.parametrize(("count", "whole"), [(3, False), (40, False), (300, True)])
def test_a_plane_is_exact_everywhere_also_beside_all_points(count, whole):
    column, row = scatter(count, whole)
    found = interpolate(column, row, plane(column, row))
    rows, columns = np.indices(SHAPE)
    np.testing.assert_allclose(found.fill(SHAPE), plane(columns, rows), atol=1e-9)
    np.testing.assert_allclose(found.predict_left_out(), found.disparity, atol=1e-9 if count > 3 else np.inf)


def test_a_full_grid_of_points_is_its_own_interpolation():
    row, column = (grid.ravel().astype(float) for grid in np.indices(SHAPE))
    values = np.random.default_rng(0).uniform(5, 9, len(row))
    # Points are moved by up to 1e-4 px, and neighbours differ by up to 4 px.
    np.testing.assert_allclose(interpolate(column, row, values).fill(SHAPE).ravel(), values, atol=4 * 2e-4)


def test_a_value_is_within_the_values_of_its_triangle():
    column, row = scatter(30)
    values = np.random.default_rng(1).uniform(5, 9, 30)
    found = interpolate(column, row, values)
    rows, columns = np.indices(SHAPE)
    inside = found.triangulation.get_trifinder()(columns, rows)
    corners = found.disparity[found.triangulation.triangles[inside[inside >= 0]]]
    filled = found.fill(SHAPE)[inside >= 0]
    assert (filled >= corners.min(axis=1) - 1e-9).all()
    assert (filled <= corners.max(axis=1) + 1e-9).all()


def test_each_point_left_out_is_the_interpolation_of_the_others():
    column, row = scatter(25)
    values = np.random.default_rng(2).uniform(5, 9, 25)
    found = interpolate(column, row, values)
    left_out = found.predict_left_out()
    triangulation = found.triangulation
    edge = np.unique(triangulation.triangles[np.any(triangulation.neighbors < 0, axis=1)])
    for k in (*edge[:5].tolist(), *np.setdiff1d(np.arange(25), edge)[:5].tolist()):
        others = np.arange(25) != k
        alone = replace(found, column=found.column[others], row=found.row[others], disparity=found.disparity[others])
        corner = np.floor([row[k], column[k]]).astype(int)
        # All points are moved, so that the missing one would lie on a pixel.
        across, down = corner[1] - found.column[k], corner[0] - found.row[k]
        shifted = replace(alone, column=alone.column + across, row=alone.row + down)
        assert left_out[k] == pytest.approx(shifted.fill(SHAPE)[corner[0], corner[1]], abs=1e-9)
    assert np.abs(left_out - values).max() > 0.1


def test_sums_over_neighbours_count_each_edge_twice():
    found = interpolate(scatter(20)[0], scatter(20)[1], np.ones(20))
    ones = np.ones(20)
    assert found.add_neighbours(ones, False).sum() == 2 * len(found.triangulation.edges)
    np.testing.assert_array_equal(found.add_neighbours(ones, True) - found.add_neighbours(ones, False), ones)


def test_too_few_points_and_points_on_a_line_are_one_sentence():
    with pytest.raises(IcyMoonError, match="needs 3 points in the left image, and there are 2"):
        interpolate(np.array([1.0, 5.0]), np.array([1.0, 2.0]), np.ones(2))
    with pytest.raises(IcyMoonError, match="lie on one line of the image"):
        interpolate(np.arange(9.0), 2 * np.arange(9.0), np.ones(9))
