"""What has to be made again when a description changes. Imports no Blender.

Made once and kept for as long as possible: the scene (ground, rocks and what they are marked with),
then its surfaces, its lights, its camera.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ..physics.mesh.grading import OF_THE_RIG
from ..physics.scene_requirements import SURFACES, follows_walk
from ..typed_settings import Parts, Settings
from .table import TOPICS

_SITE = {("rig", "x_m"), ("rig", "y_m")}
_PIXEL = {("rig", "focal_length_mm"), ("rig", "sensor_width_mm"), ("rig", "width_px")}


def _of_effect(effect: str) -> set[tuple[str, str]]:
    return {(topic.key, s.key) for topic in TOPICS.values() for s in topic.settings if s.effect == effect}


_SHAPE, _LOOK, _LIGHT, _CAMERA, _SAMPLING, _RESPONSE = map(
    _of_effect, ("geometry", "material", "light", "camera", "sampling", "response"))


def _part(settings: Settings, keys: Iterable[tuple[str, str]]) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for topic, key in sorted(keys):
        found.setdefault(topic, {})[key] = settings[topic][key]
    return found


def geometry(settings: Settings) -> Parts:
    """The settings that the ground and the rocks are made from, whatever the mesh."""
    return _geometry(settings)


def _geometry(settings: Settings) -> dict[str, dict[str, Any]]:
    around = settings.rocks.coverage > 0 and settings.rocks.clear_radius_m > 0
    return _part(settings, _SHAPE | (_SITE if around else set()))


def scene(settings: Settings) -> Parts:
    """``geometry``, and what else makes it another scene: pairs that differ in it cannot share one.

    A graded mesh is made for a rig; the ground of a file is stood on where it was placed; marks and images on
    the mesh are made with it; which device renders decides what Hapke's law is made of.
    """
    procedural = settings.source.kind == "PROCEDURAL"
    keys = {("quality", "device")} | (set() if procedural else _SITE)
    if procedural and settings.mesh.kind == "GRADED":
        keys |= {("rig", key) for key in OF_THE_RIG}
    found = _geometry(settings)
    for topic, values in _part(settings, keys).items():
        found.setdefault(topic, {}).update(values)
    found["surface"] = {**found.get("surface", {}), "elevation_marked": settings.surface.trough_dirt != 0,
                        "own_images": settings.textures.set == "MESH"}
    return found


def materials(settings: Settings) -> Parts:
    """The settings of surfaces, beside the scene's."""
    return _part(settings, _LOOK)


def look(settings: Settings) -> Parts:
    """``materials``, and what else surfaces are made from: which of them a camera sees into."""
    return {**materials(settings), "walks": {topic: follows_walk(settings, topic) for topic in SURFACES}}


def light(settings: Settings) -> Parts:
    """The settings that lights are made from; stars are as small as a pixel."""
    return _part(settings, _LIGHT | (_PIXEL if settings.light.stars else set()))


def camera(settings: Settings) -> Parts:
    """The settings that the camera is made from."""
    return _part(settings, _CAMERA)


def sampling(settings: Settings) -> Parts:
    """The settings of the light paths, which nothing is built from."""
    return _part(settings, _SAMPLING)


def response(settings: Settings) -> Parts:
    """The settings that need no new render, only that images are developed again."""
    return _part(settings, _RESPONSE)
