"""Use Selected Object as Ground: build on an object that was modelled or sculpted in Blender, as ground from a file."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ..formats.ply import encode_triangles
from ..library.inputs import Input
from ..nodes import build_scene as scenes
from ..nodes.ground.object_mesh import find_metres_per_unit, is_shaded_flat, join_meshes, read_placed_meshes
from ..settings.blender import scene_properties
from ..support.arrays import Array
from ..support.printer import show_controls
from ..support.steps import Steps, finish
from .build import leave_edit_mode
from .import_ground import GroundOperator
from .operator_type import ExplainedOperator
from .render import find_dataset_folder, require_scene
from .sidebar_text import GROUND_OBJECT

#: A function that encodes vertices (n, 3) and triangles (m, 3) as the bytes of a file.
EncodeMesh = Callable[[Array, Array], bytes]


def why_not_usable(context: bpy.types.Context) -> str:
    """Explain why the active object cannot be the ground or a rock; empty if it can."""
    item = context.active_object
    if item is None or not item.select_get():
        return "Select a mesh object"
    if item.type != "MESH" and item.instance_collection is None:
        return "The active object is not a mesh"
    collection = scenes.find_collection(context.scene)
    if collection is not None and item in set(collection.all_objects):
        return "The active object is part of the built scene; select one outside its collection"
    return ""


def shorten_path(path: Path, dataset_folder: str) -> str:
    """Shorten a path for the settings. It becomes relative to the .blend file if the data set's folder is relative to
    it."""
    beside = dataset_folder.startswith("//")
    return f"//{os.path.relpath(path, bpy.path.abspath('//'))}" if beside else str(path)


class SelectedMeshOperator(ExplainedOperator):
    """Mix-in: an operator that keeps a copy of the active mesh object in the data set."""

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return why_not_usable(context)

    def keep_mesh(self, context: bpy.types.Context, setting: str, suffix: str, encode: EncodeMesh, told: str) -> Path:
        """Do the work of ``keep_mesh_in_steps`` at once."""
        return finish(self.keep_mesh_in_steps(context, setting, suffix, encode, told))

    def keep_mesh_in_steps(
        self, context: bpy.types.Context, setting: str, suffix: str, encode: EncodeMesh, told: str
    ) -> Steps[Path]:
        """Write the mesh, encoded for a ``setting``, into the data set in steps. Its name follows from its content.

        Any thread may call ``encode``. Reports the file's path, followed by the text ``told``, and returns the path.
        """
        leave_edit_mode()  # or the mesh would lack the last edits
        item, scene = context.active_object, context.scene
        name, unit_m = item.name, find_metres_per_unit(scene)
        dataset = find_dataset_folder(scene_properties.read_settings(scene.icymoon))
        parts = read_placed_meshes(item, context.evaluated_depsgraph_get())

        def store() -> Path:
            return Input(setting, encode(*join_meshes(parts, unit_m, name)), suffix, name).store(dataset)

        path: Path = yield store
        self.report({"INFO"}, show_controls(f"{name} is kept as {path}{told}"))
        return path


class ICYMOON_OT_object_as_ground(SelectedMeshOperator, GroundOperator, bpy.types.Operator):
    """Build the scene on the active mesh object, with its modifiers, where it is. A copy is kept in the data set folder, so later changes of the object do not count"""  # noqa: E501

    bl_idname = "icymoon.object_as_ground"
    bl_label = "Use Selected Object as Ground"
    bl_options = {"REGISTER", "UNDO"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return self.execute(context) if bpy.app.background else self.begin_to_build(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.change_and_build(context)

    def make_source(self, context: bpy.types.Context) -> Steps[Mapping[str, Any]]:
        unit_m, folder = find_metres_per_unit(context.scene), context.scene.icymoon.dataset.folder
        flat = is_shaded_flat(context.active_object, context.evaluated_depsgraph_get())
        told = "" if unit_m == 1.0 else f"; a unit of this scene is {unit_m:g} m"
        encode = partial(encode_triangles, ("x", "y", "z"))
        scene_uid, name = context.scene.session_uid, context.active_object.name
        path = yield from self.keep_mesh_in_steps(context, "source.file", ".ply", encode, told)
        file = shorten_path(path, folder)
        require_scene(scene_uid)[GROUND_OBJECT] = {"file": file, "name": name}
        return {
            "kind": "MESH",
            "file": file,
            "scale": 1.0,
            "up_axis": "Z",
            "flat_faces": flat,
            "centre": False,
            "origin_x_m": 0.0,
            "origin_y_m": 0.0,
        }


CLASSES = (ICYMOON_OT_object_as_ground,)
