"""Ice, salt and dirt of a material mix by area, in the colours of their spectra."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from icymoon.benchmarks.light.furnace import albedo as furnace
from icymoon.nodes.surface.ice_material import build_material
from icymoon.physics.light.bands import bubbly_ice_bands, material_bands, snow_bands
from icymoon.physics.light.ground_colours import clean_albedo, ice_tint
from icymoon.physics.surfaces.spectra import MATERIALS
from icymoon.settings.description import check, defaults, merged
from icymoon.settings.topics.surfaces import SurfaceSettings
from icymoon.support.arrays import Array
from icymoon.support.labels import ROCK, TERRAIN


def surface(**changes: Any) -> SurfaceSettings:
    plain = {"grain_amplitude_m": 0.0, "specular": 0.0, "albedo": 0.8}
    return defaults().surface | check({"surface": plain | changes}, "test").surface


def measured(settings: SurfaceSettings, semantic: int = TERRAIN) -> Array:
    """R, G, B that level ground reflects in a white furnace; a wider view would see past the plane."""
    return np.asarray(furnace(lambda: build_material("Test", settings, 1, semantic), view_m=1.0))


@pytest.mark.parametrize("model", ["PRINCIPLED", "LAMBERT"])
@pytest.mark.parametrize("cover", [1.0, 0.4])
def test_dirt_covers_its_share_of_the_area(model, cover):
    # Negative dirt on slopes covers level ground.
    dirty = surface(model=model, dirt="EUROPA_DARK", slope_dirt=-cover)
    expected = cover * np.array(material_bands("EUROPA_DARK")) + (1 - cover) * 0.8
    assert measured(dirty) == pytest.approx(expected, rel=0.015)


@pytest.mark.parametrize("share", [0.0, 0.15, 0.5, 0.85, 1.0])
def test_patches_of_dirt_take_up_its_share(share):
    patchy = surface(model="LAMBERT", dirt="EUROPA_DARK", slope_dirt=-share, dirt_patch_m=0.05)
    found = (0.8 - measured(patchy)[2]) / (0.8 - material_bands("EUROPA_DARK")[2])
    # 20 x 20 patches in the view: 0.02 by chance, and noise is not quite Gaussian.
    assert found == pytest.approx(share, abs=0.03 if 0 < share < 1 else 0.01)


def test_black_dirt_reflects_nothing():
    assert measured(surface(slope_dirt=-0.4)) == pytest.approx([0.48] * 3, rel=0.01)


def test_snow_has_its_albedo_and_the_colour_of_its_grains():
    bands = np.array(snow_bands(1e-3))
    found = measured(surface(ice_colour="SNOW", snow_grain_m=1e-3))
    assert found.mean() == pytest.approx(0.8, rel=0.01)
    assert found / found.mean() == pytest.approx(bands / bands.mean(), rel=0.005)


def test_no_band_of_bright_ice_reflects_more_than_all_light():
    for albedo in (0.0, 0.5, 0.98, 1.0):
        assert max(ice_tint(surface(ice_colour="EUROPA_PLAINS"), max(albedo, 1e-3))) * albedo <= 1.0


def test_salt_of_a_material_replaces_the_ice_and_dirt_lies_on_it():
    white = measured(surface(salt_share=1.0, salt_patch_m=0.2, salt="IRRADIATED_SALT", ice_colour="EUROPA_PLAINS"))
    assert white == pytest.approx(material_bands("IRRADIATED_SALT"), rel=0.02)
    both = measured(
        surface(salt_share=1.0, salt_patch_m=0.2, salt="IRRADIATED_SALT", slope_dirt=-0.5, dirt="EUROPA_DARK")
    )
    expected = (np.array(material_bands("IRRADIATED_SALT")) + material_bands("EUROPA_DARK")) / 2
    assert both == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("band_m", [0.0, 0.2])
def test_salt_and_dirt_on_bubbly_ice_keep_their_own_colour(band_m):
    blue = {"bubble_share": 0.001, "bubble_band_m": band_m}
    salty = measured(surface(**blue, salt_share=1.0, salt_patch_m=0.2, salt="SULPHUR"))
    assert salty == pytest.approx(material_bands("SULPHUR"), rel=0.02)
    dirty = measured(surface(**blue, slope_dirt=-1.0, dirt="EUROPA_DARK"))
    assert dirty == pytest.approx(material_bands("EUROPA_DARK"), rel=0.02)


def test_salt_of_own_colour_is_a_factor_on_bubbly_ice():
    blue = {"bubble_share": 0.01}
    salty = measured(
        surface(**blue, salt_share=1.0, salt_patch_m=0.2, salt="OWN", salt_red=0.9, salt_green=0.8, salt_blue=0.5)
    )
    assert salty == pytest.approx(np.array(bubbly_ice_bands(5e-4, 0.01)) * [0.9, 0.8, 0.5], rel=0.02)


def test_rocks_have_no_troughs():
    assert measured(surface(trough_dirt=1.0, dirt="EUROPA_DARK"), ROCK) == pytest.approx([0.8] * 3, rel=0.01)


def test_what_is_not_asked_for_gets_no_nodes():
    names = {node.name for node in build_material("Test", surface(), 1, TERRAIN).node_tree.nodes}
    assert names.isdisjoint({"Ice Colour", "Salt Colour", "Dirt Colour", "Clean Share"})


def test_colours_of_hapke_s_law_are_over_what_it_reflects_of_even_light():
    hapke = surface(model="HAPKE")
    settings = merged(defaults(), {"surface": {"model": "HAPKE"}, "hapke": {"w": 0.6}})
    bright = merged(settings, {"hapke": {"w": 0.95}})
    assert clean_albedo(hapke, settings.hapke) < 0.4 < clean_albedo(hapke, bright.hapke) < 0.95
    assert clean_albedo(hapke, None) == pytest.approx(0.8)


@pytest.mark.parametrize("key", ["ice_colour", "dirt", "salt"])
def test_materials_of_the_settings_have_spectra(key):
    names = {choice[0] for choice in SurfaceSettings.topic[key].choices} - {"GREY", "SNOW", "BLACK", "OWN"}
    assert names <= set(MATERIALS)
