"""Building again in what is there, so that whatever points to the ground, the Sun or the camera still does.

Objects stay, with what the window knows of them: names, selection, whether they are hidden in views. What they hold
takes the place of what they held, for everyone who uses it.
"""

from __future__ import annotations

from typing import Any

import bpy

from .. import compat
from .datablocks.fingerprint import OWN, TAG
from .datablocks.stored_properties import stored_properties
from .remove import leftovers, remove_if_unused

#: What is given to an object or made in it by itself.
_BY_ITSELF = {"data", "animation_data", "pose"}


def owned_blocks(collection: bpy.types.Collection) -> dict[str, Any]:
    """What a built collection states is its own: objects by role, "ROLE data" and "ROLE material"."""
    return {key.removeprefix(OWN): collection[key] for key in collection.keys()  # noqa: SIM118 - no mapping
            if key.startswith(OWN) and collection[key] is not None}


def set_owned_blocks(collection: bpy.types.Collection, what: dict[str, Any]) -> None:
    """Say what is a built collection's own, and nothing else."""
    for key in [key for key in collection.keys() if key.startswith(OWN)]:  # noqa: SIM118
        del collection[key]
    for name, block in what.items():
        collection[f"{OWN}{name}"] = block


def is_owned_elsewhere(collection: bpy.types.Collection, block: Any) -> bool:
    """Whether another built collection has a data-block too, as the full copy of a scene has its materials."""
    return any(block in owned_blocks(other).values() for other in bpy.data.collections
               if other != collection and other.get(TAG) == "scene")


def replace_block(old: Any, new: Any) -> None:
    """Put a new data-block in the place of an old one, with its name and for all its users."""
    name = old.name
    old.user_remap(new)
    bpy.data.batch_remove([old])
    new.name = name


def update_object(old: bpy.types.Object, new: bpy.types.Object) -> bpy.types.Object:
    """Make an object what ``new`` is, which is gone afterwards, and return it."""
    found = leftovers([old])
    _clear_object(old)
    old.data = new.data
    _copy_properties(old, new)
    for modifier in new.modifiers:
        _copy_properties(old.modifiers.new(modifier.name, modifier.type), modifier)
    for constraint in new.constraints:
        _copy_properties(old.constraints.new(constraint.type), constraint)
    for key in compat.custom_properties(new):
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
    for key in compat.custom_properties(item):
        if not hasattr(item[key], "keys"):
            del item[key]


def _copy_properties(old: Any, new: Any) -> None:
    """Give a structure the properties of another that count; what only the window shows stays."""
    kind: Any = type(new)
    # Blender turns all rotations into those of another mode.
    for name, how in sorted(stored_properties(kind), key=lambda each: each[0] != "rotation_mode"):
        value = getattr(new, name)
        if name in _BY_ITSELF or how == "items":
            continue
        if not new.bl_rna.properties[name].is_readonly:
            if how != "pointer" or getattr(old, name) != value:
                setattr(old, name, value)
        elif isinstance(value, bpy.types.bpy_struct) and not isinstance(value, bpy.types.ID):
            _copy_properties(getattr(old, name), value)
