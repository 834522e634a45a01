"""Meshes exported by Blender in each format that can be imported."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from icymoon.support.arrays import Array
from rendering import empty_scene

FORMATS = ("a.obj", "a.ply", "a.stl", "a.glb", "a.gltf", "a.usdc", "a.usda", "a.fbx")


def export(path: Path, positions: Array, faces: Array, **layers: Array) -> Path:
    """Write a mesh, with UV layers of its corners (m, corners, 2) of which the last one is rendered, with Blender's own
    exporter of the suffix, leaving an empty file behind."""
    scene = empty_scene()
    mesh = bpy.data.meshes.new("Hill")
    mesh.from_pydata(positions.tolist(), [], faces.tolist())
    mesh.materials.append(bpy.data.materials.new("Stone"))
    for name, uv in layers.items():
        layer = mesh.uv_layers.new(name=name)
        layer.data.foreach_set("uv", np.ascontiguousarray(uv, np.float32).ravel())
        layer.active_render = True
    item = bpy.data.objects.new("Hill", mesh)
    scene.collection.objects.link(item)
    item.select_set(True)
    bpy.context.view_layer.objects.active = item
    wm, scenes_out = bpy.ops.wm, bpy.ops.export_scene
    try:
        {
            ".obj": lambda p: wm.obj_export(filepath=p),
            ".ply": lambda p: wm.ply_export(filepath=p),
            ".stl": lambda p: wm.stl_export(filepath=p),
            ".fbx": lambda p: scenes_out.fbx(filepath=p),
            ".glb": lambda p: scenes_out.gltf(filepath=p),
            ".gltf": lambda p: scenes_out.gltf(filepath=p, export_format="GLTF_SEPARATE"),
            ".usda": lambda p: wm.usd_export(filepath=p),
            ".usdc": lambda p: wm.usd_export(filepath=p),
        }[path.suffix](str(path))
    except AttributeError:
        pytest.skip(f"this Blender writes no {path.suffix}")
    empty_scene()
    return path
