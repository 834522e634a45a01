"""Removing what was built, with all that only it uses."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy

from . import sunlight
from .fingerprint import TAG
from .images import remove_unused_images
from .rocks import parts_of


def with_parts(objects: list[bpy.types.Object]) -> tuple[list[bpy.types.Object], list[Any]]:
    """Objects with those that others among them are made with, and the other data-blocks of that kind."""
    others = [part for item in objects for part in parts_of(item, TAG)]
    return ([*objects, *(part for part in others if isinstance(part, bpy.types.Object))],
            [part for part in others if not isinstance(part, bpy.types.Object)])


def materials_of(objects: list[bpy.types.Object]) -> set[bpy.types.Material]:
    meshes = {item.data for item in objects if isinstance(item.data, bpy.types.Mesh)}
    return {material for mesh in meshes for material in mesh.materials if material is not None}


def remove_unused(meshes: Iterable[Any], others: Iterable[Any]) -> None:
    """Remove data-blocks that nothing uses: an orphaned mesh would stay in memory for good."""
    for blocks in (meshes, others):
        unused = [block for block in blocks if block is not None and block.users == 0]
        if unused:
            bpy.data.batch_remove(unused)


def remove_leftovers() -> None:
    """Remove built worlds and lamps' collections that are no longer used."""
    remove_unused([], [w for w in bpy.data.worlds if TAG in w])
    remove_unused([], [c for c in bpy.data.collections if c.get(TAG) == sunlight.SHARED])


def remove(objects: list[bpy.types.Object]) -> None:
    """Remove objects with the meshes, lamps, cameras, materials and node groups that only they use."""
    objects, others = with_parts(objects)
    data = {item.data for item in objects if item.data is not None}
    materials = {m for m in materials_of(objects) if TAG in m}
    bpy.data.batch_remove([*objects, *others])
    remove_unused(data, materials)
    remove_unused_images()


def free_names(blocks: Iterable[Any]) -> None:
    """Give data-blocks the names that were taken by those which they replace."""
    for block in blocks:
        block.name = block.name.split(".")[0]
