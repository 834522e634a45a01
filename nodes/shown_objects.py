"""Shows objects in a scene beside the built objects, in a collection that is not rendered: results and points."""

from __future__ import annotations

import bpy

from .datablocks.fingerprint import TAG


def link_shown(scene: bpy.types.Scene, item: bpy.types.Object, name: str, role: str) -> None:
    """Show an object in front of others, in a collection of this ``name``. Both are tagged with the ``role``."""
    item[TAG] = role
    item.hide_render = item.show_in_front = True
    begin_collection(scene, name, role).objects.link(item)


def begin_collection(scene: bpy.types.Scene, name: str, role: str) -> bpy.types.Collection:
    """Add a collection, which is not rendered, to a scene."""
    collection = bpy.data.collections.new(name)
    collection[TAG] = role
    collection.hide_render = True
    scene.collection.children.link(collection)
    return collection


def find_collections(scene: bpy.types.Scene, role: str) -> list[bpy.types.Collection]:
    """Find the collections of a scene with this role."""
    return [each for each in scene.collection.children if each.get(TAG) == role]


def list_shown(scene: bpy.types.Scene, role: str) -> list[bpy.types.Object]:
    """List the objects with this role that are shown in a scene, without the user's own."""
    return [item for each in find_collections(scene, role) for item in each.objects if item.get(TAG) == role]


def remove_shown(scene: bpy.types.Scene, role: str) -> bool:
    """Remove the collections of a role with their objects, meshes, materials and node groups, and return whether there
    were any. The user's own objects in them stay in the scene."""
    collections = find_collections(scene, role)
    for collection in collections:
        items = [item for item in collection.objects if item.get(TAG) == role]
        meshes = {item.data for item in items if item.data}
        parts = {slot.material for item in items for slot in item.material_slots}
        parts |= {modifier.node_group for item in items for modifier in item.modifiers if modifier.type == "NODES"}
        for other in [item for item in collection.objects if item not in items]:
            scene.collection.objects.link(other)
        bpy.data.batch_remove(
            [*items, *meshes, *(part for part in parts if part and part.get(TAG) == role), collection]
        )
    return bool(collections)
