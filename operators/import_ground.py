"""Import Ground: the user's own mesh or height map as the ground."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import bpy

from ..formats import gdal_lines
from ..nodes import build_scene as scenes
from ..nodes.ground import user_ground as grounds
from ..settings.blender import scene_properties
from ..support.errors import IcyMoonError
from . import dialogs
from .build import build_and_report
from .sidebar_text import format_for_window, replace_keys_by_labels


def list_report_lines(scene: bpy.types.Scene) -> list[str]:
    """The findings of the import of the built ground, line by line; empty for procedural ground."""
    built = scenes.find_built(scene)
    found = built.ground.get("report", []) if built is not None else []
    return [replace_keys_by_labels(text) for text in found]


def build_on_source(
    operator: bpy.types.Operator, context: bpy.types.Context, make_source: Callable[[], Mapping[str, Any]]
) -> set[str]:
    """Build the scene on the ground of these ``source`` settings, and return the result of the operator.

    An error, including an IcyMoonError of ``make_source``, is reported, and the settings stay as before. Before a mesh
    that takes long is loaded, the user is asked.
    """
    group = context.scene.icymoon
    before = scene_properties.read_unchecked(group).source
    try:
        scene_properties.write_settings(group, {"source": make_source()})
        warnings = grounds.warn_of_cost(scene_properties.read_settings(group))
    except IcyMoonError as error:
        scene_properties.write_settings(group, {"source": before})
        operator.report({"ERROR"}, format_for_window(error))
        return {"CANCELLED"}
    if warnings and not bpy.app.background:
        bpy.ops.icymoon.build_scene("INVOKE_DEFAULT")  # asks the user first
        return {"FINISHED"}
    result = build_and_report(operator, context)
    if result == {"CANCELLED"}:
        scene_properties.write_settings(group, {"source": before})
    return result


class ICYMOON_OT_import_ground(dialogs.FileDialog, bpy.types.Operator):
    """Build the scene on your own ground: a mesh (OBJ, PLY, STL, glTF, USD, FBX) or a height map (GeoTIFF, NPY, EXR, grey PNG)"""  # noqa: E501

    bl_idname = "icymoon.import_ground"
    bl_label = "Import Ground"
    bl_options = {"REGISTER", "UNDO"}

    filepath: dialogs.file_property("Mesh or height map to read")
    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{suffix}" for suffix in (*grounds.SUFFIXES, *gdal_lines.SUFFIXES)), options={"HIDDEN"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        path = Path(bpy.path.abspath(self.filepath))
        return build_on_source(self, context, lambda: {"kind": grounds.find_kind(path), "file": str(path)})


CLASSES = (ICYMOON_OT_import_ground,)
