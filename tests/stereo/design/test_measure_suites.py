"""The rows of suites on grounds by rays: alike but for a name, under several Suns, and the keys of rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.design import measure_suites as study_of
from icymoon.stereo.design.lamps import light_night
from icymoon.stereo.design.measure_suites import LANDFORM, OWN, ROW_SHAPE, Study, draw_grounds, draw_sun, measure_suites
from icymoon.stereo.design.read_design import find_design, read_design
from icymoon.stereo.learning.grounds import HELD_OUT_LANDFORMS
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.report.row_log import RowLog
from icymoon.support.errors import IcyMoonError

DESIGN = read_design(find_design("suites"))
BASE = next(suite for suite in DESIGN.suites if suite.name == "bm")
LAMP = next(suite.lamp for suite in DESIGN.suites if suite.lamp)


def make_study(*suites, basis=("1",)):
    return Study(replace(DESIGN, suites=suites), read_rules(), basis)


def test_all_suites_see_the_same_grounds_and_other_ones_on_landforms():
    recipes = draw_grounds(DESIGN, 3, 4, 3)
    assert [recipe.split for recipe in recipes] == [OWN] * 4 + [LANDFORM] * 3
    assert {recipe.terrain for recipe in recipes[:4]} <= set(DESIGN.variety.terrains)
    assert {recipe.terrain for recipe in recipes[4:]} <= set(HELD_OUT_LANDFORMS)
    more = draw_grounds(DESIGN, 3, 6, 3)
    assert [recipe.number for recipe in more[:4]] == [recipe.number for recipe in recipes[:4]]


def test_another_sun_differs_in_its_direction_alone():
    (recipe,) = draw_grounds(DESIGN, 0, 1, 0)
    first, second, third = (draw_sun(recipe, sun, DESIGN.variety) for sun in range(3))
    assert not np.allclose(first.sun, second.sun)
    assert not np.allclose(second.sun, third.sun)
    assert all(np.array_equal(value, vars(second)[name]) for name, value in vars(first).items() if name != "sun")
    heights = [np.degrees(np.arcsin(each.sun[2])) for each in (first, second, third)]
    assert min(heights) >= 16 - 1e-9
    assert max(heights) <= 65 + 1e-9


def test_a_key_states_all_but_the_name():
    study = make_study(BASE)
    key = study.make_key(BASE)
    assert study.make_key(replace(BASE, name="other")) == key
    others = [
        study.make_key(replace(BASE, suns=2)),
        study.make_key(replace(BASE, lamp=LAMP)),
        study.make_key(replace(BASE, lamp=replace(LAMP, power_w=1.0))),
        study.make_key(replace(BASE, lamp=replace(LAMP, place=replace(LAMP.place, up_m=1.0)))),
        study.make_key(replace(BASE, method=parse_methods("bm:window=21")[0])),
        study.make_key(replace(BASE, method=parse_methods("bm+lidar:points=50")[0])),
        study.make_key(replace(BASE, settings=DESIGN.suites[1].settings)),
        make_study(BASE, basis=("2",)).make_key(BASE),
        replace(study, design=replace(study.design, rays_per_pixel=3)).make_key(BASE),
        replace(study, rules=replace(study.rules, site=replace(study.rules.site, slope_deg=1.0))).make_key(BASE),
    ]
    assert len({key, *others}) == 11
    dearer = replace(study.design, costs=replace(study.design.costs, camera_w=9.0), abstain_loss=0.5)
    assert replace(study, design=dearer).make_key(BASE) == key  # costs are no part of a row
    assert replace(study, design=replace(study.design, lamp=None)).make_key(BASE) == key  # nor is a lamp it has not


@pytest.mark.left_to_ci
def test_suites_alike_but_for_the_name_have_equal_numbers_and_a_second_start_keeps_rows(tmp_path):
    twin, suns = replace(BASE, name="twin"), replace(BASE, name="suns", suns=2)
    study, recipes = make_study(BASE, suns, twin), draw_grounds(DESIGN, 0, 1, 0)
    events = []
    rows = measure_suites(study, recipes, RowLog(tmp_path / "rows.jsonl", ROW_SHAPE), events.append)
    assert [row["status"] for row in rows] == ["ok"] * 3
    assert rows[0] | {"method": "twin"} == rows[2]
    assert rows[0]["numbers"]["cells"] != rows[1]["numbers"]["cells"]
    assert (rows[0]["numbers"]["frames"], rows[1]["numbers"]["frames"]) == (1, 2)
    assert all(row["numbers"]["cpu_s"] > 0 for row in rows)
    assert [event["done"] for event in events] == [1, 2, 3]
    assert measure_suites(study, recipes, RowLog(tmp_path / "rows.jsonl", ROW_SHAPE), events.append) == rows
    alone = measure_suites(make_study(suns), recipes, RowLog(tmp_path / "alone.jsonl", ROW_SHAPE), events.append)
    for key in ("unsafe_choice", "cells", "exposure_s"):  # other suites change nothing
        assert alone[0]["numbers"][key] == rows[1]["numbers"][key]


@pytest.mark.left_to_ci
def test_a_lamp_adds_a_pair_whose_exposure_follows_its_power(tmp_path):
    lit = replace(BASE, name="lit", lamp=LAMP)
    weak = replace(BASE, name="weak", lamp=replace(LAMP, power_w=LAMP.power_w / 10))
    study, recipes = make_study(BASE, lit, weak), draw_grounds(DESIGN, 0, 1, 0)
    rows = measure_suites(study, recipes, RowLog(tmp_path / "rows.jsonl", ROW_SHAPE), lambda event: None)
    assert [row["status"] for row in rows] == ["ok"] * 3
    base, lit_row, weak_row = (row["numbers"] for row in rows)
    assert "lamp_s" not in base
    assert (base["frames"], lit_row["frames"]) == (1, 2)
    for numbers in (lit_row, weak_row):  # the Sun's exposure is the same, and the lamp's comes on top of it
        assert numbers["exposure_s"] == pytest.approx(base["exposure_s"] + numbers["lamp_s"], rel=1e-12)
    # A tenth of the light takes ten times as long, but for the rounding of exposures.
    assert weak_row["lamp_s"] / lit_row["lamp_s"] == pytest.approx(10, rel=0.01)
    assert lit_row["cells"] != base["cells"]
    alone = measure_suites(make_study(lit), recipes, RowLog(tmp_path / "a.jsonl", ROW_SHAPE), lambda event: None)
    for key in ("unsafe_choice", "cells", "lamp_s"):  # same seed, same numbers; other suites change nothing
        assert alone[0]["numbers"][key] == lit_row[key]


def test_a_lamp_in_a_rock_is_one_sentence():
    (recipe,) = draw_grounds(DESIGN, 0, 1, 0)
    ground, settings = study_of.build_ground(recipe), BASE.settings
    try:
        day = draw_sun(recipe, 0, DESIGN.variety)
        night = light_night(LAMP, ground, day, settings)
        assert (night.irradiance_wm2, night.sky) == (0.0, 0.0)
        # 20 W, of which 0.3 are light, alike in all directions. The Sun's irradiance counts all wavelengths, of which
        # 36.6 % are from 400 to 700 nm, and so does the lamp's.
        assert night.lamp.intensity_w_sr == pytest.approx(20 * 0.3 / (4 * np.pi) / 0.366, rel=0.01)
        buried = replace(LAMP, place=replace(LAMP.place, up_m=-2.5))
        with pytest.raises(IcyMoonError, match=r"m inside the ground or a rock.*raise lamp.up_m or rig.height_m\.$"):
            light_night(buried, ground, day, settings)
    finally:
        study_of.release_ground(ground)


def test_a_suite_that_fails_has_a_row_and_stops_no_other(tmp_path, monkeypatch):
    monkeypatch.setattr(study_of, "build_ground", lambda recipe: None)
    monkeypatch.setattr(study_of, "release_ground", lambda ground: None)

    def measure(self, suite):
        if suite.name == "twin":
            raise ValueError("no camera")

    monkeypatch.setattr(study_of._OpenGround, "measure", measure)
    twin = replace(BASE, name="twin", suns=2)
    log, events = RowLog(tmp_path / "rows.jsonl", ROW_SHAPE), []
    rows = measure_suites(make_study(twin, BASE), draw_grounds(DESIGN, 0, 1, 0), log, events.append)
    assert [(row["method"], row["status"]) for row in rows] == [("twin", "failed"), ("bm", "ok")]
    assert "no camera" in rows[0]["error"]
    assert events[0]["type"] == "error"
