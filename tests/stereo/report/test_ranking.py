"""The ranking table and the names of conditions."""

import json

import numpy as np
import pytest
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset, preset_header
from icymoon.stereo.measure.result_row import NUMBERS
from icymoon.stereo.report.by_setting import swept_settings
from icymoon.stereo.report.conditions import Condition, conditions_of, name_levels, preset_title, titles_of
from icymoon.stereo.report.ranking import FIRST, VIEWS, rank_methods
from icymoon.stereo.report.summary import Table, compare_methods, summarise_method

pytestmark = pytest.mark.filterwarnings("error")


def named(many):
    facts = [{"pair": str(k), "settings": merged(defaults(), *parts)} for k, parts in enumerate(many)]
    places = {str(k): k for k in range(len(many))}
    sweeps = swept_settings(facts, places)
    levels = name_levels(sweeps, facts, places)
    return conditions_of(sweeps, levels), titles_of(sweeps, levels, len(many))


def test_conditions_are_named_by_value_and_unit():
    conditions, titles = named([({"light": {"sun_elevation_deg": float(sun)}},) for sun in (8, 45, 8)])
    assert [condition.name for condition in conditions] == ["Sun Elevation 8°", "Sun Elevation 45°"]
    assert conditions[0].pairs.tolist() == [True, False, True]
    assert titles == ["Sun Elevation 8°", "Sun Elevation 45°", "Sun Elevation 8°"]


def test_settings_of_presets_are_named_by_the_preset():
    names = ("surfaces/fresh_snow", "surfaces/rough_ice")
    conditions, _ = named([(load_preset(name),) for name in names])
    assert {condition.name for condition in conditions} == {preset_header(name)[0] for name in names}
    scene = merged(defaults(), load_preset("scenes/europa_rough_ice"))
    assert preset_title(scene) == preset_header("scenes/europa_rough_ice")[0]
    assert preset_title({}) == ""


def test_only_the_best_beyond_doubt_is_bold_and_conditions_count_for_themselves():
    table = Table(["good", "bad", "none"], [f"p{k}" for k in range(12)])
    table.scenes[:], table.counts[:] = np.arange(12), True
    random = np.random.default_rng(0)
    for k, wrong in enumerate((0.1, 0.3, 1.0)):
        table.values[k, :, NUMBERS.index("total_bad_1")] = np.clip(random.normal(wrong, 0.02, 12), 0, 1)
        table.values[k, :, NUMBERS.index("n")] = 0 if k == 2 else 100
    _, ranks = compare_methods(table, 0)
    summary = [summarise_method(table, k) | {"ranks": ranks[k]} for k in range(3)]
    found = rank_methods(table, summary, "", [Condition("few", np.arange(12) < 4)], 0)
    json.dumps(found, allow_nan=False)
    view, column = FIRST
    everything, few = (condition["cells"][view] for condition in found["conditions"])
    assert [row[column][2:4] for row in everything] == [["1", True], ["2", False], ["", False]]
    assert [row[column][2:4] for row in few] == [["", False]] * 3  # four scenes allow no verdict
    assert few[0][column][4] == pytest.approx(table.values[0, :4, NUMBERS.index("total_bad_1")].mean())
    assert [condition["ranked"] for condition in found["conditions"]] == [True, False]
    assert found["conditions"][0]["notes"] == ["", "", "no result"]
    shown = [
        cell
        for each in VIEWS
        for cell, column in zip(found["conditions"][0]["cells"][each.key][2], each.columns, strict=True)
        if column.column.key != "seconds"
    ]
    assert set(map(tuple, shown)) == {("–", "", "", False, None)}  # neither the worst nor a coverage of 0
    assert all(len(row) == len(each.columns) for each in VIEWS for row in found["conditions"][0]["cells"][each.key])
