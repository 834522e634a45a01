"""Settings of many pairs are read back by table."""

from __future__ import annotations

import json

import pytest
from icymoon.settings import description
from icymoon.settings.description import Restorer, check, defaults, merged, overlay, restore_settings
from icymoon.support.errors import IcyMoonError


def stored(**changes) -> dict:
    return json.loads(json.dumps(merged(defaults(), check(changes, "test"))))


@pytest.fixture
def checked(monkeypatch) -> list[str]:
    """The topics of the tables that are checked."""
    found: list[str] = []
    inner = description._check_table
    monkeypatch.setattr(
        description, "_check_table", lambda topic, *rest, **named: found.append(topic) or inner(topic, *rest, **named)
    )
    return found


def test_a_table_that_many_have_is_checked_once(checked):
    pairs = [stored(rig={"heading_deg": float(k % 3)}, dataset={"seed": k}) for k in range(9)]
    checked.clear()
    restore = Restorer()
    found = [restore(pair, "pair.json") for pair in pairs]
    assert checked.count("rig") == 3
    assert checked.count("dataset") == 9
    assert len(checked) == len(pairs[0]) - 2 + 3 + 9
    assert found == pairs
    assert found == [restore_settings(pair, "pair.json") for pair in pairs]
    assert all(type(pair[topic]) is type(defaults()[topic]) for pair in found for topic in pair)


@pytest.mark.parametrize("other", [1, True, "1.0", 2.0, -0.0])
def test_values_that_are_equal_or_similar_are_no_others(other):
    """1, 1.0 and true are one key of a dictionary, and 0.0 and -0.0 too."""

    def heading(restore) -> str:
        try:
            return repr(restore({"rig": {"heading_deg": other}}, "pair.json").rig.heading_deg)
        except IcyMoonError as error:
            return str(error)

    restore = Restorer()
    restore({"rig": {"heading_deg": 0.0 if other == 0 else 1.0}}, "pair.json")
    assert heading(restore) == heading(restore_settings)


def test_each_file_with_a_wrong_table_is_named():
    restore = Restorer()
    for name in ("one/pair.json", "two/pair.json"):
        with pytest.raises(IcyMoonError, match=f"^{name}: "):
            restore({"rig": {"heading_deg": "north"}}, name)


def test_what_is_no_plain_table_is_checked_too():
    with pytest.raises(IcyMoonError, match="unknown setting"):
        Restorer()({"rig": {"made": object()}}, "pair.json")


def test_the_tables_that_do_not_differ_are_those_of_the_base():
    base, part = defaults(), check({"rig": {"heading_deg": 3.0}}, "test")
    found = overlay(base, part)
    assert found == merged(base, part)
    assert {topic for topic in found if found[topic] is not base[topic]} == {"rig"}
    assert base == defaults()
