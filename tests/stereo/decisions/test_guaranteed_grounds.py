"""The study of guarantees on grounds by rays: which grounds it uses, its counts, and one ground with its rows."""

from __future__ import annotations

import argparse
import json
import re

import numpy as np
import pytest
from icymoon.benchmarks.common import ray_grounds as grounds
from icymoon.benchmarks.stereo import guaranteed_grounds as study
from icymoon.stereo.decisions.calibration import Goal
from icymoon.stereo.decisions.height_errors import QUANTITIES
from icymoon.stereo.decisions.scores import THRESHOLDS
from icymoon.stereo.decisions.stored_maps import TRUE_DEPTH
from icymoon.stereo.decisions.workspace import FEATURES, decide_from_depth
from icymoon.stereo.design.made_workspaces import name_pair
from icymoon.stereo.learning.grounds import HELD_OUT_LANDFORMS, build_ground, release_ground
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.report.row_log import RowLog

CELLS = 100


def make_row(number, margin, unsafe, alike=True):
    """A row with 20 safe cells; 10 of them and ``unsafe`` unsafe ones are taken, all with this margin."""
    found = [10 * (margin >= each) for each in THRESHOLDS]
    sites = {
        "cells": [CELLS, 20, 10 + unsafe, 10],
        "chosen": [0, 0],
        "chosen_margin": margin,
        "unsafe_choice": float(unsafe > 0),
        "dangerous_choice": float(unsafe > 1),
        "taken_from": [count + unsafe * (count > 0) for count in found],
        "unsafe_from": [unsafe * (count > 0) for count in found],
        "offered": CELLS,
    }
    errors = {name: {"cells": 0, "within": []} for name in QUANTITIES}
    features = dict.fromkeys(FEATURES, number % 7 if alike else 1000.0)
    numbers = {"sites": sites, "fails": "slope" if unsafe else None, "features": features, "errors": errors}
    return {"pair": f"{number}", "method": "bm", "status": "ok", "numbers": numbers}


def test_no_ground_both_calibrates_and_tests():
    found = grounds.draw_grounds(3, 6, 5, 4)
    assert [len(found[kind]) for kind in (grounds.CALIBRATION, grounds.TEST, grounds.LANDFORM)] == [6, 5, 4]
    everything = [recipe for own in found.values() for recipe in own]
    assert len({name_pair(recipe) for recipe in everything}) == 15
    assert not any(recipe.shapes for recipe in everything)
    assert {recipe.terrain for recipe in found[grounds.LANDFORM]} <= set(HELD_OUT_LANDFORMS)
    assert not any(recipe.terrain in HELD_OUT_LANDFORMS for recipe in found[grounds.CALIBRATION] + found[grounds.TEST])


def test_counts_are_those_of_grounds_by_hand():
    """Of 70 grounds, 10 have an unsafe choice with the margin 0.2, so 0.21 is the lowest margin without one; one unsafe
    ground is accepted from 93 on.
    """
    rows = [make_row(k, 0.2 if k < 10 else 0.5, int(k < 10)) for k in range(70)]
    calibration = grounds.calibrate(rows, Goal())
    new = [
        make_row(100, 0.5, 0),
        make_row(101, 0.4, 0),
        make_row(102, 0.25, 2),
        make_row(103, 0.2, 1),
        make_row(104, 0.5, 0, alike=False),
    ]
    (found,) = grounds.apply(calibration, new)
    assert found["threshold"] == 0.21
    assert (found["acted"], found["unsafe"], found["unlike"], found["abstained"]) == (3, 1, 1, 1)
    assert found["lost"][0] == pytest.approx(0.5)
    counts = {"grounds": 5, "acted": 5, "unsafe": 2, "dangerous": 1, "fails": {"slope": 2}}
    assert grounds.count_choices(new) == {"bm": counts}


def test_decisions_on_rendered_grounds_are_read_as_their_report_states_them(tmp_path, capsys):
    folders = {
        "calibrates": [make_row(k, 0.5, 0) for k in range(60)],
        "tests": [make_row(0, 0.4, 0)],
    }
    for name, rows in folders.items():
        (tmp_path / name).mkdir()
        for row in rows:
            del row["numbers"]["fails"]  # which only the rows of grounds by rays state
        old = make_row(99, 0.5, 2)  # of a pair that an earlier run decided on
        (tmp_path / name / "decisions.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in (old, *rows)))
        (tmp_path / name / "decisions.json").write_text(json.dumps({"rows": rows}))
    options = argparse.Namespace(decided=[tmp_path / name for name in folders], alpha=0.05, delta=0.05)
    assert study.list_rows(options) == {
        grounds.CALIBRATION: folders["calibrates"],
        grounds.TEST: folders["tests"],
    }
    study.main(options)
    assert re.search(r"^bm +0\.00 +1\.00 \(.*\) +0 ", capsys.readouterr().out, re.MULTILINE)


def test_lost_cells_are_counted_without_those_of_unlike_grounds():
    rows = [make_row(0, 0.5, 3), make_row(1, 0.5, 0), make_row(2, 0.1, 0)]
    for row, verdict in zip(rows, ("guaranteed", "unlike", "abstains"), strict=True):
        row["guarantee"] = {"verdict": verdict}
    assert grounds.find_lost_shares(rows, 0.3) == pytest.approx(np.array([[0.5, 0.5], [0.5, 1.0], [0.5, 1.0]]))
    assert (grounds.find_lost_shares(rows, None)[:, 1] == 1).all()


@pytest.mark.left_to_ci
def test_the_true_depth_agrees_with_the_exact_heights():
    """A shift by a cell of 2 cm would change heights by 2 mm and more on slopes of 6 degrees and more."""
    ground = build_ground(grounds.draw_grounds(0, 2, 0, 0)[grounds.CALIBRATION][1])
    try:
        workspace = study.make_workspace_of_ground(ground)
    finally:
        release_ground(ground)
    off = decide_from_depth(workspace, workspace.prepared.truth).dem.height_m - workspace.truth.dem.height_m
    assert np.median(workspace.truth.sites.layers.slope_deg[workspace.inside]) > 6
    assert np.nanmedian(np.abs(off[workspace.seen])) < 0.001


@pytest.mark.left_to_ci
def test_a_second_start_takes_the_rows_of_the_first(tmp_path):
    """Rows that are made again would have other CPU seconds."""
    recipe = grounds.draw_grounds(0, 2, 0, 0)[grounds.CALIBRATION][1]
    file, methods = tmp_path / "rows.jsonl", parse_methods("bm")
    rows = study.make_rows(recipe, methods, RowLog(file))
    assert [(row["method"], row["status"]) for row in rows] == [(TRUE_DEPTH, "ok"), ("bm", "ok")]
    assert rows[0]["numbers"]["sites"]["dangerous_choice"] == 0
    assert study.make_rows(recipe, methods, RowLog(file)) == rows
