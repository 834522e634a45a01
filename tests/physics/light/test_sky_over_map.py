"""A sky that is not that of the map's site is said."""

from __future__ import annotations

import re

import pytest
from icymoon.formats.geotiff import MapPlace
from icymoon.formats.map_projection import MapSystem, find_local_scale
from icymoon.physics.light.sky import compute_sky, describe_sky
from icymoon.physics.light.sky_over_map import find_sky_place, warn_sky_of_another_site
from icymoon.settings.description import check, defaults, merged
from icymoon.settings.topics.light import LightSettings
from icymoon.settings.topics.scene import Settings, typed


def light(**changes: object) -> LightSettings:
    return typed(merged(defaults(), check({"light": {"directions_from": "DATE", **changes}}, "test"))).light


def place(latitude: float | None, longitude: float | None, north: float = 0.0) -> dict:
    return MapPlace("EPSG:1", 1.0, (0.0, 0.0), (1.0, 1.0), longitude, latitude, north).to_json()


def test_a_site_elsewhere_is_said_and_its_fix_silences_it():
    (said,) = warn_sky_of_another_site(light(latitude_deg=10.0, longitude_deg=27.5), place(89.927, -180.0))
    fixed = dict(re.findall(r"light\.(\w+) to (-?[\d.]+\d)", said))
    assert set(fixed) == {"latitude_deg", "longitude_deg"}
    assert not warn_sky_of_another_site(
        light(**{key: float(value) for key, value in fixed.items()}), place(89.927, -180.0)
    )


@pytest.mark.parametrize(("latitude", "longitude"), [(-80.05, 0.0), (-80.0, 360.0), (-80.0, -360.0)])
def test_the_same_site_is_not_doubted(latitude, longitude):
    assert not warn_sky_of_another_site(light(latitude_deg=-80.0, longitude_deg=0.0), place(latitude, longitude))


@pytest.mark.parametrize("pole", [90.0, -90.0])
def test_at_a_pole_the_longitude_is_a_direction(pole):
    """Around the pole of a map every place has another longitude and another north, and the sky is the same."""
    system = MapSystem("Polar stereographic", "", 1560800.0, 40.0, pole, pole)
    turns = set()
    for x, y in ((0.0, 0.0), (1e-10, -1e-10), (0.0, 500.0), (500.0, 0.0), (-300.0, -300.0)):
        at = find_local_scale(system, x, y)
        there = place(at.latitude_deg, at.longitude_deg, at.north_deg)
        (said,) = warn_sky_of_another_site(light(latitude_deg=pole, longitude_deg=10.0), there)
        turns.add(re.search(r"(\S+)° clockwise", said)[1])
        fixed = float(re.search(r"set light\.longitude_deg to (\S+),", said)[1])
        assert fixed == pytest.approx(40.0, abs=2e-4)
        assert not warn_sky_of_another_site(light(latitude_deg=pole, longitude_deg=fixed), there)
    # Seen from above, longitude goes counterclockwise about the north pole, and the north of a meridian turns with it.
    assert turns == {"30.0" if pole > 0 else "-30.0"}


def test_a_map_whose_up_is_not_north_turns_the_sun_of_a_date():
    (said,) = warn_sky_of_another_site(light(latitude_deg=80.0, longitude_deg=-90.0), place(80.0, -90.0, -90.0))
    assert "90.0° off" in said
    assert "azimuth plus 270.0°" in said
    assert not warn_sky_of_another_site(light(latitude_deg=80.0, longitude_deg=-90.0), place(80.0, -90.0, -0.5))


def test_angles_and_files_without_a_map_are_not_doubted():
    assert not warn_sky_of_another_site(light(directions_from="ANGLES"), place(45.0, 10.0, 30.0))
    assert not warn_sky_of_another_site(light(), place(None, None))
    assert not warn_sky_of_another_site(light(), None)


def sited(kind: str = "DEGREES", **light: object) -> Settings:
    source = {"kind": "HEIGHT_MAP", "file": "a.tif", "site": kind, "site_longitude_deg": "34.6"}
    stated = {"light": {"directions_from": "DATE", "body": "EUROPA", **light}}
    return typed(merged(defaults(), check({"source": source | {"site_latitude_deg": "-48.8"}, **stated}, "test")))


@pytest.mark.parametrize("kind", ["DEGREES", "MAP"])
def test_the_sky_of_a_date_is_that_over_the_site_turned_by_the_maps_north(kind):
    """Elevations, sizes and light are those of the place; azimuths count from the map's up."""
    settings = sited(kind)
    at = find_sky_place(settings, place(-48.8, 34.6, 30.0))
    assert at is not None
    shown = describe_sky(compute_sky(settings.light, place=at))
    plain = describe_sky(compute_sky(settings.light | {"latitude_deg": -48.8, "longitude_deg": 34.6}))
    assert (shown["sun"]["azimuth_deg"] - plain["sun"]["azimuth_deg"]) % 360 == pytest.approx(30.0, abs=1e-9)
    for key in ("elevation_deg", "irradiance_wm2", "angular_diameter_deg", "eclipse"):
        assert shown["sun"][key] == pytest.approx(plain["sun"][key], rel=1e-9)
    assert shown["place"] == {"latitude_deg": -48.8, "longitude_deg": 34.6, "north_deg": 30.0, "from": "source.site"}
    assert "place" not in plain


def test_planet_and_stars_turn_with_the_sun():
    settings = sited(planet=True)
    at = find_sky_place(settings, place(-48.8, 34.6, -77.0))
    shown = compute_sky(settings.light, place=at)
    plain = compute_sky(settings.light | {"latitude_deg": -48.8, "longitude_deg": 34.6})
    assert shown.planet is not None
    assert plain.planet is not None
    pairs = [(shown.planet.direction, plain.planet.direction), (shown.planet.pole, plain.planet.pole)]
    pairs += list(zip(shown.from_j2000.T, plain.from_j2000.T, strict=True))
    for one, other in [*pairs, (shown.sun, plain.sun), (shown.planet.sun, plain.planet.sun)]:
        # Angles among them stay; the shares of phase and eclipse follow.
        assert one @ shown.sun == pytest.approx(other @ plain.sun, abs=1e-12)
        assert one[2] == pytest.approx(other[2], abs=1e-12)


@pytest.mark.parametrize(
    ("settings", "there"),
    [
        (sited(place="STATED"), place(-48.8, 34.6)),
        (sited(directions_from="ANGLES"), place(-48.8, 34.6)),
        (sited("OFFSET"), place(-48.8, 34.6)),
        (sited(), place(None, None)),
        (sited(), None),
    ],
)
def test_other_settings_have_the_sky_that_they_state(settings, there):
    assert find_sky_place(settings, there) is None


def test_at_a_pole_the_sky_has_the_meridian_of_the_maps_north():
    """The stated longitude of a pole is a direction; the map's place has the one from which its north is counted."""
    settings = sited()
    settings["source"] = settings.source | {"site_latitude_deg": "-90"}
    at = find_sky_place(settings, place(-90.0, 40.0, 0.0))
    assert at is not None
    assert at.longitude_deg == 40.0
