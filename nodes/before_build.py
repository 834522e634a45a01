"""Stores the camera, world, frame and exposure that a scene had before Build Scene, so that Clear Scene can restore
them.

The scene holds these notes, not the built collection. Otherwise a file that appends the collection would also get the
camera and the world from before the build.
"""

from __future__ import annotations

from typing import Any

import bpy

from . import check_cycles
from .datablocks.fingerprint import TAG

WORLD, CAMERA, VIEW, OSL = _PROPERTIES = (
    "icymoon_previous_world",
    "icymoon_previous_camera",
    "icymoon_previous_view",
    "icymoon_previous_osl",
)


def is_known(scene: bpy.types.Scene) -> bool:
    """Return whether the scene holds notes on its state before Build Scene."""
    return VIEW in scene


def _is_built(block: bpy.types.ID) -> bool:
    """Return whether Build Scene made this camera or world in this file."""
    return TAG in block and block.library is None and block.override_library is None


def _find_own(block: bpy.types.ID | None) -> bpy.types.ID | None:
    return None if block is None or _is_built(block) else block


def note_before_build(scene: bpy.types.Scene) -> None:
    """Note the scene's camera, world and view, before its first build.

    If the user has deleted the built collection, the earlier notes stay, except for properties that the user has set
    since.
    """
    if not is_known(scene) or _find_own(scene.world):
        scene[WORLD] = _find_own(scene.world)
        scene[VIEW] = [scene.view_settings.exposure, scene.render.resolution_x, scene.render.resolution_y]
        scene[OSL] = scene.cycles.shading_system
    if CAMERA not in scene or _find_own(scene.camera):
        scene[CAMERA] = _find_own(scene.camera)


def used_osl_before_build(scene: bpy.types.Scene) -> bool:
    """Return whether the scene used Open Shading Language before Build Scene."""
    return bool(scene.get(OSL, False))


def restore_before_build(scene: bpy.types.Scene) -> None:
    """Restore the noted view, and the noted camera and world unless the user has set others; then remove the notes."""
    stored: Any = scene.get(VIEW)
    if stored is not None:
        scene.view_settings.exposure, *resolution = stored
        scene.render.resolution_x, scene.render.resolution_y = (int(n) for n in resolution)
        if not check_cycles.why_unavailable():
            scene.cycles.shading_system = used_osl_before_build(scene)
    if _find_own(scene.camera) is None:
        scene.camera = scene.get(CAMERA)
    if _find_own(scene.world) is None:
        scene.world = scene.get(WORLD)
    for name in _PROPERTIES:
        scene.pop(name, None)


def move_notes(scenes: list[bpy.types.Scene], collection: bpy.types.Collection) -> None:
    """Move the notes from the built collection, where older versions have stored them, to its scenes."""
    for name in [name for name in _PROPERTIES if name in collection]:
        for scene in scenes:
            scene[name] = collection[name]
        del collection[name]
