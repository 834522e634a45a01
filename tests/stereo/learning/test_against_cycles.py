"""The light of made pairs against a render of the same triangles by Cycles."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest
from icymoon.formats.exr_pixels import decode_parts
from icymoon.physics.light.directions import camera_axes, direction_toward
from icymoon.physics.surfaces.photometry import lunar_lambert
from icymoon.rays.embree import load_library
from icymoon.rays.stereo_truth import Eye
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset
from icymoon.stereo.learning import grounds, made_pairs
from icymoon.stereo.learning.grounds import build_ground, draw_recipe
from icymoon.stereo.learning.made_pairs import render_eye
from icymoon.stereo.learning.radiance import Lighting
from mathutils import Matrix, Vector
from rendering import empty_scene

pytestmark = [
    pytest.mark.skipif(load_library() is None, reason="there is no Embree; pip install embreex"),
    pytest.mark.long,
]
COLUMNS, ROWS, FOCAL, IRRADIANCE, ALBEDO = 96, 64, 80.0, 50.0, 0.7


def make_ground(monkeypatch, terrain):
    """An even Lambert surface with the shape of a terrain, of flat triangles: what light does where a smooth normal
    faces the Sun and its triangle does not is for each renderer to decide."""
    monkeypatch.setattr(grounds, "_SPACING", 0.04)
    place = grounds._make_instances

    def place_flat(vertices, triangles, label, places, smooth):
        return place(vertices, triangles, label, places, smooth=False)

    monkeypatch.setattr(grounds, "_make_instances", place_flat)
    grounds._make_rings.cache_clear()
    recipe = draw_recipe(0, "train", 0)
    pattern = replace(recipe.pattern, albedo=0 * recipe.pattern.albedo, slope=0 * recipe.pattern.slope)
    own = merged(defaults(), load_preset(f"terrains/{terrain}"))
    made = replace(
        recipe, bare=own, rocks=None, shapes=0, albedo=ALBEDO, pattern=pattern, law=lambda a: lunar_lambert(a, 0.0)
    )
    ground = build_ground(made)
    grounds._make_rings.cache_clear()
    return ground


def add_ground(scene, ground):
    shape = ground.world.placed[0].shape
    mesh = bpy.data.meshes.new("Ground")
    mesh.from_pydata(shape.vertices.tolist(), [], shape.triangles.tolist())
    material = bpy.data.materials.new("Lambert")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    diffuse, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    diffuse.inputs["Color"].default_value = (ALBEDO, ALBEDO, ALBEDO, 1.0)
    material.node_tree.links.new(diffuse.outputs[0], output.inputs[0])
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("Ground", mesh))


def add_sun(scene, sun):
    lamp = bpy.data.lights.new("Sun", "SUN")
    lamp.energy, lamp.angle = IRRADIANCE, 2e-3
    item = bpy.data.objects.new("Sun", lamp)
    item.rotation_euler = Vector(sun).to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(item)


def render_by_cycles(ground, eye, sun, path):
    """Radiance (rows, columns) by Cycles, 64 samples."""
    scene = empty_scene()
    add_ground(scene, ground)
    add_sun(scene, sun)
    camera = bpy.data.cameras.new("Camera")
    camera.sensor_width, camera.lens = 36.0, 36.0 * FOCAL / COLUMNS
    item = bpy.data.objects.new("Camera", camera)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = eye.axes * [1.0, -1.0, -1.0], eye.position
    item.matrix_world = Matrix(pose.tolist())
    scene.collection.objects.link(item)
    scene.camera = item
    scene.render.engine, cycles, target = "CYCLES", scene.cycles, scene.render
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = 64, False, False
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = cycles.light_sampling_threshold = 0.0
    cycles.max_bounces = cycles.diffuse_bounces = 8
    target.resolution_x, target.resolution_y, target.resolution_percentage = COLUMNS, ROWS, 100
    image = target.image_settings
    image.file_format, image.color_depth, scene.view_settings.view_transform = "OPEN_EXR", "32", "Raw"
    target.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    channels = dict(item for _, each in decode_parts(path.read_bytes()) for item in each.items())
    return np.mean([values for name, values in channels.items() if name[-1] in "RGB"], axis=0)


@pytest.mark.parametrize(("terrain", "elevation_deg"), [("chaos", 30.0), ("rough", 12.0)])
def test_light_is_within_three_percent_of_cycles(monkeypatch, tmp_path, terrain, elevation_deg):
    ground, sun = make_ground(monkeypatch, terrain), direction_toward(70.0, elevation_deg)
    place = np.array([*ground.recipe.place_m, ground.height_m + 1.5])
    eye = Eye(COLUMNS, ROWS, FOCAL, COLUMNS / 2, ROWS / 2, camera_axes(10.0, 25.0), place)
    light = Lighting(sun, IRRADIANCE, 1e-3, 0.0, np.full(2, ALBEDO))
    monkeypatch.setattr(made_pairs, "_SQUARE_PX", 2)  # a small image; squares of 8 px would smooth over rocks
    random = np.random.default_rng(0)
    ours = np.mean([render_eye(ground, light, eye, 1, random) for _ in range(32)], axis=0)
    theirs = render_by_cycles(ground, eye, sun, tmp_path / "cycles.exr")
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.03)
    lit = theirs > 0.3 * np.quantile(theirs, 0.95)
    assert np.median(ours[lit] / theirs[lit]) == pytest.approx(1.0, abs=0.03)
