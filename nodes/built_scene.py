"""What Build made in a scene: found again, and what it shows of the settings."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import bpy

from ..errors import IcyMoonError
from ..settings.description import merged
from ..settings.table import TOPICS
from ..typed_settings import Parts, Settings, typed
from . import engine
from .datablocks.blend_file_paths import are_there, content, used_files
from .datablocks.fingerprint import (
    MAKER,
    TAG,
    added_objects,
    built_objects,
    differing,
    edited_parts,
    maker,
    read_marks,
    updated_marks,
)
from .datablocks.marks import hashed
from .light.scene_lights import ROLES, SKY
from .remove import materials_of, with_parts
from .surface import reflectance_laws

# Properties of the built collection.
SETTINGS, FINGERPRINT, PREVIOUS_WORLD, PREVIOUS_CAMERA, PREVIOUS_VIEW, GROUND = (
    "icymoon_settings", "icymoon_fingerprint", "icymoon_previous_world", "icymoon_previous_camera",
    "icymoon_previous_view", "icymoon_ground")
PREVIOUS_OSL = "icymoon_previous_osl"
SITE = "icymoon_site_m"  # height of the ground that the camera stands on
CONTENT = "icymoon_content"  # hash of the user's own files
ROUGHNESS = "icymoon_roughness"  # measured on the built ground
PREVIEW = "icymoon_preview"  # settings that are shown otherwise than Build Scene would show them
NOTES = "icymoon_notes"  # why not all settings are shown


@dataclass
class Built:
    """A scene that has been built: its collection, objects and the settings it was built from."""

    collection: bpy.types.Collection
    terrain: bpy.types.Object
    sun: bpy.types.Object
    camera: bpy.types.Object
    settings: Settings
    scene: bpy.types.Scene
    warnings: tuple[str, ...] = ()

    @property
    def ground(self) -> dict[str, Any]:
        """Of a ground from a file, the ``report`` of its import; else empty."""
        return dict(json.loads(self.collection.get(GROUND, "{}")))

    @property
    def site_m(self) -> float:
        """Height in metres of the ground that the camera was built to stand on."""
        return float(self.collection[SITE])

    @property
    def content(self) -> str:
        """Hash of the content of the user's own files that it was built from; empty without any."""
        return str(self.collection.get(CONTENT, ""))

    @property
    def extra(self) -> str:
        """What identifies the scene beside the settings: the user's own files, what stands in, edits by hand.

        Raises IcyMoonError if there are edits that no mark would tell from others.
        """
        return self.content + reflectance_laws.stand_in(self.settings) + self._edits()

    def _edits(self) -> str:
        """The mark of what was edited and added by hand, and of the frame if that matters; empty without any."""
        refuse_excluded(self.scene, self.collection)
        found = read_marks(self.collection)
        by_hand = sorted(differing(found.parts, self._known()))
        if not by_hand and "added" not in found.parts:
            return ""
        if found.refused:
            raise IcyMoonError(found.refused[0])
        frame = self.scene.frame_current if found.changes_with_time else None
        return hashed([[(part, found.parts.get(part)) for part in (*by_hand, "added")], frame])

    def _known(self) -> dict[str, str]:
        """The marks of what was built. Raises IcyMoonError if they cannot be compared with marks that are made here."""
        if self.outdated:
            raise IcyMoonError(self.outdated)
        return dict(json.loads(self.collection[FINGERPRINT]))

    @property
    def outdated(self) -> str:
        """Why Icy Moon cannot tell whether the scene was edited by hand, in a sentence; empty if that can be told."""
        if why := engine.why_not():  # whose settings count
            return why
        if json.loads(self.collection[FINGERPRINT]).get(MAKER) == maker():
            return ""
        return ("The scene was built by another version of Icy Moon or Blender, so edits by hand cannot be told from "
                "what it made; press Build Scene to build it anew.")

    @property
    def materials(self) -> list[bpy.types.Material]:
        """The materials of the ground and the rocks."""
        return sorted(materials_of(with_parts(list(self.collection.all_objects))[0]), key=lambda m: m.name)

    @property
    def planetshine(self) -> bpy.types.Object | None:
        """The planet's lamp, if the planet is up."""
        return next((item for item in self.collection.all_objects if item.get(TAG) == "planetshine"), None)

    @property
    def rock_count(self) -> int:
        """Number of rocks."""
        return sum(len(item.data.vertices) for item in self.collection.all_objects if item.get(TAG) == "rock")

    def edited_parts(self, *wanted: str) -> set[str]:
        """Which parts, of these parts and roles or of all, the user has changed since they were built.

        Raises IcyMoonError if that cannot be told.
        """
        return edited_parts(self.collection, self._known(), *wanted)

    @property
    def sky(self) -> dict[str, Any]:
        """Where the lights stand and how bright they are, see ``physics.light.sky.sky_facts``."""
        return dict(json.loads(self.sun.get(SKY, "{}")))

    @property
    def several_lights(self) -> bool:
        """Whether there may be other light than the Sun's: the planet's, stars', or that of what the user added."""
        return (any(item.get(TAG) in ROLES for item in self.collection.all_objects)
                or bool(added_objects(self.collection)))

    @property
    def edited(self) -> bool:
        """Whether the user has changed or added something since it was built."""
        return bool(added_objects(self.collection)) or bool(self.edited_parts())

    @property
    def preview(self) -> Settings:
        """Settings of which a preview is shown, where ``settings`` say what was built; empty if none is."""
        return typed(json.loads(self.collection.get(PREVIEW, "{}")))

    def remember(self, settings: Settings, preview: Parts, *changed: str) -> None:
        """Remember what the scene shows now, of which the ``changed`` parts or roles are as they should be."""
        self.settings = merged(settings)
        self.collection[SETTINGS], self.collection[PREVIEW] = json.dumps(self.settings), json.dumps(preview)
        known = json.loads(self.collection[FINGERPRINT])
        self.collection[FINGERPRINT] = json.dumps(updated_marks(self.collection, known, *changed))


def find_collection(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The collection that Build made in this scene, if any."""
    for collection in scene.collection.children_recursive:
        if collection.get(TAG) == "scene":
            return collection
    return None


def find(scene: bpy.types.Scene) -> Built | None:
    """What Build made in this scene, or None if it has not, or if a part of it was deleted."""
    collection = find_collection(scene)
    if collection is None or SETTINGS not in collection:
        return None
    roles = built_objects(collection)
    if not {"terrain", "sun", "camera"} <= roles.keys():
        return None
    return Built(collection, roles["terrain"], roles["sun"], roles["camera"], typed(json.loads(collection[SETTINGS])),
                 scene)


def refuse_excluded(scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
    """Raise IcyMoonError if a part of what was built is kept out of the view layers, which renders do not follow."""
    ours = {collection, *collection.children_recursive}

    def kept_out(layer: bpy.types.LayerCollection) -> set[str]:
        mine = {layer.collection.name} if layer.collection in ours and (
            layer.exclude or layer.holdout or layer.indirect_only) else set()
        return mine.union(*map(kept_out, layer.children))

    names = set.intersection(*(kept_out(layer.layer_collection) for layer in scene.view_layers))
    if names:
        raise IcyMoonError(f"The collection {min(names)} is excluded from the view layer, held out or indirect only, "
                           "which renders of pairs do not follow; undo that, and use its camera icon (Disable in "
                           "Renders) instead.")


def measured_roughness(scene: bpy.types.Scene) -> str:
    """What Build measured on the ground it made from the ``terrain`` settings, in a line; empty if it made none."""
    built = find(scene)
    return str(built.collection.get(ROUGHNESS, "")) if built and not built.preview else ""


def extra(settings: Settings) -> str:
    """``Built.extra`` of the scene that settings would build."""
    return content(settings) + reflectance_laws.stand_in(settings)


def changed_settings(built: Built, settings: Settings) -> list[str]:
    """Names of the settings that the built scene does not show yet, those of files also if the content is another."""
    shown = [(topic.key, s.key) for topic in TOPICS.values() for s in topic.settings
             if s.effect in ("geometry", "material", "light", "camera")]
    changed = [f"{topic}.{key}" for topic, key in shown
               if built.settings.get(topic, {}).get(key) != settings[topic][key]]
    # A file that is gone changes nothing: what was built from it is still there.
    if are_there(settings) and built.content != content(settings):
        changed += used_files(settings)
    return changed
