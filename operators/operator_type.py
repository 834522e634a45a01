"""The attributes that Blender gives every operator, as a type for mix-ins. Blender sees no class here."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

if TYPE_CHECKING:

    class OperatorMixin:
        """A class that is combined with bpy.types.Operator."""

        bl_property: str
        properties: bpy.types.OperatorProperties

        def report(self, kind: set[str], message: str, /) -> None: ...

        @classmethod
        def poll_message_set(cls, message: str) -> None: ...

        def execute(self, context: bpy.types.Context) -> set[str]: ...
else:
    OperatorMixin = object  # so that no method here hides a method of the operator
