"""The data sets that the paper's tables and figures are made from."""

from __future__ import annotations

import pytest
from icymoon.render.plans.plan_file import find_plan, read_plan
from icymoon.stereo.paper import paper_datasets
from icymoon.stereo.paper.paper_datasets import SETS, _make_part, make_parts


def test_at_full_size_they_are_the_pairs_of_the_shipped_plan():
    """So that a data set that was rendered by the plan goes on."""
    made = _make_part("albedo", "guiss_albedo", ("albedo",), 1.0, {}, None)
    assert {pair.id for pair in made.pairs} == {pair.id for pair in read_plan(find_plan("guiss_albedo")).pairs()}


def test_a_smaller_image_shows_the_same_view_in_the_same_light():
    """A pixel of half the width and height sees four times the ground, and fills in a quarter of the time."""
    full, half = (_make_part("albedo", "guiss_albedo", ("albedo",), scale, {}, None).pairs[0] for scale in (1.0, 0.5))
    rig, small = full.settings.rig, half.settings.rig
    assert (small.width_px, small.height_px) == (rig.width_px / 2, rig.height_px / 2)
    assert (small.focal_length_mm, small.sensor_width_mm) == (rig.focal_length_mm, rig.sensor_width_mm)
    assert half.settings.sensor.exposure_s == pytest.approx(full.settings.sensor.exposure_s / 4, rel=1e-6)


def test_settings_and_files_of_the_user_are_over_those_of_the_plan(tmp_path):
    made = _make_part("albedo", "guiss_albedo", ("albedo",), 0.5, {"quality": {"bake_samples": 16}}, tmp_path)
    assert {pair.settings.quality.bake_samples for pair in made.pairs} == {16}
    assert f'files = "{tmp_path}"' in made.text


@pytest.mark.long
def test_the_sets_are_the_papers_and_a_part_keeps_their_shares(monkeypatch):
    monkeypatch.setattr(paper_datasets, "_CHECKED_GROUNDS", 1)
    data = make_parts(502, 1.0, {})["data"]
    assert tuple(data.sets) == SETS
    assert {name: len(pairs) for name, pairs in data.sets.items()} == {
        "reconstructions": 306,
        "textures": 17,
        "landforms": 34,
        "generative": 72,
        "terrains": 13,
        "rocks": 32,
        "snow": 29,
    }
    assert len({pair.id for pair in data.pairs}) == 503
    assert {pair.settings.source.kind for pair in data.sets["reconstructions"]} == {"STAND_IN"}
    assert {pair.settings.source.kind for name in SETS[1:] for pair in data.sets[name]} == {"PROCEDURAL"}
    glossy = make_parts(7, 1.0, {}, glossy=True)["data"]
    assert {pair.settings.surface.model for pair in glossy.pairs} == {"PRINCIPLED"}
    assert {len(pairs) for name, pairs in glossy.sets.items() if name != "reconstructions"} == {1}
