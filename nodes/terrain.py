"""The ground as a mesh: a uniform grid over the patch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy
import numpy as np

from ..physics.terrain import Terrain


def vertex_spacing_m(terrain: Mapping[str, Any]) -> float:
    """Distance between neighbouring vertices of the grid in metres."""
    return terrain["size_m"] / (terrain["resolution"] - 1)


def shortest_wavelength_m(terrain: Mapping[str, Any]) -> float:
    """Shortest wavelength in metres that the grid carries: two vertex spacings."""
    return 2 * vertex_spacing_m(terrain)


def build_mesh(name: str, terrain: Mapping[str, Any], ground: Terrain) -> bpy.types.Mesh:
    """A smooth-shaded grid mesh of ``ground`` from ``terrain`` settings, centred on the origin.

    Raises ValueError if a height is not finite.
    """
    n = int(terrain["resolution"])
    axis = np.linspace(-terrain["size_m"] / 2, terrain["size_m"] / 2, n)
    heights = ground.heights(axis[None, :], axis[:, None], shortest_wavelength_m(terrain))
    if not np.isfinite(heights).all():
        raise ValueError("terrain heights are not finite")
    positions = np.empty((n, n, 3), np.float32)
    positions[..., 0], positions[..., 1], positions[..., 2] = axis[None, :], axis[:, None], heights
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)[None, :]).ravel()
    faces = np.stack([corner, corner + 1, corner + n + 1, corner + n], axis=1).astype(np.int32)
    return mesh_from_arrays(name, positions.reshape(-1, 3), faces)


def mesh_from_arrays(name: str, positions: np.ndarray, faces: np.ndarray) -> bpy.types.Mesh:
    """A smooth-shaded mesh from float32 positions (n, 3) and int32 faces (m, corners per face)."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(positions))
    mesh.loops.add(faces.size)
    mesh.polygons.add(len(faces))
    mesh.attributes["position"].data.foreach_set("vector", np.ascontiguousarray(positions, np.float32).ravel())
    mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(faces, np.int32).ravel())
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, faces.shape[1], dtype=np.int32))
    mesh.update(calc_edges=True)
    mesh.shade_smooth()
    return mesh
