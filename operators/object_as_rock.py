"""Use Selected Object as Rock: what was modelled or sculpted in Blender, as the shape of all rocks."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ..library.inputs import Input
from ..nodes.ground.object_mesh import read_object_mesh
from ..physics.rocks.own_rock import OWN, read_proportions
from ..settings.blender import scene_properties
from ..settings.table import TOPICS
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.printer import show_controls
from .build import build_and_report, leave_edit_mode
from .object_as_ground import shorten_path, why_not_usable
from .render import find_dataset_folder
from .sidebar_text import format_for_window

#: Share of the ground under rocks where there were none.
_FIRST_COVERAGE = 0.05


def encode_rock(positions: Array, triangles: Array) -> bytes:
    """A mesh, vertices (n, 3) and triangles (m, 3), as a Wavefront OBJ file."""
    lines = [*(f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in positions.tolist())]
    lines += [f"f {a} {b} {c}" for a, b, c in (np.asarray(triangles) + 1).tolist()]
    return "\n".join([*lines, ""]).encode()


class ICYMOON_OT_object_as_rock(bpy.types.Operator):
    """Give all rocks the shape of the active mesh object, with its modifiers. A copy is kept in the data set folder, so later changes of the object do not count"""  # noqa: E501

    bl_idname = "icymoon.object_as_rock"
    bl_label = "Use Selected Object as Rock"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reason = why_not_usable(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def execute(self, context: bpy.types.Context) -> set[str]:
        group = context.scene.icymoon
        before = scene_properties.read_unchecked(group).rocks
        try:
            scene_properties.write_settings(group, {"rocks": self._make_settings(context)})
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        result = build_and_report(self, context)
        if result == {"CANCELLED"}:
            scene_properties.write_settings(group, {"rocks": before})
        return result

    def _make_settings(self, context: bpy.types.Context) -> dict[str, Any]:
        """Write the mesh into the data set, under a name that follows from its content; return the settings."""
        leave_edit_mode()  # or the mesh would lack the last edits
        item, scene = context.active_object, context.scene
        dataset = find_dataset_folder(scene_properties.read_settings(scene.icymoon))
        mesh = read_object_mesh(item, scene, context.evaluated_depsgraph_get())
        path = Input("rocks.shape_file", encode_rock(*mesh), ".obj", item.name).store(dataset)
        height = TOPICS["rocks"]["height_ratio"]
        self.report({"INFO"}, show_controls(f"{item.name} is kept as {path}"))
        return {
            "family": OWN,
            "shape_file": shorten_path(path, scene.icymoon.dataset.folder),
            "elongation": 1.0,  # the shape has its own
            "height_ratio": min(max(read_proportions(path), height.minimum), height.maximum),
            "coverage": scene.icymoon.rocks.coverage or _FIRST_COVERAGE,
        }


CLASSES = (ICYMOON_OT_object_as_rock,)
