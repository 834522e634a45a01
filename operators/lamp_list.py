"""The list of lamps: add, remove, move."""

from __future__ import annotations

import bpy

from ..settings.table import TOPICS
from ..support.labels import LAMP_GROUPS
from .list_editing import AddEntry, EditedList, MoveEntry, RemoveEntry


class _LampOperator:
    """Mix-in: an operator on the list of lamps."""

    empty = "There is no lamp yet"

    @staticmethod
    def find(scene: bpy.types.Scene) -> EditedList:
        return EditedList(scene.icymoon.light, "lamps", "lamps_active", TOPICS["light"]["lamps"].effect)


class ICYMOON_OT_lamp_add(_LampOperator, AddEntry, bpy.types.Operator):
    """Add a lamp at the cameras, which shines ahead"""

    bl_idname = "icymoon.lamp_add"
    bl_label = "Add Lamp"

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        full = len(cls.find(context.scene).entries) >= len(LAMP_GROUPS)
        return f"{len(LAMP_GROUPS)} lamps are the most" if full else ""


class ICYMOON_OT_lamp_remove(_LampOperator, RemoveEntry, bpy.types.Operator):
    """Remove the selected lamp"""

    bl_idname = "icymoon.lamp_remove"
    bl_label = "Remove Lamp"


class ICYMOON_OT_lamp_move(_LampOperator, MoveEntry, bpy.types.Operator):
    """Move the selected lamp. Lamp Factors has the same order"""

    bl_idname = "icymoon.lamp_move"
    bl_label = "Move Lamp"

    direction: bpy.props.EnumProperty(
        name="Direction",
        description="Direction in which the lamp moves in the list",
        items=(("UP", "Up", "Toward the first"), ("DOWN", "Down", "Toward the last")),
    )


def describe_entry(entry: bpy.types.PropertyGroup) -> str:
    """Describe a lamp in a line: kind, power and position."""
    names = {setting.key: setting.choice_labels for setting in TOPICS["light"]["lamps"].entries}
    return f"{names['kind'][entry.kind]}, {entry.power_w:.3g} W, {names['place'][entry.place]}"


CLASSES = (ICYMOON_OT_lamp_add, ICYMOON_OT_lamp_remove, ICYMOON_OT_lamp_move)
