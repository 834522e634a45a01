"""Import Ground: the user's own mesh or height map as the ground."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy

from ..formats import gdal_lines
from ..nodes import build_scene as scenes
from ..nodes.ground import user_ground as grounds
from ..settings.blender import scene_properties
from ..support.errors import IcyMoonError
from ..support.steps import Steps, finish
from . import dialogs
from .build_in_pieces import build_in_pieces
from .change_and_build import ChangeAndBuildOperator
from .job_operators import WatchingOperator
from .render import require_scene
from .sidebar_text import replace_keys_by_labels


def list_report_lines(scene: bpy.types.Scene) -> list[str]:
    """List the findings of the import of the built ground, one a line; empty for procedural ground."""
    built = scenes.find_built(scene)
    found = built.ground.get("report", []) if built is not None else []
    return [replace_keys_by_labels(text) for text in found]


class GroundOperator(ChangeAndBuildOperator):
    """Mix-in: an operator that builds the scene on a ground from a file, in a window in pieces.

    Before it loads a mesh that takes long, it asks the user. If the build fails, the settings stay as before.
    """

    _asks_user = False

    def make_source(self, context: bpy.types.Context) -> Steps[Mapping[str, Any]]:
        """Make the ground's ``source`` settings in steps. Raises IcyMoonError if the file or object cannot be a
        ground."""
        raise NotImplementedError

    def change_and_build(self, context: bpy.types.Context) -> set[str]:
        """Build the scene in full, as scripts expect."""
        try:
            self.change_settings(context.scene, {"source": finish(self.make_source(context))})
            grounds.warn_of_cost(scene_properties.read_settings(context.scene.icymoon))
        except IcyMoonError as error:
            return self.fail(error)
        return self.build_at_once(context)

    def begin_to_build(self, context: bpy.types.Context) -> set[str]:
        """Build the scene in pieces."""
        return WatchingOperator.invoke(self, context, None)

    def make_steps(self, context: bpy.types.Context) -> Steps[list[tuple[str, str]]]:
        """Make the steps that make the ground's source and build the scene."""
        source = yield from self.make_source(context)
        scene = require_scene(self._scene_uid)
        self.change_settings(scene, {"source": source})
        settings = scene_properties.read_settings(scene.icymoon)
        self._asks_user = bool(grounds.warn_of_cost(settings))
        if self._asks_user:
            return []
        return (yield from build_in_pieces(self._scene_uid, settings))

    def report_success(self, context: bpy.types.Context) -> None:
        """Report the built scene, or ask the user whether to load a large mesh."""
        super().report_success(context)
        if self._asks_user:
            bpy.ops.icymoon.build_scene("INVOKE_DEFAULT")


class ICYMOON_OT_import_ground(GroundOperator, dialogs.FileDialog, bpy.types.Operator):
    """Build the scene on your own ground: a mesh (OBJ, PLY, STL, glTF, USD, FBX) or a height map (GeoTIFF, NPY, EXR, grey PNG)"""  # noqa: E501

    bl_idname = "icymoon.import_ground"
    bl_label = "Import Ground"
    bl_options = {"REGISTER", "UNDO"}

    filepath: dialogs.file_property("Mesh or height map to read")
    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{suffix}" for suffix in (*grounds.SUFFIXES, *gdal_lines.SUFFIXES)), options={"HIDDEN"}
    )

    _chooses = False

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Let the user choose the file."""
        self._chooses = not bpy.app.background
        return dialogs.FileDialog.invoke(self, context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Build in pieces, once the file is chosen. *Adjust Last Operation* and scripts call this too, and build at
        once."""
        chosen, self._chooses = self._chooses, False
        return self.begin_to_build(context) if chosen else self.change_and_build(context)

    def make_source(self, context: bpy.types.Context) -> Steps[Mapping[str, Any]]:
        yield None
        path = Path(bpy.path.abspath(self.filepath))
        return {"kind": grounds.find_kind(path), "file": str(path)}


CLASSES = (ICYMOON_OT_import_ground,)
