"""Operators that add, remove and move the entries of a list in the sidebar. A subclass names its list."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import bpy

from ..settings.change_announcements import announce
from .operator_type import ExplainedOperator


class EditedList(NamedTuple):
    """A list of a property group. It has the list's name, the name of the selected index, and the effect of a
    change."""

    group: bpy.types.PropertyGroup
    name: str
    active: str
    effect: str

    @property
    def entries(self) -> bpy.types.bpy_prop_collection:
        """The entries, a Blender collection."""
        return getattr(self.group, self.name)

    @property
    def selected(self) -> int:
        """The index of the selected entry; of the last entry if the selected one was removed."""
        return min(getattr(self.group, self.active), len(self.entries) - 1)

    def select(self, index: int, scene: bpy.types.Scene) -> None:
        """Select an entry and announce a change, because Blender itself calls updates for changed entries only."""
        setattr(self.group, self.active, max(0, min(index, len(self.entries) - 1)))
        announce(scene, self.effect)


class _ListOperator(ExplainedOperator):
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @staticmethod
    def find(scene: bpy.types.Scene) -> EditedList:
        """Return the list that this operator edits."""
        raise NotImplementedError


class AddEntry(_ListOperator):
    """Mix-in: an operator that adds an entry at the end and selects it."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        edited = self.find(context.scene)
        edited.entries.add()
        edited.select(len(edited.entries) - 1, context.scene)
        return {"FINISHED"}


class _EntryOperator(_ListOperator):
    #: The reason, without a full stop, why no entry can be edited.
    empty: ClassVar[str]

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if cls.find(context.scene).entries else cls.empty


class RemoveEntry(_EntryOperator):
    """Mix-in: an operator that removes the selected entry."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        edited = self.find(context.scene)
        here = edited.selected
        edited.entries.remove(here)
        edited.select(here, context.scene)
        return {"FINISHED"}


class MoveEntry(_EntryOperator):
    """Mix-in: an operator that moves the selected entry by one place. A subclass declares ``direction``, because
    Blender finds no property of a mix-in."""

    direction: str  # UP or DOWN

    def execute(self, context: bpy.types.Context) -> set[str]:
        edited = self.find(context.scene)
        here = edited.selected
        there = here + (-1 if self.direction == "UP" else 1)
        if not 0 <= there < len(edited.entries):
            return {"CANCELLED"}
        edited.entries.move(here, there)
        edited.select(there, context.scene)
        return {"FINISHED"}
