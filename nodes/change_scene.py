"""Changes the built scene to other settings with as little work as possible, for programs that render many scenes.

The result is the scene that Build Scene would build from the settings in an empty file.
"""

from __future__ import annotations

import bpy

from ..physics import scene_checks
from ..physics.camera.depth_accuracy import advise_on_rounding
from ..settings import rebuilt_parts
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from . import preview
from .build_scene import build_scene
from .built_scene import SETTINGS, Built, find_built
from .datablocks.blend_file_paths import hash_content
from .lander.contact import find_contact
from .light.scene_lights import advise_on_sky as light_advice
from .light.scene_lights import compute_scene_sky
from .surface import ground_and_rock_materials, reflectance_laws


def open_empty_scene(settings: Settings) -> Built:
    """Open a new, empty file and build a scene in it. This frees the memory of the previous file."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return build_scene(bpy.context.scene, settings)


def adapt_scene(built: Built | None, settings: Settings) -> tuple[Built, bool]:
    """Return a built scene of complete ``settings``, and whether it was made from ``built``, which must be unedited.

    Surfaces, lights and camera are made again if their settings differ. If more differs, or there is no built scene, a
    new file is opened. Raises IcyMoonError as ``build_scene`` does; then there is no scene.
    """
    if (
        built is None
        or SETTINGS not in built.collection
        or rebuilt_parts.select_scene(settings) != rebuilt_parts.select_scene(built.settings)
    ):
        return open_empty_scene(settings), False
    if hash_content(settings) != built.content:
        return open_empty_scene(settings), False
    preview.show_settings(built, settings, int(settings.terrain.resolution))
    if preview.read_notes(bpy.context.scene) or built.preview:  # the preview cannot show these settings
        return open_empty_scene(settings), False
    built.remember(settings, {})
    warnings = [
        *ground_and_rock_materials.advise_on_surfaces(settings),
        *reflectance_laws.advise_on_hapke(settings),
        *light_advice(compute_scene_sky(settings), settings),
        *advise_on_rounding(settings.rig, built.site_m),
        *scene_checks.advise_on_scene(settings),
        *built.excavation.get("advice", []),
    ]
    now = find_built(bpy.context.scene)
    if now is None:
        raise IcyMoonError("A part of the built scene is missing; render the pair again.")
    if settings.lander.kind != "NONE":
        warnings += find_contact(settings, now.site_m, now.terrain).advice()
    return Built(now.collection, now.terrain, now.sun, now.camera, now.settings, now.scene, tuple(warnings)), True
