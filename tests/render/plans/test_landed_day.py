"""The shipped plan of a landed day: grounds under several Suns, by one camera in one pose."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.light.ephemeris import find_positions
from icymoon.physics.light.sky import elevation_deg
from icymoon.render.plans.plan_file import find_plan, read_plan

SUNS = 4


@pytest.fixture(scope="module")
def pairs():
    plan = read_plan(find_plan("datasets/landed_day"))
    assert not plan.refused()
    return plan.pairs()


def list_settings(pair):
    return {(topic, key): value for topic, values in pair.settings.items() for key, value in values.items()}


def test_each_ground_has_all_suns_and_nothing_else_differs(pairs):
    by_seed = {}
    for pair in pairs:
        by_seed.setdefault(pair.settings.dataset.seed, []).append(list_settings(pair))
    assert [len(own) for own in by_seed.values()] == [SUNS] * 4
    for first, *others in by_seed.values():
        for other in others:
            assert {key for key in first if first[key] != other[key]} == {("light", "date_utc")}


def test_the_suns_are_of_one_day_and_high(pairs):
    """The solar day of Europa is 85.3 hours long."""
    light = pairs[0].settings.light
    dates = sorted({pair.settings.light.date_utc for pair in pairs})
    steps = np.diff(np.array(dates, "datetime64[m]")).astype(int) / 60
    assert len(set(steps)) == 1
    assert steps.sum() + steps[0] < 85.3
    for date in dates:
        sky = find_positions(light.body, date, light.latitude_deg, light.longitude_deg)
        assert 16 < elevation_deg(sky.sun) < 65
        assert elevation_deg(sky.planet) < -10
