"""The Sun of a scene: its angles follow from its direction, and what was changed by hand is known as such."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.light.directions import direction_toward
from icymoon.physics.light.scene_sun import BY_HAND, SceneSun, sun_from_facts, sun_from_json, sun_from_lamp
from icymoon.physics.light.sky import compute_sky, describe_sky
from icymoon.settings.description import defaults, merged


def described(**light) -> SceneSun:
    settings = merged(defaults(), {"light": {"sun_elevation_deg": 20.0, "sun_azimuth_deg": 250.0, **light}})
    return sun_from_facts(describe_sky(compute_sky(settings.light))["sun"], "ANGLES")


def stands(sun: SceneSun, **changed) -> SceneSun:
    values = {
        "direction": sun.direction,
        "irradiance_wm2": sun.irradiance_wm2,
        "angular_diameter_deg": sun.angular_diameter_deg,
        "distance_m": sun.distance_m,
        **changed,
    }
    return sun_from_lamp(sun, **values)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 90.0), (359.0, -5.0), (123.4, 0.0), (10.0, 1e-6)])
def test_its_angles_and_its_light_on_level_ground_follow_from_its_direction(azimuth, elevation):
    found = SceneSun(direction_toward(azimuth, elevation), 50.0, 0.1).to_json()
    assert found["elevation_deg"] == pytest.approx(elevation, abs=1e-6)
    if elevation < 89:
        assert found["azimuth_deg"] == pytest.approx(azimuth)
    assert found["ground_irradiance_wm2"] == pytest.approx(50.0 * max(0, math.sin(math.radians(elevation))), abs=1e-12)


@pytest.mark.parametrize(
    ("changed", "source"),
    [
        ({}, "ANGLES"),
        ({"direction": direction_toward(250.0, 20.001)}, BY_HAND),
        ({"irradiance_wm2": 7.0}, BY_HAND),
        ({"angular_diameter_deg": 3.0}, BY_HAND),
        ({"distance_m": 5.0}, BY_HAND),
        ({"direction": np.float32(direction_toward(250.0, 20.0)).astype(float)}, "ANGLES"),
    ],
)
def test_what_was_changed_by_hand_is_known(changed, source):
    found = stands(described(), **changed)
    assert found.source == source
    for key, value in changed.items():  # the lamp's own: what single precision leaves out shows at a grazing Sun
        np.testing.assert_allclose(
            getattr(found, key), value / np.linalg.norm(value) if key == "direction" else value, rtol=1e-12
        )


def test_what_the_planet_hides_is_left_out_once():
    sun = described(planet=True, planet_azimuth_deg=250.0, planet_elevation_deg=20.03, planet_angular_diameter_deg=0.05)
    assert 0.1 < sun.eclipse < 0.9
    assert sun.irradiance_wm2 == pytest.approx((1 - sun.eclipse) * defaults().light.sun_irradiance_wm2)
    assert stands(sun).eclipse == sun.eclipse
    assert stands(sun, direction=direction_toward(0.0, 20.0)).eclipse == 0


def test_a_sun_below_the_horizon_gives_no_light():
    assert described(sun_elevation_deg=-3.0).irradiance_wm2 == 0


def test_it_is_read_as_it_was_written():
    sun = stands(described(sun_distance_m=4.0))
    found = sun_from_json({"sun": sun.to_json()})
    assert found is not None
    written, again = sun.to_json(), found.to_json()
    assert again.pop("source") == written.pop("source") == "ANGLES"
    assert again.pop("direction_to_world") == pytest.approx(written.pop("direction_to_world"))
    assert again == pytest.approx(written)


def test_an_old_record_is_of_its_direction():
    """Pairs of releases up to 0.2 may state the elevation of the settings beside the direction of the lamp."""
    found = sun_from_json(
        {
            "sun": {
                "direction_to_world": [0.0, 0.0, 2.0],
                "elevation_deg": 20.0,
                "irradiance_wm2": 14.8,
                "ground_irradiance_wm2": 5.07,
            }
        }
    )
    assert found is not None
    assert (found.elevation_deg, found.ground_irradiance_wm2, found.source) == (90.0, 14.8, "")


@pytest.mark.parametrize(
    "light",
    [
        None,
        {},
        [],
        {"sun": None},
        {"sun": []},
        {"sun": {}},
        {"sun": {"direction_to_world": [0, 0]}},
        {"sun": {"direction_to_world": [0, 0, 0]}},
        {"sun": {"direction_to_world": "up"}},
        {"sun": {"direction_to_world": [0, 0, math.nan]}},
        {"sun": {"direction_to_world": [0, 0, 1], "eclipse": "all"}},
        {"sun": {"direction_to_world": [[0, 0, 1]]}},
        {"sun": {"direction_to_world": [0, 0, 1], "irradiance_wm2": math.inf}},
    ],
)
def test_what_is_no_sun_is_none(light):
    assert sun_from_json(light) is None
