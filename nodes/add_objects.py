"""Builds a patch of ground or a rock as an ordinary mesh object, which Build Scene and Clear Scene do not change."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from ..physics.rocks.own_rock import find_rock_shapes
from ..physics.terrain.terrain import make_terrain as make_terrain
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from . import check_cycles
from .datablocks.blend_file_paths import make_paths_absolute
from .ground.terrain_mesh import build_mesh, build_mesh_from_arrays
from .surface.ground_and_rock_materials import build_ground_material, build_rock_material
from .surface.patches_and_grain import mark_elevation
from .surface.sheltered_ground import mark_shelter


def build_terrain_object(settings: Settings) -> bpy.types.Object:
    """Build the procedural ground of the settings as a grid; the caller links it to a scene.

    Raises IcyMoonError if Cycles is off or a texture of its material is not available.
    """
    check_cycles.require_cycles()
    ground = make_terrain(settings, int(settings.dataset.seed), with_skirts=False)  # because it has no rocks
    mesh = build_mesh("Icy Terrain", settings.terrain, ground)
    mark_elevation(mesh, settings.surface)
    mark_shelter(mesh, settings)
    return _build_object(mesh, lambda: build_ground_material(settings, mesh))


def build_rock_object(settings: Settings, diameter_m: float) -> bpy.types.Object:
    """Build one rock of the shape in the settings, with its origin at its bottom; the caller links it to a scene.

    ``diameter_m`` is the diameter in metres of the circle that has the rock's area as seen from above. Raises
    IcyMoonError if Cycles is off or a texture of its material is not available.
    """
    check_cycles.require_cycles()
    rocks = make_paths_absolute(settings).rocks
    shape = find_rock_shapes(rocks, int(settings.dataset.seed))[0][0]
    long = float(np.sqrt(max(rocks.elongation, 1.0)))
    scale = diameter_m * np.array([long, 1.0 / long, shape.height * rocks.height_ratio])
    vertices = (shape.vertices - [0.0, 0.0, shape.vertices[:, 2].min()]) * scale
    mesh = build_mesh_from_arrays("Ice Rock", vertices.astype(np.float32), shape.triangles)
    mesh.polygons.foreach_set("use_smooth", ~shape.plane)
    return _build_object(mesh, lambda: build_rock_material(settings, mesh))


def _build_object(mesh: bpy.types.Mesh, make: Callable[[], bpy.types.Material]) -> bpy.types.Object:
    try:
        mesh.materials.append(make())
    except IcyMoonError:  # an image that cannot be read
        bpy.data.meshes.remove(mesh)
        raise
    return bpy.data.objects.new(mesh.name, mesh)
