"""Use Selected Object as Ground: what was modelled or sculpted in Blender, as a ground from a file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy

from ..formats.ply import encode_triangles
from ..library.inputs import Input
from ..nodes import build_scene as scenes
from ..nodes.ground.object_mesh import find_metres_per_unit, read_object_mesh
from ..settings.blender import scene_properties
from ..support.printer import show_controls
from .build import leave_edit_mode
from .import_ground import build_on_source
from .render import find_dataset_folder


def why_not_usable(context: bpy.types.Context) -> str:
    """Why the active object cannot be the ground or a rock; empty if it can."""
    item = context.active_object
    if item is None or not item.select_get():
        return "Select a mesh object"
    if item.type != "MESH" and item.instance_collection is None:
        return "The active object is no mesh"
    collection = scenes.find_collection(context.scene)
    if collection is not None and item in set(collection.all_objects):
        return "The active object is part of the built scene; select one outside its collection"
    return ""


def shorten_path(path: Path, dataset_folder: str) -> str:
    """The path as the settings state it: beside the .blend file if the data set is."""
    beside = dataset_folder.startswith("//")
    return f"//{os.path.relpath(path, bpy.path.abspath('//'))}" if beside else str(path)


class ICYMOON_OT_object_as_ground(bpy.types.Operator):
    """Build the scene on the active mesh object, with its modifiers, where it is. A copy is kept in the data set folder, so later changes of the object do not count"""  # noqa: E501

    bl_idname = "icymoon.object_as_ground"
    bl_label = "Use Selected Object as Ground"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reason = why_not_usable(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def execute(self, context: bpy.types.Context) -> set[str]:
        return build_on_source(self, context, lambda: self._write(context))

    def _write(self, context: bpy.types.Context) -> dict[str, Any]:
        """Write the mesh into the data set, under a name that follows from its content; return the settings."""
        leave_edit_mode()  # or the mesh would lack the last edits
        dataset = find_dataset_folder(scene_properties.read_settings(context.scene.icymoon))
        item, scene = context.active_object, context.scene
        positions, triangles = read_object_mesh(item, scene, context.evaluated_depsgraph_get())
        path = Input("source.file", encode_triangles(("x", "y", "z"), positions, triangles), ".ply", item.name).store(
            dataset
        )
        unit_m = find_metres_per_unit(scene)
        told = "" if unit_m == 1.0 else f"; a unit of this scene is {unit_m:g} m"
        self.report({"INFO"}, show_controls(f"{item.name} is kept as {path}{told}"))
        return {
            "kind": "MESH",
            "file": shorten_path(path, scene.icymoon.dataset.folder),
            "scale": 1.0,
            "up_axis": "Z",
            "centre": False,
            "origin_x_m": 0.0,
            "origin_y_m": 0.0,
        }


CLASSES = (ICYMOON_OT_object_as_ground,)
