"""Whether a built scene is still what its settings state.

A pair is named by the settings that made it. When the user has sculpted the ground, moved the
camera, edited the material or put a lander in, the settings no longer say it all, and the name
must change. The marks cover all that a render can show, in parts, so that an edit of one part
leaves the others to the settings; anything that the builders did not make counts as added.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import bpy

from ... import compat
from .marks import Walk, hashed

NAME = "Icy Moon"  # what the names of all that the builders make begin with
TAG = "icymoon"  # custom property that marks what the builders made, its value the role
OWN = "icymoon_own_"  # begins the custom properties of a built collection that point to its objects, by their roles

#: What marks are made by, under this name among them: those of other makers cannot be compared.
MAKER = "maker"
#: To be raised when the same settings come to be built in another way, or marked in another way.
_SCHEME = 2


def maker() -> str:
    """What makes marks here: this scheme in this Blender, whose properties differ from those of another."""
    return f"{_SCHEME} {compat.blender_series()}"


def built_objects(collection: bpy.types.Collection) -> dict[str, bpy.types.Object]:
    """What the builders made in a collection, by role. A copy that the user made of it is the user's own."""
    tagged = [item for item in collection.all_objects if TAG in item]
    roles = {item[TAG]: item for item in reversed(tagged)}
    pointed = {role: collection.get(f"{OWN}{role}") for role in roles if f"{OWN}{role}" in collection}
    roles |= pointed
    return {role: item for role, item in roles.items() if item is not None and item in tagged}


def added_objects(collection: bpy.types.Collection) -> list[bpy.types.Object]:
    """The objects in a built collection that the builders did not make."""
    ours = set(built_objects(collection).values())
    return [item for item in collection.all_objects if item not in ours]


def instanced_objects(item: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """The objects that the node groups of an object's modifiers put into instances."""
    for tree in (getattr(modifier, "node_group", None) for modifier in item.modifiers):
        for socket in (s for node in tree.nodes for s in node.inputs if s.type == "COLLECTION") if tree else ():
            yield from sorted(socket.default_value.all_objects if socket.default_value else (), key=lambda o: o.name)


def _surfaces(item: bpy.types.Object) -> list[list[bpy.types.Material | None]]:
    """The materials of an object, and of those that it instances: once if they have the same, however many they are."""
    own, others = ([list(each.data.materials) for each in items if isinstance(each.data, bpy.types.Mesh)]
                   for items in ((item,), instanced_objects(item)))
    return own + (others[:1] if all(slots == others[0] for slots in others) else others)


def _among(part: str, wanted: tuple[str, ...]) -> bool:
    return part != MAKER and (not wanted or part in wanted or part.split()[0] in wanted)


def _rendered_objects(collection: bpy.types.Collection) -> set[bpy.types.Object]:
    """The objects that are in a collection which is rendered."""
    if collection.hide_render:
        return set()
    return set(collection.objects).union(*map(_rendered_objects, collection.children))


@dataclass
class Reading:
    """Marks of the parts of a collection, why some of them cannot be marked, and whether the frame counts."""

    parts: dict[str, str]
    refused: list[str]
    changes_with_time: bool


def read_marks(collection: bpy.types.Collection, *wanted: str) -> Reading:
    """The marks of everything in a built collection, or of wanted parts and roles.

    The parts are called "ROLE object", "ROLE data" and "ROLE materials", and "added" is what the user has put in.
    They are equal in every process that loads the file.
    """
    ours, shown = built_objects(collection), _rendered_objects(collection)
    roles: dict[Any, str] = {item: f"the {role}" for role, item in ours.items()}
    surfaces = {role: _surfaces(item) for role, item in ours.items()}
    listed = {material for each in surfaces.values() for slots in each for material in slots if material is not None}
    aimed = {material.node_tree for item in collection.all_objects for slots in _surfaces(item)
             for material in slots if material is not None}
    deep, flat = Walk(roles, aimed), Walk(roles | dict.fromkeys(listed, "listed"), aimed)
    found: dict[str, Any] = {}
    for role, item in ours.items():
        if _among(f"{role} object", wanted):
            found[f"{role} object"] = [item in shown, flat.content(item, ("data", "material_slots"))]
        if _among(f"{role} data", wanted):
            found[f"{role} data"] = flat.content(item.data, ("materials",)) if item.data else []
        if _among(f"{role} materials", wanted):
            found[f"{role} materials"] = [
                [[material and deep.mark(material) for material in slots] for slots in surfaces[role]],
                [slot.material and deep.mark(slot.material) for slot in item.material_slots if slot.link == "OBJECT"]]
    if _among("added", wanted):
        others = sorted(hashed([item in shown, deep.mark(item)]) for item in added_objects(collection))
        found |= {"added": others} if others else {}
    return Reading({part: hashed(content) for part, content in found.items()}, [*flat.refused, *deep.refused],
                   flat.changes_with_time or deep.changes_with_time)


def parts(collection: bpy.types.Collection, *wanted: str) -> dict[str, str]:
    """The marks of ``read_marks``, with what they are made by."""
    return {**read_marks(collection, *wanted).parts, MAKER: maker()}


def fingerprint(collection: bpy.types.Collection) -> str:
    """Hash of everything in a built collection."""
    return hashed(sorted(parts(collection).items()))


def differing(now: Mapping[str, str], known: Mapping[str, str], *wanted: str) -> set[str]:
    """Names of the parts, all or the wanted parts and roles, that are not as ``known``; what was added is none."""
    names = {part for part in now.keys() | known.keys() if _among(part, wanted)} - {"added"}
    return {part for part in names if now.get(part) != known.get(part)}


def edited_parts(collection: bpy.types.Collection, known: Mapping[str, str], *wanted: str) -> set[str]:
    """``differing`` of a collection as it is now."""
    return differing(read_marks(collection, *wanted).parts, known, *wanted)


def updated_marks(collection: bpy.types.Collection, known: Mapping[str, str], *changed: str) -> dict[str, str]:
    """``known`` with the changed parts and roles as they are now."""
    kept = {part: mark for part, mark in known.items() if not (changed and _among(part, changed))}
    return kept | (read_marks(collection, *changed).parts if changed else {})
