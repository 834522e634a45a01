"""The shipped studies, and what a study's file may not state."""

from __future__ import annotations

import math

import pytest
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.study.design import find_study, list_study_names, read_study
from icymoon.support.errors import IcyMoonError

SHIPPED = "recipes"


@pytest.mark.parametrize("name", list_study_names())
def test_shipped_studies_are_whole(name):
    study = read_study(find_study(name))
    ids = [pair.id for view in study.views for pair in study.pairs_of(view).values()]
    assert len(set(ids)) == len(ids) == len(study.views) * len(study.recipes)
    assert sum(map(len, study.rounds())) == len(study.views)
    assert len(parse_methods(study.methods)) == 4
    compared = set(study.comparisons)
    assert {(each.of, each.against) for each in study.hypotheses} <= compared


def test_the_study_of_recipes_has_the_breadth_that_it_claims():
    study = read_study(find_study(SHIPPED))
    suns = [float(view.settings.light.sun_elevation_deg) for view in study.views]
    assert len({view.ground for view in study.views}) >= 10
    assert min(suns) <= 3
    assert max(suns) >= 40
    first, second = study.rounds()
    assert {view.ground for view in second} <= {view.ground for view in first}


def test_recipes_change_what_they_name_and_halves_differ_by_their_light_paths_alone():
    study = read_study(find_study(SHIPPED))
    pairs = study.pairs_of(study.views[0])
    one, other = (pairs[name] for name in study.reference)
    assert one.render_seed != other.render_seed
    assert one.settings | {"quality": None} == other.settings | {"quality": None}
    assert pairs["paper"].settings.surface.subsurface_weight == 1
    assert pairs["gloss"].settings.surface | {"subsurface_weight": 1.0} == pairs["paper"].settings.surface
    assert pairs["matt"].settings.quality == pairs["gloss"].settings.quality == pairs["paper"].settings.quality
    assert [pairs[name].settings.surface.model for name in ("matt", "cheap", "standard")] == ["LAMBERT"] * 3
    for name, samples in (("baked_16", 16), ("baked_64", 64), ("baked_128", 128), ("baked_256", 256)):
        quality = pairs[name].settings.quality
        assert (quality.indirect, quality.bake_area, quality.bake_samples) == ("BAKED", "VIEW", samples)


def test_a_hypothesis_is_a_range():
    found = {each.says: each for each in read_study(find_study(SHIPPED)).hypotheses}
    more = found["The cheap recipe has more error than converged light: StereoBM"]
    alike = found["Light baked with 256 samples is within 2 points of converged light: JPLV"]
    less = found["Light baked with 16 samples flatters JPLV"]
    assert (more.low, more.high) == (2, math.inf)
    assert (alike.low, alike.high) == (-2, 2)
    assert (less.low, less.high) == (-math.inf, 0)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('of = "cheap"', 'of = "cheep"', "there is no recipe 'cheep', did you mean 'cheap'?"),
        ('reference = ["half_a", "half_b"]', 'reference = ["half_a"]', "a study has two halves of its reference"),
        ('name = "half_b"', 'name = "half_a"', "recipes of different names"),
        ("above = 2.0", "abov = 2.0", "states 0 ranges"),
        ("above = 2.0", "above = 2.0\nbelow = 3.0", "states 2 ranges"),
        ("mesh.edge_px = 12.0", "mesh.edge = 12.0", "mesh.edge"),
        ("reference_noise = 0.03", "", "study.reference_noise is missing"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, old, new, problem):
    text = find_study(SHIPPED).read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "own.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(IcyMoonError) as raised:
        read_study(path)
    assert problem in str(raised.value)
    assert str(path) in str(raised.value)


def test_an_unknown_study_is_one_sentence():
    with pytest.raises(IcyMoonError, match="There is no study 'recipe', did you mean 'recipes'"):
        find_study("recipe")
