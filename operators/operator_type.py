"""Base classes of mix-ins for operators: attributes of all operators for type checkers, and grey buttons with a reason.

Blender itself gives every operator these attributes, and does not see the type.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

if TYPE_CHECKING:

    class OperatorMixin:
        """A class that is combined with ``bpy.types.Operator``."""

        bl_property: str
        properties: bpy.types.OperatorProperties
        options: bpy.types.OperatorOptions

        def report(self, kind: set[str], message: str, /) -> None: ...

        @classmethod
        def poll_message_set(cls, message: str) -> None: ...

        def execute(self, context: bpy.types.Context) -> set[str]: ...
else:
    OperatorMixin = object  # so that no method here hides a method of the operator


class ExplainedOperator(OperatorMixin):
    """Mix-in: an operator that cannot run while there is an obstacle. Its button is then grey, and its tooltip gives
    the reason."""

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        """Return the reason why the operator cannot run now; empty if it can."""
        return ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        why = cls.find_obstacle(context)
        if why:
            cls.poll_message_set(why)
        return not why
