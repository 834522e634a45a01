"""The table of reflectance at phase 0 against the laws themselves."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from icymoon.physics.lidar.backscatter import (
    AlbedoMap,
    find_clean_albedos,
    has_patches,
    tabulate_backscatter,
    tabulate_scene,
)
from icymoon.physics.surfaces.hapke import HapkeParameters, bidirectional_reflectance
from icymoon.physics.surfaces.photometry import bond_albedo, lunar_lambert
from icymoon.physics.surfaces.snow import snow_law
from icymoon.physics.surfaces.surface_law import make_law
from icymoon.settings.description import check, defaults, merged, override
from icymoon.support.labels import LANDER, ROCK, TERRAIN

SURGE = HapkeParameters(0.9, 0.3, 0.2, b_s0=0.6, h_s=0.05, b_c0=0.5, h_c=0.005, theta_bar=0.3)


@pytest.mark.parametrize(
    "law",
    [
        lunar_lambert(0.8, 0.0),
        lunar_lambert(0.8, 0.6),
        snow_law(0.95),
        partial(bidirectional_reflectance, parameters=SURGE),
    ],
    ids=["lambert", "lunar", "snow", "hapke"],
)
def test_the_table_is_the_law(law):
    angle = np.radians(np.linspace(0, 85, 997))
    assert tabulate_backscatter(law).find(np.cos(angle)) == pytest.approx(law(angle, angle, 0 * angle), rel=1e-6)
    assert np.isfinite(tabulate_backscatter(law).find(np.array([0.0, 1e-9, 1.0]))).all()


def test_the_opposition_surge_is_in_it():
    table = tabulate_backscatter(partial(bidirectional_reflectance, parameters=SURGE))
    off = bidirectional_reflectance(0.0, np.radians(30), 0.0, SURGE)
    assert table.find(np.ones(1))[0] > 1.5 * off


def test_ground_and_rocks_have_the_laws_of_their_surfaces():
    scene: dict[str, Any] = {
        "surface": {"model": "LAMBERT", "albedo": 0.8},
        "rocks": {"own_surface": True},
        "rock_surface": {"model": "LAMBERT", "albedo": 0.2},
    }
    laws = tabulate_scene(merged(defaults(), check(scene, "test")))
    head_on = np.ones(1)
    assert laws[TERRAIN].find(head_on) == pytest.approx([0.8 / np.pi])
    assert laws[ROCK].find(head_on) == pytest.approx([0.2 / np.pi])
    scene["rocks"]["own_surface"] = False
    assert tabulate_scene(merged(defaults(), check(scene, "test")))[ROCK].find(head_on) == pytest.approx([0.8 / np.pi])


def test_a_map_of_albedo_scales_the_reflectance_at_each_place():
    albedo = np.array([[0.2, 0.4, np.nan], [0.6, 0.8, 1.0]])
    patches = AlbedoMap(albedo, 2.0, -3.0, 2.0, {TERRAIN: 0.8, ROCK: 0.4})
    points = np.array(
        [[-2.9, 1.9, 5], [-0.9, 0.1, 0], [1.1, 1, 0], [2.9, -1.9, 0], [3.1, 0, 0], [0, -2.1, 0], [-2, 1, 0]]
    )
    label = np.array([TERRAIN] * 6 + [ROCK], np.uint8)
    assert patches.find_factors(points, label) == pytest.approx([0.25, 0.5, 1, 1.25, 1, 1, 0.5])
    # A lander and other objects have no albedo in the map.
    assert patches.find_factors(points, np.full(7, LANDER, np.uint8)).tolist() == [1] * 7
    black = AlbedoMap(albedo, 2.0, -3.0, 2.0, {TERRAIN: 0.0})
    assert black.find_factors(points[:2], label[:2]).tolist() == [1, 1]


@pytest.mark.parametrize(
    ("text", "patches"),
    [
        ("surface.albedo=0.5", False),
        ("surface.albedo_variation=0.1", True),
        ("surface.ice_colour=SNOW", True),
        ("surface.bubble_share=0.05", True),
        ("textures.set=CRACKS", True),
        ("rock_surface.salt_share=0.2", False),
    ],
)
def test_patches_are_known_from_the_settings(text, patches):
    assert has_patches(merged(defaults(), override(text))) == patches


def test_a_clean_albedo_is_the_laws_own():
    settings = merged(defaults(), override("surface.model=LAMBERT"), override("surface.albedo=0.6"))
    law = make_law(settings.surface, settings.hapke)
    assert law is not None
    assert find_clean_albedos(settings)[TERRAIN] == pytest.approx(bond_albedo(law), rel=1e-3)
