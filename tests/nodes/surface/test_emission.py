"""Light that ice gives by itself: the radiance that is stated, and what it makes of its surroundings."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from icymoon.benchmarks.light import furnace
from icymoon.nodes.surface.ice_material import build_material
from icymoon.physics.light.sky import compute_sky, describe_sky
from icymoon.physics.scene_requirements import find_left_out, find_why_not_baked, needs_elevation
from icymoon.settings.description import defaults, merged
from icymoon.stereo.images.develop import scale_radiance
from icymoon.stereo.images.exr import read_view
from icymoon.support.errors import IcyMoonError
from icymoon.support.labels import ROCK, TERRAIN
from rendering import complete, empty_scene, render

EMITTED = 2.5
FLAT = {
    "terrain": {"rms_slope_deg": 0.0, "size_m": 40.0},
    "rig": {"pitch_deg": 90.0, "width_px": 48, "height_px": 36},
    "light": {"sun_irradiance_wm2": 0.0},
    "quality": {"files": "FULL"},
}


def shining(model, **more):
    return {"surface": {"model": model, "grain_amplitude_m": 0.0, "emitted_w_m2_sr": EMITTED, **more}}


@pytest.mark.heavy
@pytest.mark.parametrize("model", ["LAMBERT", "PRINCIPLED"])
def test_in_the_dark_level_ground_has_the_radiance_that_is_stated(tmp_path, model):
    pair, _ = render(tmp_path, FLAT, shining(model))
    view = read_view(pair.image("left"))
    np.testing.assert_allclose(view.radiance, EMITTED, rtol=1e-6)  # single precision: it is not sampled
    with pytest.raises(IcyMoonError, match=r"light\.sun_scale"):
        scale_radiance(view, pair, complete(pair.settings, {"light": {"sun_scale": 2.0}}))


@pytest.mark.heavy
def test_in_the_sun_it_adds_to_what_is_reflected(tmp_path):
    sunny = {"light": {"sun_irradiance_wm2": 10.0, "sun_elevation_deg": 90.0}}
    pair, _ = render(tmp_path, FLAT, shining("LAMBERT", albedo=0.5), sunny)
    expected = EMITTED + 10.0 * 0.5 / np.pi
    np.testing.assert_allclose(read_view(pair.image("left")).radiance, expected, rtol=1e-5)


@pytest.mark.heavy
def test_in_a_closed_room_it_is_reflected_again_and_again():
    """In a room whose walls give E and reflect the share A of light, the radiance is E (1 + A + A² + ...)."""
    scene = empty_scene()
    scene.render.engine, scene.cycles.samples = "CYCLES", 64
    surface = merged(defaults(), shining("LAMBERT", albedo=0.5)).surface
    bpy.ops.mesh.primitive_ico_sphere_add(radius=200.0, subdivisions=4)
    bpy.context.object.data.materials.append(build_material("Test", surface, 1, TERRAIN))
    seen = furnace.radiance(scene, 0.0, 1.0, 16)
    assert seen.mean() == pytest.approx(EMITTED / (1 - 0.5), rel=0.005)  # 16384 paths, of which roulette ends some


def test_light_of_the_ground_is_not_baked():
    baked = {"quality": {"indirect": "BAKED"}}
    assert not find_why_not_baked(complete(baked, shining("LAMBERT", emitted_w_m2_sr=0.0)))
    assert "surface.emitted_w_m2_sr" in find_why_not_baked(complete(baked, shining("LAMBERT")))


def test_without_it_there_are_no_nodes():
    def names(**more):
        surface = merged(defaults(), shining("LAMBERT", **more)).surface
        return {node.label for node in build_material("Test", surface, 1, TERRAIN).node_tree.nodes}

    assert "Emitted Light" in names()
    assert "Emitted Light" not in names(emitted_w_m2_sr=0.0)


@pytest.mark.heavy
def test_in_hollows_alone_ground_below_the_height_emits_and_no_other(tmp_path):
    """Ground without reflection is black at night, or has the radiance that is stated."""
    rough = {"terrain": {"rms_slope_deg": 12.0, "regional_slope_deg": 10.0, "resolution": 129}}
    low = shining("LAMBERT", albedo=0.0, emitted_from="HOLLOWS", emitted_below=-0.5)
    pair, built = render(tmp_path, FLAT, rough, low, {"rig": {"height_m": 8.0}})
    view = read_view(pair.image("left"))
    places = built.camera.matrix_world.translation.z - view.depth  # of a camera that looks straight down
    vertices = np.array([vertex.co for vertex in built.terrain.data.vertices])
    plane = np.c_[vertices[:, :2], np.ones(len(vertices))]
    slope = np.linalg.lstsq(plane, vertices[:, 2], rcond=None)[0]
    deviation = (vertices[:, 2] - plane @ slope).std()
    column, row = np.meshgrid(np.arange(48) + 0.5 - 24, 18 - np.arange(36) - 0.5)
    away = (np.array(built.camera.matrix_world.to_3x3()) @ np.array([column.ravel(), row.ravel(), 0 * row.ravel()])).T
    east, north = (away[:, :2] * view.depth.ravel()[:, None] / pair.camera.focal_px).T
    height = (places.ravel() - np.c_[east, north, np.ones(len(east))] @ slope) / deviation
    radiance = view.radiance.mean(axis=2).ravel()
    assert 0.1 < (radiance > 0).mean() < 0.6
    # Away from the edge, which a pixel blurs.
    np.testing.assert_allclose(radiance[height < -0.8], EMITTED, rtol=1e-6)
    np.testing.assert_array_equal(radiance[height > -0.2], 0.0)


def test_rocks_have_no_hollows_and_ground_without_emission_no_heights():
    surface = merged(defaults(), shining("LAMBERT", emitted_from="HOLLOWS")).surface
    assert needs_elevation(surface)
    assert not needs_elevation(surface | {"emitted_w_m2_sr": 0.0})
    assert not needs_elevation(surface | {"emitted_from": "EVERYWHERE"})
    labels = {node.label for node in build_material("Test", surface, 1, ROCK).node_tree.nodes}
    assert "Emitted Light" not in labels
    own = {"rocks": {"coverage": 0.1, "own_surface": True}, "rock_surface": shining("LAMBERT")["surface"]}
    parts = complete(own, {"rock_surface": {"emitted_from": "HOLLOWS"}})
    said = find_left_out(parts, describe_sky(compute_sky(parts.light)))
    assert any("rocks have no hollows" in each for each in said)
