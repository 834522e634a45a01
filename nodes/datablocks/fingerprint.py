"""Detects whether a built scene was edited by hand.

The id of a pair comes from the settings. If the user has sculpted the ground, moved the camera, edited a material or
added a lander, the settings no longer determine the images, so the id must change. Marks (hashes) cover everything that
a render can show. Each part has its own mark, so that an edit of one part does not affect the marks of others.
Everything that the builders did not make counts as added.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import bpy

from ...support.blender import compat
from ...support.steps import Steps, finish
from .array_marks import list_mesh_marks_in_steps
from .known_marks import find_known_marks
from .marks import BlockHasher, hash_marks

NAME = "Icy Moon"  # prefix of the names of everything that the builders make
TAG = "icymoon"  # custom property of everything that the builders make; its value is the role
OWN = "icymoon_own_"  # prefix of the custom properties of a built collection that point to its objects, by role

OWN_GROUP = "Own Group"  # label of the nodes in built materials that have a node group of the user's
STAND_IN = "own group stand-in"  # role of a group that stands for a group of another file

#: Key of ``describe_maker`` among the marks. Marks of different makers cannot be compared.
MAKER = "maker"
#: Version of the marks. Raise this number when the same settings are built or marked in another way.
_MARKS_VERSION = 2


def describe_maker() -> str:
    """Describe the version of the marks and Blender's series, since each series has other properties."""
    return f"{_MARKS_VERSION} {compat.find_series()}"


def find_built_objects(collection: bpy.types.Collection) -> dict[str, bpy.types.Object]:
    """Find the objects that the builders made in a collection, by role, without copies that the user made of them."""
    tagged = [item for item in collection.all_objects if TAG in item]
    roles = {item[TAG]: item for item in reversed(tagged)}
    pointed = {role: collection.get(f"{OWN}{role}") for role in roles if f"{OWN}{role}" in collection}
    roles |= pointed
    return {role: item for role, item in roles.items() if item is not None and item in tagged}


def find_added_objects(collection: bpy.types.Collection) -> list[bpy.types.Object]:
    """Find the objects in a built collection that the builders did not make."""
    ours = set(find_built_objects(collection).values())
    return [item for item in collection.all_objects if item not in ours]


def list_own_nodes(materials: Iterable[bpy.types.Material | None]) -> Iterator[bpy.types.Node]:
    """Yield the nodes in built materials that have a node group of the user's, or a stand-in for it."""
    for material in materials:
        tree = material.node_tree if material is not None else None
        for node in tree.nodes if tree is not None else ():
            if node.bl_idname == "ShaderNodeGroup" and node.label == OWN_GROUP:
                yield node


def is_stand_in(group: bpy.types.NodeTree | None) -> bool:
    """Return whether the node group of ``list_own_nodes`` only stands for a group of another file."""
    return group is None or group.get(TAG) == STAND_IN


def find_instanced_objects(item: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """Yield the objects that an object instances through the node groups of its modifiers."""
    for tree in (getattr(modifier, "node_group", None) for modifier in item.modifiers):
        for socket in (s for node in tree.nodes for s in node.inputs if s.type == "COLLECTION") if tree else ():
            yield from sorted(socket.default_value.all_objects if socket.default_value else (), key=lambda o: o.name)


def _list_surfaces(item: bpy.types.Object) -> list[list[bpy.types.Material | None]]:
    """List the materials of an object, and of each object that it instances. If all instanced objects have the same
    materials, these are listed once."""
    own, others = (
        [list(each.data.materials) for each in items if isinstance(each.data, bpy.types.Mesh)]
        for items in ((item,), find_instanced_objects(item))
    )
    return own + (others[:1] if all(slots == others[0] for slots in others) else others)


def is_wanted(part: str, wanted: tuple[str, ...]) -> bool:
    """Return whether a part is among the ``wanted`` parts and roles, or any part is wanted; False for ``MAKER``."""
    return part != MAKER and (not wanted or part in wanted or part.split()[0] in wanted)


def _find_rendered_objects(collection: bpy.types.Collection) -> set[bpy.types.Object]:
    """Find the objects of a collection that are rendered."""
    if collection.hide_render:
        return set()
    return set(collection.objects).union(*map(_find_rendered_objects, collection.children))


@dataclass
class Reading:
    """Marks of the parts of a collection, the reasons why some parts have no mark, and whether parts change with the
    frame."""

    parts: dict[str, str]
    refused: list[str]
    changes_with_time: bool


def list_meshes(collection: bpy.types.Collection) -> list[bpy.types.Mesh]:
    """List the meshes of the objects that the builders made in a collection, and of the objects that these instance."""
    return list_meshes_of(find_built_objects(collection).values())


def list_meshes_of(objects: Collection[bpy.types.Object]) -> list[bpy.types.Mesh]:
    """List the meshes of objects, and of the objects that these instance."""
    every = [*objects, *(shape for item in objects for shape in find_instanced_objects(item))]
    return [item.data for item in every if isinstance(item.data, bpy.types.Mesh)]


def read_marks(collection: bpy.types.Collection, *wanted: str, trusts: bool = False) -> Reading:
    """Read marks at once, see ``read_marks_in_steps``."""
    return finish(read_marks_in_steps(collection, *wanted, trusts=trusts))


def read_marks_in_steps(collection: bpy.types.Collection, *wanted: str, trusts: bool = False) -> Steps[Reading]:
    """Read the marks of everything in a built collection, or of the wanted parts and roles, in steps.

    With ``trusts`` it uses the marks of ``known_marks``; otherwise it reads all meshes anew.

    The parts are "ROLE object", "ROLE data" and "ROLE materials", and "added" for what the user has added: objects, and
    the node groups that settings name. The marks are equal in every process that loads the file.
    """
    ours, shown = find_built_objects(collection), _find_rendered_objects(collection)
    roles: dict[Any, str] = {item: f"the {role}" for role, item in ours.items()}
    every = {item: _list_surfaces(item) for item in collection.all_objects}
    surfaces = {role: every[item] for role, item in ours.items()}
    listed = {material for each in surfaces.values() for slots in each for material in slots if material is not None}
    aimed = {
        material.node_tree for each in every.values() for slots in each for material in slots if material is not None
    }
    groups = {node.node_tree for node in list_own_nodes(listed)} - {None}
    roles |= dict.fromkeys(groups, OWN_GROUP)
    deep, flat = BlockHasher(roles, aimed), BlockHasher(roles | dict.fromkeys(listed, "listed"), aimed)
    if trusts:
        deep.mesh_marks = flat.mesh_marks = find_known_marks(list_meshes(collection))
    found: dict[str, Any] = {}
    for role, item in ours.items():
        if is_wanted(f"{role} object", wanted):
            for shape in find_instanced_objects(item):  # 50 shapes of rocks take 0.03 s together
                yield from _keep_mesh_marks(flat, shape.data)
            found[f"{role} object"] = [item in shown, flat.content(item, ("data", "material_slots"))]
            yield None
        if is_wanted(f"{role} data", wanted):
            yield from _keep_mesh_marks(flat, item.data)
            found[f"{role} data"] = flat.content(item.data, ("materials",)) if item.data else []
            yield None
        if is_wanted(f"{role} materials", wanted):
            found[f"{role} materials"] = [
                [[material and deep.mark(material) for material in slots] for slots in surfaces[role]],
                [slot.material and deep.mark(slot.material) for slot in item.material_slots if slot.link == "OBJECT"],
            ]
            yield None
    if is_wanted("added", wanted):
        others = sorted(hash_marks([item in shown, deep.mark(item)]) for item in find_added_objects(collection))
        others += sorted(hash_marks(deep.content(group)) for group in groups if not is_stand_in(group))
        found |= {"added": others} if others else {}
    return Reading(
        {part: hash_marks(content) for part, content in found.items()},
        [*flat.refused, *deep.refused],
        flat.changes_with_time or deep.changes_with_time,
    )


def _keep_mesh_marks(hasher: BlockHasher, data: bpy.types.ID | None) -> Steps[None]:
    """Read the marks of a mesh in steps, for a hasher that lacks them. A mesh in Edit Mode has no arrays."""
    if isinstance(data, bpy.types.Mesh) and not data.is_editmode and data not in hasher.mesh_marks:
        hasher.mesh_marks[data] = yield from list_mesh_marks_in_steps(data)


def read_parts(collection: bpy.types.Collection, *wanted: str) -> dict[str, str]:
    """Read the marks of ``read_marks``, with the result of ``describe_maker`` as a further mark."""
    return {**read_marks(collection, *wanted).parts, MAKER: describe_maker()}


def make_fingerprint(collection: bpy.types.Collection) -> str:
    """Hash everything in a built collection."""
    return hash_marks(sorted(read_parts(collection).items()))


def find_differing(now: Mapping[str, str], known: Mapping[str, str], *wanted: str) -> set[str]:
    """Find the names of the parts whose marks differ from ``known``, among the ``wanted`` parts and roles, or among all
    if none is given. "added" never counts."""
    names = {part for part in now.keys() | known.keys() if is_wanted(part, wanted)} - {"added"}
    return {part for part in names if now.get(part) != known.get(part)}


def find_edited_parts(
    collection: bpy.types.Collection, known: Mapping[str, str], *wanted: str, trusts: bool = False
) -> set[str]:
    """Find the parts of a collection whose present marks differ from ``known``, see ``find_differing`` and
    ``read_marks``."""
    return find_differing(read_marks(collection, *wanted, trusts=trusts).parts, known, *wanted)


def update_marks(collection: bpy.types.Collection, known: Mapping[str, str], *changed: str) -> dict[str, str]:
    """Return ``known`` with the present marks of the ``changed`` parts and roles, at least one."""
    kept = {part: mark for part, mark in known.items() if not is_wanted(part, changed)}
    return kept | read_marks(collection, *changed).parts
