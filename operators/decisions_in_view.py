"""Decisions in the 3D View: a map of a lander's decisions on the ground, with the chosen site and the reach."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import bpy

from ..nodes import painted_decisions, painted_errors
from ..render.pairs.dataset_file_names import pairs_folder
from ..settings.blender import scene_properties
from ..stereo.decisions import stored_maps
from ..stereo.matchers.methods import describe_method
from ..support.errors import IcyMoonError
from ..support.printer import show_controls
from ..support.steps import Steps
from . import errors_in_view
from .coloured_views import give_back_views, show_colours
from .job_operators import KeyStoppedOperator, PiecewiseOperator
from .jobs import Job
from .operator_type import ExplainedOperator
from .render import find_dataset_folder, require_scene
from .session import session
from .settled_steps import settle

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
    """List the matchers that have decisions on the present data set, then the true depth; empty without decisions."""
    try:
        return stored_maps.list_methods(_find_folder(scene))
    except IcyMoonError:
        return []


def _find_folder(scene: bpy.types.Scene) -> Path:
    return find_dataset_folder(scene_properties.read_for_display(scene.icymoon)) / "decisions"


class ICYMOON_OT_paint_decisions(PiecewiseOperator, KeyStoppedOperator, bpy.types.Operator):
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

    def start(self, context: bpy.types.Context) -> Job:
        """Stop a painting that still runs, and start this one."""
        session.stop_painting()
        session.painting = PiecewiseOperator.start(self, context)
        return session.painting

    def report_end(self, context: bpy.types.Context) -> None:
        """Forget the job."""
        if session.painting is self._job:
            session.painting = None

    def make_steps(self, context: bpy.types.Context, report: Callable[[float, str], object]) -> Steps[None]:
        """Find and paint the map in steps."""
        uid, method = context.scene.session_uid, self.method or list_decided_methods(context.scene)[0]
        read = yield from settle(partial(_find_map_reader, uid, method, self.map))
        stored = yield read
        find_build = partial(errors_in_view.find_current_build, uid)
        collection = yield from painted_decisions.paint_decisions(find_build, stored, describe_method(method))
        show_colours(context, list(collection.objects), solid=True)
        site = _SITES_BY_VERDICT.get(stored.guarantee, "") if stored.chosen else "; no site is safe"
        self.report({"INFO"}, show_controls(f"Decisions by {describe_method(method)} shown on the ground{site}"))


def _find_map_reader(scene_uid: int, method: str, kind: str) -> Steps[Callable[[], stored_maps.StoredMap]]:
    """Find, in steps, the pair that shows a built scene; return a function that reads its map. Raises IcyMoonError if
    the scene or the map is missing."""
    folder = _find_folder(require_scene(scene_uid))
    pairs = stored_maps.list_pairs(folder, method)
    if not pairs:
        raise IcyMoonError(f"There are no decisions by {describe_method(method)}; press Decide Where to Dig again.")
    built = errors_in_view.find_current_build(scene_uid)
    shown = yield from errors_in_view.find_shown_pairs(built, pairs_folder(folder.parent), pairs)
    return partial(stored_maps.read_map, folder, shown[0], method, kind)


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
