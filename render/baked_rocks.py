"""Bakes indirect light to points of rocks, for the few terms per rock that ``physics.light.baked_rocks`` fits to it.

A small triangle stands just above each point. No ray sees the triangle, so the light stays as it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ..nodes.datablocks.fingerprint import TAG
from ..nodes.ground.heights_under import probe_heights
from ..nodes.ground.rocks import ROTATION, SCALE, SHAPE, find_rock_parts
from ..nodes.ground.terrain_mesh import build_mesh_from_arrays
from ..physics.light import baked_rocks
from ..physics.light.baked_rocks import RockPoints
from ..physics.rocks.place_rocks import LEVEL_RANKS, euler_matrices
from ..support.arrays import Array
from ..support.blender import compat
from ..support.labels import BAKED_ATTRIBUTES
from .mesh_arrays import read_corners, read_vertices

_POINT_OBJECT_NAME = "Icy Moon Baked Rocks"


def draw_points(rocks: bpy.types.Object, random: np.random.Generator) -> RockPoints:
    """Draw random points on all rocks of a built object of rocks; large rocks get most points."""
    mesh = rocks.data
    count = len(mesh.vertices)
    shape = _read_attribute(mesh, SHAPE, np.int32, 1)[:, 0]
    scale = _read_attribute(mesh, SCALE, np.float32, 3).astype(np.float64)
    matrices = euler_matrices(_read_attribute(mesh, ROTATION, np.float32, 3).astype(np.float64)) * scale[:, None, :]
    positions = read_vertices(mesh).astype(np.float64)
    level = np.searchsorted(LEVEL_RANKS, np.arange(count), side="right")
    shapes = sorted(
        (part for part in find_rock_parts(rocks, TAG) if isinstance(part, bpy.types.Object)), key=lambda part: part.name
    )
    drawn = []
    for number, of in enumerate(shapes):
        vertices, triangles = _read_triangles(of.data)
        for some, points in enumerate(baked_rocks.POINTS_BY_DETAIL):
            these = np.flatnonzero((shape == number) & (level == some))
            if len(these):
                drawn.append(
                    baked_rocks.draw_points(
                        vertices, triangles, these, matrices[these], positions[these], points, random
                    )
                )
    return RockPoints(
        *(np.concatenate([getattr(each, name) for each in drawn]) for name in ("rock", "place", "normal", "corners"))
    )


def are_above_ground(points: RockPoints, terrain: bpy.types.Object) -> Array:
    """Find the points that are above the ground, or beside its edge, as bool (n,)."""
    middle = points.corners.mean(axis=1)
    with probe_heights(terrain) as heights:
        return ~(middle[:, 2] < heights(middle[:, 0], middle[:, 1]))


@contextmanager
def add_point_object(points: RockPoints, scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    """Add an object of the points' triangles to a scene, white and invisible to rays, for the duration of the
    context."""
    corners = points.corners.reshape(-1, 3)
    mesh = build_mesh_from_arrays(_POINT_OBJECT_NAME, corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
    mesh.polygons.foreach_set("use_smooth", np.zeros(len(points.rock), bool))
    material = bpy.data.materials.new(_POINT_OBJECT_NAME)
    tree = compat.ensure_nodes(material)
    tree.nodes.clear()
    white = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(white.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs[0])
    mesh.materials.append(material)
    item = bpy.data.objects.new(_POINT_OBJECT_NAME, mesh)
    for ray in ("camera", "diffuse", "glossy", "transmission", "shadow"):
        setattr(item, f"visible_{ray}", False)
    scene.collection.objects.link(item)
    try:
        yield item
    finally:
        bpy.data.objects.remove(item)
        bpy.data.meshes.remove(mesh)
        bpy.data.materials.remove(material)


def write_rock_light(rocks: bpy.types.Object, group: str, numbers: Array) -> None:
    """Give rocks the terms (rocks, terms, 3) of a light group as attributes. Equal values stay untouched."""
    mesh, changed = rocks.data, False
    for term in range(baked_rocks.TERM_COUNT):
        name = f"{BAKED_ATTRIBUTES[group]}_{term}"
        there = mesh.attributes.get(name)
        if there is None:
            there = mesh.attributes.new(name, "FLOAT_VECTOR", "POINT")
        values = np.ascontiguousarray(numbers[:, term], np.float32)
        if not np.array_equal(_read_attribute(mesh, name, np.float32, 3), values):
            there.data.foreach_set("vector", values.ravel())
            changed = True
    if changed:
        mesh.update()


def _read_attribute(mesh: bpy.types.Mesh, name: str, kind: type, width: int) -> Array:
    """Read an attribute (n, width) of a mesh's points."""
    found: Array = np.empty(len(mesh.vertices) * width, kind)
    mesh.attributes[name].data.foreach_get("vector" if width == 3 else "value", found)
    return found.reshape(-1, width)


def _read_triangles(mesh: bpy.types.Mesh) -> tuple[Array, Array]:
    """Read the vertices (n, 3) and triangles (m, 3) of a mesh."""
    return read_vertices(mesh).astype(np.float64), read_corners(mesh).reshape(-1, 3)
