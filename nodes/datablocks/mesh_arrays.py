"""Arrays into and out of meshes and other collections of Blender."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import DTypeLike

from ...support.arrays import Array


def read_property(
    items: bpy.types.bpy_prop_collection, name: str, kind: DTypeLike = np.float32, width: int = 1
) -> Array:
    """An array of one property of all items of a collection; each item has ``width`` numbers."""
    values = np.empty(len(items) * width, kind)
    items.foreach_get(name, values)
    return values


def fill_with_polygons(mesh: bpy.types.Mesh, positions: Array, corners: Array, sizes: Array) -> None:
    """Give an empty mesh vertices at positions (n, 3), and polygons of ``sizes`` (m,) corners, one after the other."""
    mesh.vertices.add(len(positions))
    mesh.loops.add(len(corners))
    mesh.polygons.add(len(sizes))
    mesh.attributes["position"].data.foreach_set("vector", np.ascontiguousarray(positions, np.float32).ravel())
    # loops.foreach_set("vertex_index") does the same, but takes a third of a second for each million triangles.
    mesh.attributes[".corner_vert"].data.foreach_set("value", np.ascontiguousarray(corners, np.int32))
    mesh.polygons.foreach_set("loop_start", (np.cumsum(sizes) - sizes).astype(np.int32))
    mesh.update(calc_edges=True)
