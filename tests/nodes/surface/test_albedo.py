"""Albedo means albedo: what a white furnace measures on the built materials is what the setting says."""

from __future__ import annotations

from typing import Any

import pytest
from icymoon.benchmarks.light.furnace import albedo as furnace
from icymoon.nodes.surface.ice_material import build_material
from icymoon.physics.surfaces.principled import real_albedo
from icymoon.settings.description import check, defaults, merged
from icymoon.settings.preset_files import load_preset
from icymoon.settings.topics.surfaces import SurfaceSettings
from icymoon.support.arrays import Array
from icymoon.support.labels import TERRAIN


def measured(settings, **view) -> Array:
    return furnace(lambda: build_material("Test", settings, 1, TERRAIN), **view)


def surface(**changes: Any) -> SurfaceSettings:
    return defaults().surface | {"grain_amplitude_m": 0.0} | check({"surface": changes}, "test").surface


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize(
    "changes",
    [
        {"albedo": 0.2, "specular": 0.0},
        {"albedo": 1.0, "specular": 0.0},
        {"albedo": 0.0, "specular": 0.0},
        {"albedo": 0.2, "specular": 1.0, "roughness": 0.1},
        {"albedo": 0.6, "specular": 0.5, "roughness": 0.4},
        *(pytest.param({"albedo": albedo, "subsurface_weight": 1.0}, marks=pytest.mark.heavy) for albedo in (0.9, 1.0)),
        {"albedo": 0.4, "subsurface_weight": 0.5, "roughness": 0.2},
        {"albedo": 0.8, "transmission": 0.5},
        {"albedo": 0.8, "subsurface_weight": 1.0, "subsurface_method": "BURLEY"},
        {"albedo": 0.5, "refractive_index": 2.2, "specular": 0.9, "roughness": 0.6},
        {"albedo": 0.7, "grain_size_m": 0.02, "grain_amplitude_m": 0.006},
        {
            "albedo": 1.0,
            "grain_size_m": 0.02,
            "grain_amplitude_m": 0.006,
            "transmission": 0.2,
            "subsurface_weight": 0.5,
        },
    ],
    ids=str,
)
def test_a_white_furnace_measures_the_albedo(changes):
    settings = surface(**changes)
    # One per cent is what is promised; sampling noise of 64 samples on 256 pixels is far below. Light goes further
    # under the surface than a quarter of a pixel, or Blender 4.2 would take it for plain diffuse reflection.
    settings["subsurface_radius_m"] = 0.05
    assert measured(settings, view_m=1.0) == pytest.approx(real_albedo(settings), rel=0.01, abs=1e-4)


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("subsurface", [0.0, 0.5, 1.0])
def test_bumps_as_high_as_they_are_wide_lose_the_light_that_is_reckoned_with(subsurface):
    settings = surface(
        albedo=1.0,
        grain_size_m=0.02,
        grain_amplitude_m=0.02,
        transmission=0.2,
        subsurface_weight=subsurface,
        subsurface_radius_m=0.05,
    )
    assert measured(settings, view_m=1.0) == pytest.approx(real_albedo(settings), rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize("name", ["fresh_snow", "rough_ice"])
def test_presets_have_their_albedo(name):
    settings = merged(defaults(), load_preset(f"surfaces/{name}")).surface
    settings.albedo_variation = 0.0
    assert real_albedo(settings) == pytest.approx(settings.albedo, rel=0.01)
    # Patches of grain are up to 0.8 m wide: one metre of them is steeper or smoother than they are on average.
    assert measured(settings, view_m=4.0) == pytest.approx(settings.albedo, rel=0.01)


def test_patches_darken_by_half_their_depth_on_average():
    plain, patchy = (
        measured(surface(albedo=0.8, albedo_variation=v, albedo_patch_m=0.2), view_m=20.0) for v in (0.0, 0.5)
    )
    # The noise has a mean of 0.5; a hundred patches across leave a per cent or two to chance.
    assert patchy == pytest.approx(0.75 * plain, rel=0.03)


@pytest.mark.parametrize("share", [0.0, 0.25, 0.6, 1.0])
def test_salt_stains_its_share_of_the_ground(share):
    red, green, blue = measured(
        surface(
            albedo=0.8, specular=0.0, salt_share=share, salt_patch_m=0.2, salt_red=1.0, salt_green=0.5, salt_blue=0.0
        ),
        view_m=20.0,
    )
    assert red == pytest.approx(0.8, rel=0.01)
    assert 1.0 - blue / red == pytest.approx(share, abs=0.05)  # the edges of stains and chance
    assert 1.0 - green / red == pytest.approx((1.0 - blue / red) / 2, abs=0.01)


def test_dirt_on_slopes_leaves_level_ground_clean():
    assert measured(surface(albedo=0.8, slope_dirt=0.5)) == pytest.approx(0.8, rel=0.01)
    assert measured(surface(albedo=0.8, slope_dirt=-0.5)) == pytest.approx(0.4, rel=0.02)


@pytest.mark.long
def test_a_curve_serves_patches_on_snow_with_light_under_its_surface():
    settings = surface(albedo=0.9, subsurface_weight=1.0, albedo_variation=1e-6)
    # So little variation that only the way through the curve is left.
    assert measured(settings) == pytest.approx(0.9, rel=0.01)
