"""A part of a plan keeps the share of every value."""

from __future__ import annotations

from collections import Counter

import pytest
from icymoon.render.plans.plan_file import parse_plan
from icymoon.render.plans.stratified import choose_stratified, find_varied_settings

PLAN = """
[plan]
title = "Grid"
grounds = 40

[[sweep]]
kind = "grid"
surface.albedo = [0.2, 0.4, 0.6, 0.8]
light.sun_irradiance_wm2 = [2.0, 6.0, 10.0]

[[sweep]]
name = "suns"
kind = "cases"
case = [
  { light.sun_elevation_deg = 60.0, light.sun_azimuth_deg = 90.0 },
  { light.sun_elevation_deg = 30.0, light.sun_azimuth_deg = 180.0 },
]

[[sweep]]
kind = "panorama"
headings = 5
"""


@pytest.fixture(scope="module")
def pairs(tmp_path_factory):
    return parse_plan(tmp_path_factory.mktemp("plan") / "grid.toml", PLAN).pairs()


def values(pairs, topic, key):
    return Counter(pair.settings[topic][key] for pair in pairs)


@pytest.mark.parametrize("count", [1, 7, 12, 40, 60, 119])
def test_every_value_keeps_its_share(pairs, count):
    """Each count is the nearest or second nearest whole number: all shares can hardly be met at once."""
    assert len(pairs) == 120
    chosen = choose_stratified(pairs, count)
    assert len({pair.id for pair in chosen}) == len(chosen) == count
    for topic, key in find_varied_settings(pairs):
        if (topic, key) != ("dataset", "seed"):
            every, some = values(pairs, topic, key), values(chosen, topic, key)
            assert all(abs(some[value] - count * n / 120) <= 1 for value, n in every.items()), (topic, key)


def test_what_must_divide_evenly_does(pairs):
    chosen = choose_stratified(pairs, 60)
    assert set(values(chosen, "surface", "albedo").values()) == {15}
    assert set(values(chosen, "rig", "heading_deg").values()) == {12}
    assert set(values(chosen, "light", "sun_elevation_deg").values()) == {30}


def test_a_larger_part_contains_a_smaller_one_in_the_order_of_the_plan(pairs):
    few, more = choose_stratified(pairs, 9), choose_stratified(pairs, 30)
    place = {pair.id: k for k, pair in enumerate(pairs)}
    assert {pair.id for pair in few} < {pair.id for pair in more}
    assert [place[pair.id] for pair in more] == sorted(place[pair.id] for pair in more)


def test_all_that_there_are_are_the_most(pairs):
    assert [pair.id for pair in choose_stratified(pairs, 500)] == [pair.id for pair in pairs]
