"""What Cycles is told: the image is radiance, whatever the scene was set to before."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from icymoon.benchmarks.light.furnace import render_pixels
from icymoon.render import cycles_settings
from icymoon.settings.description import defaults
from icymoon.support.blender import compat
from mathutils import Vector
from rendering import empty_scene
from stand_ins import stand_in

#: Values that change an image, by whose they are: all that a scene can be left with by its user or by a template.
HARMFUL: dict[str, dict[str, Any]] = {
    "cycles": {
        "sample_clamp_direct": 5.0,
        "sample_clamp_indirect": 5.0,
        "light_sampling_threshold": 0.5,
        "use_light_tree": True,
        "use_adaptive_sampling": True,
        "adaptive_threshold": 0.5,
        "adaptive_min_samples": 1,
        "time_limit": 0.1,
        "use_denoising": True,
        "samples": 3,
        "seed": 77,
        "use_animated_seed": True,
        "sampling_pattern": "BLUE_NOISE",
        "diffuse_bounces": 0,
        "glossy_bounces": 0,
        "transmission_bounces": 7,
        "volume_bounces": 7,
        "max_bounces": 0,
        "transparent_max_bounces": 0,
        "caustics_reflective": True,
        "caustics_refractive": True,
        "blur_glossy": 5.0,
        "film_exposure": 2.0,
        "pixel_filter_type": "BOX",
        "filter_width": 5.0,
        "use_fast_gi": True,
        "shading_system": True,
    },
    "render": {
        "film_transparent": True,
        "use_motion_blur": True,
        "use_simplify": True,
        "use_compositing": True,
        "use_sequencer": True,
        "use_border": True,
        "use_freestyle": True,
        "dither_intensity": 2.0,
        "use_stamp": True,
        "threads_mode": "FIXED",
    },
    "view_settings": {"exposure": 3.0, "gamma": 2.0},
}


def told(scene: bpy.types.Scene) -> dict[tuple[str, str], object]:
    return {(part, name): getattr(getattr(scene, part), name) for part, names in HARMFUL.items() for name in names}


def test_nothing_that_a_scene_was_left_with_reaches_the_image(registered):
    settings = defaults().quality
    fresh = empty_scene()
    cycles_settings.apply_quality(fresh, settings, 5)
    wanted = told(fresh)
    left = empty_scene()
    left.render.engine = "CYCLES"
    for part, values in HARMFUL.items():
        for name, value in values.items():
            setattr(getattr(left, part), name, value)
            assert getattr(getattr(left, part), name) != wanted[part, name], f"{part}.{name} harms nothing"
    cycles_settings.apply_quality(left, settings, 5)
    assert told(left) == wanted


class Watched:
    """A part of a scene that notes the names of the values that are assigned."""

    def __init__(self, part: Any, names: list[str]) -> None:
        self.__dict__.update(_part=part, _names=names)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._part, name)

    def __setattr__(self, name: str, value: object) -> None:
        self._names.append(name)
        setattr(self._part, name, value)


def test_what_is_set_already_is_not_assigned_again(registered):
    """Each assignment tells Blender to evaluate the scene anew."""
    scene, names = empty_scene(), list[str]()
    parts = {part: Watched(getattr(scene, part), names) for part in HARMFUL}
    settings = defaults().quality | {"noise_threshold": 0.25}  # a number that float32 has
    cycles_settings.apply_quality(stand_in(**parts), settings, 5)
    assert "diffuse_bounces" in names, "a default is assigned too"
    names.clear()
    cycles_settings.apply_quality(stand_in(**parts), settings, 5)
    assert names == []
    cycles_settings.apply_quality(stand_in(**parts), settings, 6)
    assert names == ["seed"]


def corner(strength: float) -> bpy.types.Scene:
    """A white floor and a white wall, lit by the Sun, seen from above the floor: half of the light is indirect."""
    scene = empty_scene()
    white = bpy.data.materials.new("White")
    tree = compat.ensure_nodes(white)
    tree.nodes.clear()
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    tree.links.new(diffuse.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs[0])
    mesh = bpy.data.meshes.new("Corner")
    mesh.from_pydata(
        [(0, -5, 0), (9, -5, 0), (9, 5, 0), (0, 5, 0), (0, -5, 9), (0, 5, 9)], [], [(0, 1, 2, 3), (0, 3, 5, 4)]
    )
    mesh.materials.append(white)
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle = strength, 0.0
    camera = bpy.data.cameras.new("Camera")
    for data in (mesh, sun, camera):
        scene.collection.objects.link(bpy.data.objects.new(data.name, data))
    bpy.data.objects["Sun"].rotation_euler = Vector((1.0, 0.0, 1.0)).to_track_quat("Z", "Y").to_euler()
    bpy.data.objects["Camera"].location = (1.0, 0.0, 4.0)
    scene.camera = bpy.data.objects["Camera"]
    scene.render.resolution_x = scene.render.resolution_y = 16
    return scene


def test_light_is_linear_however_bright_it_is(registered):
    """Twice the light is twice the radiance in every pixel, so nothing is clamped; and light comes off the wall."""
    images = []
    for strength in (0.01, 10000.0):
        scene = corner(strength)
        cycles_settings.apply_quality(scene, defaults().quality | {"samples": 8, "threads": 1, "diffuse_bounces": 2}, 1)
        images.append(render_pixels(scene) / strength)
    np.testing.assert_allclose(images[1], images[0], rtol=1e-4)
    direct = np.cos(np.radians(45.0)) / np.pi
    assert images[0].min() == pytest.approx(direct, rel=0.5)
    assert images[0].mean() > 1.1 * direct
