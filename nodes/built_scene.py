"""Finds the built part of a scene again, with its settings, and detects whether it was edited by hand."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import bpy

from ..settings.description import merged
from ..settings.table import TOPICS
from ..settings.topics.declaration import LANDFORMS, Parts
from ..settings.topics.scene import Settings, typed
from ..support.errors import IcyMoonError
from ..support.file_schemas import TABLE, TEXT, Each
from ..support.steps import Steps, finish
from . import check_cycles
from .datablocks.blend_file_paths import do_files_exist, find_used_files, hash_content
from .datablocks.fingerprint import (
    MAKER,
    TAG,
    describe_maker,
    find_added_objects,
    find_built_objects,
    find_differing,
    find_edited_parts,
    is_stand_in,
    is_wanted,
    list_own_nodes,
    read_marks_in_steps,
    update_marks,
)
from .datablocks.known_marks import forget_marks
from .datablocks.marks import hash_marks
from .datablocks.stored_json import parse_stored, read_stored
from .light.lamps import find_lamps
from .light.scene_lights import ROLES, SKY
from .remove_objects import find_materials, find_parts
from .surface import own_groups, reflectance_laws

# Properties of the built collection.
SETTINGS, FINGERPRINT, GROUND = "icymoon_settings", "icymoon_fingerprint", "icymoon_ground"
SITE = "icymoon_site_m"  # height of the ground under the camera
CONTENT = "icymoon_content"  # hash of the user's own files
STATISTICS = "icymoon_statistics"  # of the ground: stated by the settings, and measured on the built ground
EXCAVATION = "icymoon_excavation"  # volumes and masses of the excavation, see ``physics.excavation.dig``
PREVIEW = "icymoon_preview"  # settings that are shown as a preview, not as Build Scene would show them
REFINED = "icymoon_refined"  # geometry of the settings that will follow a coarse ground at full resolution
NOTES = "icymoon_notes"  # why some settings are not shown
#: Shapes of the stored JSON: tables by topic, and the marks of parts by their names.
TABLES_SHAPE, MARKS_SHAPE = Each(TABLE, TEXT), Each(TEXT, TEXT)
#: Settings that shape the ground.
_SHAPE_SETTINGS = [
    (topic.key, setting.key)
    for topic in TOPICS.values()
    for setting in topic.settings
    if setting.effect == "geometry" and topic.key != "rocks"
]


@dataclass
class _Update:
    """State of an update: the edited parts that were found for each requested name, and the names of the parts that the
    update has changed."""

    edited: dict[str, set[str]]
    changed: list[str]


@dataclass
class Built:
    """A built scene: its collection, its objects and the settings that it was built from."""

    collection: bpy.types.Collection
    terrain: bpy.types.Object
    sun: bpy.types.Object
    camera: bpy.types.Object
    settings: Settings
    scene: bpy.types.Scene
    warnings: tuple[str, ...] = ()
    _update: _Update | None = field(default=None, init=False, repr=False, compare=False)

    @property
    def ground(self) -> dict[str, Any]:
        """``report`` of the import of a ground from a file; empty for other ground."""
        return dict(read_stored(self.collection, GROUND, TABLE))

    @property
    def statistics(self) -> dict[str, Any]:
        """The requested and the measured statistics of ground built from ``terrain`` settings, at ``baseline_m``; empty
        for other ground."""
        return dict(read_stored(self.collection, STATISTICS, TABLE))

    @property
    def excavation(self) -> dict[str, Any]:
        """Volumes and masses of the excavation in its present state; empty without an excavation."""
        return dict(read_stored(self.collection, EXCAVATION, TABLE))

    @property
    def site_m(self) -> float:
        """Height in metres of the ground under the camera when the scene was built."""
        return float(self.collection[SITE])

    @property
    def content(self) -> str:
        """Hash of the content of the user's own files in the scene; empty without such files."""
        return str(self.collection.get(CONTENT, ""))

    @property
    def extra(self) -> str:
        """All that identifies the scene besides its settings: the user's files, nodes instead of OSL, edits by hand.

        Raises IcyMoonError if there are edits that no mark can identify.
        """
        return finish(self.find_extra())

    def find_extra(self) -> Steps[str]:
        """Find ``extra`` in steps."""
        found = self.content + reflectance_laws.describe_osl_substitute(self.settings)
        return found + (yield from self._mark_edits())

    def _mark_edits(self) -> Steps[str]:
        """Return the mark of everything edited or added by hand, and of the frame if it matters; empty without
        edits."""
        refuse_excluded(self.scene, self.collection)
        own_groups.refuse_stand_ins(self.materials)
        stored = self._read_marks()  # first: present marks are read only if they can be compared with these
        found = yield from read_marks_in_steps(self.collection)
        by_hand = sorted(find_differing(found.parts, stored))
        if not by_hand and "added" not in found.parts:
            return ""
        if found.refused:
            raise IcyMoonError(found.refused[0])
        frame = self.scene.frame_current if found.changes_with_time else None
        return hash_marks([[(part, found.parts.get(part)) for part in (*by_hand, "added")], frame])

    def _read_marks(self) -> dict[str, str]:
        """Read the marks of the scene as it was built. Raises IcyMoonError if they cannot be compared with present
        marks."""
        if self.outdated:
            raise IcyMoonError(self.outdated)
        return dict(read_stored(self.collection, FINGERPRINT, MARKS_SHAPE))

    @property
    def outdated(self) -> str:
        """Reason, in a sentence, why Icy Moon cannot detect edits by hand; empty if it can."""
        if why := check_cycles.why_unavailable():  # marks include the settings of Cycles
            return why
        if read_stored(self.collection, FINGERPRINT, MARKS_SHAPE).get(MAKER) == describe_maker():
            return ""
        return (
            "The scene was built by another version of Icy Moon or Blender, so edits by hand cannot be detected; "
            "press Build Scene to build it again."
        )

    @property
    def materials(self) -> list[bpy.types.Material]:
        """The materials of the ground and the rocks."""
        return sorted(find_materials(find_parts(list(self.collection.all_objects))[0]), key=lambda m: m.name)

    @property
    def planetshine(self) -> bpy.types.Object | None:
        """The planet's lamp; None if the planet is not up."""
        return next((item for item in self.collection.all_objects if item.get(TAG) == "planetshine"), None)

    @property
    def lamps(self) -> list[bpy.types.Object]:
        """The lamps, in the order of ``light.lamps``."""
        return find_lamps(self.collection)

    @property
    def rocks(self) -> bpy.types.Object | None:
        """The object whose points are the rocks; None without rocks."""
        return next((item for item in self.collection.all_objects if item.get(TAG) == "rock"), None)

    @property
    def rock_count(self) -> int:
        """Number of rocks."""
        return sum(len(item.data.vertices) for item in self.collection.all_objects if item.get(TAG) == "rock")

    def edited_parts(self, *wanted: str) -> set[str]:
        """Find the parts that the user has edited since the build, among the ``wanted`` parts and roles, or among all
        if none is given.

        Raises IcyMoonError if edits cannot be detected.
        """
        known = self._read_marks()
        if self._update is None:
            return find_edited_parts(self.collection, known, *wanted)
        edited, changed = self._update.edited, tuple(self._update.changed)
        if unread := [name for name in wanted if name not in edited]:
            found = find_edited_parts(self.collection, known, *unread, trusts=True)
            edited |= {name: {part for part in found if is_wanted(part, (name,))} for name in unread}
        by_hand = set().union(*(edited[name] for name in wanted))
        return {part for part in by_hand if not (changed and is_wanted(part, changed))}

    def find_edited_parts(self, *wanted: str) -> Steps[set[str]]:
        """Find ``edited_parts`` in steps."""
        known = self._read_marks()
        return find_differing((yield from read_marks_in_steps(self.collection, *wanted)).parts, known, *wanted)

    @contextmanager
    def reading_marks_once(self) -> Iterator[None]:
        """Read the marks of each part only once within this context, however often its edits are asked for. The context
        is for an update of the scene; at its end, the marks of the changed parts are read and stored."""
        self._update = _Update({}, [])
        try:
            yield
        finally:
            changed, self._update = self._update.changed, None
            self._store_marks(*changed)

    @property
    def sky(self) -> dict[str, Any]:
        """Positions and brightness of the lights, see ``physics.light.sky.describe_sky``."""
        return dict(read_stored(self.sun, SKY, TABLE))

    @property
    def several_lights(self) -> bool:
        """Whether there may be light besides sunlight: from the planet, stars or objects that the user added."""
        return any(item.get(TAG) in ROLES for item in self.collection.all_objects) or bool(
            find_added_objects(self.collection)
        )

    @property
    def edited(self) -> bool:
        """Whether the user has edited or added something since the scene was built."""
        return finish(self.is_edited_in_steps())

    def is_edited_in_steps(self) -> Steps[bool]:
        """Find in steps whether the user has edited or added something, as ``edited`` does."""
        own = any(not is_stand_in(node.node_tree) for node in list_own_nodes(self.materials))
        return own or bool(find_added_objects(self.collection)) or bool((yield from self.find_edited_parts()))

    @property
    def preview(self) -> Settings:
        """Settings that are shown as a preview and override ``settings``; empty without a preview."""
        return typed(read_stored(self.collection, PREVIEW, TABLES_SHAPE))

    def remember(self, settings: Settings, preview: Parts, *changed: str) -> None:
        """Store the settings that the scene shows now, and new marks of the ``changed`` parts or roles."""
        self.settings = merged(settings)
        self.collection[SETTINGS], self.collection[PREVIEW] = json.dumps(self.settings), json.dumps(preview)
        if self._update is None:
            self._store_marks(*changed)
        else:
            self._update.changed += changed

    def _store_marks(self, *changed: str) -> None:
        if changed:
            known = read_stored(self.collection, FINGERPRINT, MARKS_SHAPE)
            if any(is_wanted(f"{role} data", changed) for role in ("terrain", "rock")):
                forget_marks()  # their meshes have changed
            self.collection[FINGERPRINT] = json.dumps(update_marks(self.collection, known, *changed))


def list_collections(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """List the collections of a scene that Build made, the oldest first.

    A linked collection, or an override of it, belongs to another file and is the user's own.
    """
    found = {
        each
        for each in scene.collection.children_recursive
        if each.get(TAG) == "scene" and each.library is None and each.override_library is None
    }
    return sorted(found, key=lambda each: each.session_uid)


def find_collection(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """Find the collection that Build made in this scene; None without one."""
    return next(iter(list_collections(scene)), None)


def find_scenes_sharing_build(scene: bpy.types.Scene) -> list[bpy.types.Scene]:
    """Find the other scenes that share the built collection of this scene: linked copies."""
    collection = find_collection(scene)
    if collection is None:
        return []
    return [other for other in bpy.data.scenes if other != scene and find_collection(other) == collection]


def find_built(scene: bpy.types.Scene) -> Built | None:
    """Find the built scene; None if nothing was built, or a part was deleted."""
    collection = find_collection(scene)
    if collection is None or SETTINGS not in collection:
        return None
    roles = find_built_objects(collection)
    if not {"terrain", "sun", "camera"} <= roles.keys():
        return None
    return Built(collection, roles["terrain"], roles["sun"], roles["camera"], typed(_read_settings(collection)), scene)


def refuse_excluded(scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
    """Raise IcyMoonError if a built part is excluded from all view layers, because renders of pairs ignore that."""
    ours = {collection, *collection.children_recursive}

    def kept_out(layer: bpy.types.LayerCollection) -> set[str]:
        mine = (
            {layer.collection.name}
            if layer.collection in ours and (layer.exclude or layer.holdout or layer.indirect_only)
            else set()
        )
        return mine.union(*map(kept_out, layer.children))

    names = set.intersection(*(kept_out(layer.layer_collection) for layer in scene.view_layers))
    if names:
        raise IcyMoonError(
            f"The collection {min(names)} is excluded from the view layer, held out or indirect only, "
            "which renders of pairs ignore; undo that, and use its camera icon (Disable in Renders) "
            "instead."
        )


def describe_ground_statistics(scene: bpy.types.Scene) -> tuple[str, ...]:
    """Describe procedural ground in three lines: a heading, the statistics that the settings of roughness ask for, and
    the measured statistics, with landforms, layers and snow.

    Empty for other ground. The lines are short, since the sidebar is narrow.
    """
    built = find_built(scene)
    found = built.statistics if built else {}
    if built is None or "made" not in found:
        return ()
    return (
        f"RMS slope over {found['baseline_m']:g} m, RMS height",
        f"By roughness: {_format_statistics(found['asked'])}",
        f"{'With landforms' if _adds_to_roughness(built.settings) else 'Built'}: {_format_statistics(found['made'])}",
    )


def shows_earlier_ground(scene: bpy.types.Scene, settings: Settings) -> bool:
    """Return whether the ground's statistics belong to other settings, or to a preview."""
    collection = find_collection(scene)
    if collection is None or SETTINGS not in collection:
        return False
    known = _read_settings(collection)
    return collection.get(PREVIEW, "{}") != "{}" or any(
        known.get(topic, {}).get(key) != settings[topic][key] for topic, key in _SHAPE_SETTINGS
    )


def _read_settings(collection: bpy.types.Collection) -> Settings:
    """Read the settings that a scene was built from. Do not change them."""
    text = collection[SETTINGS]
    return _parse_settings(text if isinstance(text, str) else "", f"{collection.name}: the property {SETTINGS}")


@lru_cache(maxsize=4)
def _parse_settings(text: str, where: str) -> Settings:
    """Parse settings from their text. Each text is parsed only once, since the window asks at every redraw."""
    return typed(parse_stored(text, where, TABLES_SHAPE))


def _adds_to_roughness(settings: Settings) -> bool:
    """Return whether the ground has landforms, snow or layers of noise."""
    return bool(settings.terrain.layers) or any(
        settings[topic.key][topic.settings[0].key] > 0 for topic in TOPICS.values() if topic.parent == LANDFORMS
    )


def _format_statistics(numbers: dict[str, float | None]) -> str:
    slope, height = numbers["rms_slope_deg"], numbers["rms_height_m"]
    return f"{'unknown' if slope is None else f'{slope:.1f}°'}, {'unknown' if height is None else f'{height:.2g} m'}"


def make_build_facts(settings: Settings) -> str:
    """Return ``Built.extra`` of a scene newly built from settings."""
    return hash_content(settings) + reflectance_laws.describe_osl_substitute(settings)


def list_changed_settings(built: Built, settings: Settings) -> list[str]:
    """List the names of the settings that the built scene does not show yet, and of files whose content has changed."""
    shown = [
        (topic.key, s.key)
        for topic in TOPICS.values()
        for s in topic.settings
        if s.effect in ("geometry", "material", "light", "lander", "camera")
    ]
    changed = [
        f"{topic}.{key}" for topic, key in shown if built.settings.get(topic, {}).get(key) != settings[topic][key]
    ]
    # A missing file changes nothing: the scene still contains the ground and surfaces made from it.
    if do_files_exist(settings) and built.content != hash_content(settings):
        changed += find_used_files(settings)
    return changed
