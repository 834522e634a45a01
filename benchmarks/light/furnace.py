"""A white furnace in Cycles: the share of light from all sides that a flat surface reflects.

    python benchmarks furnace > physics/surfaces/principled.json

The study measures the Principled surface over its settings; ``physics/surfaces/principled.py`` reads the table. The
tests put materials into the same furnace.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from icymoon.benchmarks.common.renders import hide_cycles_output, open_empty_file
from icymoon.nodes.surface.patches_and_grain import add_grain
from icymoon.nodes.tree.builder import WHITE, Tree
from icymoon.support.arrays import Array
from icymoon.support.blender import compat
from mathutils import Vector

#: Settings that the table is measured at.
ROOT_F0 = (0.0, 0.04, 0.1, 0.2, 0.35, 0.5, math.sqrt(0.5))
ROUGHNESS = (0.0, 0.15, 0.3, 0.5, 0.75, 1.0)
BASE = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.92, 1.0)
STEEPNESS = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.5, 5.0, 20.0)  # height of bumps over their wavelength
#: Emission angles and weights of the mean over the hemisphere, weighted by projected area; eight, since Fresnel
#: reflection rises steeply near grazing (four are 5 % low).
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_PIXELS = 16
_EMISSION, _SHARE = np.arccos(np.sqrt((_NODES + 1) / 2)), _WEIGHTS / 2


def albedo(
    make: Callable[[], bpy.types.Material], *, samples: int = 64, view_m: float = 0.5, size_m: float = 100.0
) -> Array:
    """Bihemispherical reflectance (3,) in red, green and blue of a horizontal plane of the material.

    The sky above and below has radiance 1; a black floor absorbs the light that passes through. The mean is
    over a square of ``view_m`` in the middle of a plane of ``size_m``.
    """
    scene = open_empty_file()
    scene.render.engine, scene.cycles.samples = "CYCLES", samples
    scene.world = shining()
    plane(scene, "Surface", 0.0, size_m, make())
    plane(scene, "Floor", -1.0, 2 * size_m, _black())
    return np.sum(
        [
            share * radiance(scene, emission, view_m, _PIXELS).mean(axis=(0, 1))
            for emission, share in zip(_EMISSION, _SHARE, strict=True)
        ],
        axis=0,
    )


def shining() -> bpy.types.World:
    world = bpy.data.worlds.new("White")
    tree = compat.ensure_nodes(world)
    tree.nodes.clear()
    background, output = tree.nodes.new("ShaderNodeBackground"), tree.nodes.new("ShaderNodeOutputWorld")
    background.inputs["Color"].default_value, background.inputs["Strength"].default_value = (1, 1, 1, 1), 1.0
    tree.links.new(background.outputs[0], output.inputs[0])
    return world


def _black() -> bpy.types.Material:
    material = bpy.data.materials.new("Black")
    tree = compat.ensure_nodes(material)
    tree.nodes.clear()
    tree.links.new(tree.nodes.new("ShaderNodeHoldout").outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs[0])
    return material


def plane(scene: bpy.types.Scene, name: str, height_m: float, size_m: float, material: bpy.types.Material) -> None:
    """Add a horizontal square of a material."""
    mesh, half = bpy.data.meshes.new(name), size_m / 2
    mesh.from_pydata(
        [(-half, -half, height_m), (half, -half, height_m), (half, half, height_m), (-half, half, height_m)],
        [],
        [(0, 1, 2, 3)],
    )
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def radiance(scene: bpy.types.Scene, emission: float, view_m: float, pixels: int) -> Array:
    """Radiance (pixels, pixels, 3) of the scene's middle from an emission angle in the east.

    From above, at 0, row 0 is the northernmost and column 0 the easternmost.
    """
    cycles = scene.cycles
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = cycles.light_sampling_threshold = 0.0
    for kind in ("max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces"):
        setattr(cycles, kind, 64)
    scene.render.resolution_x = scene.render.resolution_y = pixels
    scene.render.resolution_percentage = 100
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", view_m
    scene.collection.objects.link(camera)
    scene.camera = camera
    toward = Vector((math.sin(emission), 0.0, math.cos(emission)))
    camera.location, camera.rotation_euler = 50.0 * toward, toward.to_track_quat("Z", "Y").to_euler()
    values = render_pixels(scene)
    bpy.data.objects.remove(camera)
    return values


def render_pixels(scene: bpy.types.Scene) -> Array:
    """Render a scene with its present settings; radiance (rows, columns, 3), row 0 at the bottom."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "furnace.exr"
        settings = scene.render.image_settings
        settings.file_format, settings.color_depth = "OPEN_EXR", "32"
        scene.render.filepath, scene.render.use_file_extension = str(path), False
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(str(path))
        width, height = image.size
        values = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(values)
        bpy.data.images.remove(image)
    return values.reshape(height, width, 4)[..., :3].astype(np.float64)


def principled(**inputs: object) -> bpy.types.Material:
    """A bare Principled surface with these inputs by name."""
    material = bpy.data.materials.new("Principled")
    tree = compat.ensure_nodes(material)
    tree.nodes.clear()
    shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
    shader.distribution, shader.subsurface_method = "MULTI_GGX", "RANDOM_WALK"
    for name, value in inputs.items():
        shader.inputs[name.replace("_", " ")].default_value = value
    tree.links.new(shader.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs[0])
    return material


def bumpy(steepness: float) -> bpy.types.Material:
    """A white Lambert surface with bumps as in ``nodes/surface/ice_material.py``."""
    material = principled(Base_Color=WHITE, Specular_IOR_Level=0.0)
    tree, wavelength_m = Tree(material.node_tree, keep=True), 0.02
    where = tree.node("ShaderNodeNewGeometry", "Geometry").outputs["Position"]
    height = add_grain(tree, where, wavelength_m, (0.0, 0.0, 0.0))
    bump = tree.bump("Relief", height, steepness * wavelength_m)
    tree.tree.links.new(bump, tree.tree.nodes["Principled BSDF"].inputs["Normal"])
    return material


def table() -> dict[str, Any]:
    """The reflectances that ``physics/surfaces/principled.py`` interpolates."""

    def measured(base: float, root_f0: float, roughness: float, **inputs: object) -> float:
        index = (1 + root_f0) / (1 - root_f0)
        found = albedo(
            lambda: principled(
                Base_Color=(base,) * 3 + (1,),
                IOR=index,
                Roughness=roughness,
                Subsurface_Radius=(1, 1, 1),
                Subsurface_Scale=0.01,
                **inputs,
            ),
            samples=32,
        )
        return round(float(found.mean()), 4)

    grid = [(q, r) for q in ROOT_F0 for r in ROUGHNESS]
    shape = (len(ROOT_F0), len(ROUGHNESS))
    specular = np.array([measured(0.0, q, r) for q, r in grid]).reshape(shape)
    glass = np.array([measured(1.0, q, r, Transmission_Weight=1.0) for q, r in grid]).reshape(shape)
    subsurface = np.array([[measured(b, q, r, Subsurface_Weight=1.0) for b in BASE] for q, r in grid])
    return {
        "made_by": "python benchmarks furnace",
        "blender": bpy.app.version_string,
        "steepness": STEEPNESS,
        "bump": [round(float(albedo(partial(bumpy, q), view_m=1.0).mean()), 4) for q in STEEPNESS],
        "root_f0": np.round(ROOT_F0, 6).tolist(),
        "roughness": ROUGHNESS,
        "base": BASE,
        "specular": specular.tolist(),
        "transmission": glass.tolist(),
        "subsurface": subsurface.reshape(*shape, len(BASE)).tolist(),
    }


def main(options: argparse.Namespace) -> None:
    """Print the table as JSON."""
    with hide_cycles_output(to_errors=True):
        print(json.dumps(table()))
