"""Elevation models of surfaces that are known."""

from __future__ import annotations

import json

import numpy as np
import pairs
import pytest
from icymoon.formats import geotiff
from icymoon.stereo.decisions.dem import Grid, back_project_depth, make_dem, mean_by_cell, measure_height_errors

GRID = Grid(0.1, 20, 30, -1.0, 2.0)


def points(height, each=25, seed=0):
    """Random points of a height field over the grid."""
    random = np.random.default_rng(seed)
    n = each * GRID.rows * GRID.columns
    x, y = random.uniform(-1.0, 2.0, n), random.uniform(0.0, 2.0, n)
    return np.stack([x, y, height(x, y)], axis=1)


def test_north_is_up_and_east_is_right():
    found = make_dem(points(lambda x, y: x + 10 * y), GRID)
    east, north = GRID.centres()
    # Half a cell's extent in each direction bounds a median of the cell.
    assert np.abs(found.height_m - (east + 10 * north)).max() < 0.05 * 11
    assert found.height_m[0, 0] > found.height_m[-1, 0]
    assert found.height_m[0, 0] < found.height_m[0, -1]


def test_a_median_does_not_follow_flying_points():
    cloud = points(lambda x, y: 0.0 * x, each=100)  # of 60 or more points in a cell, half are never among a fifth
    cloud[::5, 2] = 3.0
    assert np.abs(make_dem(cloud, GRID).height_m).max() == 0.0


def test_medians_are_numpys():
    cloud = points(lambda x, y: np.sin(7 * x) + y, each=4, seed=3)
    found, cell = make_dem(cloud, GRID, 1), GRID.find_cells(cloud)
    for k in range(0, 600, 37):
        own = cloud[cell == k, 2]
        assert found.points.ravel()[k] == len(own)
        if len(own):
            assert found.height_m.ravel()[k] == pytest.approx(np.median(own), abs=1e-12)


def test_few_points_and_points_outside_make_no_height():
    cloud = np.array([[0.05, 1.95, 1.0], [0.06, 1.95, 1.0], [-1.01, 1.0, 1.0], [0.0, 2.01, 1.0], [2.01, 0.0, 1.0]])
    found = make_dem(cloud, GRID)
    assert not found.known.any()
    assert found.points.sum() == 2
    assert make_dem(cloud, GRID, 2).height_m[0, 10] == 1.0


def test_points_of_a_plane_lie_on_it():
    camera, scene = pairs.camera(), pairs.Scene(slope_x=0.0, slope_y=0.6, rock=False)
    depth = pairs.view(scene, camera, "left")[0]
    found, index = back_project_depth(depth, camera, np.eye(4))
    _x, y, z = found.T
    np.testing.assert_allclose(z, scene.distance_m - scene.slope_y * y, rtol=1e-9)
    assert (depth.ravel()[index] == z).all()


def test_errors_of_a_known_offset_and_noise():
    random, truth = np.random.default_rng(1), np.zeros((200, 200))
    noise = random.normal(0.0, 0.004, truth.shape)
    found = make_dem(np.empty((0, 3)), Grid(0.1, 200, 200, 0.0, 0.0))
    height = truth + 0.01 + noise
    height[:50] = np.nan
    errors = measure_height_errors(type(found)(found.grid, height, found.points), truth, np.ones(truth.shape, bool))
    # 30 000 normal numbers: three standard errors of each estimate.
    assert errors["bias_m"] == pytest.approx(0.01, abs=3 * 0.004 / 173)
    assert errors["nmad_m"] == pytest.approx(0.004, rel=0.03)
    assert errors["rmse_m"] == pytest.approx(np.hypot(0.01, 0.004), rel=0.01)
    assert errors["le90_m"] == pytest.approx(np.quantile(np.abs(0.01 + noise[50:]), 0.9))
    assert errors["completeness"] == 0.75


def test_nothing_known_has_no_errors():
    found = make_dem(np.empty((0, 3)), GRID)
    errors = measure_height_errors(found, np.zeros((20, 30)), np.ones((20, 30), bool))
    assert errors == {"bias_m": None, "rmse_m": None, "nmad_m": None, "le90_m": None, "completeness": 0.0}


def test_a_geotiff_has_its_place(tmp_path):
    found = make_dem(points(lambda x, y: x + 10 * y), GRID)
    (tmp_path / "dem.tif").write_bytes(found.encode_geotiff())
    read = geotiff.read(tmp_path / "dem.tif")
    np.testing.assert_allclose(read.heights_m, found.height_m, rtol=1e-6)
    assert read.pixel_m == pytest.approx((0.1, 0.1))
    assert read.corner_m == pytest.approx((-0.95, 0.05))


def test_means_by_cell():
    cloud = np.array([[-0.95, 1.95, 0.0], [-0.95, 1.95, 0.0], [0.05, 1.95, 0.0]])
    found = mean_by_cell(cloud, np.array([1.0, 0.0, 1.0]), GRID)
    assert found[0, 0] == 0.5
    assert found[0, 10] == 1.0
    assert np.isnan(found).sum() == 598


def test_the_map_of_a_site_is_in_its_metadata(tmp_path):
    rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")
    place = {"crs": '+proj=merc <&"> +R=1560800', "origin": [5e6 + 0.123456789, -2.0], "scale": [1.0, 1.0]}
    found = make_dem(points(lambda x, y: x + 10 * y), GRID)
    (tmp_path / "dem.tif").write_bytes(found.encode_geotiff({"map": place}))
    with rasterio.open(tmp_path / "dem.tif") as opened:
        stated = json.loads(opened.tags()["map"])
    assert {key: stated[key] for key in place} == place
