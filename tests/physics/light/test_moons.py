"""The other moons: places against other theories and resonances, light against magnitudes, mesh against geometry."""

import math
from dataclasses import replace

import numpy as np
import pytest
from icymoon.physics.light import ephemeris
from icymoon.physics.light.bodies import BODIES
from icymoon.physics.light.moon_mesh import is_above_horizon, make_moon_mesh
from icymoon.physics.light.moon_orbits import find_moon_places
from icymoon.physics.light.moons import MOONS, make_sky_moons
from icymoon.physics.light.planetshine import Planet
from icymoon.physics.light.sky import SkyPlace, compute_sky, describe_sky
from icymoon.physics.light.stars import SUN_V_MAG
from icymoon.physics.light.sunlight import AU_KM
from icymoon.settings import description

pytestmark = pytest.mark.filterwarnings("error")

#: Jupiter's moons by Lainey's L1.2 theory (astronomy-engine 2.1.19): kilometres, J2000 equator, by days since J2000.
L12 = {
    100.0: {
        "IO": (-377671, -169074, -86808),
        "GANYMEDE": (-911984, -500828, -250790),
        "CALLISTO": (418193, 1655545, 789038),
    },
    5478.75: {
        "IO": (337052, -228369, -103234),
        "GANYMEDE": (-792226, 656981, 303352),
        "CALLISTO": (-1895540, -40863, -47329),
    },
    10957.5: {
        "IO": (-9098, -379515, -180867),
        "GANYMEDE": (607650, 790361, 389152),
        "CALLISTO": (437136, -1658895, -775076),
    },
    16436.25: {
        "IO": (-349247, -210747, -106232),
        "GANYMEDE": (949360, -450796, -197397),
        "CALLISTO": (1667254, 755096, 379720),
    },
    21915.0: {
        "IO": (-394782, 138568, 59403),
        "GANYMEDE": (-362994, -909513, -438936),
        "CALLISTO": (-1213272, 1311837, 598852),
    },
}
#: Angles at Saturn from Enceladus to other moons, in degrees, by days since J2000: the polynomials of the Bureau des
#: Longitudes in PyEphem 4.2.1, which are fitted to the theory TASS 1.7. With the light time to the Earth in days.
BDL = {
    1000.0: (0.05136, {"MIMAS": 95.53, "TETHYS": 25.04, "DIONE": 155.22, "RHEA": 77.7, "TITAN": 165.9}),
    4000.0: (0.05732, {"MIMAS": 10.53, "TETHYS": 125.21, "DIONE": 94.3, "RHEA": 47.2, "TITAN": 62.41}),
    7000.0: (0.06129, {"MIMAS": 67.06, "TETHYS": 134.38, "DIONE": 16.25, "RHEA": 171.75, "TITAN": 42.87}),
    10000.0: (0.05873, {"MIMAS": 124.17, "TETHYS": 33.51, "DIONE": 126.21, "RHEA": 63.1, "TITAN": 149.89}),
    13000.0: (0.05845, {"MIMAS": 162.92, "TETHYS": 70.77, "DIONE": 120.9, "RHEA": 63.9, "TITAN": 101.9}),
}
DATED = {"directions_from": "DATE", "planet": True, "moons": True, "latitude_deg": 0.0, "longitude_deg": 40.0}
UP = np.array([0.0, 0.0, 1.0])


def angle_deg(a, b):
    return math.degrees(math.atan2(np.linalg.norm(np.cross(a, b)), a @ b))


def light(**changes):
    return description.defaults().light | DATED | changes


def seen_from(body, date):
    """Positions over a site where the planet is in the zenith, so near that its own place moves no moon behind it."""
    return ephemeris.find_positions(body, date, 0.0, BODIES[body].under_planet(ephemeris.days_since_j2000(date))[0])


@pytest.mark.parametrize("days", list(L12))
def test_jupiters_moons_are_where_a_full_theory_puts_them(days):
    """The terms left out add up to 0.12°; a moon without its largest term is 0.2 to 1° off."""
    places = find_moon_places("JUPITER", days)
    for name, expected in L12[days].items():
        assert angle_deg(places[name], np.array(expected, float)) < 0.13
        assert np.linalg.norm(places[name]) == pytest.approx(np.linalg.norm(expected), rel=1e-3)


@pytest.mark.parametrize("days", list(BDL))
def test_saturns_moons_are_as_far_apart_as_in_another_theory(days):
    """Both moons of a pair may be 0.2° off; the libration that is left out of a wrong Mimas would be 43°."""
    delay, apart = BDL[days]
    places = find_moon_places("SATURN", days - delay)
    for name, expected in apart.items():
        found = angle_deg(places["ENCELADUS"], places[name])
        assert found == pytest.approx(expected, abs=0.6 if name == "MIMAS" else 0.4)


def test_mimas_and_enceladus_stand_where_a_numerical_integration_puts_them():
    """NOE (Lainey, IMCCE, 2011) at J2000, kilometres in the J2000 equatorial frame; its errors are about 600 km."""
    places = find_moon_places("SATURN", 0.0)
    for name, expected in (
        ("MIMAS", (141171.06, -116684.16, -2077.58)),
        ("ENCELADUS", (161899.81, -173370.95, -1184.99)),
    ):
        assert np.linalg.norm(places[name] - expected) < 600


@pytest.mark.parametrize(("body", "error_deg"), [("ENCELADUS", 0.05), ("EUROPA", 0.2)])
def test_the_moon_of_the_site_is_at_the_same_place_by_both_tables(body, error_deg):
    """A moon is placed from the planet's centre, and the site from the body's own table."""
    moon = BODIES[body]
    for days in np.arange(0.0, 22000.0, 777.7):
        own = -ephemeris.body_frame(moon.orientation(days)) @ find_moon_places(moon.parent, days)[body]
        longitude, _ = moon.under_planet(days)
        over = math.radians(longitude)
        assert angle_deg(own, np.array([math.cos(over), math.sin(over), 0.0])) < error_deg


def longitudes(planet, days):
    """Longitudes of the moons in degrees along the planet's equator, from one fixed direction in it."""
    pole = {"SATURN": (40.589, 83.537), "JUPITER": (268.057, 64.495)}[planet]
    frame = ephemeris.body_frame((*pole, 0.0))
    return {
        name: math.degrees(math.atan2((frame @ place)[1], (frame @ place)[0]))
        for name, place in find_moon_places(planet, days).items()
    }


def test_io_europa_and_ganymede_keep_laplaces_resonance():
    """Mean longitudes: λ₁ - 3 λ₂ + 2 λ₃ = 180°, up to a libration of 0.07°. True ones swing by the terms about it."""
    found = []
    for days in np.arange(0.0, 22000.0, 13.7):
        at = longitudes("JUPITER", days)
        found.append((at["IO"] - 3 * at["EUROPA"] + 2 * at["GANYMEDE"]) % 360)
    assert np.mean(found) == pytest.approx(180.0, abs=0.15)
    assert np.abs(np.array(found) - 180).max() < 0.5 + 3 * 1.07 + 2 * 0.35


def test_enceladus_passes_dione_near_its_pericentre():
    """The resonance 2:1 keeps Enceladus' eccentricity: 2 λ_Dione - λ_Enceladus - ϖ librates about 0 by 1.5°."""
    phases, ratios = [], []
    for days in np.arange(0.0, 30.0, 0.02):
        at = longitudes("SATURN", days)
        phases.append((at["DIONE"] - at["ENCELADUS"] + 180) % 360 - 180)
        ratios.append(np.linalg.norm(find_moon_places("SATURN", days)["ENCELADUS"]))
    passes = [k for k in range(1, len(phases)) if phases[k - 1] > 0 >= phases[k] > -90]
    assert len(passes) >= 10
    # Over 0.02 days Enceladus moves by 5.2°, which changes its distance by 0.4 % of the swing.
    np.testing.assert_allclose(np.array(ratios)[passes], min(ratios), rtol=0.02 * 0.00485)


def test_moons_inside_the_orbit_stay_near_the_planet_and_moons_outside_go_round():
    """Greatest elongation: the sine is the ratio of the orbits, with eccentricities of 0.02 and 0.005."""
    for body, reach in (
        ("ENCELADUS", {"MIMAS": 185.54 / 238.04}),
        ("EUROPA", {"IO": 421.8 / 671.1}),
    ):
        apart = {}
        for hour in range(0, 24 * 30, 4):
            at = seen_from(body, str(np.datetime64("2038-06-01T00") + np.timedelta64(hour, "h")))
            for name, place in at.moons_km.items():
                apart.setdefault(name, []).append(angle_deg(place, at.planet))
        for name, found in apart.items():
            if name in reach:
                assert max(found) == pytest.approx(math.degrees(math.asin(reach[name])), abs=1.8)
            else:
                assert max(found) > 170
                assert min(found) < 10


def test_tethys_grows_to_one_degree():
    """At its nearest, 294 660 - 238 040 - 252 km away, it is 2 asin(531 / 56 370) = 1.08° wide."""
    widest = 0.0
    for hour in range(0, 24 * 6):
        date = str(np.datetime64("2038-06-01T00") + np.timedelta64(hour, "h"))
        at = ephemeris.find_positions("ENCELADUS", date, 0.0, 176.0)  # where Saturn is in the nadir
        widest = max(widest, 2 * math.degrees(math.asin(531.0 / np.linalg.norm(at.moons_km["TETHYS"]))))
    assert widest == pytest.approx(1.08, abs=0.02)


#: V at mean opposition: Explanatory Supplement to the Astronomical Almanac.
OPPOSITION_MAG = {
    "IO": 5.02,
    "EUROPA": 5.29,
    "GANYMEDE": 4.61,
    "CALLISTO": 5.65,
    "MIMAS": 12.9,
    "ENCELADUS": 11.7,
    "TETHYS": 10.2,
    "DIONE": 10.4,
    "RHEA": 9.7,
    "TITAN": 8.28,
}


@pytest.mark.parametrize("name", list(MOONS))
def test_moons_are_as_bright_as_from_the_earth_at_opposition(name):
    """Within 0.25 mag: the moons' brightening within a degree of opposition is left out."""
    moon = MOONS[name]
    sun_au = {"JUPITER": 5.203, "SATURN": 9.555}[moon.planet]
    ratio = moon.geometric_albedo * (moon.radius_km / AU_KM) ** 2 / (sun_au * (sun_au - 1)) ** 2
    assert SUN_V_MAG - 2.5 * math.log10(ratio) == pytest.approx(OPPOSITION_MAG[name], abs=0.25)


@pytest.mark.parametrize("name", list(MOONS))
def test_the_phase_law_has_the_phase_integral(name):
    """Twice the integral of Φ sin α; the fit q = 0.290 + 0.684 G is good to 0.03."""
    moon = MOONS[name]
    phase = np.linspace(0.0, 180.0, 3601)
    found = np.array([moon.phase_function(p) for p in phase])
    assert found[0] == pytest.approx(1.0)
    assert (np.diff(found) <= 1e-12).all()
    integral = 2 * (found * np.sin(np.radians(phase))).sum() * math.radians(0.05)
    assert integral == pytest.approx(moon.phase_integral, abs=0.04)


def test_bands_follow_the_colour_index():
    """Titan and Io are orange; the green band is V, and the line through V and B meets B at 440 nm."""
    for moon in MOONS.values():
        red, green, blue = moon.band_albedos()
        assert green == pytest.approx(moon.geometric_albedo)
        assert red > green > blue > 0
        at_b = green - (green - blue) * 110 / 90
        assert -2.5 * math.log10(at_b / green) == pytest.approx(moon.b_v - 0.653, abs=1e-6)


def make_moon(diameter_deg, phase_deg, name="TETHYS", direction=UP):
    """A moon of an apparent size, with the Sun at a phase angle, beside a distant planet that shades nothing."""
    side = np.array([1.0, 0.0, 0.0])
    sun = -math.cos(math.radians(phase_deg)) * direction + math.sin(math.radians(phase_deg)) * side
    planet = Planet(np.array([0.0, -1.0, 0.0]), 1.0, 0.0, np.array([0.0, 1.0, 0.0]), sun, 14.82, 0.5, "LAMBERT")
    distance = MOONS[name].radius_km / math.sin(math.radians(diameter_deg / 2))
    return make_sky_moons({name: distance * direction}, planet, 238040.0, 0.0556)[0]


def integrate_mesh(mesh, values):
    """Integral over solid angle of values at vertices, which are linear over triangles."""
    ray = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    triangles = np.concatenate([mesh.faces[:, :3], mesh.faces[:, [0, 2, 3]]])
    a, b, c = (ray[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return float(area @ values[triangles].mean(axis=1))


@pytest.mark.parametrize("wide_px", [0.05, 1.0, 1.99, 2.01, 4.0, 40.0])
@pytest.mark.parametrize(("phase_deg", "name"), [(0.0, "TETHYS"), (75.0, "TETHYS"), (130.0, "TITAN")])
def test_a_moon_of_any_size_keeps_its_light_and_hides_its_disc(wide_px, phase_deg, name):
    moon = make_moon(0.03, phase_deg, name)
    mesh = make_moon_mesh([moon], math.radians(0.03) / wide_px)
    assert moon.irradiance_wm2.min() > 0
    for band in range(3):
        assert integrate_mesh(mesh, mesh.radiance[:, band]) == pytest.approx(moon.irradiance_wm2[band], rel=1e-3)
    hidden = math.pi * math.sin(math.radians(0.015)) ** 2
    assert integrate_mesh(mesh, 1 - mesh.transmission) == pytest.approx(hidden, rel=3e-3)
    assert mesh.transmission.min() >= 0.0
    assert mesh.radiance.min() >= 0.0


def test_the_disc_at_full_phase_has_the_radiance_of_its_albedo():
    """π L / E is the geometric albedo; the law of Lommel and Seeliger gives a flat disc, Lambert's a darker limb."""
    for name, at_limb in (("TETHYS", 1.0), ("TITAN", 0.6)):
        moon = make_moon(0.3, 0.0, name)
        mesh = make_moon_mesh([moon], math.radians(0.3) / 200)
        away = np.sin(np.arccos(np.clip(mesh.vertices @ UP / np.linalg.norm(mesh.vertices, axis=1), -1, 1)))
        inside = away < 0.9 * math.sin(math.radians(0.15))
        factor = math.pi / 14.82 * mesh.radiance[:, 1]
        middle = factor[0]
        assert middle == pytest.approx((1.5 if moon.is_hazy else 1.0) * MOONS[name].geometric_albedo, rel=0.02)
        eight = np.argmin(np.where(inside, np.abs(away - 0.8 * math.sin(math.radians(0.15))), 1.0))
        assert factor[eight] / middle == pytest.approx(at_limb, abs=0.03)


def test_the_dark_side_is_away_from_the_sun():
    mesh = make_moon_mesh([make_moon(0.3, 90.0)], math.radians(0.3) / 40)
    side = mesh.vertices[:, 0] / mesh.vertices[:, 2]
    assert mesh.radiance[side < -1e-4].max() == 0
    assert mesh.radiance[side > 1e-4].max() > 0


def test_the_shadow_of_the_planet_hides_a_moon_behind_it_only():
    """Saturn 238 040 km away in the zenith, the Sun behind it as the moon sees it, or to the side."""
    planet = Planet(UP, 29.33, 0.0, np.array([0.0, 1.0, 0.0]), -UP, 14.82, 0.5, "LAMBERT")
    behind, beside, before = np.array([0, 0, 5e5]), np.array([6.5e4, 0, 5e5]), np.array([0, 0, 1e5])
    shares = [
        make_sky_moons({"TETHYS": place}, planet, 238040.0, 0.0556)[0].eclipse for place in (behind, beside, before)
    ]
    assert shares == [1.0, 0.0, 0.0]
    assert make_sky_moons({"TETHYS": behind}, planet, 238040.0, 0.0556)[0].irradiance_wm2.max() == 0
    aside = replace(planet, sun=np.array([1.0, 0.0, 0.0]))
    assert make_sky_moons({"TETHYS": behind}, aside, 238040.0, 0.0556)[0].eclipse == 0
    # On the edge of the shadow half of the Sun is hidden: 60 290 km off the axis, at Saturn's radius.
    edge = np.array([238040.0 * math.sin(math.radians(29.33 / 2)), 0.0, 5e5])
    assert make_sky_moons({"TETHYS": edge}, planet, 238040.0, 0.0556)[0].eclipse == pytest.approx(0.5, abs=0.05)


def test_a_moon_is_before_the_planet_or_behind_it_as_its_distance_says():
    """2038-08-03 10:20: Mimas crosses Saturn's disc while Titan is behind it. In the mesh too."""
    sky = compute_sky(light(date_utc="2038-08-03T10:20"))
    at = {moon.name: moon for moon in sky.moons}
    for name, nearer in (("MIMAS", True), ("TITAN", False)):
        assert angle_deg(at[name].globe.direction, sky.planet.direction) < 7
        assert (at[name].distance < 1) == nearer
        far = np.linalg.norm(make_moon_mesh([at[name]], 1e-3).vertices, axis=1)
        np.testing.assert_allclose(far, at[name].distance, rtol=0.01)
    assert [moon.name for moon in sky.moons] == sorted(at, key=lambda name: at[name].distance)


def test_moons_are_shown_with_a_date_and_a_planet_only_and_default_to_off():
    plain = describe_sky(compute_sky(description.defaults().light))
    assert "moons" not in plain
    for changes in ({"directions_from": "ANGLES"}, {"moons": False}, {"planet": False}):
        found = compute_sky(light(**changes))
        assert not found.moons
        assert "moons" not in describe_sky(found)
    for body, names in (
        ("ENCELADUS", {"MIMAS", "TETHYS", "DIONE", "RHEA", "TITAN"}),
        ("EUROPA", {"IO", "GANYMEDE", "CALLISTO"}),
    ):
        facts = describe_sky(compute_sky(light(body=body)))
        assert {moon["name"] for moon in facts["moons"]} == names
        assert {key: value for key, value in facts.items() if key != "moons"} == describe_sky(
            compute_sky(light(body=body, moons=False))
        )


def test_moons_turn_with_the_map():
    plain, turned = (
        compute_sky(light(), place=SkyPlace(0.0, 40.0, north)).moons[0].globe.direction for north in (0.0, 90.0)
    )
    np.testing.assert_allclose(turned, [plain[1], -plain[0], plain[2]], atol=1e-12)


def test_a_moon_below_the_horizon_is_left_out_and_one_that_rises_is_not():
    low = make_moon(0.3, 0.0, direction=np.array([0.0, math.cos(0.01), -math.sin(0.01)]))
    assert not is_above_horizon(low, 1e-4, 0.2)
    assert is_above_horizon(low, 1e-4, 0.45)
    assert is_above_horizon(low, 1e-2, 0.2)


@pytest.mark.parametrize("body", list(BODIES))
def test_the_light_of_moons_on_the_ground_is_below_1e_4_of_the_suns(body):
    """Also if all of them are up. Tethys and Io bring the most."""
    most = 0.0
    for hour in range(0, 24 * 8, 2):
        date = str(np.datetime64("2038-06-01T00") + np.timedelta64(hour, "h"))
        found = compute_sky(light(body=body, date_utc=date))
        lit = sum(float(moon.irradiance_wm2.mean()) for moon in found.moons)
        most = max(most, lit / found.sun_irradiance_wm2)
    assert 1e-6 < most < 1e-4
