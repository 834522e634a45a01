"""The program that writes the geometry of pairs, for other renderers, in a Blender of its own.

    __main__.py geometry JOB.json FOLDER

The job is that of ``worker``. For each of its pairs, the folder of its id gets ``geometry.json`` and a PLY file of each
kind of object, as Cycles gets it: evaluated, in the world, as triangles with the normals that shading uses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..errors import IcyMoonError
from ..files import write_json
from ..formats.ply import write_triangles
from ..labels import PLANET, SEMANTIC
from ..nodes.scene import Built
from .scene_source import ScenesFromSettings
from .worker import pairs_of_job, run_to_exit
from .workers.job import read_job
from .workers.process import emit

_NO_MEMORY = "There is not enough memory to write the geometry; close other programs, or make the ground coarser."


class _Triangles:
    """Triangles that are collected: positions and normals (n, 3), and indices (m, 3)."""

    def __init__(self) -> None:
        self._parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._count = 0

    def add(self, vertices: np.ndarray, normals: np.ndarray, triangles: np.ndarray) -> None:
        self._parts.append((vertices, normals, triangles + self._count))
        self._count += len(vertices)

    def write(self, path: Path) -> int:
        """Write all as a PLY file; the number of triangles."""
        vertices, normals, triangles = (np.concatenate(parts) for parts in zip(*self._parts, strict=True))
        write_triangles(path, vertices, triangles, normals)
        return len(triangles)


def mesh_triangles(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions and shading normals (n, 3) of a mesh, and its triangles (m, 3), in its own coordinates.

    Vertices are shared where the surface is smooth. Otherwise each corner of a triangle has a vertex of its own.
    """
    mesh.calc_loop_triangles()
    loops = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("loops", loops)
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    positions, smooth, split = (np.empty(3 * count, np.float32) for count in (
        len(mesh.vertices), len(mesh.vertices), len(mesh.loops)))
    mesh.vertices.foreach_get("co", positions)
    mesh.vertex_normals.foreach_get("vector", smooth)
    mesh.corner_normals.foreach_get("vector", split)
    positions, smooth, split = (values.reshape(-1, 3) for values in (positions, smooth, split))
    if np.allclose(smooth[corners], split, atol=1e-4):
        return positions, smooth, corners[loops].reshape(-1, 3)
    return positions[corners[loops]], split[loops], np.arange(len(loops), dtype=np.int32).reshape(-1, 3)


def _instances(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.Object, np.ndarray]]:
    """Evaluated objects with a mesh that a render shows, and their matrices (4, 4)."""
    for found in scene.view_layers[0].depsgraph.object_instances:
        item = found.object
        if found.show_self and item.type == "MESH" and len(item.data.polygons) and not item.original.hide_render:
            yield item, np.array(found.matrix_world, np.float64)


def _label(mesh: bpy.types.Mesh) -> int:
    material = next((each for each in mesh.materials if each is not None), None)
    return material.pass_index if material is not None else 0


def write_geometry(built: Built, scene: bpy.types.Scene, folder: Path) -> dict[str, Any]:
    """Write the meshes of a built scene that ``scene`` renders; what ``geometry.json`` contains.

    The planet, its rings and stars are left out: they are no geometry of the site. Relief that only a material has is
    left out too, and named under ``left_out``.
    """
    scene.view_layers[0].update()
    kinds: dict[str, _Triangles] = {}
    known: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
    for item, matrix in _instances(scene):
        label = _label(item.data)
        if label == PLANET or item.original.get("icymoon") in ("planet", "rings", "stars"):
            continue
        if item.data.name_full not in known:
            known[item.data.name_full] = mesh_triangles(item.data)
        vertices, normals, triangles = known[item.data.name_full]
        turned = normals @ np.linalg.inv(matrix[:3, :3])  # rows times the inverse: normals by its transpose
        turned = turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-12)
        if np.linalg.det(matrix[:3, :3]) < 0:
            triangles = triangles[:, ::-1]
        kinds.setdefault(SEMANTIC.get(label, "other") if label else "other", _Triangles()).add(
            vertices @ matrix[:3, :3].T + matrix[:3, 3], turned, triangles)
    if not kinds:
        raise IcyMoonError("The scene has no meshes to write; build a ground first.")
    relief = built.settings.surface.grain_amplitude_m > 0
    facts = {"meshes": {kind: {"file": f"{kind}.ply", "triangles": found.write(folder / f"{kind}.ply")}
                        for kind, found in kinds.items()},
             "left_out": ["surface.grain_amplitude_m: relief that is finer than the mesh"] if relief else []}
    write_json(folder / "geometry.json", facts)
    return facts


def run_job(job: dict[str, Any], folder: Path, send: Callable[..., None] = emit) -> None:
    """Write the geometry of each pair of a job. Raises IcyMoonError for what a user can fix."""
    if job.get("blend"):
        raise IcyMoonError("The geometry of a scene in a .blend file cannot be written; give settings or pairs.")
    pairs = pairs_of_job(job)
    with ScenesFromSettings(lambda warning: send("warning", message=warning)) as source:
        for k, planned in enumerate(pairs):
            send("progress", fraction=k / len(pairs), message=f"Geometry {k + 1} of {len(pairs)}")
            built, scene, _ = source.prepare(planned)
            write_geometry(built, scene, folder / planned.id)
    send("done", folders=[str(folder / planned.id) for planned in pairs])


def main(arguments: list[str]) -> int:
    """Run the job in a file, the first argument, into a folder, the second, and end the process."""
    job, folder = Path(arguments[0]), Path(arguments[1])
    run_to_exit(lambda: run_job(read_job(job), folder), lambda: _NO_MEMORY)
