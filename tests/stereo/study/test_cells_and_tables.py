"""What is measured of a view, on pairs with noise that was put in, and the files of a study."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import pairs
import pytest
from icymoon.physics.light.sky import compute_sky, describe_sky
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.settings.description import check, merged
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.study import view_measurements as cells_of
from icymoon.stereo.study.conclusions import draw_conclusions
from icymoon.stereo.study.design import CONVERGED, Study, find_study, read_study
from icymoon.stereo.study.tables import BEGIN, END, replace_between_marks, write_study
from icymoon.stereo.study.view_measurements import read_or_measure_cell
from icymoon.support.errors import IcyMoonError

METHODS = parse_methods("bm,sgbm")
RIG = pairs.camera(160, 120)
SCENE = pairs.Scene(contrast=0.4)
#: The noise of each recipe, relative.
NOISE = {"half_a": 0.01, "half_b": 0.01, "traced_16": 0.3, "standard": 0.08}


@pytest.fixture(scope="module")
def study():
    whole = read_study(find_study("recipes"))
    recipes = tuple(recipe for recipe in whole.recipes if recipe.name in NOISE)
    return replace(
        whole,
        views=whole.views[:1],
        recipes=recipes,
        noise=("traced_16", "standard"),
        comparisons=(("traced_16", CONVERGED), ("standard", CONVERGED)),
        hypotheses=(),
    )


@pytest.fixture
def out(study, tmp_path, monkeypatch):
    """A folder with the pairs of the study's only view, which are synthetic."""
    view = study.views[0]
    exposure = check({"sensor": {"shot_noise": False, "read_noise_e": 0.0}}, "test")
    settings = merged(view.settings, {"rig": pairs.described(RIG)}, exposure)
    planned = {name: PlannedPair(pairs.id_of(name), settings, 0.0) for name in NOISE}
    for name, pair in planned.items():
        folder = pairs.write_pair(pair.folder(tmp_path), SCENE, RIG, noise=NOISE[name], settings=settings)
        data = json.loads((folder / "pair.json").read_text())
        data |= {"light": describe_sky(compute_sky(settings.light)), "cpu_seconds": {"before": 1.0, "pair": 2.0}}
        (folder / "pair.json").write_text(json.dumps(data))
    monkeypatch.setattr(Study, "pairs_of", lambda self, view: planned)
    return tmp_path


def test_noise_costs_what_was_put_in(study, out):
    cell = read_or_measure_cell(study, study.views[0], out, METHODS)
    assert cell is not None
    assert set(cell.tallies) == {CONVERGED, *NOISE}
    for method in ("bm", "sgbm"):
        assert cell.error(CONVERGED, method) <= cell.error("standard", method) < cell.error("traced_16", method)
        assert 0 <= cell.error(CONVERGED, method) < 0.5
    # The mean of two halves has the noise of one over the root of 2; the texture has a mean square above 1.
    assert cell.reference_noise == pytest.approx(0.01 / 2**0.5, rel=0.15)
    for name in study.noise:
        assert cell.noise[name]["distance"] == pytest.approx(NOISE[name], rel=0.15)
        assert abs(cell.noise[name]["bias"]) < 0.02
        # The verdict knows one render alone, whose right eye is interpolated, and takes the noise of a wider square.
        assert cell.noise[name]["hidden"] == pytest.approx(cell.noise[name]["truly_hidden"], abs=0.07)
    assert cell.noise["traced_16"]["hidden"] > cell.noise["standard"]["hidden"]
    assert cell.cpu_s["standard"] == {"pair": 2.0, "bake": 0}


def test_a_view_is_measured_once_and_again_only_if_something_changed(study, out, monkeypatch):
    view = study.views[0]
    first = read_or_measure_cell(study, view, out, METHODS)
    with monkeypatch.context() as patched:
        patched.setattr(cells_of, "load_pair", None)  # nothing is read
        again = read_or_measure_cell(study, view, out, METHODS)
    assert again is not None
    assert first is not None
    assert again.noise == first.noise
    assert set(read_or_measure_cell(study, view, out, METHODS[:1]).tallies["standard"]) == {"bm"}


def test_a_view_without_both_halves_has_no_numbers(study, out):
    (study.pairs_of(study.views[0])["half_b"].folder(out) / "pair.json").unlink()
    assert read_or_measure_cell(study, study.views[0], out, METHODS) is None


def test_the_files_tell_what_was_run(study, out, tmp_path):
    cell = read_or_measure_cell(study, study.views[0], out, METHODS)
    found = draw_conclusions(study, [cell], [method.label for method in METHODS])
    text = write_study(study, found, out)
    assert "1 of 1 views were run, 1 of them with all 4 recipes. 1 views count" in " ".join(text.split())
    assert (out / "study.md").read_text() == text
    assert json.loads((out / "study.json").read_text()) == json.loads(json.dumps(found))
    rows = list(csv.DictReader((out / "cells.csv").open()))
    assert {(row["recipe"], row["method"]) for row in rows} == {
        (recipe, method.label) for recipe in (CONVERGED, *NOISE) for method in METHODS
    }
    for name in ("changes.svg", "changes.png", "noise.svg", "noise.png"):
        assert (out / name).stat().st_size > 1000
    assert "mathdefault" not in (out / "noise.svg").read_text()
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n", encoding="utf-8")
    new = replace_between_marks(page, text)
    assert new.startswith(f"before\n{BEGIN}\n")
    assert new.endswith(f"{END}\nafter\n")
    assert text in new
    assert "\nold\n" not in new
    page.write_text("no marks", encoding="utf-8")
    with pytest.raises(IcyMoonError, match="add them where the tables are to stand"):
        replace_between_marks(page, text)
