"""The sentences before the tables: search ranges that miss disparities, ranges from truth."""

import pytest
from icymoon.records import find_fault
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.report.notes import SEARCH, Notes


def sentences(text, *searches):
    methods = parse_methods(text)
    notes = Notes(methods)
    for k, search in enumerate(searches):
        assert not find_fault({"search": search}, {"search": SEARCH})
        notes.add({"pair": f"p{k}", "method": methods[0].label, "search": search, "options": {}})
    return notes.sentences()


def search(missed, source="rig", most=95):
    return {"least_px": 0, "most_px": most, "source": source, "missed": missed}


@pytest.mark.parametrize(("source", "fix"), [
    ("stated", "Leave the option out"), ("rig", "State a larger range"), ("fixed", "Nothing is known of the rig")])
def test_a_range_that_misses_disparities_is_said_with_the_fix(source, fix):
    said, = sentences("bm", search(0.3, source, 31), search(0.005, source), search(0.02, source), search(None, source))
    assert "in 2 of 4 pairs" in said
    assert "at most 30 % (pair p0, searched 0 to 31 px)" in said
    assert fix in said


def test_nothing_is_said_without_a_reason():
    assert not sentences("bm", search(0.01), search(0.0), None)


def test_a_range_from_truth_is_said():
    said, = sentences("bm:disparities=truth", search(0.0, "truth"))
    assert "range from truth" in said
