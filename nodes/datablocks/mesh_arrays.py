"""Copies arrays into and out of meshes and other collections of Blender."""

from __future__ import annotations

from functools import partial

import bpy
import numpy as np
from numpy.typing import DTypeLike

from ...support.arrays import Array
from ...support.steps import Steps

#: Bytes of an array above which a thread allocates it and works on it. For the corners of three million triangles, each
#: takes 0.05 s.
LARGE_BYTES = 2**20


def read_property(
    items: bpy.types.bpy_prop_collection,
    name: str,
    kind: DTypeLike = np.float32,
    width: int = 1,
    memory: Array | None = None,
) -> Array:
    """Read one property of all items of a collection into an array; each item has ``width`` numbers. The array is in
    ``memory`` if that has its size."""
    count = len(items) * width
    values = memory if memory is not None and len(memory) == count else np.empty(count, kind)
    items.foreach_get(name, values)
    return values


def get_memory(count: int, kind: DTypeLike) -> Steps[Array]:
    """Get memory for an array of ``count`` numbers, in steps. A thread gets large memory, because the system takes
    longer to give it than Blender takes to copy the values."""
    memory = np.empty(count, kind)
    if memory.nbytes > LARGE_BYTES:
        yield partial(memory.fill, 0)
    return memory


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
