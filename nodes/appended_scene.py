"""Turns a built collection that was appended from another file into this scene's built scene.

Append brings the built collection. It also puts the shapes of the rocks at the origin of the scene, because the
collection uses but does not hold them. The sky, and the scene's choice of camera, stay in the other file.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ..settings import user_files
from ..settings.description import merged
from . import before_build
from .build_scene import update_sunlight
from .built_scene import Built, find_built, list_collections
from .datablocks.fingerprint import NAME, OWN, TAG
from .light.sun_lamp import build_sky
from .remove_objects import free_names
from .scene_objects import mark_as_built


def remove_shapes(scene: bpy.types.Scene) -> None:
    """Take the shapes of rocks out of a scene, where only their instances are seen."""
    for parent in (scene.collection, *scene.collection.children_recursive):
        if parent.is_editable:
            for shapes in [child for child in parent.children if child.get(TAG) == "rock shapes"]:
                parent.children.unlink(shapes)


def untag_later_builds(scene: bpy.types.Scene) -> None:
    """Remove the tags from all built collections of a scene except the oldest, since a scene has one built
    collection."""
    for collection in list_collections(scene)[1:]:
        for block in (collection, *collection.children_recursive, *collection.all_objects):
            if block.get(TAG) != "rock shapes":
                block.pop(TAG, None)
        for key in [key for key in collection.keys() if key.startswith(OWN)]:  # noqa: SIM118 - no mapping
            del collection[key]


def adopt_appended(scene: bpy.types.Scene) -> Built | None:
    """Give a scene the camera of a built collection that was appended to it, and a black sky. Return the built scene;
    None without such a collection."""
    built = find_built(scene)
    if built is None or before_build.is_known(scene):
        return None
    before_build.move_notes([], built.collection)  # the notes describe the scene in the other file
    before_build.note_before_build(scene)
    sky = mark_as_built(build_sky(f"{NAME} Sky"), "sky")
    scene.camera, scene.world = built.camera, sky
    free_names([sky])
    update_sunlight(built.collection)
    return built


def find_paths(built: Built) -> list[dict[str, dict[str, str]]]:
    """Find the settings of an appended scene that name files, with // as the folder of the scene's original file."""
    origin = built.collection.library_weak_reference
    if origin is None:
        return []
    folder = str(Path(bpy.path.abspath(origin.filepath)).parent)
    found = user_files.find_used_files(merged(built.settings, built.preview), folder)
    return [{topic: {key: str(path)}} for (topic, _, key), path in ((n.partition("."), p) for n, p in found.items())]
