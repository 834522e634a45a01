"""The exports ``dem``, ``ply``, ``obj``, ``usd`` and ``gltf``: the ground of pairs as maps and meshes.

They are in the site's frame. A pair contains no ground, so Blender builds it again from the settings of the pair.
``<out>/<pair>/`` gets

* ``dem``: ``dem.tif``, ``dsm.tif`` and ``albedo.tif``, GeoTIFF, see ``render.ground_maps``;
* ``ply``: ``terrain.ply``, ``rock.ply``; ``obj``, ``usd``: ``ground.obj``, ``ground.usd``, with z up; ``gltf``:
  ``ground.glb``, with y up;
* ``geometry.json``: frame, units, cells, and the files' omissions; ``pairs`` lists the pairs that show this ground.

Pairs that show the same ground are written once, in the folder of the first pair.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ...physics.scene_requirements import surface_topics
from ...render.pairs.pair_folder import Pair, read_pair
from ...render.plans.planned_pair import PlannedPair
from ...render.workers.job_commands import Job, blender_command
from ...render.workers.process import Message, Process
from ...settings import rebuilt_parts
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from ...support.file_schemas import TEXT, Each, read_record
from ...support.files import write_json
from ...support.temporary_folders import open_scratch_folder
from . import Export
from .plug_in import FoldersContext

NEEDS = "Blender"
PACKAGES = ("numpy", "rich")
TITLES = {
    "dem": "Maps of the Ground: GeoTIFF of heights, of heights with rocks, and of albedo",
    "ply": "Meshes, PLY: triangles of ground and rocks, a binary file for each kind",
    "obj": "Meshes, OBJ: triangles of ground and rocks, in one text file",
    "usd": "Meshes, USD: ground, and each rock as an instance of its shape",
    "gltf": "Meshes, glTF: ground, and each rock as an instance of its shape, in a binary file",
}
TAKES = {"dem": ("cell_m",)}
_GEOMETRY_FILE = "geometry.json"
FORMATS = ("dem", "ply", "obj", "usd", "gltf")
Hear = Callable[[Message], None]


def export_ground(
    pairs: Sequence[Pair],
    out: Path,
    kind: str,
    blender: str,
    cell_m: float | None = None,
    hear: Hear = lambda message: None,
) -> list[Path]:
    """Write the ground of pairs as ``kind``, one of ``FORMATS``, and return the folders.

    ``cell_m`` is the size of the cells of ``dem``, by default a 1024th of the ground. Raises IcyMoonError if a pair was
    edited by hand, if the size is invalid, or if Blender fails.
    """
    for pair in pairs:
        refuse_edited(pair)
    return write_grounds([PlannedPair(pair.id, pair.settings, 0.0) for pair in pairs], out, kind, blender, cell_m, hear)


def write_grounds(
    planned: Sequence[PlannedPair],
    out: Path,
    kind: str,
    blender: str,
    cell_m: float | None = None,
    hear: Hear = lambda message: None,
) -> list[Path]:
    """Write the ground of planned pairs; see ``export_ground``."""
    if cell_m is not None and not (kind == "dem" and math.isfinite(cell_m) and cell_m > 0):
        raise IcyMoonError(f"The size of a cell is {cell_m:g} m; give a size above 0, and for dem only.")
    shared: dict[str, list[PlannedPair]] = {}
    for each in planned:
        shared.setdefault(_make_files_key(each.settings, kind), []).append(each)
    arguments = (kind, *(() if cell_m is None else (repr(float(cell_m)),)))
    build_geometry([those[0] for those in shared.values()], out, blender, hear, *arguments)
    folders = []
    for those in shared.values():
        folders.append(out / those[0].id)
        write_json(folders[-1] / _GEOMETRY_FILE, read_geometry(folders[-1]) | {"pairs": [each.id for each in those]})
    return folders


def read_geometry(folder: Path) -> dict[str, Any]:
    """Read an exported ground's ``geometry.json``; ``left_out`` are sentences on the omissions of its files.

    Raises IcyMoonError if it is missing or damaged.
    """
    fix = "export the ground again"
    try:
        return dict(read_record(folder / _GEOMETRY_FILE, {"left_out": Each(TEXT)}, fix))
    except FileNotFoundError:
        raise IcyMoonError(f"{folder / _GEOMETRY_FILE} is missing; {fix}.") from None


def _make_files_key(settings: Settings, kind: str) -> str:
    """Return equal texts for pairs with equal files. Maps have albedo, but no lander."""
    shown = kind == "dem" or any(
        settings[topic]["relief"] != "BUMP" and settings[topic]["grain_amplitude_m"] > 0
        for topic in surface_topics(settings)
    )
    return json.dumps(
        [
            rebuilt_parts.select_scene(settings),
            rebuilt_parts.select_materials(settings) if shown else None,
            rebuilt_parts.select_lander(settings) if kind != "dem" else None,
        ]
    )


def refuse_edited(pair: Pair) -> None:
    """Raise IcyMoonError if a pair was edited by hand, because its settings do not describe it."""
    if pair.data.get("edited_by_hand"):
        raise IcyMoonError(
            f"{pair.folder} was edited by hand, so its meshes cannot be built again from its settings; "
            "export a pair that was rendered from settings."
        )


def build_geometry(
    planned: Sequence[PlannedPair], out: Path, blender: str, hear: Hear, *arguments: str, program: str = "geometry"
) -> None:
    """Have Blender write the ground of pairs to ``<out>/<pair>/``. Raises IcyMoonError with Blender's message.

    ``arguments`` are the arguments of ``render.geometry_worker`` after the folder, or of another ``program``.
    """
    failure = ""
    with open_scratch_folder() as scratch:
        job = Job(scratch, pairs=planned)
        try:
            process = Process(blender_command(blender, program, str(job.file), str(out.absolute()), *arguments))
            done = False
            try:
                for message in process.wait_for_messages():
                    hear(message)
                    failure = message["message"] if message["type"] == "error" else failure
                    done = done or message["type"] == "done"
            finally:
                process.stop()
        finally:
            job.discard()
    if failure or not done:
        raise IcyMoonError(failure or f"Blender ended without geometry: {process.cause}")


def _write_folders(kind: str, folders: Sequence[Path], out: Path, context: FoldersContext) -> None:
    """Write the ground of the pairs in folders, and warn of content that the files cannot hold."""
    if context.changes:
        raise IcyMoonError("--set changes the response of the camera, which ground does not have; leave it out.")
    pairs = {pair.id: pair for pair in map(read_pair, folders)}
    with context.progress("Starting Blender") as show:
        written = export_ground(list(pairs.values()), out, kind, context.blender, context.cell_m, show)
    for folder in written:
        whose = f"The files of {folder.name} lack" if len(written) > 1 else "The files lack"
        for sentence in read_geometry(folder)["left_out"]:
            context.warn(f"{whose} {sentence}")


DEM = Export(write_folders=partial(_write_folders, "dem"))
PLY, OBJ, USD, GLTF = (Export(write_folders=partial(_write_folders, kind)) for kind in FORMATS[1:])
