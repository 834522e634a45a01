"""Stores the edges of a mesh apart from it, so that a large ground can be read from a file in pieces.

Blender reads a ground of three million triangles in one call, in 0.17 s. Half of its bytes are edges and the edges of
corners. They come from a separate file, which any thread can read, and are given to the mesh array by array.
"""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ...support.arrays import Array
from ...support.steps import Steps
from ..datablocks.array_marks import READERS_BY_TYPE
from ..datablocks.mesh_arrays import read_property

_VERTICES, _OF_CORNERS = ".edge_verts", ".corner_edge"
#: Attributes that Blender adds with vertices, edges and faces.
_SELECTIONS = (".select_vert", ".select_edge", ".select_poly")


def take_edges(ground: bpy.types.Object) -> dict[str, Array]:
    """Remove the edges of an object's mesh with their attributes, and return their arrays for ``give_edges``. Do not
    use the mesh in between.

    A mesh with vertex groups, shape keys, custom normals or attributes of unknown types stays as it is; then the result
    is empty.
    """
    mesh: bpy.types.Mesh = ground.data
    attributes = [each for each in mesh.attributes if each.name not in _SELECTIONS]
    plain = not (mesh.shape_keys or mesh.has_custom_normals or ground.vertex_groups)
    if not plain or any(each.data_type not in READERS_BY_TYPE for each in attributes):
        return {}
    edges, others = dict[str, Array](), list[tuple[str, str, str, Array]]()
    for each in attributes:
        dtype, key, width = READERS_BY_TYPE[each.data_type]
        values = read_property(each.data, key, dtype, width)
        if each.domain == "EDGE" or each.name == _OF_CORNERS:
            edges[f"{each.data_type} {each.name}"] = values
        else:
            others.append((each.name, each.data_type, each.domain, values))
    _fill_without_edges(mesh, others)
    return edges


def _fill_without_edges(mesh: bpy.types.Mesh, attributes: list[tuple[str, str, str, Array]]) -> None:
    """Give a mesh its geometry and attributes (name, type, domain, values) again, without edges."""
    sizes = len(mesh.vertices), len(mesh.loops), len(mesh.polygons)
    starts = read_property(mesh.polygons, "loop_start", np.int32)
    colours = mesh.attributes.active_color_name, mesh.attributes.default_color_name
    mesh.clear_geometry()
    for items, count in zip((mesh.vertices, mesh.loops, mesh.polygons), sizes, strict=True):
        items.add(count)
    mesh.polygons.foreach_set("loop_start", starts)
    for name, kind, domain, values in attributes:
        _set_attribute(mesh, name, kind, domain, values)
    for key, name in zip(("active_color_name", "default_color_name"), colours, strict=True):
        if name:
            setattr(mesh.attributes, key, name)
    for name in _SELECTIONS:
        if name in mesh.attributes:
            mesh.attributes.remove(mesh.attributes[name])


def _set_attribute(mesh: bpy.types.Mesh, name: str, kind: str, domain: str, values: Array) -> None:
    attribute = mesh.attributes.get(name) or mesh.attributes.new(name, kind, domain)
    attribute.data.foreach_set(READERS_BY_TYPE[kind][1], values)


def give_edges(mesh: bpy.types.Mesh, edges: dict[str, Array]) -> Steps[None]:
    """Give a mesh the edges that ``take_edges`` has taken, in steps."""
    if not edges:
        return
    mesh.edges.add(len(edges[f"INT32_2D {_VERTICES}"]) // 2)
    yield None
    for key, values in edges.items():
        kind, _, name = key.partition(" ")
        _set_attribute(mesh, name, kind, "CORNER" if name == _OF_CORNERS else "EDGE", values)
        yield None
    mesh.update()


def write_edges(edges: dict[str, Array], path: Path) -> None:
    """Write the arrays that ``take_edges`` returns to a file."""
    with path.open("wb") as file:
        np.savez(file, **edges)


def read_edges(path: Path) -> dict[str, Array]:
    """Read the arrays that ``write_edges`` has written; any thread may call this."""
    with np.load(path, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}
