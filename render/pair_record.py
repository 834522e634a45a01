"""Makes the content of the ``pair.json`` of a rendered pair."""

from __future__ import annotations

import math
import platform
from typing import Any

import bpy
import numpy as np

from ..formats.map_frame import describe_cameras
from ..nodes.build_scene import Built
from ..nodes.light.lamps import describe_lamps
from ..nodes.light.sun_lamp import read_scene_sun
from ..nodes.surface.sun_inputs import describe_hapke
from ..paper_stand_ins.shown_items import describe_item, list_items
from ..physics import scene_checks
from ..physics.camera.blur import find_blur
from ..physics.camera.eyes import eyes_json, make_camera_with_eyes
from ..physics.light.sky import planet_to_sun_ratio
from ..physics.scene_requirements import explain_traced_light, find_left_out
from ..settings.topics.rendering import QualitySettings
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.blender import compat
from ..support.labels import FIRST_ROCK_INSTANCE, INSTANCE_AOV, SEMANTIC_NAMES, TERRAIN_INSTANCE
from ..support.system import measure_peak_memory_mib
from ..support.version import version
from .graphics_cards import list_selected_cards
from .pairs.pair_folder import EYES, FORMAT, VERSION
from .pairs.workspace_cells import describe_workspace
from .plans.planned_pair import PlannedPair


def make_light_json(built: Built, source: str) -> dict[str, Any]:
    """Make the entry "light" of ``pair.json``. The sky is from ``source``, a value of ``light.directions_from``, or
    from the user's rotation of the lamp."""
    facts = built.sky
    sun = read_scene_sun(built.sun, facts["sun"], source)
    facts["sun"] = sun.to_json()
    if planet := facts["planet"]:
        over_sun = planet_to_sun_ratio(
            planet["irradiance_wm2"], planet["ground_irradiance_wm2"], sun.irradiance_wm2, sun.ground_irradiance_wm2
        )
        planet["over_sun"] = None if math.isinf(over_sun) else over_sun
    if lamps := describe_lamps(built.collection, built.settings.light):
        facts["lamps"] = lamps
    return facts


def _compute_eye_pose(pose: Array, rotation: Array) -> Array:
    """Rotate the camera-to-world matrix (4, 4) of an eye of the parallel rig by ``rotation`` (3, 3)."""
    turned = pose.copy()
    turned[:3, :3] = pose[:3, :3] @ rotation.T
    return turned


#: The loss of precision in files with ``quality.files`` COMPACT, in words.
_COMPACT_LOSS = (
    "radiance as 16-bit floats, off by at most 0.05 % or 3e-8, unless 16 bits cannot carry it; normals as "
    "16-bit floats, off by at most 0.03°; no Beauty.Combined where it is the sum of the light groups; "
    "all else in 32 bits"
)


#: The content of the pass of loose material, in words.
_LOOSE_THICKNESS = "m of talus, mantle, skirts and spoil on hard ground, along the vertical; 0 on all but the ground"


def _describe_channels(quality: QualitySettings) -> dict[str, Any]:
    """Describe in words the content of the images at this quality."""
    light: dict[str, Any] = {
        "radiance": "W/(m² sr), linear, in the bands R, G, B at 620, 550, 460 nm: over all "
        "wavelengths, if all light were as bright, relative to sunlight, as there",
        "depth": "planar Z in m at pixel centres, sky 1e10",
        **({"stored": _COMPACT_LOSS} if quality.files == "COMPACT" else {}),
    }
    if quality.truth == "DEPTH":
        return light
    light["semantic"] = {str(k): v for k, v in SEMANTIC_NAMES.items()}
    return (
        light
        if quality.truth == "SEMANTIC"
        else {
            **light,
            "normal": "unit, world axes, of the facet",
            "hidden": "1 where the other eye sees something nearer in front of the point, by its rays; else 0",
            "instance": f"{INSTANCE_AOV} where it is above 0 (rocks, from {FIRST_ROCK_INSTANCE}), else the "
            f"object index ({TERRAIN_INSTANCE} terrain, others objects); 0 sky",
            **({"loose_thickness": _LOOSE_THICKNESS} if quality.loose_thickness else {}),
        }
    )


def _list_omissions(built: Built, settings: Settings, indirect: dict[str, Any] | None) -> list[str]:
    """List the details that the render omitted, and the reason for traced light, if only the scene or the image shows
    it."""
    sentences = find_left_out(settings, built.sky)
    traced = [explain_traced_light(indirect["why"])] if indirect and "why" in indirect else []
    return [*sentences, *(each for each in traced if each not in sentences)]


def _place_head_on_map(head: list[dict[str, Any]], ground: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the entries of the cameras beside the pair, each with ``on_map`` if the ground is on a map."""
    poses = {entry["name"]: np.array(entry["pose_camera_to_world"]) for entry in head}
    on_map = describe_cameras(ground, poses)
    return [entry | {"on_map": on_map[entry["name"]]} for entry in head] if on_map else head


def make_pair_json(
    built: Built,
    planned: PlannedPair,
    poses: dict[str, Array],
    light: dict[str, Any],
    files: dict[str, Any],
    seconds: dict[str, float],
    denoiser: str,
    indirect: dict[str, Any] | None,
    head: list[dict[str, Any]],
) -> dict[str, Any]:
    """Make the content of ``pair.json`` without the facts that are known only at the end of the render.

    ``light`` is from ``make_light_json``. ``denoiser`` is the denoiser that was used. ``indirect`` is the statement
    about baked light, if any. ``head`` are the entries of the cameras beside the pair.
    """
    settings, workspace = planned.settings, describe_workspace(planned.settings.workspace)
    camera, blur = make_camera_with_eyes(settings), find_blur(settings)
    eyes = {eye: _compute_eye_pose(poses[eye], camera.eye_rotation(eye)) for eye in EYES}
    on_map = describe_cameras(built.ground, eyes)
    return {
        "format": FORMAT,
        "version": VERSION,
        "id": planned.id,
        "settings": settings,
        "edited_by_hand": built.edited,
        "ground": built.ground,
        "terrain": built.statistics,
        "own_files_sha256": built.content,
        **({"excavation": built.excavation} if built.excavation else {}),
        "stand_ins": [describe_item(item) for item in list_items(settings)],
        "camera": camera.to_json(),
        "eyes": eyes_json(camera, settings.rig),
        "poses_camera_to_world": {eye: pose.tolist() for eye, pose in eyes.items()},
        "poses_rectified_to_world": {eye: poses[eye].tolist() for eye in EYES},
        **({"cameras_on_map": on_map} if on_map else {}),
        **({"head": _place_head_on_map(head, built.ground)} if head else {}),
        "blur": blur.to_json() if blur else None,
        "light": light,
        "left_out": _list_omissions(built, settings, indirect),
        "advice": scene_checks.advise_on_scene(settings),
        "channels": _describe_channels(settings.quality),
        "seeds": {"dataset": settings.dataset.seed, "render": planned.render_seed},
        "versions": {
            "blender": bpy.app.version_string,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "icymoon": version(),
        },
        "device": settings.quality.device,
        **({"cards": list_selected_cards()} if settings.quality.device == "GPU" else {}),
        "osl": compat.has_osl(),
        "hapke": describe_hapke(built.materials),
        "denoiser": denoiser,
        **({} if indirect is None else {"indirect": indirect}),
        "platform": platform.platform(),
        **({"workspace": workspace} if workspace else {}),
        "seconds": seconds,
        "peak_memory_mib": measure_peak_memory_mib(),
        "files": files,
    }
