"""The parts of a built scene that must be made again after a change of settings. Imports no Blender.

Each part is kept as long as possible: the scene (ground, rocks and their attributes), its surfaces, its lights, its
camera.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple
from typing import Any

from ..physics.mesh import finer_in_view
from ..physics.mesh.break_walls import breaks_walls
from ..physics.mesh.finer_in_view import is_carried_by_grid
from ..physics.mesh.vertex_spacing import GRADING_RIG_SETTINGS, find_fine_relief
from ..physics.scene_requirements import SURFACE_TOPICS, find_elevation_mark, traces_random_walk
from .table import TOPICS
from .topics.declaration import Parts
from .topics.scene import Settings

_SITE_SETTINGS = {("rig", "x_m"), ("rig", "y_m")}
_PIXEL_SIZE_SETTINGS = {("rig", "focal_length_mm"), ("rig", "sensor_width_mm"), ("rig", "width_px")}


def _select_by_effect(effect: str) -> set[tuple[str, str]]:
    return {(topic.key, s.key) for topic in TOPICS.values() for s in topic.settings if s.effect == effect}


_SHAPE, _LOOK, _LIGHT, _LANDER, _CAMERA, _SAMPLING, _RESPONSE = map(
    _select_by_effect, ("geometry", "material", "light", "lander", "camera", "sampling", "response")
)
#: Settings of the rig that the lander uses, because its mast carries the rig.
_MAST_SETTINGS = {
    ("rig", key)
    for key in ("x_m", "y_m", "height_m", "height_from", "z_m", "heading_deg", "pitch_deg", "roll_deg", "baseline_m")
}


#: Settings that determine the path of a scoop if the arm's joints move it: the sizes and the place of the arm.
_DIGGING_SETTINGS = (
    {("rig", key) for key in ("x_m", "y_m", "heading_deg", "baseline_m")}
    | {("lander", key) for key in ("kind", "file", "turn_deg")}
    | {(topic, key) for topic, key in _LANDER if topic == "arm" and key.endswith("_m")}
)


def _select_settings(settings: Settings, keys: Iterable[tuple[str, str]]) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for topic, key in sorted(keys):
        found.setdefault(topic, {})[key] = settings[topic][key]
    return found


def select_geometry(settings: Settings) -> Parts:
    """Select the settings on which the shape of ground and rocks depends. They include the site if it must be clear of
    rocks."""
    return _select_geometry_cached(settings)


def _select_geometry_cached(settings: Settings) -> dict[str, dict[str, Any]]:
    joints = settings.excavation.path == "JOINTS"
    around = settings.rocks.coverage > 0 and settings.rocks.clear_radius_m > 0
    return _select_settings(
        settings, _SHAPE | (_SITE_SETTINGS if around else set()) | (_DIGGING_SETTINGS if joints else set())
    )


def select_scene(settings: Settings) -> Parts:
    """Select the settings of ``select_geometry`` and all others on which a built scene depends. Pairs that differ in
    them cannot share a scene.

    A graded mesh depends on the rig, and on fine relief that is geometry. Ground from a file depends on the site,
    because only a build finds the height there, unless the camera's height is stated. Attributes and images of the mesh
    are made with it. Whether Hapke's law uses OSL depends on the device.
    """
    procedural = settings.source.kind == "PROCEDURAL"
    placed = procedural or settings.rig.height_from == "ZERO"
    keys = {("quality", "device"), ("rig", "height_from")} | (set() if placed else _SITE_SETTINGS)
    if procedural and settings.mesh.kind == "GRADED":
        keys |= {("rig", key) for key in GRADING_RIG_SETTINGS}
    found = _select_geometry_cached(settings)
    for topic, values in _select_settings(settings, keys).items():
        found.setdefault(topic, {}).update(values)
    found["surface"] = {
        **found.get("surface", {}),
        "elevation_marked": find_elevation_mark(settings.surface),
        "own_images": settings.textures.set == "MESH",
        "in_mesh": describe_mesh_relief(settings),
        **({"loose_marked": True} if settings.quality.loose_thickness else {}),
    }
    return found


def describe_mesh_relief(settings: Settings) -> str:
    """Make a cache key of the fine relief and the broken walls of the meshes; empty without both."""
    if settings.mesh.kind != "GRADED":
        return "grid" if is_carried_by_grid(settings) else ""
    relief, walls = find_fine_relief(settings), breaks_walls(settings)
    if relief is None and not walls:
        return ""
    return " ".join(
        f"{value:.6g}"
        for value in (
            *(astuple(relief) if relief else ()),
            *((-1.0,) if walls else ()),
            *(settings.rig[key] for key in finer_in_view.RELIEF_RIG_SETTINGS),
        )
    )


def select_materials(settings: Settings) -> Parts:
    """Select the settings of surfaces that are not in ``select_scene``."""
    return _select_settings(settings, _LOOK)


def select_appearance(settings: Settings) -> Parts:
    """Select the settings of ``select_materials``, the distance of a lamp in place of the Sun, whether there are other
    lamps, and whether each surface's subsurface light is traced."""
    return {
        **select_materials(settings),
        "walks": {topic: traces_random_walk(settings, topic) for topic in SURFACE_TOPICS},
        "lamp": {
            "distance_m": settings.light.sun_distance_m,
            **({"near": True} if settings.light.lamps else {}),
        },
    }


def select_light(settings: Settings) -> Parts:
    """Select the settings on which lights depend. Stars also depend on the size of a pixel."""
    return _select_settings(settings, _LIGHT | (_PIXEL_SIZE_SETTINGS if settings.light.stars else set()))


def select_lander(settings: Settings) -> Parts:
    """Select the settings on which the lander and its arm depend, with the rig that its mast carries."""
    return _select_settings(settings, _LANDER | (_MAST_SETTINGS if settings.lander.kind != "NONE" else set()))


def select_camera(settings: Settings) -> Parts:
    """Select the settings on which the camera depends."""
    return _select_settings(settings, _CAMERA)


def select_sampling(settings: Settings) -> Parts:
    """Select the settings of Cycles' sampling; no built part depends on them."""
    return _select_settings(settings, _SAMPLING)


def select_response(settings: Settings) -> Parts:
    """Select the settings that need no new render: after they change, images are only developed again."""
    return _select_settings(settings, _RESPONSE)
