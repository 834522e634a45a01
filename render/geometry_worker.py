"""The program that writes the geometry of pairs, for other renderers, in a Blender of its own.

    __main__.py geometry JOB.json FOLDER [FORMAT [CELL_M]]

The job is that of ``worker``. For each of its pairs, the folder of its id gets ``geometry.json`` and, by the format,
meshes of each kind of object (``ply``, ``obj``, ``usd``), as Cycles gets them: evaluated, in the world, as triangles
with the normals that shading uses; or maps (``dem``), see ``ground_files``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..errors import IcyMoonError
from ..files import explain_disk_errors, write_json
from ..labels import PLANET, SEMANTIC
from ..nodes.datablocks.blend_file_paths import content
from ..nodes.scene import Built, extra
from ..nodes.surface.reflectance_laws import OF_NODES
from ..physics.camera.blur import blur_identity
from ..physics.scene_requirements import surface_topics
from ..physics.surfaces import principled
from ..settings.description import digest, merged
from ..support.printer import emit
from ..typed_settings import Settings
from .ground_files import Triangles, frame_facts, write_map, write_meshes
from .ground_maps import make_ground_map
from .plans.planned_pair import PlannedPair
from .scene_source import ScenesFromSettings
from .worker import pairs_of_job, run_to_exit
from .workers.job import read_job

_NO_MEMORY = "There is not enough memory to write the geometry; close other programs, or make the ground coarser."


class _Triangles:
    """Triangles that are collected: positions and normals (n, 3), and indices (m, 3)."""

    def __init__(self) -> None:
        self._parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._count = 0

    def add(self, vertices: np.ndarray, normals: np.ndarray, triangles: np.ndarray) -> None:
        self._parts.append((vertices, normals, triangles + self._count))
        self._count += len(vertices)

    def join(self) -> Triangles:
        """All as one mesh."""
        vertices, normals, triangles = (np.concatenate(parts) for parts in zip(*self._parts, strict=True))
        return vertices, normals, triangles


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


def write_geometry(built: Built, scene: bpy.types.Scene, folder: Path, kind: str = "ply",
                   cell_m: float | None = None) -> dict[str, Any]:
    """Write the ground of a built scene that ``scene`` renders in a format; what ``geometry.json`` contains.

    The planet, its rings and stars are left out: they are no geometry of the site. Relief that only a material has is
    left out of meshes too, and named under ``left_out``.
    """
    facts = frame_facts(built.settings)
    if kind == "dem":
        made = make_ground_map(built, scene, folder, cell_m)
        facts |= write_map(made, built.settings, folder) | {"left_out": _left_out_of_maps(built.settings)}
    else:
        kinds = _collect(scene)
        names = write_meshes(kinds, kind, built.settings, folder)
        relief = built.settings.surface.grain_amplitude_m > 0
        facts |= {"files": names, "meshes": {each: {"triangles": len(mesh[2])} for each, mesh in kinds.items()},
                  "left_out": ["surface.grain_amplitude_m: relief that is finer than the mesh"] if relief else []}
    write_json(folder / "geometry.json", facts)
    return facts


def _left_out_of_maps(settings: Settings) -> list[str]:
    """What the maps do not have of what is rendered, a sentence each."""
    found = []
    if settings.surface.grain_amplitude_m > 0 and settings.surface.relief != "DISPLACEMENT":
        found.append("surface.grain_amplitude_m: relief where it is shading only, as it is where the mesh is coarser")
    if settings.rocks.coverage > 0 and any(principled.lets_light_through(settings[topic])
                                           for topic in surface_topics(settings)):
        found.append("clear ice: such rocks have the albedo of the rest of their ice")
    return found


def _collect(scene: bpy.types.Scene) -> dict[str, Triangles]:
    """The meshes that ``scene`` renders, in the world, by kind. Raises IcyMoonError if there are none."""
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
    return {kind: found.join() for kind, found in kinds.items()}


@contextmanager
def _own_folder(folder: Path) -> Iterator[Path]:
    """The folder of a pair, which does not stay if it gets no file."""
    with explain_disk_errors("write to", folder):
        folder.mkdir(parents=True, exist_ok=True)
    try:
        yield folder
    finally:
        with suppress(OSError):  # it has files
            folder.rmdir()


def _without_quality(planned: PlannedPair) -> PlannedPair:
    """The same ground, asked for so that any Blender can make it: without denoiser, graphics card and OSL.

    A pair that is not what its id names, as where a file has changed, stays as it is, and is refused as in a render.
    """
    settings = planned.settings
    known = (digest(settings, content(settings) + nodes + blur_identity(settings)) for nodes in ("", OF_NODES))
    if planned.id not in known:
        return planned
    plain = merged(settings, {"quality": {"denoiser": "NONE", "device": "CPU"}, "hapke": {"backend": "AUTO"}})
    return PlannedPair(digest(plain, extra(plain) + blur_identity(plain)), plain, 0.0)


def run_job(job: dict[str, Any], folder: Path, send: Callable[..., None] = emit, kind: str = "ply",
            cell_m: float | None = None) -> None:
    """Write the ground of each pair of a job in a format. Raises IcyMoonError for what a user can fix."""
    if job.get("blend"):
        raise IcyMoonError("The geometry of a scene in a .blend file cannot be written; give settings or pairs.")
    pairs = pairs_of_job(job)
    with ScenesFromSettings(lambda warning: send("warning", message=warning)) as source:
        for k, planned in enumerate(pairs):
            send("progress", fraction=k / len(pairs), message=f"Geometry {k + 1} of {len(pairs)}")
            built, scene, _ = source.prepare(_without_quality(planned))
            with _own_folder(folder / planned.id) as own:
                write_geometry(built, scene, own, kind, cell_m)
    send("done", folders=[str(folder / planned.id) for planned in pairs])


def main(arguments: list[str]) -> int:
    """Run the job in a file, the first argument, into a folder, the second, and end the process; the third is the
    format, the fourth the size of a cell in metres."""
    job, folder, kind = Path(arguments[0]), Path(arguments[1]), (arguments[2:3] or ["ply"])[0]
    cell_m = float(arguments[3]) if len(arguments) > 3 else None
    run_to_exit(lambda: run_job(read_job(job), folder, emit, kind, cell_m), lambda: _NO_MEMORY)
