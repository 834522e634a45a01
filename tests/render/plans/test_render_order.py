"""The order of pairs: everything once, little made again; shards and shares lose nothing."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.render.plans.render_order import (
    choose_shard,
    cut_into_jobs,
    make_settings_key,
    order_pairs,
    split_into_scene_runs,
)
from icymoon.settings import rebuilt_parts
from plans import grid, planned

PAIRS = grid(seeds=3, elevations=(10.0, 20.0), headings=(0.0, 90.0, 180.0))


def changed(pairs, part) -> int:
    """How often a part of the settings changes from one pair to the next."""
    keys = [make_settings_key(part, pair) for pair in pairs]
    return sum(a != b for a, b in pairwise(keys))


@pytest.mark.long
@given(st.randoms(use_true_random=False))
def test_whatever_the_plan_each_scene_is_built_once_and_each_light_once_in_it(rng: random.Random):
    shuffled = list(PAIRS)
    rng.shuffle(shuffled)
    found = order_pairs(shuffled)
    assert sorted(p.id for p in found) == sorted(p.id for p in PAIRS)
    assert changed(found, rebuilt_parts.select_scene) == 3 - 1
    assert (
        changed(found, rebuilt_parts.select_light) == 3 * 2 - 1
    )  # two lights in each scene, and each scene begins with one
    assert found[0].id == shuffled[0].id


def test_a_pair_that_is_planned_twice_is_there_once():
    assert len(order_pairs([*PAIRS, *PAIRS])) == len(PAIRS)


def test_a_surface_is_dearer_than_a_light_and_a_light_dearer_than_a_camera():
    found = order_pairs(
        [
            planned({"surface": {"albedo": a}, "light": {"sun_azimuth_deg": s}, "rig": {"pitch_deg": p}})
            for p in (10.0, 20.0)
            for s in (0.0, 50.0)
            for a in (0.5, 0.8)
        ]
    )
    counts = [
        changed(found, part)
        for part in (
            rebuilt_parts.select_scene,
            rebuilt_parts.select_appearance,
            rebuilt_parts.select_light,
            rebuilt_parts.select_camera,
        )
    ]
    assert counts == [0, 1, 3, 7]


def test_a_graded_mesh_belongs_to_its_rig_and_a_grid_does_not():
    for kind, number in (("GRADED", 2), ("GRID", 1)):
        pairs = [planned({"mesh": {"kind": kind}, "rig": {"x_m": x}}) for x in (0.0, 1.0)]
        assert len(split_into_scene_runs(order_pairs(pairs))) == number
    turned = [planned({"mesh": {"kind": "GRADED"}, "rig": {"heading_deg": h}}) for h in (0.0, 90.0)]
    assert len(split_into_scene_runs(order_pairs(turned))) == 1


PLANS = {
    "few large scenes": PAIRS,
    "many scenes of one pair": grid(seeds=30, elevations=(20.0,), headings=(0.0,)),
    "many scenes of three": grid(seeds=10, elevations=(20.0,), headings=(0.0, 90.0, 180.0)),
    "of both kinds": [*PAIRS, *grid(seeds=16, elevations=(20.0,), headings=(0.0,))],
}


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("workers", [1, 2, 5, 40])
@pytest.mark.parametrize("most_scenes", [1, 2, 50])
def test_shards_are_all_pairs_in_order(plan, workers, most_scenes):
    pairs = order_pairs(PLANS[plan])
    found = cut_into_jobs(pairs, workers, most_scenes)
    assert [p.id for shard in found for p in shard] == [p.id for p in pairs]
    assert all(shard and len(split_into_scene_runs(shard)) <= most_scenes for shard in found)


@pytest.mark.parametrize(("most_scenes", "length"), [(1, 1), (2, 2), (5, 5), (8, 8), (50, 8)])
def test_a_shard_has_as_many_scenes_as_it_may_and_as_its_length_allows(most_scenes, length):
    """32 scenes of a pair for one worker, who gets four shards if a process may render as many scenes."""
    pairs = order_pairs(grid(seeds=32, elevations=(20.0,), headings=(0.0,)))
    lengths = [len(shard) for shard in cut_into_jobs(pairs, 1, most_scenes)]
    assert set(lengths[:-1]) == {length}
    assert sum(lengths) == 32


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_a_scene_is_cut_only_if_it_is_longer_than_two_shards(workers):
    pairs = order_pairs(PLANS["of both kinds"])
    found, length = cut_into_jobs(pairs, workers, 50), -(-len(pairs) // (4 * workers))
    for scene in split_into_scene_runs(pairs):
        holders = [shard for shard in found if {p.id for p in shard} & {p.id for p in scene}]
        assert len(holders) == -(-len(scene) // (2 * length))
    assert max(map(len, found)) <= 2 * length


def test_shards_keep_workers_busy_to_the_end():
    pairs = order_pairs(grid(seeds=64, elevations=(10.0,), headings=(0.0,)))
    lengths = [len(shard) for shard in cut_into_jobs(pairs, 4, 50)]
    assert max(lengths) == min(lengths) == 4
    one_scene = grid(seeds=1, elevations=(10.0,), headings=tuple(float(h) for h in range(64)))
    assert len(cut_into_jobs(one_scene, 4, 50)) >= 4


def test_no_pairs_are_no_shards():
    assert cut_into_jobs([], 2, 50) == []
    assert order_pairs([]) == []


@pytest.mark.parametrize("count", [1, 2, 3, 7, 18, 30])
def test_shares_are_all_pairs_each_once(count):
    pairs = order_pairs(PAIRS)
    found = [choose_shard(pairs, number, count) for number in range(1, count + 1)]
    assert [p.id for part in found for p in part] == [p.id for p in pairs]
    if count <= len(pairs):
        assert sum(map(bool, found)) >= min(count, 3)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 6, 10, 15, 30])
def test_shares_of_scenes_of_a_pair_are_equal(count):
    pairs = order_pairs(PLANS["many scenes of one pair"])
    assert {len(choose_shard(pairs, number, count)) for number in range(1, count + 1)} == {30 // count}


@pytest.mark.parametrize("count", [2, 5, 8, 9])
def test_shares_are_whole_scenes_if_there_are_as_many(count):
    """A scene of 12 pairs and eight of one; more shares than scenes have pairs of their own."""
    pairs = order_pairs(
        [
            *grid(seeds=1, elevations=(10.0,), headings=tuple(30.0 * k for k in range(12))),
            *grid(seeds=9, elevations=(20.0,), headings=(0.0,))[1:],
        ]
    )
    found = [{p.id for p in choose_shard(pairs, number, count)} for number in range(1, count + 1)]
    assert sum(1 for part in found if part & {p.id for p in pairs[:12]}) == 1
    assert max(len(part) for part in (choose_shard(pairs, number, 20) for number in range(1, 21))) == 1


def test_what_decides_the_order_is_every_setting_but_response_and_run():
    settings = PAIRS[0].settings
    parts = (
        rebuilt_parts.select_scene,
        rebuilt_parts.select_appearance,
        rebuilt_parts.select_light,
        rebuilt_parts.select_lander,
        rebuilt_parts.select_camera,
        rebuilt_parts.select_sampling,
    )
    listed = {(topic, name) for part in parts for topic, values in part(settings).items() for name in values}
    from icymoon.settings.table import list_all_settings

    needed = {(topic, s.key) for topic, s in list_all_settings() if s.effect not in ("response", "run")}
    assert needed <= listed
