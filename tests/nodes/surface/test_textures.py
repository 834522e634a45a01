"""Textures: right means and colours on the ground, no repeats, every map where it belongs, clear refusals."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from icymoon.benchmarks.light.furnace import albedo as furnace
from icymoon.benchmarks.light.furnace import plane, radiance
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.surface.ice_material import build_material
from icymoon.nodes.surface.images import load_maps
from icymoon.nodes.surface.textures import Textured
from icymoon.physics.surfaces.textures import MAP_SIDE_PX, SETS, make_maps
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.settings.description import check, defaults
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from icymoon.support.labels import TERRAIN
from rendering import complete, empty_scene, png


def measured(surface: dict, textures: dict, files=None, **view) -> Array:
    """What a white furnace measures on a textured surface."""
    settings = defaults().surface | {
        "grain_amplitude_m": 0.0,
        "specular": 0.0,
        **check({"surface": surface}, "test").get("surface", {}),
    }
    described = defaults().textures | check({"textures": textures}, "test").textures
    return furnace(
        lambda: build_material("Test", settings, 1, TERRAIN, Textured(described, load_maps(described, files or {}))),
        **view,
    )


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("name", SETS)
def test_the_sets_go_on_beyond_their_edges(name):
    found = make_maps(name)
    for values in (found.albedo, found.roughness, found.height):
        assert values.shape == (MAP_SIDE_PX, MAP_SIDE_PX)
        assert np.isfinite(values).all()
        across = np.abs(np.diff(values, axis=1)).mean()
        edge = np.abs(values[:, 0] - values[:, -1]).mean()
        assert edge < 2.0 * across  # the step from the last column to the first is one like the others
    assert found.albedo.mean() == pytest.approx(1.0, abs=1e-6)
    assert 0.0 <= found.roughness.min() <= found.roughness.max() <= 1.0
    assert (found.height.min(), found.height.max()) == (0.0, 1.0)


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("repeat", ["TURNED", "SHIFTED", "PLAIN"])
def test_a_texture_leaves_the_mean_albedo_as_it_is(repeat):
    # Blending keeps the mean (it is taken out and put back); 4 m are eight images across, cut off at no edge.
    found = measured({"albedo": 0.6}, {"set": "GRAINS", "repeat": repeat, "width_m": 0.25, "height_m": 0.0}, view_m=4.0)
    assert found == pytest.approx(0.6, rel=0.02)


def test_colour_is_read_as_what_it_is(tmp_path):
    # An even image of sRGB (0.8, 0.5, 0.2), whose linear values are known.
    linear = ((np.array([0.8, 0.5, 0.2]) + 0.055) / 1.055) ** 2.4
    path = png(tmp_path / "a.png", np.broadcast_to([0.8, 0.5, 0.2], (8, 8, 3)))
    found = measured({"albedo": 0.3}, {"set": "OWN"}, {"albedo": path})
    assert found == pytest.approx(0.3 * linear / linear.mean(), rel=0.015)


def test_an_even_map_of_numbers_is_that_number(tmp_path):
    path = png(tmp_path / "t.png", np.full((8, 8, 3), 0.4))
    by_map = measured({"albedo": 1.0}, {"set": "OWN"}, {"transmission": path})
    by_setting = measured({"albedo": 1.0, "transmission": 0.4}, {"set": "NONE"})
    assert by_map == pytest.approx(by_setting, rel=0.01)  # 0.4 in 8 bits is 0.4


def test_repeats_do_not_show():
    def periodicity(repeat: str) -> float:
        """Correlation of the albedo, seen from above, with itself one image width on."""
        image = seen({"set": "CRACKS", "repeat": repeat, "width_m": 0.5, "height_m": 0.0})
        a, b = image[:, :-32] - image.mean(), image[:, 32:] - image.mean()
        return float((a * b).mean() / np.sqrt((a**2).mean() * (b**2).mean()))

    assert periodicity("PLAIN") > 0.7  # cracks are thinner than a pixel: the four samples that see them are random
    # 128 x 96 pixels hold about 8 x 6 images: chance correlations of a few per cent.
    assert abs(periodicity("TURNED")) < 0.1
    assert abs(periodicity("SHIFTED")) < 0.1


def seen(textures: dict) -> Array:
    """The emission (128, 128) of a flat textured surface 2 m wide, seen from above, as its albedo."""
    empty_scene()
    described = defaults().textures | check({"textures": textures}, "test").textures
    settings = defaults().surface | {"grain_amplitude_m": 0.0, "specular": 0.0, "albedo": 0.5}
    material = build_material("Test", settings, 1, TERRAIN, Textured(described, load_maps(described, {})))
    tree = material.node_tree
    colour = tree.nodes["Snow"].inputs["Base Color"].links[0].from_socket
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(colour, emission.inputs["Color"])
    tree.links.new(emission.outputs[0], tree.nodes["Surface"].inputs["Surface"])
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples = "CYCLES", 4
    plane(scene, "Ground", 0.0, 10.0, material)
    return radiance(scene, 0.0, 2.0, 128)[..., 0]


def test_a_normal_map_tilts_as_it_says(tmp_path):
    # Normals that lean east by atan(0.5) everywhere: under a Sun in the east the ground is brighter by the cosine. The
    # Sun is high, since Blender 4.2 darkens tilted normals near the terminator.
    normal = np.array([0.5, 0.0, 1.0]) / np.hypot(0.5, 1.0)
    path = png(tmp_path / "n.png", np.broadcast_to(0.5 + 0.5 * normal, (8, 8, 3)))
    empty_scene()
    described = defaults().textures | {"set": "OWN", "repeat": "PLAIN"}
    settings = defaults().surface | {"grain_amplitude_m": 0.0, "specular": 0.0, "albedo": 0.5}
    material = build_material("Test", settings, 1, TERRAIN, Textured(described, load_maps(described, {"normal": path})))
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples = "CYCLES", 16
    plane(scene, "Ground", 0.0, 10.0, material)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.data.angle, sun.rotation_euler = 1.0, 0.0, (0.0, np.radians(15.0), 0.0)  # from the east
    scene.collection.objects.link(sun)
    toward = np.array([np.sin(np.radians(15.0)), 0.0, np.cos(np.radians(15.0))])
    assert radiance(scene, 0.0, 1.0, 8).mean() == pytest.approx(0.5 / np.pi * float(normal @ toward), rel=0.01)


def test_maps_are_the_pair_s_and_missing_ones_are_refused(tmp_path):
    path = png(tmp_path / "a.png", np.full((8, 8, 3), 0.5))
    settings = complete({"textures": {"set": "OWN", "albedo_file": str(path)}})
    scene = empty_scene()
    built = scenes.build_scene(scene, settings)
    first = expand_headings(settings, built.extra)[0].id
    assert not built.edited
    assert scenes.list_changed_settings(built, settings) == []
    png(path, np.full((8, 8, 3), 0.7))
    assert scenes.list_changed_settings(built, settings) == ["textures.albedo_file"]
    built = scenes.build_scene(scene, settings)
    assert expand_headings(settings, built.extra)[0].id != first
    count = len(bpy.data.images)
    scenes.build_scene(scene, settings)
    assert len(bpy.data.images) == count
    for bad, word in (("missing.png", r"albedo_file"), (str(tmp_path), r"albedo_file")):
        with pytest.raises(IcyMoonError, match=word):
            scenes.build_scene(scene, complete({"textures": {"set": "OWN", "albedo_file": bad}}))
    (tmp_path / "no.png").write_bytes(b"no image")
    with pytest.raises(IcyMoonError, match="not an image"):
        scenes.build_scene(scene, complete({"textures": {"set": "OWN", "albedo_file": str(tmp_path / "no.png")}}))
    assert len(bpy.data.images) == count
    scenes.clear_scene(scene)
    assert not any(image.name.startswith("a.png") for image in bpy.data.images)


def test_a_set_of_no_images_is_said():
    scene = empty_scene()
    with pytest.raises(IcyMoonError, match=r"textures\.set"):
        scenes.build_scene(scene, complete({"textures": {"set": "OWN"}}))


def test_an_image_that_reflects_more_light_than_it_gets_is_told(registered, tmp_path):
    # A quarter is white, the rest black: with an albedo of 0.6 the white part reflects 2.4 times its light.
    path = png(tmp_path / "q.png", np.where(np.arange(64).reshape(8, 8) % 4 == 0, 1.0, 0.0)[..., None] * np.ones(3))
    scene = empty_scene()
    own = {"textures": {"set": "OWN", "albedo_file": str(path)}, "terrain": {"size_m": 8.0}}
    told = [
        sentence
        for sentence in scenes.build_scene(scene, complete(own, {"surface": {"albedo": 0.6}})).warnings
        if "more light than they receive" in sentence
    ]
    assert len(told) == 1
    assert "25 % of the albedo image" in told[0]
    assert "2.4 times" in told[0]
    assert "at most 0.25" in told[0]
    built = scenes.build_scene(scene, complete(own, {"surface": {"albedo": 0.25}}))
    assert not any("more light than they receive" in sentence for sentence in built.warnings)
