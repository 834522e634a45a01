"""Layers of ice: off they cost nothing; on, each has the albedo that was asked for, and clear ice absorbs by length."""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np
import pytest
from icymoon.benchmarks import furnace
from icymoon.nodes.surface.fractures import VEIL_ALBEDO
from icymoon.nodes.surface.ice_material import build_material
from icymoon.physics.light.bands import bubbly_ice_bands, clear_ice_absorption_1_m
from icymoon.settings.description import check, defaults
from icymoon.settings.topics.surfaces import SurfaceSettings
from icymoon.support.arrays import Array
from icymoon.support.labels import ROCK, TERRAIN
from rendering import empty_scene

CLEAR = {"transmission": 1.0, "transmitted": "THROUGH", "roughness": 0.05}
#: Views that see many patches are of a plane whose ends take 1 % of the light at grazing angles.
WIDE_M, LOST_AT_ENDS = 10.0, 0.01


def surface(**changes: Any) -> SurfaceSettings:
    return defaults().surface | {"grain_amplitude_m": 0.0} | check({"surface": changes}, "test").surface


def measured(settings: SurfaceSettings, semantic: int = TERRAIN, view_m: float = 1.0) -> Array:
    return furnace.albedo(lambda: build_material("Test", settings, 1, semantic), view_m=view_m, samples=32)


def names(semantic: int = TERRAIN, **changes: Any) -> set[str]:
    empty_scene()
    return set(build_material("Test", surface(**changes), 1, semantic).node_tree.nodes.keys())


def test_what_is_off_adds_no_nodes():
    off: dict[str, Any] = {"crust_share": 0.0, "frost_share": 0.0, "bubble_share": 0.0, "fracture_share": 0.0}
    assert names(**off) == {"Geometry", "Snow", "Surface", "Geometric Normal"}
    assert names(fracture_share=0.5) == names(fracture_share=0.0), "nobody sees into opaque ice"
    assert names(model="LAMBERT", crust_share=0.5, frost_share=0.5, bubble_share=0.01) == names(model="LAMBERT")


def test_faces_of_rocks_differ_in_brightness_and_roughness_and_ground_has_none():
    assert names(face_variation=0.3) == names(face_variation=0.0)
    added = names(ROCK, face_variation=0.3) - names(ROCK, face_variation=0.0)
    assert {"Face", "Rock", "Brightness of Faces"} <= added
    # Without the attribute of a shape all is one face: darker by up to the variation, by the same chance everywhere.
    made = measured(surface(albedo=0.8, face_variation=0.3), ROCK)
    assert 0.8 * 0.7 * 0.99 < made.mean() < 0.8 * 1.01


@pytest.mark.parametrize(("radius_m", "share"), [(5e-4, 0.05), (5e-4, 0.001), (1e-3, 0.01)])
def test_bubbles_give_the_albedo_of_their_closed_form(radius_m, share):
    made = measured(surface(bubble_radius_m=radius_m, bubble_share=share, albedo=0.1))
    assert made == pytest.approx(bubbly_ice_bands(radius_m, share), rel=0.01, abs=0.002)  # sampling noise


def test_bubbles_in_bands_stay_between_the_whitest_and_the_bluest():
    even, banded = (measured(surface(bubble_share=0.01, bubble_band_m=band), view_m=WIDE_M) for band in (0.0, 0.2))
    bluest, whitest = (np.array(bubbly_ice_bands(5e-4, share)) for share in (0.0025, 0.04))
    assert (bluest < banded).all()
    assert (banded < whitest).all()
    # As far up as down in the logarithm of the share: the mean moves little.
    assert banded == pytest.approx(even, rel=0.05)


def test_fractures_brighten_clear_ice_by_less_than_a_veil_and_the_more_the_more_are_open():
    blue = {"bubble_share": 0.001, "bubble_radius_m": 1e-3, "fracture_spacing_m": 0.1}
    none, few, many = (measured(surface(**blue, fracture_share=share), view_m=WIDE_M) for share in (0.0, 0.3, 0.8))
    assert (none < few).all()
    assert (few < many).all()
    assert (many < VEIL_ALBEDO).all()
    # One sees 1.3 m far, so nearly all of what is open shows; three sets, each 0.3 open, leave 0.7^3 free.
    veiled = ((few - none) / (VEIL_ALBEDO - none)).mean()
    assert 0.3 * (1 - 0.7**3) < veiled < 1 - 0.7**3


def test_frost_covers_its_share_of_level_ground():
    dark = {"albedo": 0.4, "specular": 0.0, "frost_albedo": 0.9, "frost_patch_m": 0.1}
    assert measured(surface(**dark, frost_share=1.0)) == pytest.approx(0.9, rel=0.01)
    for raggedness in (0.0, 0.5):
        half = measured(surface(**dark, frost_share=0.5, patch_raggedness=raggedness), view_m=WIDE_M)
        assert half == pytest.approx(0.65, rel=0.05)  # the noise is nearly a normal distribution


def test_steep_faces_have_no_frost():
    settings = surface(albedo=0.4, specular=0.0, frost_share=1.0, frost_albedo=0.9)
    scene = _shining_scene()
    furnace.plane(scene, "Slope", 0.0, 100.0, build_material("Test", settings, 1, TERRAIN))
    for tilt_deg, albedo in ((0.0, 0.9), (65.0, 0.4)):
        scene.objects["Slope"].rotation_euler = (0.0, math.radians(tilt_deg), 0.0)
        seen = furnace.radiance(scene, math.radians(tilt_deg), 1.0, 16).mean()
        assert seen == pytest.approx(albedo, rel=0.01)


def test_a_crust_of_any_share_has_the_albedo_of_the_snow():
    settings = {"albedo": 0.8, "crust_patch_m": 0.2, "crust_height_m": 0.0}
    for share in (0.4, 1.0):
        made = measured(surface(**settings, crust_share=share), view_m=WIDE_M)
        assert made == pytest.approx(0.8 * (1 - LOST_AT_ENDS), rel=0.01)
    # Its steps lose a little of the light, as bumps do.
    assert measured(surface(**settings | {"crust_height_m": 0.006}, crust_share=0.4), view_m=WIDE_M) == pytest.approx(
        0.79, rel=0.02
    )


def _shining_scene() -> bpy.types.Scene:
    scene = empty_scene()
    scene.render.engine, scene.cycles.samples = "CYCLES", 64
    scene.world = furnace.shining()
    return scene


def _through_a_cube(size_m: float, settings: SurfaceSettings, on_white: bool) -> Array:
    """Radiance (3,) of a cube of clear ice in a sky of radiance 1, seen from above, on white ground or in the air."""
    scene = _shining_scene()
    bpy.ops.mesh.primitive_cube_add(size=size_m)
    bpy.context.object.data.materials.append(build_material("Test", settings, 1, ROCK))
    if on_white:
        white = furnace.principled(Base_Color=(1, 1, 1, 1), Specular_IOR_Level=0.0)
        furnace.plane(scene, "Ground", -0.501 * size_m, 1000.0, white)
    return furnace.radiance(scene, 0.0, 0.5 * size_m, 16).mean(axis=(0, 1))


@pytest.mark.parametrize("size_m", [0.5, 5.0])
def test_clear_ice_absorbs_by_the_length_of_the_path(size_m):
    # Of the light that is reflected inside, 2 % at each face, some takes a longer way.
    beer = np.exp(-size_m * np.array(clear_ice_absorption_1_m()))
    assert _through_a_cube(size_m, surface(**CLEAR), on_white=False) == pytest.approx(beer, abs=0.015)


def test_clear_ice_on_white_ground_keeps_the_light():
    """Nothing is lost at its faces, and what is lost inside is least in the blue."""
    red, green, blue = _through_a_cube(0.5, surface(**CLEAR), on_white=True)
    assert blue == pytest.approx(1.0, abs=0.01)
    assert red < green < blue


def test_the_albedo_of_rocks_that_let_light_through_is_that_of_the_rest():
    opaque = surface(albedo=0.6, transmission=0.0, transmitted="THROUGH")
    assert names(ROCK, transmission=0.5, transmitted="THROUGH") > names(ROCK, transmission=0.5)
    assert "Clear Ice" not in names(TERRAIN, transmission=0.5, transmitted="THROUGH")
    assert measured(opaque, ROCK) == pytest.approx(0.6, rel=0.01)
