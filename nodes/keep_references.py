"""Builds again into the existing objects, so that references to the ground, the Sun or the camera stay valid.

Objects keep their names, their selection and whether they are hidden in views. Their new data replaces the old data
for all its users.
"""

from __future__ import annotations

from typing import Any

import bpy

from ..support.blender import compat
from .datablocks.fingerprint import OWN, TAG
from .datablocks.stored_properties import stored_properties
from .remove_objects import find_leftovers, remove_if_unused

#: Properties that ``_copy_properties`` does not copy: they are set, or made by Blender, separately. Blender 5.2 makes
#: the ``properties`` of a modifier from its node group, and crashes when it quits if a script has written them.
_SET_SEPARATELY = {"data", "animation_data", "pose", "properties"}


def find_owned_blocks(collection: bpy.types.Collection) -> dict[str, Any]:
    """Find the data-blocks that a built collection owns: objects by role, "ROLE data" and "ROLE material"."""
    return {
        key.removeprefix(OWN): collection[key]
        for key in collection.keys()  # noqa: SIM118 - no mapping
        if key.startswith(OWN) and collection[key] is not None
    }


def set_owned_blocks(collection: bpy.types.Collection, blocks: dict[str, Any]) -> None:
    """Replace the data-blocks that a built collection owns."""
    for key in [key for key in collection.keys() if key.startswith(OWN)]:  # noqa: SIM118
        del collection[key]
    for name, block in blocks.items():
        collection[f"{OWN}{name}"] = block


def is_owned_by_another_build(collection: bpy.types.Collection, block: bpy.types.ID) -> bool:
    """Return whether another built collection uses a data-block too. After a full copy of a scene, both scenes own the
    materials."""
    return any(
        block in find_owned_blocks(other).values()
        for other in bpy.data.collections
        if other != collection and other.get(TAG) == "scene"
    )


def replace_block(old: bpy.types.ID, new: bpy.types.ID) -> None:
    """Replace a data-block for all its users. The new data-block takes its name."""
    name = old.name
    old.user_remap(new)
    bpy.data.batch_remove([old])
    new.name = name


def update_object(old: bpy.types.Object, new: bpy.types.Object) -> bpy.types.Object:
    """Give an object the data and properties of ``new``, remove ``new``, and return the object."""
    found = find_leftovers([old])
    _clear_object(old)
    old.data = new.data
    _copy_properties(old, new)
    for modifier in new.modifiers:
        _copy_properties(old.modifiers.new(modifier.name, modifier.type), modifier)
    for constraint in new.constraints:
        _copy_properties(old.constraints.new(constraint.type), constraint)
    for key in compat.list_custom_properties(new):
        if not hasattr(new[key], "keys"):
            old[key] = new[key]
    new.user_remap(old)  # the planet follows the camera
    bpy.data.batch_remove([new])
    remove_if_unused(found)
    return old


def _clear_object(item: bpy.types.Object) -> None:
    item.animation_data_clear()
    item.modifiers.clear()
    item.constraints.clear()
    for slot in item.material_slots:
        slot.link = "DATA"
    for key in compat.list_custom_properties(item):
        if not hasattr(item[key], "keys"):
            del item[key]


def _copy_properties(old: bpy.types.ID, new: bpy.types.ID) -> None:
    """Copy the properties that a render can show from ``new`` to ``old``; properties of the window stay."""
    kind: Any = type(new)
    # The rotation mode comes first: Blender converts all rotations when it changes.
    for name, how in sorted(stored_properties(kind), key=lambda each: each[0] != "rotation_mode"):
        value = getattr(new, name)
        if name in _SET_SEPARATELY or how == "items":
            continue
        if not new.bl_rna.properties[name].is_readonly:
            if how != "pointer" or getattr(old, name) != value:
                setattr(old, name, value)
        elif isinstance(value, bpy.types.bpy_struct) and not isinstance(value, bpy.types.ID):
            _copy_properties(getattr(old, name), value)
