"""The plans of the paper's grids of images."""

from __future__ import annotations

from collections import Counter

import pytest
from icymoon.render.plans.combine import combine
from icymoon.render.plans.plan_file import find_plan, read_plan
from icymoon.stereo.paper.paper_datasets import FIGURES


@pytest.fixture(scope="module")
def figures():
    designs = read_plan(find_plan("guiss_figures")).designs
    return {name: combine(design, 1).pairs for name, design in zip(FIGURES, designs, strict=True)}


def test_every_figure_has_its_factors(figures):
    def values(name, *settings):
        return Counter(
            tuple(pair.settings[topic][key] for topic, key in (each.split(".") for each in settings))
            for pair in figures[name]
        )

    assert {name: len(pairs) for name, pairs in figures.items()} == {
        "ruggedness": 11,
        "subsurface": 9,
        "texture": 18,
        "suns": 10,
        "rocks": 4,
    }
    assert len(values("subsurface", "surface.subsurface_weight", "surface.transmission")) == 9
    assert len(values("texture", "surface.albedo", "surface.specular", "surface.albedo_variation")) == 18
    assert sorted(values("suns", "light.sun_elevation_deg", "light.sun_azimuth_deg").values()) == [2] * 5
    assert len(values("rocks", "rocks.coverage", "rocks.largest_m")) == 4


def test_what_a_figure_shows_is_neither_baked_nor_hidden_by_lamberts_law(figures):
    assert {pair.settings.quality.indirect for pairs in figures.values() for pair in pairs} == {"TRACED"}
    for name in ("subsurface", "texture"):
        assert {pair.settings.surface.model for pair in figures[name]} == {"PRINCIPLED"}


def test_a_figure_has_one_view_of_one_ground(figures):
    for name in ("subsurface", "texture", "rocks"):
        assert len({(pair.settings.dataset.seed, pair.settings.rig.heading_deg) for pair in figures[name]}) == 1
