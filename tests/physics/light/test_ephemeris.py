"""Where Sun and planet stand: against full theories, SPICE with kernels made here, and geometry."""

import math
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from icymoon.physics.light import ephemeris, moons, spice
from icymoon.physics.light.bodies import BODIES
from icymoon.physics.light.moon_orbits import find_moon_places
from icymoon.physics.light.sky import azimuth_deg, compute_sky, elevation_deg
from icymoon.physics.light.sunlight import AU_KM
from icymoon.settings import description, preset_files
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")

#: Heliocentric positions in au, J2000 equator, by days since J2000: Simon et al. 1994 (ERFA's plan94).
PLAN94 = {
    "EUROPA": {
        0.0: (4.00156, 2.7361, 1.07544),
        5478.75: (-3.73145, 3.45229, 1.57059),
        10957.5: (-4.01803, -3.38021, -1.35113),
        16436.25: (3.60244, -3.24691, -1.47929),
        21915.0: (2.58981, 3.96914, 1.63825),
    },
    "ENCELADUS": {
        0.0: (6.4046, 6.17527, 2.27445),
        5478.75: (-5.40649, -7.80468, -2.99047),
        10957.5: (5.50225, 6.80734, 2.57451),
        16436.25: (-4.47945, -8.31086, -3.23976),
        21915.0: (4.46981, 7.39535, 2.86213),
    },
}
DATE = "2035-03-01T12:00:00"


def angle_deg(a, b):
    return math.degrees(math.atan2(np.linalg.norm(np.cross(a, b)), a @ b))


@pytest.mark.parametrize("body", list(BODIES))
def test_the_sun_is_where_a_full_theory_puts_it(body):
    for days, expected in PLAN94[body].items():
        found = ephemeris.heliocentric_position_au(BODIES[body].orbit, days)
        assert angle_deg(found, np.array(expected)) < 0.25
        assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(expected), rel=2e-3)


def test_sub_solar_latitude_and_irradiance_stay_in_their_ranges():
    for body, tilt, low, high in (("ENCELADUS", 26.75, 13.3, 16.8), ("EUROPA", 3.7, 45.5, 55.8)):
        elevations, irradiances = [], []
        for year in range(2000, 2060):
            at = ephemeris.find_positions(body, f"{year}-06-01", 90.0, 0.0)  # over the pole: the sub-solar latitude
            elevations.append(elevation_deg(at.sun))
            irradiances.append(1361 / at.sun_distance_au**2)
        assert max(np.abs(elevations)) == pytest.approx(tilt, abs=0.5)
        assert low < min(irradiances) < 0.95 * max(irradiances) < max(irradiances) < high


#: Europa about Jupiter by Lainey's L1.2 theory (astronomy-engine 2.1.19) and Enceladus about Saturn by Dourneau's with
#: its inclination, from B1950 to J2000: kilometres, J2000 equator, by days since J2000.
MOONS = {
    "EUROPA": {
        100.0: (13329, -610590, -284909),
        5478.75: (-506242, 390695, 182562),
        10957.5: (262214, 552237, 262411),
        16436.25: (661925, -69783, -23780),
        21915.0: (124109, -595495, -275670),
    },
    "ENCELADUS": {
        100.0: (139327, -191949, 2094),
        5478.75: (-103114, 215269, -7005),
        10957.5: (29515, -236595, 15087),
        16436.25: (39340, 232890, -20651),
        21915.0: (-106710, -211597, 24770),
    },
}


@pytest.mark.parametrize(("body", "error_deg"), [("EUROPA", 0.15), ("ENCELADUS", 0.05)])
def test_the_planet_is_where_a_full_theory_puts_it(body, error_deg):
    """The errors are what the terms left out add up to, Enceladus' inclination of 0.03° included; from a planet that
    stood still over the meridian it would be more than ten times that."""
    moon = BODIES[body]
    for days, place in MOONS[body].items():
        seen = -ephemeris.body_frame(moon.orientation(days)) @ np.array(place, float)
        longitude, ratio = moon.under_planet(days)
        over = np.array([math.cos(math.radians(longitude)), math.sin(math.radians(longitude)), 0.0])
        assert angle_deg(seen, over) < error_deg
        assert moon.distance_km * ratio == pytest.approx(np.linalg.norm(seen), rel=1e-3)


@pytest.mark.parametrize(
    ("body", "mean", "reach", "eccentricity"), [("EUROPA", -1.53, 1.065, 0.0094), ("ENCELADUS", -4.09, 1.02, 0.0048)]
)
def test_the_planet_swings_in_bounds(body, mean, reach, eccentricity):
    found = np.array([BODIES[body].under_planet(d) for d in np.arange(0.0, 21900.0, 0.37)])
    assert found[:, 0].mean() == pytest.approx(mean, abs=0.02)
    assert np.abs(found[:, 0] - mean).max() == pytest.approx(reach, abs=0.03)
    assert np.abs(found[:, 1] - 1).max() == pytest.approx(eccentricity, rel=0.02)


def test_the_planet_stands_in_the_zenith_under_it_and_the_sun_goes_round_once_a_day():
    under, _ = BODIES["ENCELADUS"].under_planet(ephemeris.days_since_j2000(DATE))
    zenith = ephemeris.find_positions("ENCELADUS", DATE, 0.0, under)
    assert elevation_deg(zenith.planet) == pytest.approx(90.0, abs=0.2)  # the normal leans toward longitude 0
    pole = ephemeris.find_positions("ENCELADUS", DATE, -80.0, under + 30.0)
    # 98.6° from the sub-planet point but for the parallax of a site that is a thousandth of the way nearer.
    assert azimuth_deg(pole.planet) == pytest.approx(328.63, abs=0.1)
    assert elevation_deg(pole.planet_axis) == pytest.approx(-80.0, abs=0.6)
    day = 360 / 262.7318996 * 86400
    hour = np.datetime64(DATE) + np.timedelta64(round(day * 1000 / 4), "ms")
    later = ephemeris.find_positions("ENCELADUS", str(hour), 90.0, 0.0)
    now = ephemeris.find_positions("ENCELADUS", DATE, 90.0, 0.0)
    assert (azimuth_deg(later.sun) - azimuth_deg(now.sun)) % 360 == pytest.approx(90.0, abs=0.1)


def test_up_is_the_normal_of_the_ellipsoid():
    radii = BODIES["ENCELADUS"].radii_km
    tilts = []
    for latitude in range(-90, 91, 15):
        for longitude in range(0, 360, 30):
            place, axes = ephemeris.site_frame(radii, latitude, longitude)
            np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
            assert np.linalg.det(axes) == pytest.approx(1.0)
            assert (place**2 / np.array(radii) ** 2).sum() == pytest.approx(1.0)
            tilts.append(angle_deg(axes[2], place))
    assert max(tilts) == pytest.approx(1.88, abs=0.05)  # (a² - c²) / 2ac, at 45° on the meridian


@pytest.mark.parametrize(
    "text",
    [
        "",
        "yesterday",
        "NaT",
        "20350-03-01",
        "2035-3-1",
        "2035-03-01T12:00+99:00",
        "2035-03-01T12:00 CET",
        "2035-03-01+02:00",
    ],
)
def test_what_is_no_date_is_said_in_a_sentence(text):
    with pytest.raises(IcyMoonError, match=r"light\.date_utc is .*; write it as 2035-03-01T12:00:00\."):
        ephemeris.days_since_j2000(text)


@pytest.mark.parametrize(
    ("text", "cause", "fix"),
    [
        ("2035-13-01", "a year has 12 months", "write a month from 01 to 12"),
        ("2035-00-01T12:00", "a year has 12 months", "write a month from 01 to 12"),
        ("2035-02-29T00:00", "2035-02 has 28 days", "write a day from 01 to 28"),
        ("2036-02-30", "2036-02 has 29 days", "write a day from 01 to 29"),
        ("2035-12-32T00:00+02:00", "2035-12 has 31 days", "write a day from 01 to 31"),
        ("2035-03-01T24:00", "the hours of a day are 00 to 23", "write its end as 2035-03-02T00:00:00"),
        ("2035-12-31 24:00:00.000Z", "the hours of a day are 00 to 23", "write its end as 2036-01-01T00:00:00"),
        ("2035-03-01T24:01", "the hours of a day are 00 to 23", "write an hour from 00 to 23"),
        ("2035-03-01T25:00", "the hours of a day are 00 to 23", "write an hour from 00 to 23"),
        ("2035-03-01T12:60", "an hour has 60 minutes", "write a minute from 00 to 59"),
        ("2035-03-01T12:00:60", "a minute has 60 seconds here", "write a second from 00 to 59"),
    ],
)
def test_what_the_calendar_lacks_is_said(text, cause, fix):
    with pytest.raises(IcyMoonError) as caught:
        ephemeris.days_since_j2000(text)
    assert str(caught.value) == f"light.date_utc is {text!r}, but {cause}; {fix}."


@pytest.mark.parametrize(
    ("text", "moment"),
    [
        ("2036-05-05T01:02:03+02:00", "2036-05-04T23:02:03"),
        ("2035-12-31T23:30-01", "2036-01-01T00:30:00"),
        ("2035-03-01 12:00:00.250+0530", "2035-03-01T06:30:00.250"),
    ],
)
def test_the_same_moment_in_utc_is_the_fix_for_another_zone(text, moment):
    with pytest.raises(IcyMoonError, match=re.escape(f"is not in UTC; write the same moment as {moment}.")):
        ephemeris.parse_date(text)


@pytest.mark.parametrize("zone", ["Z", "z", "+00:00", "-00:00", "+0000", "+00", " Z"])
def test_utc_may_be_stated(kernels, zone):
    """Also where SPICE reads the date."""
    assert ephemeris.parse_date(f"2035-03-01T12:00{zone}") == ephemeris.parse_date("2035-03-01T12:00")
    stated, plain = (
        spice.find_positions(kernels, "ENCELADUS", "SATURN", date, 0.0, 0.0)
        for date in (f"2035-03-01T12:00{zone}", "2035-03-01T12:00")
    )
    assert np.array_equal(stated.sun, plain.sun)


def test_dates_and_bodies():
    assert ephemeris.days_since_j2000("2000-01-01T12:00:00Z") == pytest.approx(69.184 / 86400)
    assert ephemeris.parse_date("2035") == ephemeris.parse_date("2035-01") == ephemeris.parse_date("2035-01-01T00")
    assert ephemeris.days_since_j2000("2000-01-11") == pytest.approx(9.5 + 69.184 / 86400)
    with pytest.raises(IcyMoonError, match=r"light\.body is 'Titan'.*ENCELADUS and EUROPA"):
        ephemeris.find_positions("Titan", DATE, 0.0, 0.0)


LSK = """KPL/LSK
\\begindata
DELTET/DELTA_T_A = 32.184
DELTET/K = 1.657D-3
DELTET/EB = 1.671D-2
DELTET/M = ( 6.239996D0 1.99096871D-7 )
DELTET/DELTA_AT = ( 37, @2017-JAN-1 )
"""
PCK = """KPL/PCK
\\begindata
BODY602_POLE_RA = ( 40.66 -0.036 0. )
BODY602_POLE_DEC = ( 83.52 -0.004 0. )
BODY602_PM = ( 6.32 262.7318996 0. )
BODY602_RADII = ( 256.6 251.4 248.3 )
BODY699_POLE_RA = ( 40.589 -0.036 0. )
BODY699_POLE_DEC = ( 83.537 -0.004 0. )
BODY699_PM = ( 38.90 810.7939024 0. )
BODY699_RADII = ( 60268 60268 54364 )
"""


@pytest.fixture(scope="module")
def kernels(tmp_path_factory):
    """Ten days of Sun, Saturn and Enceladus about DATE."""
    return written_kernels(tmp_path_factory.mktemp("kernels"), DATE)


def written_kernels(folder, date, other_moons=()):
    """A folder of kernels for ten days about a date, the moons where the elements have them."""
    spiceypy = pytest.importorskip("spiceypy")
    (folder / "a.tls").write_text(LSK)
    (folder / "b.tpc").write_text(PCK)
    moon = BODIES["ENCELADUS"]
    middle = ephemeris.days_since_j2000(date) * 86400
    times = middle + np.arange(-120, 121) * 3600.0

    def states(position):
        here, before, after = (np.array([position(t + dt) for t in times]) for dt in (0.0, -30.0, 30.0))
        return np.hstack([here, (after - before) / 60.0])

    def around(t):
        longitude, ratio = moon.under_planet(t / 86400)
        over = np.array([math.cos(math.radians(longitude)), math.sin(math.radians(longitude)), 0.0])
        return -moon.distance_km * ratio * over @ ephemeris.body_frame(moon.orientation(t / 86400))

    handle = spiceypy.spkopn(str(folder / "c.bsp"), "test", 0)
    for body, centre, position in (
        (10, 0, lambda t: np.zeros(3)),
        (602, 699, around),
        (699, 0, lambda t: AU_KM * ephemeris.heliocentric_position_au(moon.orbit, t / 86400)),
        *(
            (moons.MOONS[name].number, 699, lambda t, n=name: find_moon_places("SATURN", t / 86400)[n])
            for name in other_moons
        ),
    ):
        spiceypy.spkw08(
            handle,
            body,
            centre,
            "J2000",
            times[0],
            times[-1],
            str(body),
            7,
            len(times),
            states(position),
            times[0],
            3600.0,
        )
    spiceypy.spkcls(handle)
    return folder


def test_spice_and_the_elements_agree(kernels):
    """Rotation, ellipsoid, site and local frame worked out by SPICE; light time and aberration are the difference."""
    for latitude, longitude in ((-80.0, 30.0), (0.0, 120.0), (45.0, 300.0)):
        exact = spice.find_positions(kernels, "enceladus", "saturn", DATE, latitude, longitude)
        found = ephemeris.find_positions("ENCELADUS", DATE, latitude, longitude)
        assert angle_deg(exact.sun, found.sun) < 0.02
        assert angle_deg(exact.planet, found.planet) < 0.05
        assert exact.sun_distance_au == pytest.approx(found.sun_distance_au, rel=5e-4)  # the moon is off the planet
        assert exact.planet_distance_km == pytest.approx(found.planet_distance_km, rel=1e-4)
        assert angle_deg(exact.planet_axis, found.planet_axis) < 0.1
        assert exact.planet_equator_km == found.planet_equator_km
        assert exact.planet_name == found.planet_name == "SATURN"
        np.testing.assert_allclose(exact.from_j2000, found.from_j2000, atol=1e-6)


def test_spice_has_the_other_moons_if_the_kernels_have_them(kernels, tmp_path):
    """Light time is the difference: up to 4 s, in which Mimas moves 60 km. Without it the site would also be off."""
    site = "ENCELADUS", "SATURN", DATE, 10.0, 20.0
    all_moons = written_kernels(tmp_path, DATE, ("MIMAS", "TETHYS", "DIONE", "RHEA", "TITAN"))
    exact = spice.find_positions(all_moons, *site, with_moons=True)
    found = ephemeris.find_positions("ENCELADUS", *site[2:])
    assert set(exact.moons_km) == set(found.moons_km) == {"MIMAS", "TETHYS", "DIONE", "RHEA", "TITAN"}
    for name, place in exact.moons_km.items():
        assert np.linalg.norm(place - found.moons_km[name]) < 1e-3 * found.planet_distance_km
    assert spice.find_positions(all_moons, *site).moons_km == {}
    with pytest.raises(IcyMoonError, match=r"add kernels that cover body and date"):
        spice.find_positions(kernels, *site, with_moons=True)


@pytest.mark.parametrize("pole", [90.0, -90.0])
@pytest.mark.parametrize("longitude", [0.0, 30.0, -120.0, 250.0])
def test_a_pole_is_the_end_of_the_meridian_of_its_longitude(kernels, pole, longitude):
    """Of a date and of kernels. A thousandth of a degree before it, directions differ by about as much."""
    at = []
    for latitude in (pole, math.copysign(89.999, pole)):
        for found in (
            ephemeris.find_positions("ENCELADUS", DATE, latitude, longitude),
            spice.find_positions(kernels, "ENCELADUS", "SATURN", DATE, latitude, longitude),
        ):
            at.append(found)
            assert abs(found.from_j2000 @ found.from_j2000.T - np.eye(3)).max() < 1e-9
    here, here_by_spice, before, before_by_spice = at
    for one, other, most_deg in (
        (here, before, 3e-3),
        (here_by_spice, before_by_spice, 3e-3),
        (here, here_by_spice, 0.05),
    ):
        for name in ("sun", "planet", "planet_axis"):
            apart = angle_deg(getattr(one, name), getattr(other, name))
            assert apart < (0.1 if name == "planet_axis" and most_deg > 0.01 else most_deg)
        assert np.abs(one.from_j2000 - other.from_j2000).max() < (1e-4 if most_deg < 0.01 else 1e-6)


@pytest.mark.parametrize("pole", [90.0, -90.0])
def test_a_sky_of_angles_has_stars_at_a_pole(pole):
    light = description.defaults().light | {"planet": True, "planet_elevation_deg": 90.0}
    here, before = (compute_sky(light | {"latitude_deg": latitude}) for latitude in (pole, math.copysign(89.999, pole)))
    assert np.abs(here.from_j2000 - before.from_j2000).max() < 1e-4
    assert np.array_equal(here.sun, before.sun)
    assert here.ground_irradiance_wm2 == pytest.approx(before.ground_irradiance_wm2, rel=1e-4)


def test_the_folder_of_a_mac_and_a_meta_kernel_give_the_same_sky(kernels, tmp_path):
    """What is no kernel is skipped, and names are relative to the meta-kernel, wherever the program runs."""
    wanted = spice.find_positions(kernels, "ENCELADUS", "SATURN", DATE, 10.0, 20.0)
    folder = shutil.copytree(kernels, tmp_path / "mac")
    (folder / ".DS_Store").write_bytes(b"\0\0\0\1Bud1" + bytes(100))
    (folder / "m.tm").write_text("KPL/MK\n\\begindata\nKERNELS_TO_LOAD = ( 'a.tls' 'b.tpc' 'c.bsp' )\n")
    for given in (folder, folder / "m.tm"):
        found = spice.find_positions(given, "ENCELADUS", "SATURN", DATE, 10.0, 20.0)
        assert np.array_equal(found.sun, wanted.sun)


def test_the_sky_of_a_date_and_of_kernels(kernels):
    light = description.merged(description.defaults(), preset_files.load_preset("bodies/enceladus")).light
    dated = compute_sky(light | {"directions_from": "DATE", "date_utc": DATE})
    exact = compute_sky(light | {"directions_from": "KERNELS", "date_utc": DATE, "kernels": str(kernels)})
    for shown in (dated, exact):
        assert shown.sun_irradiance_wm2 == pytest.approx(1361 / 9.0878**2, rel=1e-3)
        assert shown.planet.angular_diameter_deg == pytest.approx(29.33, rel=0.006)  # the eccentricity
        assert shown.planet.flattening == pytest.approx(0.098, abs=1e-3)
        assert elevation_deg(shown.planet.direction) == pytest.approx(10.0 - 0.65, abs=0.1)  # the normal leans
    assert angle_deg(dated.sun, exact.sun) < 0.02


@pytest.mark.long
def test_the_planet_eclipses_the_sun_once_an_orbit(tmp_path):
    """Shown or not; for as long as the Sun takes to pass behind an ellipse, which it does not in the solstices."""
    light = description.defaults().light | {"body": "ENCELADUS", "latitude_deg": 0.0, "longitude_deg": 0.0}
    date = "2038-06-01T12:00:00"
    kernels = written_kernels(tmp_path, date)

    def eclipses(start, source):
        times = np.datetime64(start) + np.arange(0, 1974, 3) * np.timedelta64(1, "m")  # an orbit, 32.9 hours
        return np.array([compute_sky(light | source | {"date_utc": str(time)}).eclipse for time in times])

    dated, exact = (
        eclipses(date, source)
        for source in ({"directions_from": "DATE"}, {"directions_from": "KERNELS", "kernels": str(kernels)})
    )
    assert dated.max() == exact.max() == 1.0
    at = compute_sky(light | {"directions_from": "DATE", "date_utc": date, "planet": True})
    below = math.degrees(math.asin(at.planet.sun @ at.planet.pole))
    polar = math.degrees(math.atan(0.902 * math.tan(math.radians(14.665))))
    chord = 2 * 14.665 * math.sqrt(1 - (below / polar) ** 2)
    for found in (dated, exact):
        minutes = 3 * found.sum()
        assert minutes == pytest.approx(chord / 262.73 * 1440, abs=6)  # two steps
        assert np.count_nonzero((found > 0) & (found < 1)) <= 2  # the Sun's disc is 0.3 minutes wide
    assert np.argmax(dated == 1) == pytest.approx(np.argmax(exact == 1), abs=1)
    assert not eclipses("2032-06-01", {"directions_from": "DATE"}).any()


@pytest.mark.parametrize(
    ("body", "date", "words"),
    [("ENCELADUS", "1990-01-01", "1990-01-01"), ("DIONE", DATE, "DIONE"), ("ENCELADUS", "soon", "light.date_utc")],
)
def test_what_kernels_lack_is_a_sentence(kernels, body, date, words):
    with pytest.raises(IcyMoonError, match=words) as caught:
        spice.find_positions(kernels, body, "SATURN", date, 0.0, 0.0)
    assert "\n" not in str(caught.value)
    spice.find_positions(kernels, "ENCELADUS", "SATURN", DATE, 0.0, 0.0)  # nothing is left behind


@pytest.mark.parametrize(
    ("body", "parent", "planet"),
    [("EUROPA", "SATURN", "JUPITER"), ("Enceladus", "jupiter", "SATURN"), ("TITANIA", "SATURN", "URANUS")],
)
def test_a_moon_of_another_planet_is_refused_before_data_of_that_are_asked_for(kernels, body, parent, planet):
    """Data of the wrong planet would give its sky without a word."""
    with pytest.raises(IcyMoonError, match=f"a moon of {planet}, but .* set light.parent to {planet}"):
        spice.find_positions(kernels, body, parent, DATE, 0.0, 0.0)


def test_missing_kernels_and_a_missing_package_are_sentences(tmp_path, monkeypatch):
    monkeypatch.setattr(spice, "has_spice", lambda: False)
    with pytest.raises(IcyMoonError, match=r"SpiceyPy.*ephemeris"):
        spice.find_positions(tmp_path, "ENCELADUS", "SATURN", DATE, 0.0, 0.0)
    monkeypatch.setattr(spice, "has_spice", lambda: True)
    with pytest.raises(IcyMoonError, match="does not exist"):
        spice.find_positions(tmp_path / "no.tm", "ENCELADUS", "SATURN", DATE, 0.0, 0.0)


def test_spice_is_loaded_for_kernels_only():
    program = (
        "import sys\nfrom icymoon.settings import description\nfrom icymoon.physics.light.sky import compute_sky\n"
        "light = description.defaults()['light']\ncompute_sky(light)\ncompute_sky(light | {'directions_from': "
        "'DATE'})\n"
        "assert 'spiceypy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=240)
