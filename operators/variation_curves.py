"""Show the curves of the error against each varied setting in an Image Editor."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..render.plans.vary_scene import (
    find_label,
)
from ..settings.blender import scene_properties
from . import results
from .operator_type import ExplainedOperator


def sort_curves(scene: bpy.types.Scene) -> dict[str, Path]:
    """Return the pictures of the error against each varied setting of an evaluation, by setting. Settings in the list
    come first."""
    curves = results.find_curves(scene)
    listed = [each.name for each in scene_properties.read_variations(scene.icymoon).varied]
    return {name: curves[name] for name in sorted(curves, key=lambda name: name not in listed)}


def describe_curve(name: str) -> str:
    """Return the name of a curve of the error against a setting."""
    return f"Error against {find_label(name)}"


def show_curves(context: bpy.types.Context, open_window: bool, first: str = "") -> None:
    """Show the curves in an Image Editor, the curve of the setting ``first`` before the others."""
    curves = sort_curves(context.scene)
    results.show_images(
        sorted(curves.values(), key=lambda path: path != curves.get(first)),
        open_window,
        {path: describe_curve(name) for name, path in curves.items()},
    )


class ICYMOON_OT_show_curve(ExplainedOperator, bpy.types.Operator):
    """Show the error of each matcher against a setting that varies, in an Image Editor"""

    bl_idname = "icymoon.show_curve"
    bl_label = "Show Error Curve"

    setting: bpy.props.StringProperty(name="Setting", description="Which setting; if empty, the first that varies")

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        if results.find_curves(context.scene):
            return ""
        return "There is no evaluation of a data set in which a setting varies; evaluate one first"

    def execute(self, context: bpy.types.Context) -> set[str]:
        show_curves(context, open_window=True, first=self.setting)
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_show_curve,)
