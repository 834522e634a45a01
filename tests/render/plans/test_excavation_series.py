"""The shipped series of an excavation: one site in eight states, of which only what a state changes differs."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.nodes.ground.dug_ground import _make_ground_key
from icymoon.physics.excavation.camera_jitter import jitter_rig
from icymoon.physics.light.sky import compute_sky
from icymoon.render.plans.plan_file import find_plan, read_plan


@pytest.fixture(scope="module")
def pairs():
    plan = read_plan(find_plan("datasets/excavation_series"))
    assert not plan.refused()
    return plan.pairs()


def test_there_are_eight_states_in_order_of_one_seed(pairs):
    assert [pair.settings.excavation.state for pair in pairs] == list(range(8))
    assert {pair.settings.dataset.seed for pair in pairs} == {pairs[0].settings.dataset.seed}
    assert len({pair.id for pair in pairs}) == 8


def test_only_state_and_clock_differ(pairs):
    first = pairs[0].settings
    for pair in pairs:
        differ = {
            f"{topic}.{key}"
            for topic, values in pair.settings.items()
            for key, value in values.items()
            if first[topic][key] != value
        }
        assert differ <= {"excavation.state", "light.date_utc"}


def test_all_states_are_dug_from_one_ground(pairs):
    # What is built again for a state is what this key leaves out.
    assert len({_make_ground_key(pair.settings) for pair in pairs}) == 1


def test_the_camera_jitters_as_much_as_is_stated(pairs):
    rigs = [jitter_rig(pair.settings) for pair in pairs]
    off = np.array(
        [
            [
                rig.x_m - pairs[0].settings.rig.x_m,
                rig.y_m - pairs[0].settings.rig.y_m,
                rig.height_m - pairs[0].settings.rig.height_m,
            ]
            for rig in rigs
        ]
    )
    assert len({tuple(each) for each in off}) == 8
    # 24 normal numbers of 1 mm: their RMS is within 0.5 to 1.6 mm but for one in a thousand times.
    assert 0.5e-3 < np.sqrt((off**2).mean()) < 1.6e-3


def test_the_sun_rises_by_the_clock(pairs):
    heights = [compute_sky(pair.settings.light).sun_elevation_deg for pair in pairs]
    assert (np.diff(heights) > 0).all()
