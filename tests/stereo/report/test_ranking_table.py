"""The ranking table and the names of conditions."""

import json

import numpy as np
import pytest
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset, read_preset_header
from icymoon.stereo.measure.row_metrics import NUMBERS
from icymoon.stereo.report.by_setting import find_swept_settings
from icymoon.stereo.report.conditions import (
    Condition,
    find_preset_title,
    join_by_scene,
    list_conditions,
    make_pair_titles,
    name_levels,
)
from icymoon.stereo.report.ranking_table import FIRST_SORTING, VIEWS, make_ranking_table
from icymoon.stereo.report.summary import ResultTable, compare_methods, summarise_method

pytestmark = pytest.mark.filterwarnings("error")


def named(many):
    facts = [{"pair": str(k), "settings": merged(defaults(), *parts)} for k, parts in enumerate(many)]
    places = {str(k): k for k in range(len(many))}
    sweeps = join_by_scene(find_swept_settings(facts, places), facts, places)
    levels = name_levels(sweeps, facts, places)
    return list_conditions(sweeps, levels), make_pair_titles(sweeps, levels, len(many))


def test_conditions_are_named_by_value_and_unit():
    conditions, titles = named([({"light": {"sun_elevation_deg": float(sun)}},) for sun in (8, 45, 8)])
    assert [condition.name for condition in conditions] == ["Sun Elevation 8°", "Sun Elevation 45°"]
    assert conditions[0].pairs.tolist() == [True, False, True]
    assert titles == ["Sun Elevation 8°", "Sun Elevation 45°", "Sun Elevation 8° (2)"]


def test_terrains_are_one_condition_each_and_settings_of_the_same_label_name_their_topic():
    """Settings of landforms, which divide the terrains in other ways, are no conditions beside them."""
    terrains = ("low_1", "low_2", "low_3", "medium_3", "very_high")
    rocks = [{"rocks": {"coverage": share}} for share in (0.05, 0.08)]
    conditions, titles = named([(load_preset(f"terrains/{each}"), own) for each in terrains for own in rocks])
    names = [condition.name for condition in conditions]
    assert names[:5] == sorted(f"Terrain: {read_preset_header(f'terrains/{each}')[0]}" for each in terrains)
    assert names[5:] == ["Rocks: Coverage 0.05", "Rocks: Coverage 0.08"]
    assert titles[0] == "Terrain: Low ruggedness, snow swells, Rocks: Coverage 0.05"
    assert len(set(titles)) == 10


def test_a_level_has_the_name_of_a_preset_only_if_all_of_its_pairs_are_from_it():
    snow, ice, blue = (load_preset(f"surfaces/{name}") for name in ("fresh_snow", "rough_ice", "blue_ice"))
    together = {"mesh": {"error_px": 2.0}, "terrain": {"hurst": 0.61}}
    conditions, _ = named([(snow,), (ice, together), (blue, together)])
    at_two = next(each for each in conditions if each.pairs.tolist() == [False, True, True])
    assert not {read_preset_header(f"surfaces/{each}")[0] for each in ("rough_ice", "blue_ice")} & {at_two.name}


def test_ground_from_files_has_no_terrain_and_own_ground_leaves_all_settings():
    low, high = (load_preset(f"terrains/{name}") for name in ("low_1", "high_1"))
    mesh, own = {"source": {"kind": "STAND_IN"}}, {"terrain": {"hurst": 0.61}}
    conditions, _ = named([(low,), (high,), (low, mesh)])
    assert [c.pairs.tolist() for c in conditions if c.name.startswith("Terrain: ")] == [
        [False, True, False],
        [True, False, False],
    ]
    assert any(c.name == "Source Stand-In Mesh" for c in conditions)
    assert not any(c.name.startswith("Terrain: ") for c in named([(low,), (high,), (low, own)])[0])


def test_titles_of_pairs_differ():
    """As many values as tell them apart, whatever there are before."""
    many = [
        (
            {
                "light": {"sun_elevation_deg": sun},
                "surface": {"albedo": albedo},
                "rig": {"x_m": east, "heading_deg": turn},
            },
        )
        for sun in (8.0, 45.0)
        for albedo in (0.4, 0.8)
        for east in (0.0, 1.0)
        for turn in (0.0, 90.0)
    ]
    _, titles = named([*many, many[0]])
    assert len(set(titles)) == 17
    assert titles[-1] == f"{titles[0]} (2)"
    assert all(title.count("Sun Elevation") == 1 for title in titles)


def test_settings_of_presets_are_named_by_the_preset():
    names = ("surfaces/fresh_snow", "surfaces/rough_ice")
    conditions, _ = named([(load_preset(name),) for name in names])
    assert {condition.name for condition in conditions} == {read_preset_header(name)[0] for name in names}
    scene = merged(defaults(), load_preset("scenes/europa_rough_ice"))
    assert find_preset_title(scene) == read_preset_header("scenes/europa_rough_ice")[0]
    assert find_preset_title({}) == ""


def test_only_the_best_beyond_doubt_is_bold_and_conditions_count_for_themselves():
    table = ResultTable(["good", "bad", "none"], [f"p{k}" for k in range(12)])
    table.scenes[:], table.counts[:] = np.arange(12), True
    random = np.random.default_rng(0)
    for k, wrong in enumerate((0.1, 0.3, 1.0)):
        table.values[k, :, NUMBERS.index("total_bad_1")] = np.clip(random.normal(wrong, 0.02, 12), 0, 1)
        table.values[k, :, NUMBERS.index("n")] = 0 if k == 2 else 100
    _, ranks = compare_methods(table, 0)
    summary = [summarise_method(table, k) | {"ranks": ranks[k]} for k in range(3)]
    found = make_ranking_table(table, summary, "", [Condition("few", np.arange(12) < 4)], 0)
    json.dumps(found, allow_nan=False)
    view, column = FIRST_SORTING
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
