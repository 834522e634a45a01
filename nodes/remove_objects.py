"""Removes built objects with the data-blocks that only they use."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy

from .datablocks.fingerprint import OWN, STAND_IN, TAG
from .ground.rocks import find_rock_parts
from .light.lamps import SPREAD
from .surface import sun_inputs
from .surface.images import remove_unused_images


def find_parts(objects: list[bpy.types.Object]) -> tuple[list[bpy.types.Object], list[Any]]:
    """Return the objects together with the shapes of rocks that they instance, and the node groups and collections of
    these instances."""
    others = [part for item in objects for part in find_rock_parts(item, TAG)]
    return (
        [*objects, *(part for part in others if isinstance(part, bpy.types.Object))],
        [part for part in others if not isinstance(part, bpy.types.Object)],
    )


def find_materials(objects: list[bpy.types.Object]) -> set[bpy.types.Material]:
    meshes = {item.data for item in objects if isinstance(item.data, bpy.types.Mesh)}
    return {material for mesh in meshes for material in mesh.materials if material is not None}


def remove_unused(meshes: Iterable[Any], others: Iterable[Any]) -> None:
    """Remove data-blocks without users: an orphaned mesh would stay in memory."""
    for blocks in (meshes, others):
        unused = [block for block in blocks if block is not None and block.users == 0]
        if unused:
            bpy.data.batch_remove(unused)


def remove_leftovers() -> None:
    """Remove built worlds, collections of lamps, shapes of rocks and stand-ins for own groups that have no users, and
    all objects that were built in scenes that the user has deleted."""
    for collection in [c for c in bpy.data.collections if c.get(TAG) == "scene" and c.users == 0]:
        remove_objects([item for item in collection.all_objects if TAG in item])
        bpy.data.batch_remove([*(c for c in collection.children_recursive if TAG in c), collection])
    parts = [
        block
        for kind in (bpy.data.node_groups, bpy.data.collections, bpy.data.objects)
        for block in kind
        if block.get(TAG) in ("rock shapes", "rock shape")
    ]
    remove_if_unused((parts, {item.data for item in parts if isinstance(item, bpy.types.Object)}, set()))
    remove_unused([], [w for w in bpy.data.worlds if TAG in w])
    remove_unused([], [c for c in bpy.data.collections if c.get(TAG) == sun_inputs.SHARED])
    remove_unused([], [group for group in bpy.data.node_groups if group.get(TAG) == STAND_IN])


def find_leftovers(objects: list[bpy.types.Object]) -> tuple[list[Any], set[Any], set[Any]]:
    """Find everything that may lose its users when objects are removed: their parts, their data and their materials."""
    every, others = find_parts(objects)
    parts = [*others, *(item for item in every if item not in objects)]
    return (
        parts,
        {item.data for item in every if item.data is not None},
        {m for m in find_materials(every) if TAG in m},
    )


def remove_if_unused(found: tuple[list[Any], set[Any], set[Any]]) -> None:
    """Remove the data-blocks of ``find_leftovers`` that have no users. Copies of a scene may use the others."""
    parts, data, materials = found
    for kind in (bpy.types.NodeTree, bpy.types.Collection, bpy.types.Object):  # each kind uses the next
        remove_unused([], [part for part in parts if isinstance(part, kind)])
    remove_unused(data, materials)
    remove_unused([], [text for text in bpy.data.texts if text.get(TAG) == SPREAD])
    remove_unused_images()


def remove_objects(objects: list[bpy.types.Object]) -> None:
    """Remove objects with the meshes, lamps, cameras, materials and node groups that only they use."""
    found = find_leftovers(objects)
    _release_blocks([*objects, *found[1], *found[2]])
    bpy.data.batch_remove(objects)
    remove_if_unused(found)


def _release_blocks(blocks: list[Any]) -> None:
    """Remove references of built collections to data-blocks that will be removed."""
    for collection in [c for c in bpy.data.collections if c.library is None]:
        for key in [key for key in collection.keys() if key.startswith(OWN)]:  # noqa: SIM118 - no mapping
            if collection[key] in blocks:
                del collection[key]


def free_names(blocks: Iterable[Any]) -> None:
    """Rename data-blocks to the names of the data-blocks that they replaced, without a number at the end."""
    for block in blocks:
        block.name = block.name.split(".")[0]
