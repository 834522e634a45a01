"""Scale and place on maps against PROJ, through rasterio, on spheres; and what a scale means."""

from __future__ import annotations

import math

import pytest
from icymoon.formats.map_projection import KNOWN_SYSTEMS, MapSystem, find_local_scale, read_system
from map_systems import EUROPA_M, ON_A_SPHERE


def by_proj(text: str, points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Longitude and latitude of places by PROJ."""
    warp = pytest.importorskip("rasterio.warp", reason="pip install rasterio, which only tests need")
    from rasterio.crs import CRS

    sphere = CRS.from_proj4(f"+proj=longlat +R={EUROPA_M} +no_defs")
    xs, ys = zip(*points, strict=True)
    return list(zip(*warp.transform(CRS.from_proj4(f"{text} +R={EUROPA_M} +no_defs"), sphere, xs, ys), strict=True))


@pytest.mark.parametrize("text", ON_A_SPHERE)
def test_places_and_scales_are_those_of_proj(text):
    system, (x, y) = ON_A_SPHERE[text]
    (lon, lat), west, east, south, north = by_proj(text, [(x, y), (x - 50, y), (x + 50, y), (x, y - 50), (x, y + 50)])
    found = find_local_scale(system, x, y)
    assert (found.longitude_deg, found.latitude_deg) == (pytest.approx(lon, abs=1e-9), pytest.approx(lat, abs=1e-9))

    def on_ground(a, b):
        return (
            math.radians(b[0] - a[0]) * math.cos(math.radians(lat)) * EUROPA_M / 100,
            math.radians(b[1] - a[1]) * EUROPA_M / 100,
        )

    along_x, along_y = on_ground(west, east), on_ground(south, north)
    assert found.east == pytest.approx(math.hypot(*along_x), rel=1e-6)
    assert found.north == pytest.approx(math.hypot(*along_y), rel=1e-6)
    assert found.north_deg == pytest.approx(-math.degrees(math.atan2(*along_y)), abs=1e-4)
    turn = math.degrees(math.atan2(*along_x) - math.atan2(*along_y))
    assert found.skew_deg == pytest.approx((turn - 90 + 180) % 360 - 180, abs=1e-4)


@pytest.mark.parametrize("code", [*sorted(KNOWN_SYSTEMS), 32633, 32733, 25832, 26915])
def test_systems_of_earth_by_number_are_right_to_its_flattening(code):
    warp = pytest.importorskip("rasterio.warp", reason="pip install rasterio, which only tests need")
    from rasterio.crs import CRS

    system = read_system({3072: code}, 1.0)
    assert system is not None
    # A place that is on every one of these maps but near their middle.
    x, y = system.east_m + 3.1e5, system.north_m + (-2.2e6 if code in (32733,) else 7.4e5)
    (lon,), (lat,) = warp.transform(CRS.from_epsg(code), CRS.from_epsg(4326), [x], [y])
    assert system.to_sphere(x, y) == (
        pytest.approx(lon, abs=0.25 / max(math.cos(math.radians(lat)), 0.1)),
        pytest.approx(lat, abs=0.25),
    )


def test_a_web_map_at_60_degrees_is_twice_too_wide():
    found = find_local_scale(KNOWN_SYSTEMS[3857], 1e6, 8399737.8898)
    assert (found.east, found.north, found.latitude_deg) == (
        pytest.approx(0.5, rel=1e-6),
        pytest.approx(0.5, rel=1e-6),
        pytest.approx(60, abs=1e-5),
    )


def test_a_cylindrical_map_at_70_degrees_is_wider_than_high():
    system = read_system({1024: 1, 3072: 32767, 3075: 17, 2057: EUROPA_M, 2058: EUROPA_M, 3078: 0.0, 3088: 0.0}, 1.0)
    assert system is not None
    found = find_local_scale(system, 0.0, math.radians(-70) * EUROPA_M)
    assert found.east == pytest.approx(math.cos(math.radians(70)), rel=1e-6)
    assert found.north == pytest.approx(1, rel=1e-6)


def test_a_polar_map_is_true_at_its_parallel_only():
    system = read_system({1024: 1, 3072: 32767, 3075: 15, 2057: EUROPA_M, 3081: -70.0, 3095: 0.0}, 1.0)
    assert system is not None
    radius = 2 * EUROPA_M * (1 + math.sin(math.radians(70))) / 2 * math.tan(math.radians(10))
    assert find_local_scale(system, 0.0, radius).latitude_deg == pytest.approx(-70)
    assert find_local_scale(system, 0.0, radius).east == pytest.approx(1, rel=1e-7)
    assert find_local_scale(system, 0.0, 0.0).east == pytest.approx(2 / (1 + math.sin(math.radians(70))), rel=1e-6)


@pytest.mark.parametrize("keys", [{}, {3072: 32767}, {3072: 2056}, {3075: 99}, {3072: 32600}])
def test_what_is_not_known_is_none(keys):
    assert read_system(keys, 1.0) is None


@pytest.mark.parametrize(
    ("kind", "place"),
    [
        ("Orthographic", (2e6, 0.0)),
        ("Equidistant cylindrical", (0.0, 3e6)),
        ("Sinusoidal", (0.0, 3e6)),
        ("Lambert azimuthal equal area", (9e6, 0.0)),
        ("Albers equal area", (9e6, 9e6)),
    ],
)
def test_a_place_beyond_the_edge_of_a_map_is_an_error(kind, place):
    with pytest.raises((ValueError, OverflowError)):
        find_local_scale(MapSystem(kind, "", EUROPA_M, 0.0, 0.0, 30.0, 60.0), *place)


@pytest.mark.parametrize("pole", [90.0, -90.0])
@pytest.mark.parametrize(
    "kind",
    [
        "Polar stereographic",
        "Stereographic",
        "Azimuthal equidistant",
        "Lambert azimuthal equal area",
        "Orthographic",
        "Transverse Mercator",
    ],
)
def test_at_a_pole_the_central_meridian_says_where_north_is(kind, pole):
    """Whatever its coordinates are rounded to; it is north at places before the pole on that meridian."""
    origin = 0.0 if kind == "Transverse Mercator" else pole
    system = MapSystem(kind, "", EUROPA_M, -140.0, origin, origin)
    y = math.radians(pole) * EUROPA_M if kind == "Transverse Mercator" else 0.0
    before = find_local_scale(system, 0.0, y - math.copysign(20.0, pole))
    for dx, dy in ((0.0, 0.0), (-0.0, -0.0), (1e-10, 0.0), (-1e-10, 1e-10), (0.0, -1e-9)):
        found = find_local_scale(system, dx, y + dy)
        assert (found.longitude_deg, found.latitude_deg) == (pytest.approx(-140.0), pole)
        assert found.north_deg == pytest.approx(before.north_deg, abs=1e-3) == pytest.approx(0.0, abs=1e-3)
        assert (found.east, found.north) == pytest.approx((before.east, before.north), rel=1e-6)
    assert before.longitude_deg == pytest.approx(-140.0)
