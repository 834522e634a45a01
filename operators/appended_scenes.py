"""Follows Append: a built collection from another file becomes the built scene of the open file, with its settings."""

from __future__ import annotations

from contextlib import suppress

import bpy

from ..nodes import appended_scene, before_build
from ..nodes import build_scene as scenes
from ..settings.blender import scene_properties
from ..settings.description import merged
from ..support.blender import compat
from ..support.errors import IcyMoonError
from . import user_render
from .build import frame_and_expose
from .window_events import call_later, make_registration


def adopt_appended() -> None:
    """Make an appended collection the built scene if the scene has none; otherwise make its objects the user's own."""
    for scene in bpy.data.scenes:
        appended_scene.untag_later_builds(scene)
        appended_scene.remove_shapes(scene)
        if (built := appended_scene.adopt_appended(scene)) is not None:
            with suppress(IcyMoonError):  # the file is of another version, which Build Scene reports
                _show_settings(scene, built)


def _show_settings(scene: bpy.types.Scene, built: scenes.Built) -> None:
    """Show the settings of the appended scene in the sidebar, but keep this file's data set and its options."""
    paths, present = appended_scene.find_paths(built), scene_properties.read_unchecked(scene.icymoon).dataset
    kept = merged(built.settings, *paths, {"dataset": {**present, "seed": built.settings.dataset.seed}})
    settings = merged(kept, built.preview)
    built.remember(kept, built.preview)
    scene_properties.write_settings(scene.icymoon, settings)
    built.collection.pop(user_render.NOTE, None)  # these notes describe the scene in the other file
    user_render.prepare_render(scene, built)
    frame_and_expose(scene, settings)


def _move_notes() -> None:
    """Move the notes that older versions stored in built collections to their scenes, when a file is opened."""
    for scene in bpy.data.scenes:
        if (collection := scenes.find_collection(scene)) is not None:
            before_build.move_notes([scene, *scenes.find_scenes_sharing_build(scene)], collection)


def _look_for_appended() -> None:
    """Schedule ``adopt_appended`` if a scene has a built collection that it does not know. Blender before 4.3 does not
    report Append."""
    if any(
        not before_build.is_known(scene) or len(scenes.list_collections(scene)) > 1
        for scene in bpy.data.scenes
        if scenes.list_collections(scene)
    ):
        call_later(adopt_appended)


register, unregister = (
    make_registration(blend_import_post=adopt_appended, load_post=_move_notes)
    if compat.has_append_handler()
    else make_registration(timers=(adopt_appended,), depsgraph_update_post=_look_for_appended, load_post=_move_notes)
)
