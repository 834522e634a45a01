"""What descriptions share is stated once, and each is as it was."""

from __future__ import annotations

import pytest
from icymoon.settings.shared_settings import add_shared, find_shared, remove_shared

A = {"rig": {"x_m": 0.0, "y_m": 1.0}, "light": {"layers": [{"a": 1}]}}


@pytest.mark.parametrize(
    ("others", "shared"),
    [
        ([], A),
        ([A], A),
        ([{}], {}),
        ([A, {"rig": {"x_m": 0.0}}], {"rig": {"x_m": 0.0}}),
        ([{**A, "rig": {"x_m": -0.0, "y_m": 1.0}}], {**A, "rig": {"y_m": 1.0}}),
        ([{**A, "rig": {"x_m": 0, "y_m": True}}], {"light": A["light"]}),
        ([{**A, "light": {"layers": [{"a": 2}]}, "more": {"b": 1}}], {"rig": A["rig"]}),
    ],
    ids=str,
)
def test_what_is_shared_and_what_is_not(others, shared):
    descriptions = [A, *others]
    found = find_shared(iter(descriptions))
    assert repr(found) == repr(shared)
    for each in descriptions:
        assert repr(
            {
                topic: dict(sorted(table.items()))
                for topic, table in sorted(add_shared(remove_shared(each, found), found).items())
            }
        ) == repr({topic: dict(sorted(table.items())) for topic, table in sorted(each.items())})


def test_nothing_shares_nothing():
    assert find_shared([]) == {}
