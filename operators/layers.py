"""The list of noise layers (add, remove, move) and the table of measured roughness."""

from __future__ import annotations

from typing import Any

import bpy

from ..nodes import scene as scenes
from ..nodes.ground.terrain_mesh import roughness_table
from ..settings import description
from ..settings.change_announcements import announce
from ..settings.table import TOPICS
from ..support.printer import show_controls


def _announce(context: bpy.types.Context) -> None:
    """Announce a change of the list. Blender itself calls updates for changed entries only."""
    announce(context.scene, TOPICS["terrain"]["layers"].effect)


class _LayerOperator:
    """Mix-in: an operator that changes the list of layers, which must not be empty."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.icymoon.terrain.layers:
            cls.poll_message_set("There is no layer yet")  # type: ignore[attr-defined]
            return False
        return True


class ICYMOON_OT_layer_add(bpy.types.Operator):
    """Add a layer of fractal noise to the ground"""

    bl_idname = "icymoon.layer_add"
    bl_label = "Add Layer"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        terrain = context.scene.icymoon.terrain
        terrain.layers.add()
        terrain.layers_active = len(terrain.layers) - 1
        _announce(context)
        return {"FINISHED"}


class ICYMOON_OT_layer_remove(_LayerOperator, bpy.types.Operator):
    """Remove the selected layer of noise"""

    bl_idname = "icymoon.layer_remove"
    bl_label = "Remove Layer"

    def execute(self, context: bpy.types.Context) -> set[str]:
        terrain = context.scene.icymoon.terrain
        terrain.layers.remove(min(terrain.layers_active, len(terrain.layers) - 1))
        terrain.layers_active = max(0, min(terrain.layers_active, len(terrain.layers) - 1))
        _announce(context)
        return {"FINISHED"}


class ICYMOON_OT_layer_move(_LayerOperator, bpy.types.Operator):
    """Move the selected layer of noise. Its shape changes, because its seed depends on its position"""

    bl_idname = "icymoon.layer_move"
    bl_label = "Move Layer"

    direction: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Direction", description="Direction in which the layer moves in the list",
        items=(("UP", "Up", "Toward the first"), ("DOWN", "Down", "Toward the last")))

    def execute(self, context: bpy.types.Context) -> set[str]:
        terrain = context.scene.icymoon.terrain
        here = min(terrain.layers_active, len(terrain.layers) - 1)
        there = here + (-1 if self.direction == "UP" else 1)
        if not 0 <= there < len(terrain.layers):
            return {"CANCELLED"}
        terrain.layers.move(here, there)
        terrain.layers_active = there
        _announce(context)
        return {"FINISHED"}


class ICYMOON_OT_show_roughness(bpy.types.Operator):
    """Show the measured RMS deviation and power spectrum of the built ground, and the values from the settings"""

    bl_idname = "icymoon.show_roughness"
    bl_label = "Measured Roughness"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not scenes.ground_statistics(context.scene):
            cls.poll_message_set("Nothing has been built from the settings of Ground in this scene; press Build Scene")
            return False
        return True

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.table = self._measure(context)
        return context.window_manager.invoke_popup(self, width=460)

    def execute(self, context: bpy.types.Context) -> set[str]:
        for row in self._measure(context):
            self.report({"INFO"}, show_controls("  ".join(row)))
        return {"FINISHED"}

    def _measure(self, context: bpy.types.Context) -> list[tuple[str, ...]]:
        built = scenes.find(context.scene)
        return roughness_table(scenes.measured_patch(built), built.settings.terrain) if built else []

    def draw(self, context: bpy.types.Context) -> None:
        grid: Any = self.layout.grid_flow(row_major=True, columns=5, even_columns=True, align=True)
        for row in self.table:
            for cell in row:
                grid.label(text=cell)


def layer_title(entry: Any) -> str:
    """A line that describes a layer: basis, fractal and amplitude."""
    names = {s.key: {c[0]: c[1] for c in s.choices} for s in description.TOPICS["terrain"]["layers"].entries}
    return f"{names['basis'][entry.basis]}, {names['fractal'][entry.fractal]}, {entry.amplitude_m:.3g} m"


CLASSES = (ICYMOON_OT_layer_add, ICYMOON_OT_layer_remove, ICYMOON_OT_layer_move, ICYMOON_OT_show_roughness)
