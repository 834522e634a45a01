"""Sites by longitude and latitude or by the coordinates of a map, against PROJ through rasterio."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.formats import geotiff
from icymoon.formats.geotiff import Site
from icymoon.formats.map_forward import project_point
from icymoon.formats.map_point import MapPoint
from icymoon.formats.map_projection import MapSystem
from icymoon.support.errors import IcyMoonError
from map_systems import EUROPA_M, ON_A_SPHERE

rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")
warp = pytest.importorskip("rasterio.warp")

MOON_M = 1737400.0
LONLAT = f"+proj=longlat +R={MOON_M} +no_defs"
#: Map systems of the Moon, the middle of a map in longitude and latitude, and the size of a pixel in its unit.
MAPS = {
    "south pole": (f"+proj=stere +lat_0=-90 +R={MOON_M} +units=m +no_defs", (34.6, -88.8), 5.0),
    "at the pole": (f"+proj=stere +lat_0=90 +lon_0=15 +R={MOON_M} +units=m +no_defs", (10.0, 89.99995), 5.0),
    "kilometres": (f"+proj=merc +lon_0=-80 +R={MOON_M} +units=km +no_defs", (-75.0, 40.0), 0.01),
    "feet": (f"+proj=tmerc +lon_0=20 +lat_0=5 +k=0.9996 +x_0=1e5 +R={MOON_M} +units=ft +no_defs", (21.0, 6.0), 10.0),
    "degrees": (LONLAT, (12.5, -33.0), 1e-4),
    "degrees over 180": (LONLAT, (180.0, 5.0), 1e-4),
    "degrees to 360": (LONLAT, (-100.0 + 360.0, 5.0), 1e-4),
    "cylindrical over 180": (f"+proj=eqc +lon_0=180 +lat_ts=30 +R={MOON_M} +units=m +no_defs", (-179.0, 31.0), 10.0),
}
SIZE = 40


def write_map(path, name, upward=False, size=SIZE):
    """A map about its middle whose heights are its rows and columns; the map's transform and system."""
    text, middle, pixel = MAPS[name]
    crs = rasterio.crs.CRS.from_string(text)
    if name.startswith("degrees"):
        x, y = middle
    else:
        (x,), (y,) = warp.transform(LONLAT, crs, [middle[0]], [middle[1]])
    transform = rasterio.transform.Affine(
        pixel, 0, x - pixel * size / 2, 0, pixel if upward else -pixel, y + (-1 if upward else 1) * pixel * size / 2
    )
    rows, columns = np.mgrid[:size, :size]
    profile = {"driver": "GTiff", "width": size, "height": size, "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", **profile, crs=crs, transform=transform) as out:
        out.write((100 * rows + columns).astype(np.float32), 1)
    return transform, crs


def find(path, x, y, degrees, origin=(0.0, 0.0)):
    found = geotiff.read(path, Site(True, origin, 30.0, MOON_M, MapPoint(x, y, degrees)))
    assert found.place is not None
    return found


@pytest.mark.parametrize("text", ON_A_SPHERE)
def test_projections_forward_are_those_of_proj(text):
    system, place = ON_A_SPHERE[text]
    longitude, latitude = system.to_sphere(*place)
    # A micrometre on a body of 1560 km: what double precision leaves of angles in degrees.
    assert project_point(system, longitude, latitude) == pytest.approx(place, abs=1e-6)
    (x,), (y,) = warp.transform(
        f"+proj=longlat +R={EUROPA_M} +no_defs", f"{text} +R={EUROPA_M} +no_defs", [longitude], [latitude]
    )
    assert project_point(system, longitude, latitude) == pytest.approx((x, y), abs=1e-5)


def test_cylindrical_equal_area_and_places_that_no_map_has():
    system = MapSystem("Cylindrical equal area", "", EUROPA_M, 10.0, parallel_deg=30.0)
    assert project_point(system, *system.to_sphere(3e5, 4e5)) == pytest.approx((3e5, 4e5), abs=1e-6)
    for kind, place in (("Mercator", (0.0, 90.0)), ("Orthographic", (170.0, 0.0))):
        with pytest.raises(ValueError, match=r"pole|far side"):
            project_point(MapSystem(kind, "", EUROPA_M), *place)


@pytest.mark.parametrize("upward", [False, True])
@pytest.mark.parametrize("name", MAPS)
def test_a_site_by_coordinates_is_where_proj_has_it(tmp_path, name, upward):
    transform, crs = write_map(tmp_path / "map.tif", name, upward)
    x, y = rasterio.transform.xy(transform, SIZE / 2 - 2.0, SIZE / 2 + 2.75)
    (longitude,), (latitude,) = ([x], [y]) if crs.is_geographic else warp.transform(crs, LONLAT, [x], [y])
    unit = find(tmp_path / "map.tif", x, y, False).place.unit_m
    # A micrometre and what 1e-12 degrees are; degrees of a map are metres on a sphere of its radius.
    for found in (
        find(tmp_path / "map.tif", x, y, False),
        find(tmp_path / "map.tif", longitude, latitude, True),
        find(tmp_path / "map.tif", longitude + 360.0, latitude, True),
        find(tmp_path / "map.tif", longitude - 360.0, latitude, True),
    ):
        # A hundredth of a millimetre: PROJ's own latitudes about a pole are cosines that have lost half their digits.
        assert found.place.origin == pytest.approx((x * unit, y * unit), abs=1e-5)
    # The pixel under the site: a quarter of one east of a centre, on the edge between two rows.
    column = -found.corner_m[0] / found.pixel_m[0]
    row = -found.corner_m[1] / found.pixel_m[1]
    assert column % 1 == pytest.approx(0.75, abs=1e-4)
    assert row % 1 == pytest.approx(0.0, abs=1e-4) or row % 1 == pytest.approx(1.0, abs=1e-4)


def test_an_offset_is_of_ground_from_the_stated_place(tmp_path):
    write_map(tmp_path / "map.tif", "cylindrical over 180")
    here, there = (find(tmp_path / "map.tif", -179.0, 31.0, True, origin) for origin in ((0, 0), (30.0, -20.0)))
    scale = here.place.scale
    assert there.place.origin[0] - here.place.origin[0] == pytest.approx(30.0 / scale[0], rel=1e-9)
    assert there.place.origin[1] - here.place.origin[1] == pytest.approx(-20.0 / scale[1], rel=1e-9)
    # A parallel is longer on this map than on the ground by the cosines of 30 and 31 degrees.
    assert scale[0] == pytest.approx(math.cos(math.radians(31)) / math.cos(math.radians(30)), rel=1e-5)


@pytest.mark.parametrize("name", MAPS)
def test_a_site_beyond_the_map_is_a_sentence_with_its_extent(tmp_path, name):
    transform, crs = write_map(tmp_path / "map.tif", name)
    with rasterio.open(tmp_path / "map.tif") as opened:
        bounds = opened.bounds
    x, y, pixel = bounds.right, bounds.top, abs(transform.a)
    find(tmp_path / "map.tif", x, y, False)  # the edge is on the map
    with pytest.raises(IcyMoonError, match="does not contain easting") as caught:
        find(tmp_path / "map.tif", x + pixel, y, False)
    for edge in bounds:
        assert f"{edge:.10g}" in str(caught.value)
    beyond = (x + pixel, y) if crs.is_geographic else [v[0] for v in warp.transform(crs, LONLAT, [x + pixel], [y])]
    with pytest.raises(IcyMoonError, match=r"does not contain .* source\.site_longitude_deg"):
        find(tmp_path / "map.tif", beyond[0], beyond[1], True)


def test_latitudes_of_an_ellipsoid_are_planetocentric(tmp_path):
    """Earth's map in degrees has planetographic ones; of a projection of it the sentence has PROJ's systems."""
    profile = {"driver": "GTiff", "width": 9, "height": 9, "count": 1, "dtype": "float32"}
    centric = math.degrees(math.atan(math.tan(math.radians(45.0)) * (1 - 1 / 298.257223563) ** 2))
    for crs, x, y in (("EPSG:4326", 10.0, 45.0), ("EPSG:3857", 1113194.9079327357, 5621521.486192066)):
        pixel = 1e-5 if crs == "EPSG:4326" else 1.0
        place = rasterio.transform.from_origin(x - 4.5 * pixel, y + 4.5 * pixel, pixel, pixel)
        with rasterio.open(tmp_path / "e.tif", "w", **profile, crs=crs, transform=place) as out:
            out.write(np.ones((9, 9), np.float32), 1)
        found = find(tmp_path / "e.tif", 10.0, centric, True)
        assert (found.place.origin[0] / found.place.unit_m, found.place.origin[1] / found.place.unit_m) == (
            pytest.approx((x, y), abs=1e-9 if crs == "EPSG:4326" else 1e-3)
        )
    place = rasterio.transform.from_origin(5e5, 5e6, 1.0, 1.0)
    with rasterio.open(tmp_path / "u.tif", "w", **profile, crs="EPSG:32632", transform=place) as out:
        out.write(np.ones((9, 9), np.float32), 1)
    with pytest.raises(IcyMoonError, match=r"source\.site to MAP.*gdaltransform -s_srs") as caught:
        find(tmp_path / "u.tif", 9.0, centric, True)
    _, source, _, target, _ = str(caught.value).split('"')
    latitude = float(str(caught.value).split("echo ")[1].split()[1])
    assert latitude == pytest.approx(45.0, abs=1e-8)
    (x,), (y,) = warp.transform(source, target, [9.0], [45.0])
    assert x == pytest.approx(5e5, abs=1e-3)


def test_a_map_without_a_system_has_no_longitudes(tmp_path):
    profile = {"driver": "GTiff", "width": 9, "height": 9, "count": 1, "dtype": "float32"}
    with rasterio.open(tmp_path / "n.tif", "w", **profile, transform=rasterio.transform.from_origin(0, 9, 1, 1)) as out:
        out.write(np.ones((9, 9), np.float32), 1)
    with pytest.raises(IcyMoonError, match=r"set source\.site to MAP"):
        find(tmp_path / "n.tif", 4.0, 4.0, True)
    assert find(tmp_path / "n.tif", 4.0, 4.0, False).place.origin == (4.0, 4.0)
