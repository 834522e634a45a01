"""Cameras in map terms, against PROJ by steps on the ground; and GeoKeys that survive a copy."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from icymoon.formats import geotiff
from icymoon.formats.geokeys import geokeys_from_json
from icymoon.formats.geotiff import Site
from icymoon.formats.map_frame import describe_cameras, map_frame_from_json
from icymoon.formats.map_point import MapPoint
from icymoon.formats.tiff_write import MapPlace, encode_tiff
from icymoon.physics.light.directions import camera_axes

rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")
warp = pytest.importorskip("rasterio.warp")

pytestmark = pytest.mark.filterwarnings("ignore:Use `@` matmul")

R_M = 1737400.0
LONLAT = f"+proj=longlat +R={R_M} +no_defs"
SYSTEMS = {
    "polar": (f"+proj=stere +lat_0=-90 +R={R_M} +units=m +no_defs", (34.6, -70.0), 1.0),
    "transverse": (f"+proj=tmerc +lon_0=20 +lat_0=5 +R={R_M} +units=m +no_defs", (27.0, 41.0), 1.0),
    "stretched": (f"+proj=eqc +lon_0=0 +R={R_M} +units=m +no_defs", (12.0, 60.0), 1.0),
    "kilometres over 180": (f"+proj=merc +lon_0=180 +R={R_M} +units=km +no_defs", (-179.9999, 50.0), 1e-3),
    "degrees": (LONLAT, (-100.0, -45.0), 1e-4),
}


def make_place(tmp_path, name, size=64):
    """``ground`` of a pair whose site is at a place, its longitude and latitude, and the file's system."""
    text, (longitude, latitude), pixel = SYSTEMS[name]
    (x,), (y,) = (
        ([longitude], [latitude]) if name == "degrees" else warp.transform(LONLAT, text, [longitude], [latitude])
    )
    transform = rasterio.transform.from_origin(x - size * pixel / 2, y + size * pixel / 2, pixel, pixel)
    profile = {"driver": "GTiff", "width": size, "height": size, "count": 1, "dtype": "float32"}
    with rasterio.open(tmp_path / "m.tif", "w", **profile, crs=text, transform=transform) as out:
        out.write(np.zeros((size, size), np.float32), 1)
    site = Site(True, (0.0, 0.0), 40.0, R_M, MapPoint(longitude, latitude, True))
    place = geotiff.read_place(tmp_path / "m.tif", site)
    assert place is not None
    return {"map": json.loads(json.dumps(place.to_json() | {"height_zero_m": -1234.5}))}, longitude, latitude, text


def pose_at(x, y, z, heading):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera_axes(heading, 30.0), (x, y, z)
    return pose


@pytest.mark.parametrize("heading", [0.0, 77.0, 200.0])
@pytest.mark.parametrize("name", SYSTEMS)
def test_a_camera_is_where_and_looks_whither_proj_has_it(tmp_path, name, heading):
    ground, longitude, latitude, text = make_place(tmp_path, name)
    # 3 m off, where the map's scale is that of the site to a part in a million.
    found = describe_cameras(ground, {"left": pose_at(3.0, -2.0, 1.5, heading)})["left"]
    assert found["height_m"] == pytest.approx(-1233.0)
    here = [found["easting"]], [found["northing"]]
    (lon,), (lat,) = here if name == "degrees" else warp.transform(text, LONLAT, *here)
    assert (lon - found["longitude_deg"] + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-9)
    assert found["latitude_deg"] == pytest.approx(lat, abs=1e-9)
    east = math.radians((lon - longitude + 180) % 360 - 180) * math.cos(math.radians(latitude)) * R_M
    north = math.radians(lat - latitude) * R_M
    assert math.hypot(east, north) == pytest.approx(math.hypot(3.0, 2.0), rel=2e-3)  # scales below 1e-3 count as 1
    # A step of 100 m along the true azimuth, by a great circle, is a step along the grid azimuth on the map.
    azimuth, step = math.radians(found["azimuth_true_deg"]), 100.0 / R_M
    phi = math.radians(lat)
    there_lat = math.asin(math.sin(phi) * math.cos(step) + math.cos(phi) * math.sin(step) * math.cos(azimuth))
    turn = math.atan2(
        math.sin(azimuth) * math.sin(step) * math.cos(phi), math.cos(step) - math.sin(phi) * math.sin(there_lat)
    )
    there = [lon + math.degrees(turn)], [math.degrees(there_lat)]
    (x,), (y,) = there if name == "degrees" else warp.transform(LONLAT, text, *there)
    on_map = math.degrees(math.atan2(x - found["easting"], y - found["northing"])) % 360
    # A hundred metres of a great circle bend by some hundredths of a degree on these maps.
    assert (on_map - found["azimuth_grid_deg"] + 180) % 360 - 180 == pytest.approx(0.0, abs=0.01)


def test_convergence_of_polar_and_transverse_maps_has_its_closed_form(tmp_path):
    ground, *_ = make_place(tmp_path, "polar")
    polar = describe_cameras(ground, {"left": pose_at(0.0, 0.0, 0.0, 10.0)})["left"]
    # About the south pole north is the longitude, clockwise of the map's up.
    assert polar["convergence_deg"] == pytest.approx(34.6, abs=1e-6)
    assert polar["azimuth_true_deg"] == pytest.approx((10.0 - 34.6) % 360, abs=1e-6)
    ground, *_ = make_place(tmp_path, "transverse")
    transverse = describe_cameras(ground, {"left": pose_at(0.0, 0.0, 0.0, 10.0)})["left"]
    wanted = math.degrees(math.atan(math.tan(math.radians(7.0)) * math.sin(math.radians(41.0))))
    assert transverse["convergence_deg"] == pytest.approx(-wanted, abs=1e-6)
    assert transverse["azimuth_grid_deg"] == pytest.approx(10.0, abs=1e-9)


def test_a_camera_that_looks_down_has_the_azimuth_of_its_upper_edge(tmp_path):
    ground, *_ = make_place(tmp_path, "polar")
    pose = np.eye(4)
    pose[:3, :3] = camera_axes(50.0, 90.0)
    assert describe_cameras(ground, {"left": pose})["left"]["azimuth_grid_deg"] == pytest.approx(50.0, abs=1e-6)


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_copy_of_the_geokeys_is_the_same_system_for_gdal(tmp_path, name):
    ground, _, _, _ = make_place(tmp_path, name)
    frame = map_frame_from_json(ground)
    assert frame is not None
    values = np.arange(12, dtype=np.float32).reshape(3, 4)
    place = MapPlace((0.5, 0.25), 7.0, 9.0, frame.geokeys, "m", notes={"values": "a <b> & c"})
    (tmp_path / "c.tif").write_bytes(encode_tiff(values, place))
    with rasterio.open(tmp_path / "m.tif") as source, rasterio.open(tmp_path / "c.tif") as made:
        assert made.crs == source.crs
        assert made.transform[:6] == (0.5, 0.0, 7.0, 0.0, -0.25, 9.0)
        assert math.isnan(made.nodata)
        assert made.units == ("m",)
        assert made.tags()["values"] == "a <b> & c"
        np.testing.assert_array_equal(made.read(1), values)


def test_vertical_systems_in_another_unit_are_left_out_of_a_copy(tmp_path):
    profile = {"driver": "GTiff", "width": 9, "height": 9, "count": 1, "dtype": "float32"}
    transform = rasterio.transform.from_origin(5e5, 5e6, 1.0, 1.0)
    for vertical, kept in ((5703, True), (6360, False)):  # NAVD88 in metres, and in US survey feet
        with rasterio.open(
            tmp_path / "v.tif", "w", **profile, crs=f"EPSG:32633+{vertical}", transform=transform
        ) as out:
            out.write(np.ones((9, 9), np.float32), 1)
        place = geotiff.read_place(tmp_path / "v.tif", Site(True, (0.0, 0.0), 5.0))
        assert place is not None
        assert place.geokeys is not None
        made = MapPlace((1.0, 1.0), 5e5, 5e6, place.geokeys, "m")
        (tmp_path / "w.tif").write_bytes(encode_tiff(np.ones((2, 2), np.float32), made))
        with rasterio.open(tmp_path / "v.tif") as source, rasterio.open(tmp_path / "w.tif") as copy:
            assert (copy.crs == source.crs) == kept
            assert kept or copy.crs == rasterio.crs.CRS.from_epsg(32633)


@pytest.mark.parametrize(
    "change",
    [
        {"geokeys": None},
        {"geokeys": {"directory": "1 1 0 x", "doubles": "", "text": ""}},
        {"geokeys": {"directory": "1 1 0 1 3072 34736 1 9", "doubles": "1.0", "text": ""}},
        {"geokeys": {"directory": "1 1 0 1 3072 0 1 70000", "doubles": "", "text": ""}},
        {"geokeys": {"directory": "1 1 0 1 3072 0 1 32633", "doubles": "nan", "text": ""}},
        {"geokeys": {"directory": "1 1 0 1 3072 0 1 32633", "doubles": "1.0", "text": "\u00e9"}},
        {"bounds": [0.0, 1.0]},
        {"scale": [0.0, 1.0]},
        {"unit_m": "1"},
        {"origin": [1.0, float("inf")]},
    ],
)
def test_a_damaged_place_is_none(tmp_path, change):
    ground, *_ = make_place(tmp_path, "polar")
    assert map_frame_from_json(ground) is not None
    assert map_frame_from_json({"map": ground["map"] | change}) is None
    assert describe_cameras({"map": ground["map"] | change}, {"left": np.eye(4)}) == {}


def test_geokeys_of_nothing_are_none():
    assert geokeys_from_json(None) is None
    assert map_frame_from_json(None) is None
    assert map_frame_from_json({"map": None}) is None
