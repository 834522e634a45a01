"""Decisions in the 3D View: a map of a lander's decisions on the ground, with the chosen site and the reach."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..nodes import painted_decisions, painted_errors
from ..nodes.built_scene import Built
from ..render.pairs.dataset_file_names import pairs_folder
from ..settings.blender import scene_properties
from ..stereo.decisions import stored_maps
from ..stereo.matchers.methods import describe_method
from ..support.errors import IcyMoonError
from ..support.printer import show_controls
from . import errors_in_view
from .build import leave_edit_mode
from .coloured_views import give_back_views, show_colours
from .operator_type import ExplainedOperator
from .render import find_dataset_folder
from .sidebar_text import format_for_window

#: The maps, with the names on their buttons.
MAPS = (
    (stored_maps.SUITABILITY, "Suitability", "How far each place keeps the rules of a safe site"),
    (stored_maps.SLOPE, "Slope", "Slope under the disc of a site, as the matcher measured it"),
    (stored_maps.HEIGHT_ERROR, "Height Error", "Measured less true height"),
)
#: The verdict of a calibration on the chosen site, as the end of a sentence.
_SITES_BY_VERDICT = {
    stored_maps.GUARANTEED: "; the chosen site is guaranteed",
    stored_maps.ABSTAINS: "; the lander abstains, because the margin of its site is too small",
    stored_maps.UNLIKE: "; the ground is unlike the calibration grounds, so no site is guaranteed",
}


def list_decided_methods(scene: bpy.types.Scene) -> list[str]:
    """The matchers with decisions on the data set to show, then the true depth; empty without decisions."""
    try:
        return stored_maps.list_methods(_find_folder(scene))
    except IcyMoonError:
        return []


def _find_folder(scene: bpy.types.Scene) -> Path:
    return find_dataset_folder(scene_properties.read_for_display(scene.icymoon)) / "decisions"


class ICYMOON_OT_paint_decisions(ExplainedOperator, bpy.types.Operator):
    """Paint what a lander would decide on the ground, in Solid shading, with the chosen site and the arm's reach"""

    bl_idname = "icymoon.paint_decisions"
    bl_label = "Show Decisions"  # the redo panel cuts longer ones
    bl_options = {"REGISTER", "UNDO"}

    method: bpy.props.StringProperty(name="Matcher", description="Matcher of the decisions; empty for the first")
    map: bpy.props.EnumProperty(name="Map", items=MAPS, description="What the colours show")

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        if list_decided_methods(context.scene):
            return ""
        return "There are no decisions on this data set yet; press Decide Where to Dig"

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        method = self.method or list_decided_methods(scene)[0]
        leave_edit_mode()  # a mesh that is being edited has no attributes
        try:
            built, stored = _read_decisions(scene, method, self.map)
            collection = painted_decisions.paint_decisions(scene, built, stored, describe_method(method))
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        show_colours(context, list(collection.objects), solid=True)
        site = _SITES_BY_VERDICT.get(stored.guarantee, "") if stored.chosen else "; no site is safe"
        self.report({"INFO"}, show_controls(f"Decisions by {describe_method(method)} shown on the ground{site}"))
        return {"FINISHED"}


def _read_decisions(scene: bpy.types.Scene, method: str, kind: str) -> tuple[Built, stored_maps.StoredMap]:
    """The built scene and a map of its pair. Raises IcyMoonError if the scene or the map is missing."""
    folder = _find_folder(scene)
    pairs = stored_maps.list_pairs(folder, method)
    if not pairs:
        raise IcyMoonError(f"There are no decisions by {describe_method(method)}; press Decide Where to Dig again.")
    built = errors_in_view.find_current_build(scene)
    shown = errors_in_view.find_shown_pairs(scene, built, pairs_folder(folder.parent), pairs)
    return built, stored_maps.read_map(folder, shown[0], method, kind)


class ICYMOON_OT_hide_decisions(ExplainedOperator, bpy.types.Operator):
    """Remove the map, the chosen site and the reach, and restore the earlier view"""

    bl_idname = "icymoon.hide_decisions"
    bl_label = "Remove Decisions"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if painted_decisions.make_legend(context.scene) else "No decisions are shown"

    def execute(self, context: bpy.types.Context) -> set[str]:
        painted_errors.clear_painted(context.scene)
        give_back_views(context.scene)
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_paint_decisions, ICYMOON_OT_hide_decisions)
