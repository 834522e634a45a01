"""Rendering one pair of a built scene into its folder."""

from __future__ import annotations

import math
import os
import platform
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from .. import compat
from ..errors import DiskError, IcyMoonError
from ..files import disk_errors, part_of, sha256, sync, write_json
from ..labels import BEAUTY, FIRST_ROCK_INSTANCE, INSTANCE_AOV, SEMANTIC, TERRAIN_INSTANCE, TRUTH
from ..nodes.light import build_sky
from ..nodes.rig import eye_poses
from ..nodes.scene import Built
from ..nodes.sunlight import attune, made_of
from ..version import version
from . import passes, quality
from .exr_check import is_whole
from .exr_parts import joined
from .labelling import labelled
from .pair import EYES, FORMAT, VERSION, StereoCamera, is_complete
from .plan import PlannedPair
from .progress import on_sample

#: Where Cycles takes the first sample of a pixel, right of and above its centre, with the pixel filter
#: that ``quality`` sets: half a bin of the filter's table. Measured the same in 4.3, 5.0 and 5.2.
_SAMPLE_OFFSET_PX = 5.4e-4
#: Largest size on disk of one eye, uncompressed 32-bit channels: in both renders RGBA, value passes and two light
#: groups, in one of them depth, normals and indices.
_BYTES_PER_PIXEL = 4 * (2 * (4 + 4 + 1 + 3 + 3) + 1 + 3 + 1 + 1)


#: Most triangles that Cycles' data is kept for between two renders: half a gigabyte more than without.
MOST_KEPT_TRIANGLES = 8_000_000


@contextmanager
def studio(built: Built, frame: int) -> Iterator[bpy.types.Scene]:
    """A scene of its own that shows the built collection under a black sky, for any number of pairs.

    The person's scene is never changed for a render, so there is nothing to put back; this one is
    removed at the end whatever happens. As long as it is there, and nothing but the camera and the sampling
    changes, Cycles keeps its tree of triangles, unless there are too many.
    """
    scene = bpy.data.scenes.new("Icy Moon Render")
    sky = build_sky("Icy Moon Render Sky")
    try:
        scene.collection.children.link(built.collection)
        scene.world = sky
        scene.camera = built.camera
        scene.frame_set(frame)
        scene.render.use_persistent_data = _triangles(built) <= MOST_KEPT_TRIANGLES
        passes.prepare(scene, built.several_lights)
        with labelled(scene):
            yield scene
    finally:
        scene.render.use_persistent_data = False  # which frees what is kept
        bpy.data.scenes.remove(scene)
        bpy.data.worlds.remove(sky)


def _triangles(built: Built) -> int:
    """Triangles of the collection's meshes; those of instances once."""
    meshes = {item.data for item in built.collection.all_objects if isinstance(item.data, bpy.types.Mesh)}
    return sum(len(mesh.loops) - 2 * len(mesh.polygons) for mesh in meshes)


@contextmanager
def _turned(camera: bpy.types.Object, turn_deg: float, width_px: int) -> Iterator[None]:
    """Turn the camera clockwise about the vertical through its left eye, and back at the end.

    The lens is shifted by what Cycles' sampling is off the pixel centre, so that truth is exact.
    """
    lens = camera.data
    shift = lens.shift_x, lens.shift_y
    # A matrix put back is taken apart into other numbers, by a rounding error, and would pass for an edit.
    pose = {key: tuple(getattr(camera, key)) for key in ("location", "rotation_euler", "rotation_quaternion",
                                                         "rotation_axis_angle", "scale")}
    lens.shift_x, lens.shift_y = (s - _SAMPLE_OFFSET_PX / width_px for s in shift)
    if turn_deg:
        turn = Matrix.Rotation(-math.radians(turn_deg), 4, "Z")
        camera.matrix_world = Matrix.Translation(camera.matrix_world.translation) @ turn @ Matrix.Translation(
            -camera.matrix_world.translation) @ camera.matrix_world
    try:
        yield
    finally:
        for key, value in pose.items():
            setattr(camera, key, value)
        lens.shift_x, lens.shift_y = shift


def check_space(dataset: Path, pairs: list[PlannedPair]) -> None:
    """Raise IcyMoonError if the folder cannot be made or its disk has no room for the pairs."""
    with disk_errors("write to", dataset):
        dataset.mkdir(parents=True, exist_ok=True)
        probe = part_of(dataset / ".icymoon")
        probe.write_bytes(b"")
        probe.unlink()
        free = shutil.disk_usage(dataset).free
    rig = pairs[0].settings["rig"]
    needed = len(pairs) * 2 * int(rig["width_px"]) * int(rig["height_px"]) * _BYTES_PER_PIXEL
    if needed > free:
        raise IcyMoonError(f"{dataset} has {free / 1e6:.0f} MB free, {len(pairs)} pairs may need "
                           f"{needed / 1e6:.0f} MB; "
                           "free some space, choose another folder or render fewer pixels.")


def shoot(built: Built, scene: bpy.types.Scene, planned: PlannedPair, dataset: Path, seconds_build: float,
          report: Callable[[float], None], again: bool = False) -> Path:
    """Render one pair of the scene that ``studio`` made and return its folder.

    ``report`` receives the fraction done. A pair that another process has finished meanwhile is left, unless
    ``again``. Raises IcyMoonError when the render or the disk fails; nothing half-written stays.
    """
    folder = planned.folder(dataset)
    part = part_of(folder)
    spent = time.process_time()
    with disk_errors("write", folder):
        part.mkdir(parents=True)
    try:
        facts = _render_into(part, built, scene, planned, report)
        facts["seconds"]["build"] = round(seconds_build, 3)
        # Of all threads; "before" is what this process had spent: its start, the build, other pairs.
        facts["cpu_seconds"] = {"before": round(spent, 3), "pair": round(time.process_time() - spent, 3)}
        write_json(part / "pair.json", facts)
        if again or not is_complete(folder):
            with disk_errors("write", folder):
                shutil.rmtree(folder, ignore_errors=True)
                os.replace(part, folder)
                sync(folder.parent)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return folder


def check_camera(built: Built) -> None:
    """Raise IcyMoonError if the camera was made, by hand, into one whose pairs are not rectified or not sharp."""
    stereo = built.camera.data.stereo
    if (stereo.convergence_mode, stereo.pivot) != ("PARALLEL", "LEFT"):
        raise IcyMoonError(f"The stereo camera's eyes are set to {stereo.convergence_mode.lower()} about "
                           f"{stereo.pivot.lower()}; set its convergence to Parallel and its pivot to Left: pairs are "
                           "rectified, without toe-in.")
    if built.camera.data.dof.use_dof:
        raise IcyMoonError("The stereo camera has depth of field, which blurs the true depth too; switch it off. A "
                           "blurred image is what sensor.psf_sigma_px makes.")


def _render_into(part: Path, built: Built, scene: bpy.types.Scene, planned: PlannedPair,
                 report: Callable[[float], None]) -> dict[str, Any]:
    settings = planned.settings
    files: dict[str, dict[str, Path]] = {eye: {} for eye in EYES}
    start = time.perf_counter()
    with _turned(built.camera, planned.turn_deg, int(settings["rig"]["width_px"])):
        passes.apply(scene, settings["rig"])
        quality.apply(scene, settings["quality"], planned.render_seed)
        attune(scene, built.materials, built.sun)
        with on_sample(int(settings["quality"]["samples"]), report) as sampling:
            for name in (BEAUTY, TRUTH):
                for eye, file in passes.choose(scene, name, part).items():
                    files[eye][name] = file
                try:
                    bpy.ops.render.render(write_still=True, scene=scene.name)
                except RuntimeError as error:
                    raise IcyMoonError(f"Cycles could not render pair {planned.id}: {_first_line(error)}") from None
        poses = eye_poses(built.camera.matrix_world, built.camera.data.stereo.interocular_distance)
        toward_sun = np.array(built.sun.matrix_world.to_3x3().col[2])
    rendered = time.perf_counter() - start
    start = time.perf_counter()
    written = {f"{eye}.exr": _finish(files[eye], part / f"{eye}.exr", planned) for eye in EYES}
    return _facts(built, planned, poses, toward_sun, written, {
        "render": round(rendered, 3), "sampling": round(sampling.seconds, 3),
        "write": round(time.perf_counter() - start, 3)})


def _first_line(error: Exception) -> str:
    lines = [line.removeprefix("Error: ").strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__


def _finish(written: dict[str, Path], final: Path, planned: PlannedPair) -> dict[str, Any]:
    """Put the layers that Blender wrote into one file, flush it and return its size and checksum."""
    if not all(map(is_whole, written.values())):
        raise DiskError(f"Blender could not write the whole image of pair {planned.id} to {final.parent.parent}; "
                        "the disk is full or the folder may not be written to.")
    with disk_errors("write", final):
        final.write_bytes(joined({name: file.read_bytes() for name, file in written.items()}, passes.UNWANTED))
        for file in written.values():
            file.unlink()
        sync(final)
        return {"bytes": final.stat().st_size, "sha256": sha256(final)}


def _peak_memory_mib() -> float | None:
    try:
        import resource
    except ImportError:
        return None  # Windows
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (2**20 if sys.platform == "darwin" else 2**10), 1)


def _light_facts(built: Built, toward_sun: np.ndarray) -> dict[str, Any]:
    """The sky that was described, but for the Sun as it stands, which a person may have turned."""
    described = built.sky
    described["sun"] |= {"direction_to_world": toward_sun.tolist(), "irradiance_wm2": built.sun.data.energy,
                         "angular_diameter_deg": math.degrees(built.sun.data.angle)}
    return described


def _facts(built: Built, planned: PlannedPair, poses: dict[str, np.ndarray], toward_sun: np.ndarray,
           files: dict[str, Any], seconds: dict[str, float]) -> dict[str, Any]:
    """The content of ``pair.json``."""
    settings = planned.settings
    camera = StereoCamera.from_settings(settings["rig"])
    return {
        "format": FORMAT, "version": VERSION, "id": planned.id, "settings": settings,
        "edited_by_hand": built.edited, "ground": built.ground, "own_files_sha256": built.content,
        "camera": camera.to_json(),
        "poses_camera_to_world": {eye: poses[eye].tolist() for eye in EYES},
        "light": _light_facts(built, toward_sun),
        "channels": {"radiance": "W/(m² sr) per band, linear", "depth": "planar Z in m at pixel centres, sky 1e10",
                     "normal": "unit, world axes, of the facet", "semantic": {str(k): v for k, v in SEMANTIC.items()},
                     "instance": f"{INSTANCE_AOV} where it is above 0 (blocks, from {FIRST_ROCK_INSTANCE}), else the "
                                 f"object index ({TERRAIN_INSTANCE} terrain, others objects); 0 sky"},
        "seeds": {"dataset": settings["dataset"]["seed"], "render": planned.render_seed},
        "versions": {"blender": bpy.app.version_string, "python": platform.python_version(),
                     "numpy": np.__version__, "icymoon": version()},
        "device": settings["quality"]["device"], "osl": compat.has_osl(),
        "hapke": made_of(built.materials), "denoiser": settings["quality"]["denoiser"],
        "platform": platform.platform(),
        "seconds": seconds, "peak_memory_mib": _peak_memory_mib(),
        "files": files,
    }
