"""Ice blocks as objects that share a few meshes."""

from __future__ import annotations

import bmesh
import bpy
import numpy as np

from ..labels import FIRST_ROCK_INSTANCE
from ..physics.rocks import Rocks, block_radii
from ..physics.seeds import generator
from .terrain import mesh_from_arrays

SHAPES = 12
_SUBDIVISIONS = 4


def _sphere() -> tuple[np.ndarray, np.ndarray]:
    """Unit directions (n, 3) and triangles (m, 3) of an icosphere."""
    sphere = bmesh.new()
    bmesh.ops.create_icosphere(sphere, subdivisions=_SUBDIVISIONS, radius=1.0)
    sphere.verts.index_update()
    directions = np.array([v.co for v in sphere.verts])
    faces = np.array([[v.index for v in f.verts] for f in sphere.faces], np.int32)
    sphere.free()
    return directions / np.linalg.norm(directions, axis=1, keepdims=True), faces


def build_shapes(name: str, angularity: float, seed: int) -> list[bpy.types.Mesh]:
    """The block meshes, each of unit diameter about the origin."""
    directions, faces = _sphere()
    return [mesh_from_arrays(f"{name} Shape {i + 1}",
                             directions * block_radii(directions, angularity, generator(seed, "rocks", i))[:, None],
                             faces)
            for i in range(SHAPES)]


def build_objects(name: str, rocks: Rocks, shapes: list[bpy.types.Mesh],
                  material: bpy.types.Material) -> list[bpy.types.Object]:
    """One object per block, its instance label its place in the order of size, largest first."""
    for mesh in shapes:
        mesh.materials.append(material)
    objects = []
    for i, (position, diameter, rotation, shape) in enumerate(
            zip(rocks.position_m.tolist(), rocks.diameter_m.tolist(), rocks.rotation.tolist(),
                rocks.shape.tolist(), strict=True)):
        block = bpy.data.objects.new(f"{name} {i + 1}", shapes[shape])
        block.location, block.rotation_euler, block.scale = position, rotation, (diameter,) * 3
        block.pass_index = FIRST_ROCK_INSTANCE + i
        objects.append(block)
    return objects
