"""Reads the geometry of a mesh file by Blender's importers.

An importer runs in a scratch scene, never in the user's scene. Only vertices, faces and texture coordinates are kept.
Everything else that it makes (materials, images, cameras, collections) is removed, even if it fails.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import addon_utils
import bpy
import numpy as np

from ...formats import ply
from ...formats.mesh_checks import check_mesh
from ...formats.mesh_file import detect_kind, estimate_cost
from ...support import printer
from ...support.arrays import Array
from ...support.blender import compat
from ...support.errors import IcyMoonError
from ...support.system import bound_memory_and_time
from ..datablocks.mesh_arrays import read_property

#: Maximum number of triangles of a ground, with all copies of its meshes.
MAX_TRIANGLES = 50_000_000
#: Memory limit of an importer: a multiple of the estimated memory of the mesh, and additional bytes.
_MEMORY_FACTOR, _EXTRA_MEMORY_BYTES = 4, 2**31


def _list_data_blocks() -> set[Any]:
    """List all data-blocks of the open file."""
    return {
        block
        for prop in bpy.data.bl_rna.properties
        if prop.type == "COLLECTION"
        for block in getattr(bpy.data, prop.identifier)
    }


@contextlib.contextmanager
def open_scratch_scene() -> Iterator[bpy.types.Scene]:
    """Use a temporary scene as the context. The scene, and all data-blocks made meanwhile, are removed at the end."""
    before = _list_data_blocks()
    scene = bpy.data.scenes.new("Icy Moon Import")
    layer = scene.view_layers[0]
    try:
        with bpy.context.temp_override(
            scene=scene,
            view_layer=layer,
            collection=scene.collection,
            layer_collection=layer.layer_collection,
            active_object=None,
            object=None,
        ):
            yield scene
    finally:
        bpy.data.batch_remove(_list_data_blocks() - before)


@contextlib.contextmanager
def _enable_importer(kind: str, path: Path) -> Iterator[Any]:
    """Yield the import operator and its options, with its add-on enabled meanwhile.

    Raises IcyMoonError if this Blender has no such operator.
    """
    found, name = compat.find_mesh_importer(kind), compat.IMPORT_ADD_ONS.get(kind)
    enabled = False
    if found is None and name is not None:
        enabled = addon_utils.enable(name, default_set=False) is not None
        found = compat.find_mesh_importer(kind)
    try:
        if found is None:
            raise IcyMoonError(
                f"{path}: this Blender {bpy.app.version_string} cannot read {kind}; "
                "use an official build or export the mesh as PLY."
            )
        yield found
    finally:
        if enabled:
            addon_utils.disable(name, default_set=False)


def read_mesh(path: Path) -> tuple[Array, Array, Array | None]:
    """Read the vertices (n, 3) float64 and triangles (m, 3) int32 of all meshes in a file, and UV coordinates of the
    corners.

    UV coordinates (m, 3, 2) float32 are from the layer that is rendered. They are NaN for meshes without any, and None
    if no mesh has any. Vertices of OBJ, PLY and STL files keep their coordinates. Vertices of glTF, USD and FBX files
    are rotated to z up and scaled to metres as the headers state. Raises IcyMoonError if the file is missing, of the
    wrong kind, unreadable or without faces.
    """
    kind = detect_kind(path)
    check_mesh(path, kind)
    memory = int(estimate_cost(path).memory_mib * 2**20)
    # A window has no limit, because the user's other work in it needs memory too.
    limit = (
        bound_memory_and_time(_MEMORY_FACTOR * memory + _EXTRA_MEMORY_BYTES)
        if bpy.app.background
        else contextlib.nullcontext()
    )
    with _enable_importer(kind, path) as (operator, options), open_scratch_scene(), limit:
        try:
            operator("EXEC_DEFAULT", filepath=str(path), **options)
        except RuntimeError as error:
            printer.say("")  # the importer's report has no end of line, and a message follows
            raise IcyMoonError(
                f"{path}: Blender cannot read it as {kind} ({_find_last_error_line(error)}); export it again."
            ) from None
        positions, faces, uv = _read_geometry(path)
    if kind == "PLY":
        positions, uv = _read_as_written(path, positions, faces, uv)
    if not len(faces):
        fault = f"is a point cloud of {len(positions)} points" if len(positions) else "contains no mesh"
        raise IcyMoonError(f"{path}: {fault}; choose a mesh with faces.")
    return positions, faces, uv


def _read_as_written(path: Path, positions: Array, faces: Array, uv: Array | None) -> tuple[Array, Array | None]:
    """Read the vertices and UV coordinates of a PLY file in full precision. If this fails, or if their number differs
    from Blender's import, return the given ones."""
    try:
        written = ply.read_vertices(path)
        if written is None or written.shape != positions.shape:
            return positions, uv
        written_uv = ply.read_texture_coordinates(path, faces)
    except (ValueError, IndexError):
        return positions, uv
    return written, uv if written_uv is None else written_uv.astype(np.float32)


def _find_last_error_line(error: Exception) -> str:
    lines = [line.removeprefix("Error: ").strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1].rstrip(".") if lines else type(error).__name__


def _read_corners_uv(mesh: bpy.types.Mesh, loops: Array) -> Array | None:
    """Return UV coordinates (m, 3, 2) of the corners (m, 3) of triangles in the rendered layer; None if there is no
    layer."""
    layer = next((each for each in mesh.uv_layers if each.active_render), None)
    if layer is None:
        return None
    values = np.empty(2 * len(mesh.loops), np.float32)
    mesh.attributes[layer.name].data.foreach_get("vector", values)
    return values.reshape(-1, 2)[loops]


@dataclass(frozen=True)
class PlacedMesh:
    """The arrays of an instance of a mesh: positions (n, 3) float32 in its coordinates, the vertices of its corners
    (k,) and the corners of its triangles (m, 3) int32, and its matrix (4, 4) to the world."""

    positions: Array
    vertices: Array
    corners: Array
    matrix: Array

    @classmethod
    def read(cls, instance: bpy.types.DepsgraphObjectInstance) -> Self:
        """Read an instance of a mesh. Whole arrays are copied, because reading vertex by vertex takes Blender 20 times
        as long."""
        mesh = instance.object.data
        mesh.calc_loop_triangles()
        corners = read_property(mesh.loop_triangles, "loops", np.int32, 3).reshape(-1, 3)
        if not len(mesh.vertices):
            return cls(np.empty((0, 3), np.float32), np.empty(0, np.int32), corners, np.eye(4))
        positions = read_property(mesh.attributes["position"].data, "vector", width=3).reshape(-1, 3)
        vertices = np.empty(0, np.int32)
        if len(corners):
            vertices = read_property(mesh.attributes[".corner_vert"].data, "value", np.int32)
        return cls(positions, vertices, corners, np.array(instance.matrix_world, np.float64))

    def place(self) -> tuple[Array, Array, Array]:
        """Return the vertices (n, 3) float64 in world coordinates, and the vertices and corners (m, 3) of the
        triangles. Any thread may call this. A mirrored instance shows its other side, so its triangles are reversed."""
        triangles, corners, turned = self.vertices[self.corners], self.corners, self.matrix[:3, :3]
        if np.linalg.det(turned) < 0:
            triangles, corners = triangles[:, ::-1], corners[:, ::-1]
        return self.positions.astype(np.float64) @ turned.T + self.matrix[:3, 3], triangles, corners


def _read_geometry(path: Path) -> tuple[Array, Array, Array | None]:
    """Read all visible meshes of the context's scene as one, with instances and transforms applied; see
    ``read_mesh``."""
    bpy.context.view_layer.update()
    positions, faces, offset, count = [np.empty((0, 3))], [np.empty((0, 3), np.int32)], 0, 0
    uvs: list[tuple[int, Array | None]] = []
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.object.type != "MESH":
            continue
        mesh = instance.object.data
        points, triangles, loops = PlacedMesh.read(instance).place()
        uvs.append((len(triangles), _read_corners_uv(mesh, loops)))
        positions.append(points)
        faces.append(triangles + np.int32(offset))
        offset += len(mesh.vertices)
        count += len(triangles)
        if count > MAX_TRIANGLES:  # a small file may show one mesh many times
            raise IcyMoonError(
                f"{path}: has more than {MAX_TRIANGLES} triangles with all its copies; leave some "
                "out, or make it coarser."
            )
    uv = None
    if any(each is not None for _, each in uvs):
        uv = np.concatenate([np.full((n, 3, 2), np.nan, np.float32) if each is None else each for n, each in uvs])
    return np.concatenate(positions), np.concatenate(faces), uv
