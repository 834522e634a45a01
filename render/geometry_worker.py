"""The program that writes the geometry of pairs, for other renderers, in a separate Blender.

    __main__.py geometry JOB.json FOLDER [FORMAT [CELL_M]]

The job is a job of ``worker``. For each of its pairs, the folder of its id gets ``geometry.json`` and, by the format,
meshes of each kind of object (``ply``, ``obj``, ``usd``, ``gltf``), as Cycles traces them: evaluated, as triangles,
with the vertices where displacement moves them, and with normals for shading; or maps (``dem``), see ``ground_files``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..formats.placed_meshes import PlacedMesh, group_by_kind
from ..nodes.build_scene import Built, make_build_facts
from ..nodes.datablocks.blend_file_paths import hash_content
from ..nodes.surface.reflectance_laws import OF_NODES
from ..physics.camera.blur import describe_blur_identity
from ..physics.mesh.finer_in_view import find_undisplaced_spacing_m
from ..physics.scene_requirements import surface_topics
from ..physics.surfaces import principled
from ..settings.description import merged
from ..settings.pair_ids import make_pair_id
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.files import explain_disk_errors, write_json
from ..support.labels import PLANET, SEMANTIC_NAMES, SKY_TAGS
from ..support.printer import emit
from .displaced_vertices import is_moved, open_rendered_mesh
from .ground_files import make_frame_facts, refuse_too_many_triangles, write_map, write_meshes
from .ground_maps import make_ground_map
from .mesh_arrays import (
    is_rendered,
    read_corner_normals,
    read_corners,
    read_triangles,
    read_vertex_normals,
    read_vertices,
)
from .plans.planned_pair import PlannedPair
from .scene_source import ScenesFromSettings
from .worker import list_job_pairs, run_to_exit
from .workers.job_commands import read_job

#: Positions and normals (n, 3) and triangles (m, 3) of a mesh.
Triangles = tuple[Array, Array, Array]
_NO_MEMORY_MESSAGE = (
    "There is not enough memory to write the geometry; close other programs, or make the ground coarser."
)


def read_mesh_triangles(mesh: bpy.types.Mesh) -> Triangles:
    """Read the positions and shading normals (n, 3) of a mesh, and its triangles (m, 3), in its own coordinates.

    Triangles share a vertex where the surface is smooth. Elsewhere each corner of a triangle has its own vertex.
    """
    loops, corners, positions = read_triangles(mesh)[0].ravel(), read_corners(mesh), read_vertices(mesh)
    smooth, split = read_vertex_normals(mesh), read_corner_normals(mesh)
    alone = (np.abs(smooth[corners] - split) > 1e-4).any(axis=1)[loops]
    used = np.zeros(len(positions), bool)
    used[corners[loops[~alone]]] = True
    index = (np.cumsum(used, dtype=np.int32) - 1)[corners[loops]]
    index[alone] = used.sum() + np.arange(alone.sum())
    own = loops[alone]
    return (
        np.concatenate([positions[used], positions[corners[own]]]),
        np.concatenate([smooth[used], split[own]]),
        index.reshape(-1, 3),
    )


@dataclass
class _FoundMesh:
    """A mesh in a render: kind of object, number of vertices and of triangles, matrices of its instances."""

    kind: str
    vertices: int
    triangles: int
    places: list[Array]


def _list_instances(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.Object, bpy.types.DepsgraphObjectInstance]]:
    """Yield the evaluated objects of the site that have a mesh and are shown by renders, with their instances."""
    for found in scene.view_layers[0].depsgraph.object_instances:
        item = found.object
        if (
            is_rendered(found)
            and item.type == "MESH"
            and len(item.data.polygons)
            and _find_label(item.data) != PLANET
            and item.original.get("icymoon") not in SKY_TAGS
        ):
            yield item, found


def _find_label(mesh: bpy.types.Mesh) -> int:
    material = next((each for each in mesh.materials if each is not None), None)
    return material.pass_index if material is not None else 0


def write_geometry(
    built: Built, scene: bpy.types.Scene, folder: Path, kind: str = "ply", cell_m: float | None = None
) -> dict[str, Any]:
    """Write the ground that ``scene`` renders in a format, and return the content of ``geometry.json``.

    The planet, its rings and stars are left out, since they are not part of the site. ``left_out`` names the relief
    that is shading only, which depth maps lack too.
    """
    facts = make_frame_facts(built.settings, built.ground)
    if kind == "dem":
        made = make_ground_map(built, scene, folder, cell_m)
        facts |= write_map(made, built.settings, built.ground, folder) | {
            "left_out": _list_map_omissions(built.settings)
        }
    else:
        meshes = _collect_meshes(scene, kind, built.settings)
        names = write_meshes(meshes, kind, built.settings, folder)
        facts |= {
            "files": names,
            "meshes": {each: _count_triangles(own) for each, own in group_by_kind(meshes).items()},
            "left_out": _list_mesh_omissions(built.settings),
        }
    write_json(folder / "geometry.json", facts)
    return facts


def _count_triangles(meshes: Sequence[PlacedMesh]) -> dict[str, int]:
    """Count the rendered triangles, the distinct meshes (``shapes``) and their ``instances``."""
    return {
        "triangles": sum(len(mesh.triangles) * len(mesh.places) for mesh in meshes),
        "shapes": len(meshes),
        "instances": sum(len(mesh.places) for mesh in meshes),
    }


def _list_mesh_omissions(settings: Settings) -> list[str]:
    """List the rendered details that meshes lack, one sentence each."""
    if settings.surface.grain_amplitude_m > 0 and settings.surface.relief != "DISPLACEMENT":
        return [
            "surface.grain_amplitude_m: relief that is shading only, where the mesh is coarser than the relief; "
            "the true depth lacks it too"
        ]
    return []


def _list_map_omissions(settings: Settings) -> list[str]:
    """List the rendered details that maps lack, one sentence each."""
    found = _list_mesh_omissions(settings)
    if settings.rocks.coverage > 0 and any(
        principled.lets_light_through(settings[topic]) for topic in surface_topics(settings)
    ):
        found.append("clear ice: such rocks have the albedo of their other ice")
    return found


def _collect_meshes(scene: bpy.types.Scene, suffix: str, settings: Settings) -> list[PlacedMesh]:
    """Collect the meshes that ``scene`` renders, with their instances. Raises IcyMoonError without a mesh, and for more
    triangles than a file of this suffix can hold."""
    scene.view_layers[0].update()
    counted: dict[str, _FoundMesh] = {}
    for item, found in _list_instances(scene):
        mesh = item.data
        if mesh.name_full not in counted:
            label = _find_label(mesh)
            counted[mesh.name_full] = _FoundMesh(
                SEMANTIC_NAMES.get(label, "other") if label else "other",
                len(mesh.vertices),
                len(mesh.loops) - 2 * len(mesh.polygons),
                [],
            )
        counted[mesh.name_full].places.append(np.array(found.matrix_world, np.float64))
    if not counted:
        raise IcyMoonError("The scene has no meshes to write; build a ground first.")
    refuse_too_many_triangles([(len(each.places), each.vertices, each.triangles) for each in counted.values()], suffix)
    # Moved vertices need another evaluated scene, which frees the objects evaluated here. So the places come first.
    ready: dict[str, Triangles] = {}
    moved: dict[str, bpy.types.Mesh] = {}
    for item, _ in _list_instances(scene):
        if item.data.name_full in ready or item.data.name_full in moved:
            continue
        if is_moved(item.data):
            moved[item.data.name_full] = item.original.data
        else:
            ready[item.data.name_full] = read_mesh_triangles(item.data)
    for name, original in moved.items():
        with open_rendered_mesh(
            original, counted[name].places[0], settings.quality.threads, find_undisplaced_spacing_m(settings.surface)
        ) as made:
            ready[name] = read_mesh_triangles(made)
    return [PlacedMesh(each.kind, *ready[name], np.array(each.places)) for name, each in counted.items()]


@contextmanager
def _open_pair_folder(folder: Path) -> Iterator[Path]:
    """Make the folder of a pair, and remove it at the end if it is empty."""
    with explain_disk_errors("write to", folder):
        folder.mkdir(parents=True, exist_ok=True)
    try:
        yield folder
    finally:
        with suppress(OSError):  # the folder has files
            folder.rmdir()


def lower_quality(planned: PlannedPair) -> PlannedPair:
    """Lower a pair's quality to one that every Blender can build, without denoiser, graphics card and OSL.

    A pair whose files changed, so that its id no longer fits, stays as it is; the build refuses it as a render does.
    """
    settings = planned.settings
    known = (
        make_pair_id(settings, hash_content(settings) + nodes + describe_blur_identity(settings))
        for nodes in ("", OF_NODES)
    )
    if planned.id not in known:
        return planned
    plain = merged(settings, {"quality": {"denoiser": "NONE", "device": "CPU"}, "hapke": {"backend": "AUTO"}})
    return PlannedPair(make_pair_id(plain, make_build_facts(plain) + describe_blur_identity(plain)), plain, 0.0)


def run_job(
    job: dict[str, Any], folder: Path, send: Callable[..., None] = emit, kind: str = "ply", cell_m: float | None = None
) -> None:
    """Write the ground of each pair of a job in a format. Raises IcyMoonError for errors that a user can fix."""
    if job.get("blend"):
        raise IcyMoonError("The geometry of a scene in a .blend file cannot be written; give settings or pairs.")
    pairs = list_job_pairs(job)
    with ScenesFromSettings(lambda warning: send("warning", message=warning)) as source:
        for k, planned in enumerate(pairs):
            send("progress", fraction=k / len(pairs), message=f"Geometry {k + 1} of {len(pairs)}")
            built, scene, _ = source.prepare(lower_quality(planned))
            with _open_pair_folder(folder / planned.id) as own:
                write_geometry(built, scene, own, kind, cell_m)
    send("done", folders=[str(folder / planned.id) for planned in pairs])


def main(arguments: list[str]) -> int:
    """Run the job in a file, and end the process. Arguments: the job's file, the folder to write to, the format and the
    size of a cell in metres.
    """
    job, folder, kind = Path(arguments[0]), Path(arguments[1]), (arguments[2:3] or ["ply"])[0]
    cell_m = float(arguments[3]) if len(arguments) > 3 else None
    run_to_exit(lambda: run_job(read_job(job), folder, emit, kind, cell_m), lambda: _NO_MEMORY_MESSAGE)
