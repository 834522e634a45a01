"""Building and rendering small scenes in tests."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from icymoon.nodes.build_scene import Built, build_scene
from icymoon.render.pairs.pair_folder import Pair, read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.settings import description
from icymoon.settings.topics.scene import Settings
from icymoon.support.arrays import Array
from icymoon.support.blender import compat

SMALL: dict[str, dict[str, Any]] = {
    "terrain": {"resolution": 65},
    "mesh": {"kind": "GRID"},
    "quality": {"samples": 2, "threads": 2},
    "rig": {"width_px": 96, "height_px": 72},
}


def complete(*parts: dict[str, Any]) -> Settings:
    """The defaults, made small, with changes."""
    return description.merged(description.defaults(), SMALL, *(description.check(p, "test") for p in parts))


def on_height_map(heights: Path, size_m: float) -> dict[str, dict[str, Any]]:
    """Settings of ground from a height map of 33 x 33 values that covers the patch."""
    return {
        "source": {
            "kind": "HEIGHT_MAP",
            "file": str(heights),
            "metres_per_pixel": size_m / 32,
            "height_scale_m": 1.0,
            "centre": False,
            "origin_x_m": size_m / 2,
            "origin_y_m": size_m / 2,
        },
        "terrain": {"size_m": size_m, "resolution": 33},
    }


def empty_scene() -> bpy.types.Scene:
    """A scene with nothing in it, in a new file."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context.scene


def render(folder: Path, *parts: dict[str, Any]) -> tuple[Pair, Built]:
    """Build a described scene, render its first pair into a data set folder and read it back."""
    settings = complete(*parts)
    scene = empty_scene()
    start = time.perf_counter()
    built = build_scene(scene, settings)
    folders = render_pairs(
        built, expand_headings(settings), folder, 1, time.perf_counter() - start, lambda *a, **k: None
    )
    return read_pair(folders[0]), built


def add_shining_ball(built: Built, place_m: Array, radius_m: float, radiance: float) -> None:
    """Add a ball that shines, with the instance 77, to a built scene; in W/(m² sr)."""
    import bmesh  # which the module bpy brings

    shape, mesh = bmesh.new(), bpy.data.meshes.new("Ball")
    bmesh.ops.create_icosphere(shape, subdivisions=4, radius=radius_m)
    shape.to_mesh(mesh)
    shape.free()
    material = bpy.data.materials.new("Shining")
    tree = compat.ensure_nodes(material)
    tree.nodes.clear()
    light, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
    light.inputs["Strength"].default_value = radiance
    tree.links.new(light.outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)
    ball = bpy.data.objects.new("Ball", mesh)
    ball.location, ball.pass_index = place_m.tolist(), 77
    built.collection.objects.link(ball)


def png(path: Path, pixels: Array) -> Path:
    """Write an image (rows, columns, 3), row 0 at the bottom, of values as they stand in the file."""
    image = bpy.data.images.new("Test", pixels.shape[1], pixels.shape[0])
    rgba = np.ones((*pixels.shape[:2], 4), np.float32)
    rgba[..., :3] = pixels
    image.pixels.foreach_set(rgba.ravel())
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)
    return path
