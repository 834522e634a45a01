"""Use Selected Object as Rock: give all rocks the shape of an object that was modelled or sculpted in Blender."""

from __future__ import annotations

from functools import partial
from typing import Any

import bpy
import numpy as np

from ..physics.rocks.own_rock import OWN, make_own_shape, read_proportions
from ..settings.table import TOPICS
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from .change_and_build import ChangeAndBuildOperator
from .jobs import Job
from .object_as_ground import SelectedMeshOperator, shorten_path

#: Share of the ground that the rocks cover if there were no rocks before.
_FIRST_COVERAGE = 0.05


def encode_rock(positions: Array, triangles: Array) -> bytes:
    """Encode a mesh, vertices (n, 3) and triangles (m, 3), as a Wavefront OBJ file."""
    lines = [*(f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in positions.tolist())]
    lines += [f"f {a} {b} {c}" for a, b, c in (np.asarray(triangles) + 1).tolist()]
    return "\n".join([*lines, ""]).encode()


def _encode_checked(name: str, positions: Array, triangles: Array) -> bytes:
    """Encode the object with this name as ``encode_rock`` does. Raises IcyMoonError if the object cannot be a rock."""
    make_own_shape(positions, triangles, name)
    return encode_rock(positions, triangles)


class RockOperator(SelectedMeshOperator, ChangeAndBuildOperator):
    """Mix-in: an operator that gives all rocks the shape of the active object. In a window it builds the scene in
    pieces."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Build the scene in full, as scripts expect."""
        try:
            self.change_settings(context.scene, {"rocks": self._make_settings(context)})
        except IcyMoonError as error:
            return self.fail(error)
        return self.build_at_once(context)

    def start(self, context: bpy.types.Context) -> Job:
        """Start to build the scene with these rocks. Raises IcyMoonError if the object cannot be a rock or no scene can
        be built."""
        self.change_settings(context.scene, {"rocks": self._make_settings(context)})
        return super().start(context)

    def _make_settings(self, context: bpy.types.Context) -> dict[str, Any]:
        scene, height = context.scene, TOPICS["rocks"]["height_ratio"]
        encode = partial(_encode_checked, context.active_object.name)
        path = self.keep_mesh(context, "rocks.shape_file", ".obj", encode, "")
        return {
            "family": OWN,
            "shape_file": shorten_path(path, scene.icymoon.dataset.folder),
            "elongation": 1.0,  # the shape has its own elongation
            "height_ratio": min(max(read_proportions(path), height.minimum), height.maximum),
            "coverage": scene.icymoon.rocks.coverage or _FIRST_COVERAGE,
        }


class ICYMOON_OT_object_as_rock(RockOperator, bpy.types.Operator):
    """Give all rocks the shape of the active mesh object, with its modifiers. A copy is kept in the data set folder, so later changes of the object do not count"""  # noqa: E501

    bl_idname = "icymoon.object_as_rock"
    bl_label = "Use Selected Object as Rock"
    bl_options = {"REGISTER", "UNDO"}


CLASSES = (ICYMOON_OT_object_as_rock,)
