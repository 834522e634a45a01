"""Reads the mesh of an object as the 3D View shows it: modifiers applied, with its instances, in metres."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..datablocks.mesh_arrays import read_property
from .import_mesh import MAX_TRIANGLES, PlacedMesh


def find_metres_per_unit(scene: bpy.types.Scene) -> float:
    """Return the metres per unit of length, as the scene shows lengths; 1 where it shows them without a unit."""
    units = scene.unit_settings
    return 1.0 if units.system == "NONE" else float(units.scale_length)


def is_shaded_flat(item: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    """Return whether most faces of an object, with its modifiers, are shaded flat; False for an object without a
    mesh."""
    if item.type != "MESH":
        return False
    mesh = item.evaluated_get(depsgraph).data
    sharp = mesh.attributes.get("sharp_face")  # Blender keeps none where all faces are smooth
    if sharp is None or not len(mesh.polygons):
        return False
    return bool(read_property(sharp.data, "value", np.bool_).mean() > 0.5)


def read_object_mesh(
    item: bpy.types.Object, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph
) -> tuple[Array, Array]:
    """Read the mesh of an object and its instances, see ``join_meshes``."""
    return join_meshes(read_placed_meshes(item, depsgraph), find_metres_per_unit(scene), item.name)


def read_placed_meshes(item: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> list[PlacedMesh]:
    """Read the meshes of an object and of its instances. Raises IcyMoonError if they have more triangles than a ground
    may have."""
    found, triangles = list[PlacedMesh](), 0
    for instance in depsgraph.object_instances:
        shown_by = instance.parent if instance.is_instance else instance.object
        if shown_by is None or shown_by.original != item or instance.object.type != "MESH":
            continue
        found.append(PlacedMesh.read(instance))
        triangles += len(found[-1].corners)
        if triangles > MAX_TRIANGLES:
            raise IcyMoonError(
                f"{item.name} has more than {MAX_TRIANGLES} triangles; leave some out, or make it coarser."
            )
    return found


def join_meshes(meshes: Sequence[PlacedMesh], unit_m: float, name: str) -> tuple[Array, Array]:
    """Join the meshes of the object of this ``name``, where a unit of length is ``unit_m``. Returns vertices (n, 3),
    float64, in metres and world coordinates, and triangles (m, 3), int32. Any thread may call this.

    Raises IcyMoonError if the triangles have no area.
    """
    positions, faces, vertices = [np.empty((0, 3))], [np.empty((0, 3), np.int32)], 0
    for mesh in meshes:
        points, corners, _ = mesh.place()
        positions.append(points)
        faces.append(corners + np.int32(vertices))
        vertices += len(points)
    placed, corners = unit_m * np.concatenate(positions), np.concatenate(faces)
    a, b, c = (placed[corners[:, k]] for k in range(3))
    if not np.any(np.cross(b - a, c - a)):
        raise IcyMoonError(f"{name} has no face with an area; choose an object with a surface.")
    return placed, corners
