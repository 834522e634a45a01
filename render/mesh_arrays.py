"""Reads the meshes that renders show into arrays. Attributes are copied as a whole, which is faster than Blender's
properties of each facet."""

from __future__ import annotations

import bpy
import numpy as np

from ..support.arrays import Array


def is_rendered(found: bpy.types.DepsgraphObjectInstance) -> bool:
    """Return whether renders show an instance of an evaluated scene, because both its object and its instancer are
    visible."""
    shown = [found.object, *([found.parent] if found.parent is not None else [])]
    return bool(found.show_self) and not any(item.original.hide_render for item in shown)


def read_vertices(mesh: bpy.types.Mesh) -> Array:
    """Read the vertices (n, 3) float32 of a mesh."""
    vertices = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", vertices)
    return vertices.reshape(-1, 3)


def read_corners(mesh: bpy.types.Mesh) -> Array:
    """Read the vertex (k,) int32 of each corner of a facet of a mesh."""
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.attributes[".corner_vert"].data.foreach_get("value", corners)
    return corners


def read_vertex_normals(mesh: bpy.types.Mesh) -> Array:
    """Read the normals (n, 3) float32 of the vertices of a mesh."""
    normals = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertex_normals.foreach_get("vector", normals)
    return normals.reshape(-1, 3)


def read_corner_normals(mesh: bpy.types.Mesh) -> Array:
    """Read the normals (k, 3) float32 of the corners of facets of a mesh, which differ at a vertex of flat facets."""
    normals = np.empty(3 * len(mesh.loops), np.float32)
    mesh.corner_normals.foreach_get("vector", normals)
    return normals.reshape(-1, 3)


def read_triangles(mesh: bpy.types.Mesh) -> tuple[Array, Array]:
    """Read the corners (m, 3) of the rendered triangles of a mesh, and the facet (m,) of each triangle."""
    mesh.calc_loop_triangles()
    loops, facets = np.empty(3 * len(mesh.loop_triangles), np.int32), np.empty(len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("loops", loops)
    mesh.loop_triangle_polygons.foreach_get("value", facets)
    return loops.reshape(-1, 3), facets


def read_smooth_shading(mesh: bpy.types.Mesh) -> Array:
    """Read the facets of a mesh that are shaded smoothly, as bool (n,)."""
    return ~_read_facets(mesh, "sharp_face", bool)


def read_material_slots(mesh: bpy.types.Mesh) -> Array:
    """Read the material slot (n,) int32 of each facet of a mesh."""
    return _read_facets(mesh, "material_index", np.int32)


def _read_facets(mesh: bpy.types.Mesh, name: str, kind: type) -> Array:
    """Read the values (n,) of an attribute of facets; 0 if the mesh lacks it."""
    values: Array = np.zeros(len(mesh.polygons), kind)
    attribute = mesh.attributes.get(name)
    if attribute is not None:
        attribute.data.foreach_get("value", values)
    return values
