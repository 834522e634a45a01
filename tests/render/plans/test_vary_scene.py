"""The plan of a scene that varies: it makes the scene's own pairs, but for what varies."""

from __future__ import annotations

import itertools
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import settings as trials
from hypothesis import strategies as st
from icymoon.render.cost.estimate import estimate_plan, estimate_roughly
from icymoon.render.plans import vary_scene
from icymoon.render.plans.plan_file import parse_plan, read_plan
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.plans.vary_scene import (
    SceneVariations,
    VariedSetting,
    count_pairs,
    describe_variations,
    list_values,
    list_variable_settings,
    make_default_variation,
    make_end_settings,
    make_plan_text,
    sample_settings,
    why_fixed,
)
from icymoon.settings import description, preset_files
from icymoon.settings.pair_ids import make_pair_id
from icymoon.settings.table import TOPICS, list_all_settings
from icymoon.settings.topics.declaration import Parts
from icymoon.settings.topics.scene import Settings
from icymoon.support.errors import IcyMoonError

ELEVATION = VariedSetting("light.sun_elevation_deg", 5.0, 60.0, 5)
ALBEDO = VariedSetting("surface.albedo", 0.2, 0.8, 3)
SAMPLES = VariedSetting("quality.samples", 4, 16, 4)
MODEL = VariedSetting("surface.model", values=("LAMBERT", "HAPKE"))
PLANET = VariedSetting("light.planet")
NUMBERS = [
    name
    for name in list_variable_settings()
    if TOPICS[name.partition(".")[0]][name.partition(".")[2]].kind in ("int", "float")
]


def scene(*parts: Parts) -> Settings:
    """A whole scene of a preset, with changes."""
    return description.merged(
        description.defaults(),
        preset_files.load_preset("scenes/europa_rough_ice"),
        *(description.check(part, "test") for part in parts),
    )


def pairs_of(settings, variations):
    return parse_plan(Path("plan.toml"), make_plan_text(settings, variations)).pairs()


def value(settings, name):
    topic, _, key = name.partition(".")
    return settings[topic][key]


def differing(settings, other):
    return {
        f"{topic}.{s.key}"
        for topic, s in list_all_settings()
        if s.effect != "run" and settings[topic][s.key] != other[topic][s.key]
    }


def test_nothing_varied_is_the_pair_that_the_scene_makes():
    described = scene({"terrain": {"layers": [{"amplitude_m": 0.25}]}})
    assert [p.id for p in pairs_of(described, SceneVariations(()))] == [p.id for p in expand_headings(described)]


@pytest.mark.parametrize("name", preset_files.preset_names("scenes")[::5])
def test_pairs_are_the_scene_but_for_what_varies(name):
    described = description.merged(description.defaults(), preset_files.load_preset(name))
    pairs = pairs_of(described, SceneVariations((ELEVATION,)))
    assert [p.settings.light.sun_elevation_deg for p in pairs] == [5.0, 18.75, 32.5, 46.25, 60.0]
    assert all(differing(p.settings, described) <= {"light.sun_elevation_deg"} for p in pairs)


def test_the_file_on_the_disk_makes_the_same_pairs(tmp_path):
    text = make_plan_text(scene(), SceneVariations((ELEVATION, ALBEDO)))
    (tmp_path / "plan.toml").write_text(text, encoding="utf-8")
    found = [p.id for p in read_plan(tmp_path / "plan.toml").pairs()]
    assert found == [p.id for p in parse_plan(tmp_path / "plan.toml", text).pairs()]


def test_a_file_of_ones_own_is_found_from_anywhere(tmp_path):
    (tmp_path / "ground.ply").write_text("ply")
    described = scene({"source": {"kind": "MESH", "file": str(tmp_path / "ground.ply")}})
    stated = tomllib.loads(make_plan_text(described, SceneVariations((ELEVATION,))))
    assert stated["source"]["file"] == str(tmp_path / "ground.ply")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "plan.toml").write_text(make_plan_text(described, SceneVariations((ELEVATION,))))
    pairs = read_plan(tmp_path / "sub" / "plan.toml").pairs()
    assert {p.settings.source.file for p in pairs} == {str(tmp_path / "ground.ply")}


def test_a_plan_states_no_folder_and_no_matchers():
    stated = tomllib.loads(
        make_plan_text(scene({"dataset": {"folder": "/secret", "methods": "own:mine"}}), SceneVariations((ELEVATION,)))
    )
    assert set(stated["dataset"]) == {"seed", "headings"}


@pytest.mark.long
@trials(max_examples=12)  # each checks grounds
@given(
    st.lists(st.sampled_from([ELEVATION, ALBEDO, SAMPLES, MODEL, PLANET]), unique=True, max_size=3),
    st.integers(1, 3),
    st.integers(1, 3),
)
def test_a_grid_is_the_product_of_its_values(varied, seeds, headings):
    described, variations = scene({"dataset": {"headings": headings}}), SceneVariations(tuple(varied), seeds=seeds)
    pairs = pairs_of(described, variations)
    assert len({p.id for p in pairs}) == len(pairs) == count_pairs(described, variations)
    found = {
        (p.settings.dataset.seed, p.settings.rig.heading_deg, *(value(p.settings, v.name) for v in varied))
        for p in pairs
    }
    seeds_there, turns = ({each[k] for each in found} for k in (0, 1))
    assert (len(seeds_there), len(turns)) == (seeds, headings)
    assert found == set(itertools.product(seeds_there, turns, *(list_values(v) for v in varied)))
    allowed = {"dataset.seed", "rig.heading_deg", *(v.name for v in varied)}
    assert all(differing(p.settings, described) <= allowed for p in pairs)


@pytest.mark.long
def test_the_first_seed_is_the_scenes_own_and_more_seeds_keep_the_pairs():
    described = scene({"dataset": {"seed": 77}})
    few, more = ({p.id for p in pairs_of(described, SceneVariations((ELEVATION,), seeds=n))} for n in (2, 3))
    assert few < more
    assert {p.id for p in pairs_of(described, SceneVariations((ELEVATION,)))} < few
    assert pairs_of(described, SceneVariations((), seeds=2))[0].settings.dataset.seed == 77


@given(st.sampled_from(NUMBERS), st.integers(2, 9), st.sampled_from(["EVEN", "RATIO"]), st.data())
def test_values_begin_and_end_where_they_are_to_and_lie_evenly(name, count, spacing, data):
    topic, _, key = name.partition(".")
    setting = TOPICS[topic][key]
    low, high = setting.soft or (setting.minimum, setting.maximum)
    if spacing == "RATIO":
        low = max(low, high / 1e4)
    place = st.integers(int(low) + 1, int(high)) if setting.kind == "int" else st.floats(low, high)
    first = data.draw(place)
    last = data.draw(place.filter(lambda value: abs(value - first) > 1e-4 * (high - low)))
    values = list_values(VariedSetting(name, first, last, count, spacing))
    assert (values[0], values[-1]) == (first, last)
    assert all(setting.minimum <= v <= setting.maximum for v in values)
    assert values == sorted(values, reverse=first > last)
    if setting.kind == "float" and len(values) > 2:
        steps = [b / a if spacing == "RATIO" else b - a for a, b in itertools.pairwise(values)]
        size = max(steps) if spacing == "RATIO" else max(map(abs, values))
        assert max(steps) - min(steps) <= 2.1e-5 * size  # values have six digits
    if setting.kind == "int":
        assert all(isinstance(v, int) for v in values)
        assert len(values) == len(set(values)) <= count


def test_sobol_draws_are_those_of_a_plan_written_by_hand(tmp_path):
    described = scene({"dataset": {"seed": 5}})
    varied = (ELEVATION, VariedSetting("surface.grain_size_m", 0.001, 0.1, spacing="RATIO"), SAMPLES, MODEL, PLANET)
    pairs = pairs_of(described, SceneVariations(varied, "SOBOL", draws=8))
    (tmp_path / "hand.toml").write_text("""
[plan]
title = "By hand"
include = ["scenes/europa_rough_ice"]
[dataset]
seed = 5
[[sweep]]
kind = "sobol"
name = "draws"
count = 8
light.sun_elevation_deg = { uniform = [5, 60] }
surface.grain_size_m = { log_uniform = [0.001, 0.1] }
quality.samples = { uniform = [4, 16] }
surface.model = { choice = ["LAMBERT", "HAPKE"] }
light.planet = { choice = [false, true] }
""")
    assert [p.id for p in pairs] == [p.id for p in read_plan(tmp_path / "hand.toml").pairs()]
    assert all(5 <= p.settings.light.sun_elevation_deg <= 60 for p in pairs)
    assert sum(p.settings.light.planet for p in pairs) == 4


def test_random_values_are_combined_with_all_others():
    random = VariedSetting("light.sun_azimuth_deg", -90.0, 90.0, 4, "RANDOM")
    pairs = pairs_of(scene(), SceneVariations((random, ALBEDO)))
    azimuths = {p.settings.light.sun_azimuth_deg for p in pairs}
    assert len(azimuths) == 4
    assert all(-90 <= azimuth <= 90 for azimuth in azimuths)
    assert {(p.settings.light.sun_azimuth_deg, p.settings.surface.albedo) for p in pairs} == set(
        itertools.product(azimuths, [0.2, 0.5, 0.8])
    )


def test_one_at_a_time_is_the_scene_and_each_value_alone():
    described = scene({"surface": {"albedo": 0.5}})
    variations = SceneVariations((ELEVATION, ALBEDO), "ONE_AT_A_TIME")
    pairs = pairs_of(described, variations)
    assert pairs[0].id == expand_headings(described)[0].id
    changed = [differing(p.settings, described) for p in pairs]
    assert changed == [set()] + 5 * [{"light.sun_elevation_deg"}] + 2 * [{"surface.albedo"}]
    assert len(pairs) == count_pairs(described, variations)


@pytest.mark.parametrize(
    ("variations", "text"),
    [
        (SceneVariations(()), "1 pair"),
        (SceneVariations((ELEVATION,), seeds=3), "5 values of Sun Elevation x 3 seeds = 15 pairs"),
        (
            SceneVariations((VariedSetting("surface.albedo", 0.2, 0.8, 3, "RANDOM"), PLANET)),
            "3 random values of Albedo x 2 values of Planet = 6 pairs",
        ),
        (SceneVariations((ELEVATION, ALBEDO), "SOBOL", 16), "16 draws of 2 settings = 16 pairs"),
        (SceneVariations((ELEVATION,), "SOBOL", 8), "8 draws of Sun Elevation = 8 pairs"),
        (SceneVariations((ELEVATION, SAMPLES), "ONE_AT_A_TIME"), "10 scenes, one setting at a time = 10 pairs"),
    ],
)
def test_the_pairs_are_described_in_words(variations, text):
    assert describe_variations(scene(), variations) == text


def test_headings_are_described_too():
    assert describe_variations(scene({"dataset": {"headings": 4}}), SceneVariations((ELEVATION,))) == (
        "5 values of Sun Elevation x 4 headings = 20 pairs"
    )


@pytest.mark.parametrize(
    ("varied", "problem"),
    [
        (VariedSetting("light.sun_elevation_deg", 5, 95), "light.sun_elevation_deg is 95 deg, outside -90 to 90 deg"),
        (VariedSetting("light.sun_elevation_deg", 5, 5), "goes from 5 to 5; give two different ends"),
        (VariedSetting("surface.albedo", 0.0, 0.8, spacing="RATIO"), "even ratios need two ends above 0"),
        (VariedSetting("quality.samples", 2.5, 16), "must be a whole number"),
        (VariedSetting("surface.model", values=("LAMBERT",)), "has 1 of its values; tick two or more"),
        (VariedSetting("surface.model", values=("LAMBERT", "LAMBRT")), "LAMBERT"),
        (VariedSetting("light.sun_elevation", 5, 9), "sun_elevation_deg"),
        (VariedSetting("x" * 10000), "…"),
        (VariedSetting("sensor.bits", 8, 12), "needs no new render"),
        (VariedSetting("dataset.workers", 1, 2), "changes no pair"),
        (VariedSetting("dataset.seed", 1, 2), "raise Variations by Seed"),
        (VariedSetting("light.body"), "is not a number, choice or tick"),
        (VariedSetting("terrain.layers"), "is not a number, choice or tick"),
        (VariedSetting("light.sun_elevation_deg", 5, 9, 1), "has 1 value;"),
        (VariedSetting("light.sun_elevation_deg", 5, 9, 100000), "more than 100000"),
    ],
)
def test_what_cannot_vary_is_refused_in_a_sentence(varied, problem):
    with pytest.raises(IcyMoonError) as caught:
        make_plan_text(scene(), SceneVariations((varied,), seeds=2))
    assert problem in str(caught.value)
    assert str(caught.value).startswith("Vary This Scene: ")


@pytest.mark.parametrize(
    ("variations", "problem"),
    [
        (SceneVariations((ELEVATION, ELEVATION)), "listed 2 times"),
        (SceneVariations((ELEVATION,), seeds=0), "0 seeds"),
        (SceneVariations((ELEVATION,), draws=0), "0 draws"),
        (SceneVariations((VariedSetting("surface.albedo", 0.2, 0.8, 3, "RANDOM"),), "ONE_AT_A_TIME"), "is random"),
    ],
)
def test_what_cannot_be_combined_is_refused_in_a_sentence(variations, problem):
    with pytest.raises(IcyMoonError, match=problem):
        make_plan_text(scene(), variations)


def test_every_setting_varies_around_its_default_or_says_why_not():
    described = description.defaults()
    for topic, setting in list_all_settings():
        name = f"{topic}.{setting.key}"
        if why_fixed(topic, setting.key):
            assert name not in list_variable_settings()
            continue
        varied = make_default_variation(name, described[topic][setting.key])
        values = list_values(varied)
        assert len(values) > 1
        if setting.kind in ("int", "float"):
            assert min(values) <= described[topic][setting.key] <= max(values)
            low, high = setting.soft or (setting.minimum, setting.maximum)
            assert low <= min(values), name
            assert max(values) <= high, name
            assert len(values) == 5 or (setting.kind == "int" and high - low < 4), name


@pytest.mark.parametrize("value", [1, 2, 6])
def test_a_small_whole_number_has_five_values(value):
    assert len(list_values(make_default_variation("ridges.sets", value))) == 5


def test_a_value_beyond_the_slider_keeps_its_place():
    varied = make_default_variation("light.sun_temperature_k", 30000.0)
    assert varied.first <= 30000.0 <= varied.last


def test_what_changes_the_picture_can_vary_but_for_texts_and_lists():
    fixed = {
        name
        for topic, s in list_all_settings()
        if (name := f"{topic}.{s.key}") not in list_variable_settings()
        and s.effect not in ("response", "run")
        and s.kind not in ("text", "list")
    }
    assert fixed == {"dataset.seed"}


def test_a_sample_is_of_the_pairs_of_the_plan_and_of_all_where_they_are_few():
    described, variations = scene(), SceneVariations((ELEVATION, ALBEDO, MODEL), seeds=2)
    ids = {p.id for p in pairs_of(described, variations)}
    found, grounds = sample_settings(described, variations, 100)
    assert {make_pair_id(each) for each in found} == ids
    assert grounds == 2
    few, _ = sample_settings(described, variations, 10)
    assert len(few) == 10
    assert {make_pair_id(each) for each in few} < ids
    assert all(len({value(each, v.name) for each in few}) > 1 for v in variations.varied)


def test_grounds_are_counted_without_making_all_draws():
    slope = VariedSetting("terrain.rms_slope_deg", 5.0, 20.0)
    assert sample_settings(scene(), SceneVariations((slope,), "SOBOL", draws=1000), 16)[1] == 1000
    assert sample_settings(scene(), SceneVariations((slope, ELEVATION)), 16)[1] == 5
    assert sample_settings(scene(), SceneVariations((ELEVATION,), "SOBOL", draws=1000), 16)[1] == 1


def test_the_rough_estimate_is_near_the_one_that_counts_triangles():
    described, variations = scene(), SceneVariations((ELEVATION, SAMPLES))
    pairs = pairs_of(described, variations)
    some, grounds = sample_settings(described, variations, 8)
    seconds, size = estimate_roughly(some, len(pairs), grounds, None)
    exact = estimate_plan(pairs)
    assert seconds == pytest.approx(exact.left_wall_s, rel=0.3)
    assert size == pytest.approx(exact.left_bytes, rel=0.05)


def test_labels_are_without_units():
    assert vary_scene.find_label("light.sun_elevation_deg") == "Sun Elevation"
    assert vary_scene.find_label("no such.thing") == "no such.thing"


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize(
    "variations",
    [
        SceneVariations((ELEVATION, ALBEDO)),
        SceneVariations((ALBEDO, ELEVATION), seeds=3),
        SceneVariations((ELEVATION, ALBEDO, PLANET), "ONE_AT_A_TIME"),
        SceneVariations((ELEVATION, MODEL), "SOBOL", draws=7),
        SceneVariations((VariedSetting("surface.albedo", 0.2, 0.8, 6, "RANDOM"), PLANET)),
        SceneVariations((), seeds=2),
    ],
)
@pytest.mark.parametrize("headings", [1, 3])
def test_the_ends_are_the_first_and_the_last_pair_of_the_plan(variations, headings):
    described = scene({"dataset": {"headings": headings}})
    pairs = pairs_of(described, variations)
    ends = make_end_settings(described, variations)
    assert [make_pair_id(end) for end in ends] == [pairs[0].id, pairs[-1].id]
