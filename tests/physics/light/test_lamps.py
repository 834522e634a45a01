"""Lamps without Blender: power, intensity and factors at evaluation, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from icymoon.physics.light import lamps
from icymoon.physics.light.photons import band_share, electron_rate
from icymoon.physics.scene_checks import describe_buried_lamp, find_reasons_in_settings
from icymoon.settings import description
from icymoon.settings.pair_ids import make_pair_id
from icymoon.settings.topics.scene import Settings
from icymoon.support.errors import IcyMoonError


def make_settings(*entries: dict[str, Any], **light: object) -> Settings:
    part = description.check({"light": {"lamps": list(entries), **light}}, "test")
    return description.merged(description.defaults(), part)


@pytest.mark.parametrize(
    "entry",
    [{"kind": "POINT"}, {"kind": "AREA"}, *({"cone_deg": c, "blend": b} for c in (5, 60, 179) for b in (0, 0.3, 1))],
)
def test_the_intensity_of_each_kind_sends_out_all_of_the_power(entry):
    (lamp,) = make_settings(entry).light.lamps
    cosine = (np.arange(200_000) + 0.5) / 100_000 - 1
    assert 4 * math.pi * lamps.intensity(lamp, cosine).mean() == pytest.approx(1.0, rel=2e-3)


def test_electrons_of_a_lamp_depend_on_neither_the_band_of_the_irradiance_nor_the_colour_of_the_sun():
    """They are of its watts from 400 to 700 nm, for a camera with this band of its watts alone."""
    sensor = {"sensor": {"band_centre_nm": 550.0, "band_width_nm": 300.0, "colour": "MONO"}}
    found = []
    for light in (
        {"irradiance_band": "BOLOMETRIC"},
        {"irradiance_band": "CAMERA"},
        {"irradiance_band": "CAMERA", "sun_temperature_k": 4000.0},
    ):
        settings = description.merged(make_settings({"power_w": 10.0, "efficiency": 0.3}, **light), sensor)
        (lamp,) = settings.light.lamps
        factor = lamps.find_light_factors(settings)["Lamp1"]
        watts = lamps.pair_power_w(lamp, settings.light) * factor
        if settings.light.irradiance_band == "BOLOMETRIC":
            watts *= band_share(settings.light, settings.sensor)
        assert watts == pytest.approx(3.0, rel=1e-6)
        found.append(
            lamps.pair_power_w(lamp, settings.light) * factor * electron_rate(settings.light, settings.sensor, 1e-5)
        )
    assert found[1] == pytest.approx(found[0], rel=1e-6)


def test_factors_are_in_the_order_of_the_lamps_and_leave_ids_alone():
    settings = make_settings({}, {"kind": "AREA"}, sun_scale=0.0, lamp_scales="1, 0.5")
    assert lamps.find_light_factors(settings) == {"Sun": 0.0, "Planet": 1.0, "Lamp1": 1.0, "Lamp2": 0.5}
    assert lamps.is_light_scaled(settings)
    assert not lamps.is_light_scaled(make_settings({}, {"kind": "AREA"}))
    assert lamps.find_light_factors(lamps.switch_lamps_off(settings))["Lamp2"] == 0.0
    assert make_pair_id(settings) == make_pair_id(make_settings({}, {"kind": "AREA"}))
    assert make_pair_id(make_settings()) == make_pair_id(description.defaults())
    assert len({make_pair_id(make_settings(*each)) for each in ([], [{}], [{"power_w": 1.0}], [{}, {}])}) == 4


@pytest.mark.parametrize(
    ("entries", "light", "told"),
    [
        ([{}], {"lamp_scales": "1, 2"}, "light.lamp_scales has 2 numbers, but light.lamps has 1"),
        ([{}] * 9, {}, "light.lamps has 9 lamps; 8 are the most"),
    ],
)
def test_a_list_that_cannot_be_is_refused_by_one_sentence(entries, light, told):
    (reason,) = find_reasons_in_settings(make_settings(*entries, **light))
    assert told in reason


def test_lamps_under_the_ground_or_in_a_rock_are_told():
    assert describe_buried_lamp(1, 0.25).startswith("light.lamps[1] is 0.25 m under the ground")
    assert "inside a rock" in describe_buried_lamp(0, math.inf)
    assert not describe_buried_lamp(0, None)
    assert not describe_buried_lamp(0, -0.1)


def test_laws_in_osl_are_refused():
    settings = description.merged(make_settings({}), {"surface": {"model": "HAPKE"}})
    assert any("light.lamps" in each for each in find_reasons_in_settings(settings))
    assert not find_reasons_in_settings(description.merged(settings, {"hapke": {"backend": "NODES"}}))


@pytest.mark.parametrize(
    ("entry", "light", "told"),
    [
        ({"power_w": -1.0}, {}, "lamps[0].power_w is -1 W, outside 0 to 100000 W"),
        ({"size_m": 0.0}, {}, "lamps[0].size_m is 0 m"),
        ({"kind": "LASER"}, {}, "lamps[0].kind is 'LASER'"),
        ({}, {"lamp_scales": "1, -1"}, "light.lamp_scales is '1, -1', which is not a list of numbers"),
        ({}, {"lamp_scales": "nan"}, "which is not a list of numbers"),
    ],
)
def test_values_that_no_lamp_has_are_one_sentence(entry, light, told):
    with pytest.raises(IcyMoonError) as error:
        make_settings(entry, **light)
    assert told in str(error.value)
