"""The summary of decisions over scenes: means and what their intervals can be."""

from __future__ import annotations

import pytest
from icymoon.stereo.decisions.report import COLUMNS, compare_methods, find_notes, make_head_sentences, summarise
from icymoon.stereo.measure.render_noise import BAKE, CLEAN, DECIDES, RENDER, UNKNOWN

SHARES = {column.key for column in COLUMNS if column.unit == "%"} | {"sites.average_precision", "sites.roc_area"}


def summary(*scenes):
    """The summary of a method that has these numbers (false_safe, AP, unsafe_choice, bias) in as many scenes."""
    rows = [
        {
            "pair": str(k),
            "method": "bm",
            "status": "ok",
            "numbers": {
                "dem": {"bias_m": bias, "completeness": 1.0, "rmse_m": abs(bias)},
                "sites": {
                    "false_safe": unsafe,
                    "average_precision": precision,
                    "unsafe_choice": choice,
                    "no_site": 0.0,
                    "roc": None,
                    "base_rate": 0.2,
                    "chosen": [0, 0],
                },
            },
        }
        for k, (unsafe, precision, choice, bias) in enumerate(scenes)
    ]
    (entry,) = summarise(rows, [{"pair": row["pair"], "scene": row["pair"]} for row in rows], ["bm"])
    return entry


def test_no_interval_leaves_the_range_of_its_number():
    # By Student's t alone: false_safe from -0.31 to 0.53, AP to 1.39, RMSE from below 0.
    entry = summary((0.0, 1.0, 0.0, 0.001), (0.02, 0.98, 1.0, -0.002), (0.3, 0.6, 0.0, 0.03))
    for key, (low, high) in entry["intervals"].items():
        if low is None:
            continue
        assert low <= entry[key] <= high
        assert key == "dem.bias_m" or low >= 0
        assert key not in SHARES or high <= 1
    assert entry["intervals"]["dem.bias_m"] == [None, None]  # a mean that is no share needs more scenes
    assert entry["intervals"]["sites.false_safe"][1] > 0.4
    many = summary(*((0.1, 0.5, 0.0, 0.001 * (k % 5 - 2)) for k in range(20)))
    assert many["intervals"]["dem.bias_m"][0] < 0 < many["intervals"]["dem.bias_m"][1]
    assert many["intervals"]["dem.rmse_m"][0] > 0


def test_choices_of_one_kind_in_all_scenes_are_no_certainty():
    entry = summary(*[(0.1, 0.5, 0.0, 0.01)] * 8)
    low, high = entry["intervals"]["sites.unsafe_choice"]
    assert low == 0
    assert (1 - high) ** 8 == pytest.approx(0.025, abs=0.004)  # if so many were unsafe, all of 8 rarely would be safe
    assert summary((0.1, 0.5, 0.0, 0.01))["intervals"]["sites.unsafe_choice"] == [None, None]


def test_no_unsafe_site_in_any_scene_is_no_certainty():
    entry = summary(*[(0.0, 0.5, 0.0, 0.01)] * 5)
    assert (1 - entry["intervals"]["sites.false_safe"][1]) ** 5 == pytest.approx(0.025, abs=0.004)
    one = summary(*[(0.0, 0.5, 0.0, 0.01)] * 4, (0.01, 0.5, 0.0, 0.01))
    assert one["intervals"]["sites.false_safe"][1] > entry["intervals"]["sites.false_safe"][1]


@pytest.mark.parametrize(("scenes", "found"), [(5, 0), (6, 1)])
def test_matchers_are_compared_in_the_typical_scene(scenes, found):
    rows = [
        {
            "pair": str(k),
            "method": method,
            "status": "ok",
            "numbers": {
                "dem": {"rmse_m": (0.01 + 1e-4 * k) * factor, "completeness": 1.0},
                "sites": {"false_safe": 0.1, "cells": [9, 9, 0, 0], "safe_lost": 0.1, "lost_by": {"known": 0.1}},
            },
        }
        for k in range(scenes)
        for method, factor in (("true depth", 0.1), ("bm", 1.0), ("sgbm", 3.0))
    ]
    facts = [{"pair": str(k), "scene": str(k), "exact": True, "arm": {"kind": "PARAMETRIC"}} for k in range(scenes)]
    entries = compare_methods(rows, facts, ["true depth", "bm", "sgbm"], 0)
    assert len(entries) == found
    for entry in entries:
        assert (entry["metric"], entry["better"], entry["worse"], entry["scenes"]) == ("dem.rmse_m", "bm", "sgbm", 6)
        assert entry["typical"] == pytest.approx(2 * 0.01025)
        assert entry["typical_interval"] == pytest.approx([0.02, 0.021])
    told = " ".join(find_notes(rows, facts))
    assert ("no difference between 2 matchers can be shown; it takes 6." in told) == (not found)


def test_where_no_image_shows_ground_in_reach_nothing_is_told_of_sites():
    def rows(completeness):
        sites = {
            "false_safe": None,
            "taken": 0.0,
            "safe_lost": 1.0,
            "lost_by": {"known": 1.0},
            "refused_by": {"known": 0.3, "slope": 0.7},
            "roc": None,
            "base_rate": 0.9,
            "chosen": None,
            "unsafe_choice": None,
            "no_site": 1.0,
            "cells": [9, 9, 0, 0],
        }
        return [
            {
                "pair": "a",
                "method": "true depth",
                "status": "ok",
                "numbers": {"dem": {"completeness": completeness, "reached_completeness": 0.0}, "sites": sites},
            }
        ]

    facts = [{"pair": "a", "scene": "a", "sun_elevation_deg": 35.0, "exact": True, "arm": {"kind": "PARAMETRIC"}}]
    for completeness in (None, 0.9):
        found = rows(completeness)
        head = make_head_sentences(summarise(found, facts, ["true depth"]), facts)
        notes = [note for note in find_notes(found, facts) if "shows no cell in reach" in note]
        assert bool(head) == (completeness is not None)
        assert [note.split(",")[0] for note in notes] == (
            ["The left image of 1 of 1 pair shows no cell in reach"] if completeness is None else []
        )
    why = "mainly because it looks too steep (70 of 100 sites)"
    assert head[0].endswith(f"no site looks safe, {why}, although 90 of 100 are safe (1 scene).")
    found[0]["numbers"]["sites"] |= {"base_rate": 0.0, "safe_lost": None, "no_site": None}
    head = make_head_sentences(summarise(found, facts, ["true depth"]), facts)
    assert head[0].startswith("No site is safe by the rules; with the true depth")
    assert head[0].endswith(f"no site looks safe, {why} (1 scene).")
    del found[0]["numbers"]["sites"]["refused_by"]  # as an earlier version wrote it
    head = make_head_sentences(summarise(found, facts, ["true depth"]), facts)
    assert head[0].endswith("no site looks safe (1 scene).")


@pytest.mark.parametrize(
    ("lost_by", "told"),
    [
        ({"slope": 0.1, "roughness": 0.39}, "and 49 of 100 safe ones are lost; it"),
        (
            {"slope": 0.1, "roughness": 0.5},
            "and 60 of 100 safe ones are lost, mainly because it looks too rough (50 of 100 safe ones); it",
        ),
    ],
)
def test_the_main_reason_is_told_where_most_safe_ground_is_lost(lost_by, told):
    sites = {
        "false_safe": 0.1,
        "taken": 0.4,
        "safe_lost": sum(lost_by.values()),
        "lost_by": lost_by,
        "refused_by": {"known": 0.6},
        "roc": None,
        "base_rate": 0.9,
        "chosen": [1, 1],
        "unsafe_choice": 0.0,
        "no_site": 0.0,
        "cells": [9, 9, 0, 0],
    }
    row = {"pair": "a", "method": "bm", "status": "ok", "numbers": {"dem": {"completeness": 0.9}, "sites": sites}}
    facts = [{"pair": "a", "scene": "a", "sun_elevation_deg": 35.0, "exact": True, "arm": {"kind": "PARAMETRIC"}}]
    assert told in make_head_sentences(summarise([row], facts, ["bm"]), facts)[0]


def test_what_the_true_depth_loses_is_told_with_its_reasons():
    def row(pair, lost_by, cells=(90, 50, 10, 10)):
        lost = sum(lost_by.values()) if cells[1] else None
        sites = {"safe_lost": lost, "lost_by": lost_by, "cells": list(cells)}
        return {
            "pair": pair,
            "method": "true depth",
            "status": "ok",
            "numbers": {"dem": {"completeness": 1.0}, "sites": sites},
        }

    rows = [row("a", {"known": 0.5, "rocks": 0.1}), row("b", {"rocks": 0.2}), row("c", {}, (90, 0, 0, 0))]
    facts = [{"pair": pair, "scene": pair, "exact": True, "arm": True} for pair in "abc"]
    notes = find_notes(rows, facts)
    # 0.8 of two pairs: 0.5 for unknown cells, 0.3 for rocks.
    assert (
        "The true depth loses 40 of 100 safe sites: in 62 % of these too few of its cells have a height, in 38 % of "
        "these a rock looks too near. No matcher can be expected to lose fewer." in notes
    )
    ranks = [note for note in notes if "cannot rank" in note]
    assert [note.partition(" cannot")[0] for note in ranks] == ["1 pair (a)", "1 pair (c)"]
    assert ranks[1].endswith("no site is safe; try flatter ground, a longer reach or looser rules.")


def _choose_on(grounds, unsafe, pairs_each=1):
    """Notes on a matcher on grounds of some pairs; on the first pair of ``unsafe`` grounds the choice is unsafe."""
    facts, rows = [], []
    for k in range(grounds):
        for j in range(pairs_each):
            facts.append({"pair": f"{k}-{j}", "scene": f"{k}-{j}", "site": str(k), "exact": True, "arm": True})
            sites = {"cells": [9, 9, 0, 0], "unsafe_choice": float(k < unsafe and j == 0)}
            rows.append({"pair": f"{k}-{j}", "method": "bm", "status": "ok", "numbers": {"sites": sites}})
    return [note for note in find_notes(rows, facts) if "ground" in note and "unsafe" in note]


def test_choices_on_few_grounds_support_no_statement_on_others():
    # Ten Suns of a ground are one ground, and no bound is stated.
    (note,) = _choose_on(8, 0, 10)
    assert note.startswith("8 grounds cannot show that at most 5 %")
    assert "it takes 59 grounds" in note
    assert _choose_on(58, 0)[0].startswith("58 grounds cannot show")


def test_choices_on_enough_grounds_have_the_bound_of_clopper_and_pearson():
    (note,) = _choose_on(59, 0)
    assert "unsafe on 0 of 59 grounds, and with 95 % confidence on at most 5.0 %" in note  # 1 - 0.05^(1/59)
    (note,) = _choose_on(60, 6, 2)
    assert "unsafe on 6 of 60 grounds" in note


def test_noise_is_counted_over_the_pairs_of_all_suns_and_not_over_the_last():
    decides, clean = {"verdict": DECIDES, "larger": RENDER}, {"verdict": CLEAN, "larger": None}
    baked, unknown = {"verdict": DECIDES, "larger": BAKE}, {"verdict": UNKNOWN, "larger": None}

    def tell(*sites):
        facts = [
            {"pair": str(k), "scene": str(k), "exact": True, "arm": True, "suns": [{"noise": each} for each in noises]}
            for k, noises in enumerate(sites)
        ]
        return [note.split(":")[0].split(",")[0] for note in find_notes([], facts) if "oise of" in note]

    assert tell([clean, clean], [clean, clean]) == []
    assert tell([decides, clean], [decides, clean]) == [
        "Noise of the render decides the result in 2 of 4 pairs under all Suns"
    ]
    assert tell([baked, unknown, clean]) == [
        "Noise of baked light decides the result in 1 of 3 pairs under all Suns",
        "The noise of baked light is unknown in 1 of 3 pairs under all Suns",
    ]
