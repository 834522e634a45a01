"""Light that enters snow and leaves it elsewhere, at the edge of a shadow."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
from icymoon.benchmarks.light import furnace
from icymoon.nodes.surface.ice_material import build_material
from icymoon.settings.description import defaults, merged
from icymoon.support.labels import TERRAIN
from mathutils import Vector
from rendering import empty_scene

#: Mean free path, and width of the view across the edge of the shadow, metres.
PATH_M, VIEW_M = 5e-3, 0.04


def across(**surface: float | str):
    """Radiance (16,) from shadow to light of level snow whose western half is in the shadow of a plate."""
    scene = empty_scene()
    scene.render.engine, scene.cycles.samples, scene.cycles.pixel_filter_type = "CYCLES", 2048, "BOX"
    parts = {"surface": {"model": "PRINCIPLED", "albedo": 0.8, "grain_amplitude_m": 0.0, "specular": 0.0, **surface}}
    snow = build_material("Snow", merged(defaults(), parts).surface, 1, TERRAIN)
    furnace.plane(scene, "Ground", 0.0, 20.0, snow)
    dark = merged(defaults(), {"surface": {"model": "LAMBERT", "albedo": 0.0}}).surface
    black = build_material("Black", dark, 1, TERRAIN)
    furnace.plane(scene, "Plate", 60.0, 20.0, black)  # above the eye, at 50 m
    bpy.data.objects["Plate"].location.x = -10.0
    lamp = bpy.data.lights.new("Sun", "SUN")
    lamp.energy, lamp.angle = 10.0, 0.0
    item = bpy.data.objects.new("Sun", lamp)
    item.rotation_euler = Vector((0.0, 0.0, 1.0)).to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(item)
    # Column 0 is the easternmost.
    return furnace.radiance(scene, 0.0, VIEW_M, 16).mean(axis=(0, 2))[::-1]


@pytest.mark.long
def test_light_under_the_surface_leaves_it_in_the_shadow():
    full = 10.0 * 0.8 / math.pi
    walk = across(subsurface_weight=1.0, subsurface_radius_m=PATH_M)
    shade, light = walk[:8][::-1], walk[8:]  # from the edge on
    assert shade[0] > 0.05 * full
    assert (np.diff(shade[:4]) < 0.0).all()
    # The halves are mirrored, so light here and light there are what light on the whole would give, at every distance.
    both = shade + light
    np.testing.assert_allclose(both, both.mean(), rtol=0.01)  # 16 pixels of 2048 paths each
    assert both.mean() == pytest.approx(full, rel=0.07)  # the albedo is that of even light, and the Sun stands overhead


@pytest.mark.heavy
def test_without_it_the_shadow_is_black():
    bare = across()
    assert bare[:8].max() == 0.0
    np.testing.assert_allclose(bare[8:], 10.0 * 0.8 / math.pi, rtol=0.01)  # of the table of albedos


def through(thickness_m: float, **surface: float | str) -> float:
    """Radiance of a plate of snow of albedo 0.8 from its dark side, before ground that emits 1 W/(m² sr)."""
    scene = empty_scene()
    scene.render.engine, scene.cycles.samples = "CYCLES", 256
    parts = {"surface": {"model": "PRINCIPLED", "albedo": 0.8, "grain_amplitude_m": 0.0, "specular": 0.0, **surface}}
    bpy.ops.mesh.primitive_cube_add(size=1.0)
    plate = bpy.context.object.data
    for vertex in plate.vertices:
        vertex.co = vertex.co.x * 4.0, vertex.co.y * 4.0, vertex.co.z * thickness_m
    plate.materials.append(build_material("Snow", merged(defaults(), parts).surface, 1, TERRAIN))
    lamp = merged(defaults(), {"surface": {"model": "LAMBERT", "albedo": 0.0, "emitted_w_m2_sr": 1.0}}).surface
    furnace.plane(scene, "Lamp", -1.0, 400.0, build_material("Lamp", lamp, 1, TERRAIN))
    return float(furnace.radiance(scene, 0.0, 0.2, 16).mean())


def diffused(thicknesses: float, albedo: float) -> float:
    """Share of even light that a plate lets through, by its thickness in mean free paths: that of two streams, with the
    diffusion length of even scattering and van de Hulst's albedo of thick layers."""
    similarity = np.linspace(0.0, 1.0, 100_001)
    of_layer = (1 - similarity) * (1 - 0.139 * similarity) / (1 + 1.17 * similarity)
    scattered = 1 - float(np.interp(-albedo, -of_layer, similarity)) ** 2
    per_path = np.linspace(1e-3, 0.999, 100_001)
    k = float(np.interp(1.0, scattered / (2 * per_path) * np.log((1 + per_path) / (1 - per_path)), per_path))
    left = math.exp(-k * thicknesses)
    return (1 - albedo**2) * left / (1 - albedo**2 * left**2)


@pytest.mark.long
def test_light_through_a_plate_dims_by_the_diffusion_of_a_mean_free_path_of_a_radius_over_4_pi():
    walk = {"subsurface_weight": 1.0, "subsurface_radius_m": PATH_M}
    thin, thick = (through(share * PATH_M, **walk) for share in (0.25, 0.75))
    # The factor that both have in common is that of light that enters refracted, see docs/theory/surfaces.md.
    expected = diffused(0.75 * 4 * math.pi, 0.8) / diffused(0.25 * 4 * math.pi, 0.8)
    assert thick / thin == pytest.approx(expected, rel=0.06)  # 65536 paths of which 1 in 10 arrives: 1.5 %
    assert 1.0 < thin / diffused(0.25 * 4 * math.pi, 0.8) < 1.4
    assert through(0.25 * PATH_M) == 0.0
