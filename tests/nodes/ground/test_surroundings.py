"""Ground around the patch of a height map: one ground that camera, rays, reports and maps agree on, and nothing changes
without it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.formats.map_frame import map_frame_from_json
from icymoon.nodes.build_scene import build_scene
from icymoon.nodes.ground.user_ground import UserGround, load_ground
from icymoon.physics.mesh.height_map import HeightMap
from icymoon.physics.mesh.heights_on_mesh import SurroundedGround
from icymoon.physics.mesh.horizon import dip_deg, drop_m
from icymoon.rays.engine import open_tracer
from icymoon.rays.shapes import Placed, Shape, World
from icymoon.render.cost.estimate import compute_sky_fraction
from icymoon.render.ground_maps import find_extent
from icymoon.render.plans.triangle_count import count_triangles
from icymoon.settings.description import merged
from icymoon.settings.user_files import find_used_files, hash_content
from icymoon.support.errors import IcyMoonError
from map_systems import EUROPA_M, POLAR, write_map
from rendering import complete, empty_scene

rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")

PLACE = (4e5, 7e5)
#: Metres of ground per metre of the map there: (1 + cos(c)) / 2 with the angle c from the pole.
SCALE = 1 / (1 + (math.hypot(*PLACE) / (2 * EUROPA_M)) ** 2)


def write(path, height, pixel, size, middle=PLACE, nodata=None):
    """A polar map of ``height``, a function of metres of ground east and north of the site."""
    west, north = middle[0] - size * pixel / 2, middle[1] + size * pixel / 2
    transform = rasterio.transform.from_origin(west, north, pixel, pixel)
    step = (np.arange(size) + 0.5) * pixel
    x, y = np.meshgrid((west + step - PLACE[0]) * SCALE, (north - step - PLACE[1]) * SCALE)
    return write_map(path, POLAR, transform, (height(x, y) + 0 * x).astype(np.float32), nodata=nodata)


def settings_of(path, coarse=None, reach_m=1000.0, **source):
    own = {"surroundings_file": str(coarse)} if coarse else {}
    place = {"site": "MAP", "site_easting": str(PLACE[0]), "site_northing": str(PLACE[1])}
    return complete(
        {
            "source": {"kind": "HEIGHT_MAP", "file": str(path), "surroundings_m": reach_m, **place, **own, **source},
            "terrain": {"size_m": 40.0, "resolution": 33},
            "rig": {"height_m": 2.0},
        }
    )


def load(*args, **more) -> UserGround:
    return load_ground(settings_of(*args, **more), lambda _: None)


@pytest.fixture
def plain(tmp_path):
    return write(tmp_path / "fine.tif", lambda x, y: 100.0 + 0 * x, 0.5, 201)


def test_without_surroundings_ground_is_the_flat_patch(plain):
    ground = load(plain, reach_m=0.0)
    assert isinstance(ground.surface, HeightMap)
    assert ground.positions.shape == (33 * 33, 3)
    assert ground.map_place is not None
    assert "body_radius_m" not in ground.map_place
    assert not ground.positions[:, 2].any()


def test_two_plains_are_one_sphere_with_its_horizon(tmp_path, plain):
    """On a sphere of the map's body, whatever the settings state: vertices at the drop, to single precision."""
    coarse = write(tmp_path / "coarse.tif", lambda x, y: 100.0 + 0 * x, 50.0, 201)
    ground = load(plain, coarse, reach_m=4000.0)
    away = np.hypot(*ground.positions[:, :2].astype(np.float64).T)
    assert np.abs(ground.positions[:, 2] + drop_m(away, EUROPA_M)).max() < 2e-6
    seen = np.degrees(np.arctan2(ground.positions[:, 2] - 2.0, np.maximum(away, 1e-3))).max()
    assert seen == pytest.approx(-dip_deg(2.0, EUROPA_M), rel=1e-3)
    assert not [each for each in ground.warnings if "horizon" in each or "higher" in each]


def test_a_slope_goes_on_across_both_maps_and_all_rings(tmp_path):
    def slope(x, y):
        return 0.1 * x - 0.05 * y

    fine = write(tmp_path / "fine.tif", slope, 0.5, 201)
    ground = load(fine, write(tmp_path / "coarse.tif", slope, 20.0, 201))
    assert ground.map_place is not None
    x, y, z = ground.positions.astype(np.float64).T
    wanted = 0.1 * x - 0.05 * y - ground.map_place["height_zero_m"] - drop_m(np.hypot(x, y), EUROPA_M)
    # Float32 heights of some 100 m in the files, and the scale of the map, which is 1 part in a million off over 1 km.
    assert np.abs(z - wanted).max() < 1e-3


def test_heights_of_another_datum_are_evened_out_and_told(tmp_path, plain):
    coarse = write(tmp_path / "coarse.tif", lambda x, y: 60.0 + 0 * x, 50.0, 201)
    ground = load(plain, coarse)
    away = np.hypot(*ground.positions[:, :2].astype(np.float64).T)
    assert np.abs(ground.positions[:, 2] + drop_m(away, EUROPA_M)).max() < 1e-5
    assert [each for each in ground.warnings if "40 m higher on average" in each]
    near = write(tmp_path / "near.tif", lambda x, y: 99.5 + 0 * x, 50.0, 201)
    assert not [each for each in load(plain, near).warnings if "on average" in each]
    assert [each for each in load(plain, near).report if "0.5 m were added" in each]


def test_the_surface_is_the_mesh_and_rays_meet_it_without_a_step(tmp_path):
    """From straight above, along a line across patch, rings and both maps: every ray meets ground, and neighbours
    differ by no more than the steepest slope of the waves over the step, with room for the blend."""

    def waves(x, y):
        return 2.0 * np.sin(x / 25.0) + np.cos(y / 40.0)

    fine = write(tmp_path / "fine.tif", waves, 0.5, 201)
    ground = load(fine, write(tmp_path / "coarse.tif", waves, 20.0, 201))
    assert isinstance(ground.surface, SurroundedGround)
    assert ground.surface.size_m == 40.0
    x = np.linspace(-990.0, 990.0, 20000)
    y = 0.3 * x + 1.0
    faces = ground.faces
    shape = Shape(ground.positions, faces.astype(np.uint32), np.ones(len(faces), bool), np.ones(len(faces), np.uint8))
    world = World([Placed(shape, np.eye(4)[None], np.ones(1, np.int64))])
    tracer = open_tracer(world)
    eye = np.array([0.0, 0.0, 500.0])
    hits = tracer.intersect(eye, np.column_stack([x, y, np.full(len(x), -505.0)]), 0.0, np.inf)
    tracer.close()
    assert hits.met.all()
    z = 500.0 - 505.0 * hits.along
    assert np.abs(np.diff(z)).max() < 0.2 * (x[1] - x[0]) * 1.1
    for k in (0, 9000, 10000, 10500, 19999):
        at = x[k] * hits.along[k], y[k] * hits.along[k]
        assert float(ground.surface.heights(*at)) == pytest.approx(z[k], abs=1e-3)


def test_a_site_at_the_edge_of_the_fine_map_has_a_whole_patch(tmp_path, plain):
    coarse = write(tmp_path / "coarse.tif", lambda x, y: 100.0 + 0 * x, 20.0, 201)
    ground = load(plain, coarse, origin_x_m=40.0)
    inside = np.abs(ground.positions[:, :2]).max(axis=1) <= 20.0
    assert inside.sum() == 33 * 33
    assert np.abs(ground.positions[inside, 2]).max() < 1e-3


def test_ground_that_ends_before_the_horizon_is_told_with_its_share(tmp_path, plain):
    def said(ground):
        return [each for each in ground.warnings if "ends before the horizon" in each]

    (short,) = said(load(plain, reach_m=100.0))
    assert "in 100% of all directions and in 100% of the view's; raise source.surroundings_m to 2" in short
    beside = write(tmp_path / "coarse.tif", lambda x, y: 100.0 + 0 * x, 50.0, 201, (PLACE[0] + 4000.0, PLACE[1]))
    (west,) = said(load(plain, beside, reach_m=4000.0))
    # The map ends 940 m west of the site: directions with a westward part above 0.94 / 2.5 of the horizon's distance.
    share = math.acos(1000.0 * SCALE / 2498.6) / math.pi
    told = float(west.split(" in ")[1].split("%")[0]) / 100
    assert told == pytest.approx(share, abs=0.02)


def test_gaps_of_the_coarse_map_are_filled_if_small_and_end_the_ground_if_wide(tmp_path, plain):
    def height(x, y):
        small = (np.abs(x - 500.0) < 30.0) & (np.abs(y) < 30.0)
        return np.where((y > 600.0) | small, -9999.0, 100.0)

    coarse = write(tmp_path / "coarse.tif", height, 20.0, 201, nodata=-9999.0)
    x, y, z = load(plain, coarse).positions.T
    assert y.max() == pytest.approx(600.0, abs=60.0)
    assert ((np.abs(x - 500.0) < 60.0) & (np.abs(y) < 60.0)).sum() > 3
    assert np.abs(z + drop_m(np.hypot(x, y), EUROPA_M)).max() < 1e-3


def test_the_patch_keeps_the_heights_that_it_has_alone(tmp_path):
    """With a gap in it too, on a map of 2 m pixels; only the body curves it."""

    def bumps(x, y):
        return np.where(np.hypot(x, y - 5.0) < 6.0, -9999.0, np.sin(x / 3.0) * np.cos(y / 5.0))

    path = write(tmp_path / "fine.tif", bumps, 2.0, 101, nodata=-9999.0)
    alone, ground = load(path, reach_m=0.0), load(path, reach_m=80.0)
    inside = np.abs(ground.positions[:, :2]).max(axis=1) <= 20.0
    assert inside.sum() == 33 * 33
    x, y, z = ground.positions[inside].astype(np.float64).T
    np.testing.assert_allclose(z + drop_m(np.hypot(x, y), EUROPA_M), alone.positions[:, 2], atol=1e-6)


def test_points_go_back_to_heights_of_the_file(tmp_path):
    def slope(x, y):
        return 500.0 + 0.1 * x

    ground = load(write(tmp_path / "fine.tif", slope, 20.0, 201), reach_m=1500.0)
    frame = map_frame_from_json({"map": ground.map_place})
    assert frame is not None
    x, y, z = ground.positions.astype(np.float64).T
    heights = z + frame.height_zero_m + frame.find_drop_m(x, y)
    assert np.abs(heights - slope(x, y)).max() < 1e-3
    pose = np.eye(4)
    pose[:3, 3] = 1200.0, 0.0, -float(drop_m(1200.0, EUROPA_M)) - frame.height_zero_m
    assert frame.describe_camera(pose)["height_m"] == pytest.approx(0.0, abs=1e-9)


def test_plans_count_the_triangles_and_the_sky_and_the_files(tmp_path, plain):
    coarse = write(tmp_path / "coarse.tif", lambda x, y: 100.0 + 0 * x, 20.0, 201)
    settings = settings_of(plain, coarse)
    assert count_triangles(settings) == len(load(plain, coarse).faces)
    level = {"rig": {"pitch_deg": 0.0}}
    flat = merged(settings_of(plain, reach_m=0.0), level)
    assert compute_sky_fraction(merged(settings, level)) == pytest.approx(0.5, abs=0.01)
    assert compute_sky_fraction(flat) > 0.55
    assert find_used_files(settings)["source.surroundings_file"] == coarse
    assert "source.surroundings_file" not in find_used_files(settings_of(plain, coarse, reach_m=0.0))
    before = hash_content(settings)
    write(coarse, lambda x, y: 101.0 + 0 * x, 20.0, 201)
    assert hash_content(settings) != before


def test_a_scene_stands_on_it_and_its_maps_are_of_the_patch(tmp_path):
    def slope(x, y):
        return 0.1 * x

    settings = settings_of(
        write(tmp_path / "fine.tif", slope, 0.5, 201), write(tmp_path / "wide.tif", slope, 20.0, 201)
    )
    built = build_scene(empty_scene(), merged(settings, {"rig": {"x_m": 500.0}}))
    assert built.site_m == pytest.approx(
        0.1 * 500.0 - drop_m(500.0, EUROPA_M) - built.ground["map"]["height_zero_m"], abs=1e-3
    )
    assert built.ground["map"]["body_radius_m"] == pytest.approx(EUROPA_M)
    extent = find_extent(built, 1.0)
    assert (extent.rows, extent.columns) == (40, 40)


def test_what_does_not_fit_together_is_refused(tmp_path, plain):
    np.save(tmp_path / "a.npy", np.zeros((64, 64)))
    alone = {"site": "OFFSET", "metres_per_pixel": 1.0}
    with pytest.raises(IcyMoonError, match=r"a\.npy states no coordinate system; give a GeoTIFF"):
        load(tmp_path / "a.npy", plain, **alone)
    assert len(load(tmp_path / "a.npy", reach_m=100.0, **alone).faces)
    with pytest.raises(IcyMoonError, match=r"beyond the visible side of a body with a radius of 252\.1 km"):
        load(tmp_path / "a.npy", reach_m=2e5, **alone)
    with pytest.raises(IcyMoonError, match="does not contain the site, which is at 400000 east, 700000 north"):
        load(plain, write(tmp_path / "far.tif", lambda x, y: 0 * x, 20.0, 21, (9e5, 7e5)))
