"""The list of noise layers (add, remove, move) and the table of measured roughness."""

from __future__ import annotations

import bpy

from ..nodes import build_scene as scenes
from ..nodes.ground.terrain_mesh import make_roughness_table
from ..settings.table import TOPICS
from ..support.printer import show_controls
from .list_editing import AddEntry, EditedList, MoveEntry, RemoveEntry
from .operator_type import ExplainedOperator


class _LayerOperator:
    """Mix-in: an operator on the list of layers."""

    empty = "There is no layer yet"

    @staticmethod
    def find(scene: bpy.types.Scene) -> EditedList:
        return EditedList(scene.icymoon.terrain, "layers", "layers_active", TOPICS["terrain"]["layers"].effect)


class ICYMOON_OT_layer_add(_LayerOperator, AddEntry, bpy.types.Operator):
    """Add a layer of fractal noise to the ground"""

    bl_idname = "icymoon.layer_add"
    bl_label = "Add Layer"


class ICYMOON_OT_layer_remove(_LayerOperator, RemoveEntry, bpy.types.Operator):
    """Remove the selected layer of noise"""

    bl_idname = "icymoon.layer_remove"
    bl_label = "Remove Layer"


class ICYMOON_OT_layer_move(_LayerOperator, MoveEntry, bpy.types.Operator):
    """Move the selected layer of noise. Its shape changes, because its seed depends on its position"""

    bl_idname = "icymoon.layer_move"
    bl_label = "Move Layer"

    direction: bpy.props.EnumProperty(
        name="Direction",
        description="Direction in which the layer moves in the list",
        items=(("UP", "Up", "Toward the first"), ("DOWN", "Down", "Toward the last")),
    )


class ICYMOON_OT_show_roughness(ExplainedOperator, bpy.types.Operator):
    """Show the measured RMS deviation and power spectrum of the built ground, and the values in the settings"""

    bl_idname = "icymoon.show_roughness"
    bl_label = "Measured Roughness"

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        if scenes.describe_ground_statistics(context.scene):
            return ""
        return "Nothing has been built from the settings of Ground in this scene; press Build Scene"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.table = self._measure(context)
        return context.window_manager.invoke_popup(self, width=460)

    def execute(self, context: bpy.types.Context) -> set[str]:
        for row in self._measure(context):
            self.report({"INFO"}, show_controls("  ".join(row)))
        return {"FINISHED"}

    def _measure(self, context: bpy.types.Context) -> list[tuple[str, ...]]:
        built = scenes.find_built(context.scene)
        return make_roughness_table(scenes.measure_patch(built), built.settings.terrain) if built else []

    def draw(self, context: bpy.types.Context) -> None:
        grid: bpy.types.UILayout = self.layout.grid_flow(row_major=True, columns=5, even_columns=True, align=True)
        for row in self.table:
            for cell in row:
                grid.label(text=cell)


def describe_layer(entry: bpy.types.PropertyGroup) -> str:
    """Describe a layer in a line: basis, fractal and amplitude."""
    names = {setting.key: setting.choice_labels for setting in TOPICS["terrain"]["layers"].entries}
    return f"{names['basis'][entry.basis]}, {names['fractal'][entry.fractal]}, {entry.amplitude_m:.3g} m"


CLASSES = (ICYMOON_OT_layer_add, ICYMOON_OT_layer_remove, ICYMOON_OT_layer_move, ICYMOON_OT_show_roughness)
