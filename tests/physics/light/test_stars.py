"""Stars against zero points, separations and counts; where they stand against the axes of bodies."""

import math

import numpy as np
import pytest
from icymoon.physics.camera.sensor import choose_exposure_s, gain_dn_per_e
from icymoon.physics.light import ephemeris, stars
from icymoon.physics.light.photons import electron_rate, pixel_pitch_m, planck_radiance, total_radiance
from icymoon.physics.light.sky import azimuth_deg, compute_sky, elevation_deg
from icymoon.physics.rig.focal_length import focal_px
from icymoon.settings import description, preset_files

pytestmark = pytest.mark.filterwarnings("error")

LIGHT = description.defaults().light


def star(name):
    known = stars.read_catalogue()
    return known.direction[known.name.index(name)]


def angle_deg(a, b):
    return math.degrees(math.atan2(np.linalg.norm(np.cross(a, b)), a @ b))


def test_a_star_of_magnitude_zero_has_the_light_of_vegas_zero_point():
    assert pytest.approx(2.69e-8, rel=2e-3) == stars.V0_WM2
    # Bessell, Castelli and Plez 1998, A&A 333, 231: 3.631e-9 erg/(cm² s Å) at 545 nm. The Sun as a black body is
    # within a few percent of its spectrum there.
    per_nm = stars.V0_WM2 * planck_radiance(545e-9, 5772.0) / total_radiance(5772.0) * 1e-9
    assert per_nm == pytest.approx(3.631e-11, rel=0.05)
    assert stars.star_irradiance_wm2(np.array([5.0, -2.5])) == pytest.approx(stars.V0_WM2 * np.array([0.01, 10.0]))


def test_a_camera_counts_the_photons_of_a_star():
    """A thousand photons per cm², second and Ångström at V = 0 (Bessell 1979, PASP 91, 589), through f/8 of 32 mm."""
    sensor = description.defaults().sensor | {
        "band_centre_nm": 545.0,
        "band_width_nm": 80.0,
        "f_number": 8.0,
        "transmission": 1.0,
        "quantum_efficiency": 1.0,
    }
    pitch, focal = 94e-6, 32e-3
    radiance = stars.V0_WM2 / (pitch / focal) ** 2  # of the one pixel that has all of it
    expected = 1000 * 800 * math.pi * 0.2**2
    assert radiance * electron_rate(LIGHT, sensor, pitch) == pytest.approx(expected, rel=0.06)


def test_the_brightest_stars_are_where_they_are():
    known = stars.read_catalogue()
    assert len(known.name) == len(set(known.name)) == 92
    assert (np.diff(known.v_mag) >= 0).all()
    assert known.v_mag[-1] == stars.COMPLETE_TO_MAG
    np.testing.assert_allclose(np.linalg.norm(known.direction, axis=1), 1.0)
    # Separations that observing handbooks give.
    for one, other, apart in (
        ("Dubhe", "Merak", 5.4),
        ("Alnitak", "Mintaka", 2.7),
        ("Castor", "Pollux", 4.5),
        ("Sirius", "Procyon", 25.7),
        ("Betelgeuse", "Rigel", 18.6),
        ("Deneb", "Altair", 38.0),
        ("Hadar", "Rigil Kentaurus", 4.4),
        ("Acrux", "Gacrux", 6.0),
    ):
        assert angle_deg(star(one), star(other)) == pytest.approx(apart, abs=0.06), (one, other)
    closest = np.sort(known.direction @ known.direction.T, axis=1)[:, -2]
    assert closest.max() < math.cos(math.radians(1.0))  # none is there twice


def test_colours_are_those_of_their_temperatures():
    assert stars.star_temperature_k(0.65) == pytest.approx(5772, rel=0.02)  # the Sun
    assert stars.star_temperature_k(0.0) == pytest.approx(10000, rel=0.03)
    assert stars.star_temperature_k(1.85) == pytest.approx(3400, rel=0.05)
    shown = stars.stars_above_horizon(
        -1.0, 1, np.diag([1.0, 1.0, -1.0])
    ).irradiance_wm2  # Sirius alone, which is in the south
    assert shown.shape == (1, 3)
    assert shown[0, 2] > shown[0, 0]
    assert shown.mean() == pytest.approx(stars.V0_WM2 * 10 ** (0.4 * 1.46))


def test_fainter_stars_come_in_their_numbers_and_stay_when_more_are_asked_for():
    both = [np.diag([1.0, 1.0, side]) for side in (1.0, -1.0)]

    def whole(faintest, seed):
        parts = [stars.stars_above_horizon(faintest, seed, half) for half in both]
        return np.concatenate([p.direction @ m for p, m in zip(parts, both, strict=True)]), np.concatenate(
            [p.irradiance_wm2.mean(axis=1) for p in parts]
        )

    for faintest, number in ((4.0, 558), (5.0, 1744), (6.0, 5326), (8.0, 48559)):
        direction, light = whole(faintest, 7)
        assert len(direction) == pytest.approx(number, rel=0.03)  # of the brightest there are 92, not 102
        assert light.min() >= stars.V0_WM2 * 10 ** (-0.4 * faintest) * 0.999
        np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0)
    # Even over the sky: the mean direction of n is within 4/√n of none.
    assert np.linalg.norm(direction.mean(axis=0)) < 4 / math.sqrt(len(direction))
    few, more = (stars.stars_above_horizon(faintest, 7, both[0]) for faintest in (4.0, 6.0))
    assert {tuple(d) for d in few.direction} < {tuple(d) for d in more.direction}
    assert not np.array_equal(few.direction, stars.stars_above_horizon(4.0, 8, both[0]).direction)
    np.testing.assert_array_equal(few.direction, stars.stars_above_horizon(4.0, 7, both[0]).direction)


def test_starlight_on_the_ground_is_nothing_beside_the_planets():
    """Of all the stars together less than 2e-6 W/m², against 0.4 of a full Saturn and 15 of the Sun."""
    sky_light = stars.stars_above_horizon(8.0, 1, np.eye(3))
    assert 5e-7 < (sky_light.irradiance_wm2.mean(axis=1) * sky_light.direction[:, 2]).sum() < 2e-6


def test_without_a_date_the_pole_of_the_stars_is_the_bodys():
    for latitude in (60.0, -80.0):
        shown = compute_sky(LIGHT | {"latitude_deg": latitude})
        np.testing.assert_allclose(shown.from_j2000 @ shown.from_j2000.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(shown.from_j2000) == pytest.approx(1.0)
        assert elevation_deg(shown.from_j2000[:, 2]) == pytest.approx(latitude)
        assert azimuth_deg(shown.from_j2000[:, 1]) == pytest.approx(90.0)  # right ascension 6 h rises
        assert elevation_deg(shown.from_j2000[:, 0]) == pytest.approx(90 - abs(latitude))  # 0 h culminates
    assert elevation_deg(compute_sky(LIGHT | {"latitude_deg": 60.0}).from_j2000 @ star("Polaris")) == pytest.approx(
        60, abs=0.8
    )


@pytest.mark.parametrize(("body", "declination"), [("ENCELADUS", 83.52), ("EUROPA", 64.5)])
def test_at_a_date_the_stars_turn_about_the_bodys_axis(body, declination):
    light = LIGHT | {"directions_from": "DATE", "body": body, "latitude_deg": 30.0}
    now = compute_sky(light | {"date_utc": "2035-03-01T12:00:00"})
    axis = np.array([0.0, math.cos(math.radians(30)), math.sin(math.radians(30))])
    assert angle_deg(now.from_j2000[:, 2], axis) == pytest.approx(90 - declination, abs=2.0)  # the normal leans
    rate = {"ENCELADUS": 262.7318996, "EUROPA": 101.3747235}[body]
    day = np.datetime64("2035-03-01T12:00:00", "ms") + np.timedelta64(round(360 / rate * 86.4e6), "ms")
    again = compute_sky(light | {"date_utc": str(day)})
    assert angle_deg(now.from_j2000 @ star("Vega"), again.from_j2000 @ star("Vega")) < 0.01
    # Of the Sun, which the stars carry: its right ascension and declination are those of the elements.
    toward = -ephemeris.heliocentric_position_au(
        ephemeris.BODIES[body].orbit, ephemeris.days_since_j2000("2035-03-01T12:00:00")
    )
    assert angle_deg(now.from_j2000 @ toward, now.sun) < 1e-6


@pytest.mark.parametrize(("rig", "electrons"), [("guiss", 61), ("gallery", 307)])
def test_hardly_any_star_shows_in_the_exposure_of_sunlit_snow(rig, electrons):
    """The figures of docs/theory/light.md. Sirius, at V = -1.46, is the brightest star."""
    made = description.merged(
        description.defaults(), preset_files.load_preset(f"rigs/{rig}"), preset_files.load_preset("sensors/default")
    )
    rate = electron_rate(made.light, made.sensor, pixel_pitch_m(made.sensor, made.rig))
    snow = np.full(100, 3.17)  # W/(m² sr), of scenes/enceladus_fresh_snow
    # A pixel in the middle of the image is 1 / f wide; the radiance of a star that fills it is its light by that area.
    radiance = stars.V0_WM2 * 10 ** (0.4 * 1.46) * focal_px(made.rig) ** 2
    sirius = radiance * rate * choose_exposure_s(snow, rate, made.sensor)
    assert sirius == pytest.approx(electrons, rel=0.01)
    steps = sirius * gain_dn_per_e(made.sensor)
    assert steps < 1 if rig == "guiss" else 3 < steps < 5
