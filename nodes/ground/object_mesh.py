"""The mesh of an object as the 3D View shows it: modifiers applied, with its instances, in metres."""

from __future__ import annotations

import bpy
import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from .import_mesh import MAX_TRIANGLES, read_placed_triangles


def find_metres_per_unit(scene: bpy.types.Scene) -> float:
    """Metres per unit of length, as the scene shows lengths; 1 where it shows them without a unit."""
    units = scene.unit_settings
    return 1.0 if units.system == "NONE" else float(units.scale_length)


def read_object_mesh(
    item: bpy.types.Object, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph
) -> tuple[Array, Array]:
    """Vertices (n, 3), float64, in metres and world coordinates, and triangles (m, 3), int32, of an object and its
    instances.

    Raises IcyMoonError if they have no area, or more triangles than a ground may have.
    """
    positions, faces, vertices, triangles = [np.empty((0, 3))], [np.empty((0, 3), np.int32)], 0, 0
    for instance in depsgraph.object_instances:
        shown_by = instance.parent if instance.is_instance else instance.object
        if shown_by is None or shown_by.original != item or instance.object.type != "MESH":
            continue
        points, corners, _ = read_placed_triangles(instance)
        positions.append(points)
        faces.append(corners + np.int32(vertices))
        vertices, triangles = vertices + len(points), triangles + len(corners)
        if triangles > MAX_TRIANGLES:
            raise IcyMoonError(
                f"{item.name} has more than {MAX_TRIANGLES} triangles; leave some out, or make it coarser."
            )
    placed, corners = find_metres_per_unit(scene) * np.concatenate(positions), np.concatenate(faces)
    a, b, c = (placed[corners[:, k]] for k in range(3))
    if not np.any(np.cross(b - a, c - a)):
        raise IcyMoonError(f"{item.name} has no face with an area; choose an object with a surface.")
    return placed, corners
