"""What is made once of tables that descriptions share is the same as what is made of each."""

import json
from typing import Any

from icymoon.settings import pair_ids
from icymoon.settings.description import check, defaults, merged
from icymoon.settings.pair_ids import make_pair_id
from icymoon.settings.table_cache import SettingsTexts, TableCache


def test_of_a_table_something_is_made_once_and_of_an_equal_one_again():
    made = []
    once = TableCache(lambda table: made.append(table) or len(made))
    one, other = {"a": 1}, {"a": 1}
    assert [once.of(one), once.of(other), once.of(one)] == [1, 2, 1]


def test_a_table_that_is_gone_is_not_taken_for_a_later_one():
    once = TableCache(lambda table: table["k"])
    assert [once.of({"k": k}) for k in range(1000)] == list(range(1000))


def test_texts_are_equal_where_the_named_settings_are():
    texts = SettingsTexts([("terrain", "hurst"), ("rig", "x_m"), ("terrain", "size_m")])
    base = defaults()
    assert texts.of(base) == texts.of(merged(base, {"rig": {"y_m": 3.0}}))
    others = [
        merged(base, {"rig": {"x_m": 3.0}}),
        merged(base, {"terrain": {"hurst": 0.5}}),
        merged(base, {"terrain": {"size_m": 0.5}}),
    ]
    assert len({texts.of(each) for each in (base, *others)}) == 4


def test_a_counter_for_many_descriptions_gives_each_the_id_that_it_has_alone():
    base = defaults()
    parts: list[dict[str, dict[str, Any]]] = [
        {},
        {"rig": {"heading_deg": 90.0}},
        {"surface": {"albedo": 0.5}},
        {"surface": {"relief": "REAL"}, "mesh": {"kind": "GRID"}},
        {"quality": {"truth": "DEPTH"}},
        {"terrain": {"hurst": 0.5}},
    ]
    described = [
        base | {topic: base[topic] | values for topic, values in check(part, "test").items()} for part in parts
    ]  # which share the other tables, as those of a plan do
    count = pair_ids.make_counter()
    assert [make_pair_id(each, "x", count) for each in described] == [
        make_pair_id(merged(each), "x") for each in described
    ]
    assert len({make_pair_id(each, "x", count) for each in described}) == len(parts)
    assert [json.loads(text) for text in count(described[1])] == pair_ids.list_counted_values(described[1])
