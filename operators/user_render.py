"""The user's own render (F12) of a built scene: the view of the left eye, rendered as in a pair.

Pairs are rendered in a separate scene. The user's scene has its own frame, engine and objects, so without these changes
F12 would show the inside of Blender's default cube, in another engine. The changes are noted in the built collection,
and Clear Scene reverts each value that the user has not changed since.
"""

from __future__ import annotations

import json
from contextlib import suppress
from typing import Any

import bpy

from ..nodes import build_scene as scenes
from ..nodes.datablocks.stored_json import read_stored
from ..physics.scene_requirements import are_rocks_clear
from ..render import cycles_settings
from ..settings import description
from ..support.blender import compat
from ..support.file_schemas import TEXT, Each, Kind
from .view_exposure import TRANSFORM

NOTE = "icymoon_user_render"
#: Mark of an object that was hidden from renders, by which Clear Scene finds it under any name.
HIDDEN = "icymoon_hidden"
#: Types of objects that a render shows, or that light the scene.
_RENDERED_TYPES = (
    "MESH",
    "CURVE",
    "SURFACE",
    "META",
    "FONT",
    "CURVES",
    "POINTCLOUD",
    "VOLUME",
    "GPENCIL",
    "GREASEPENCIL",
    "LIGHT",
    "LIGHT_PROBE",
    "EMPTY",
)
#: This setting is restored first, because it decides which looks exist.
_FIRST_RESTORED = "view_settings.view_transform"
#: Maximum number of light paths per pixel of a 3D View. With Blender's 1024, a view without a graphics card would use
#: all processors for minutes, and slow down the render of a pair.
_VIEW_SAMPLES = 64
#: A value before and after its change.
_TWO_VALUES = Kind("two values", lambda value: isinstance(value, list) and len(value) == 2)
_VALUE_TYPES = ("BOOLEAN", "INT", "FLOAT", "ENUM", "STRING")


def prepare_render(scene: bpy.types.Scene, built: scenes.Built) -> None:
    """Make F12 render the image of a pair: by Cycles with the quality of the scene, without the user's other objects.

    It acts only once after Clear Scene, so later choices of the user stay.
    """
    if NOTE in built.collection:
        return
    before = _read_values(scene)
    uses_osl = scene.cycles.shading_system
    exposure, gamma = scene.view_settings.exposure, scene.view_settings.gamma
    settings = built.settings
    if not compat.has_oidn():  # pairs are refused; F12 renders without denoiser, and Build Scene has warned
        settings = description.merged(settings, {"quality": {"denoiser": "NONE"}})
    cycles_settings.apply_quality(
        scene, settings.quality, int(settings.dataset.seed), through=are_rocks_clear(settings)
    )
    scene.cycles.shading_system = uses_osl
    scene.cycles.sampling_pattern = "AUTOMATIC"  # spreads a view's first light paths evenly over the pixels
    if not 0 < scene.cycles.preview_samples <= _VIEW_SAMPLES:  # 0 would never end
        scene.cycles.preview_samples = _VIEW_SAMPLES
    scene.view_settings.exposure, scene.view_settings.gamma = exposure, gamma
    with suppress(TypeError):  # the user's own color management may lack this view transform
        scene.view_settings.view_transform = TRANSFORM
    after = _read_values(scene)
    changed = {name: [value, after[name]] for name, value in before.items() if after[name] != value}
    ours = set(built.collection.all_objects)
    hidden = [
        item
        for item in scene.objects
        if item not in ours and item.type in _RENDERED_TYPES and not item.hide_render and item.is_editable
    ]
    for item in hidden:
        item.hide_render = item[HIDDEN] = True
    built.collection[NOTE] = json.dumps(changed)


def restore_render(scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
    """Restore the settings that ``prepare_render`` changed, unless the user has changed them since. Call it before the
    scene is cleared."""
    for item in [item for item in scene.objects if HIDDEN in item]:
        del item[HIDDEN]
        item.hide_render = False
    present = _read_values(scene)
    noted = read_stored(collection, NOTE, Each(_TWO_VALUES, TEXT))
    for name, (before, after) in sorted(noted.items(), key=lambda each: each[0] != _FIRST_RESTORED):
        if present.get(name) == after:
            group, _, key = name.partition(".")
            with suppress(TypeError, ValueError, OverflowError):  # a choice that this Blender does not have
                setattr(getattr(scene, group), key, before)


def _read_values(scene: bpy.types.Scene) -> dict[str, Any]:
    """Read the numbers, ticks, choices and texts of the scene's render settings, by ``group.key``."""
    return {
        f"{group}.{prop.identifier}": getattr(getattr(scene, group), prop.identifier)
        for group in ("render", "cycles", "view_settings")
        if hasattr(scene, group)  # cycles is missing while its add-on is off
        for prop in getattr(scene, group).bl_rna.properties
        if prop.type in _VALUE_TYPES
        and not prop.is_readonly
        and not getattr(prop, "is_array", False)
        and not getattr(prop, "is_enum_flag", False)
        and prop.identifier != "exposure"  # which follows the settings
        and (prop.identifier != "denoiser" or compat.has_oidn())
    }  # without OIDN the denoiser has no choice, and reading it would make Blender warn
