"""Errors in the 3D View: the surface that a matcher measured, and its depth errors painted on the ground."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import bpy

from ..nodes import build_scene as scenes
from ..nodes import measured_surface, painted_errors
from ..render.pairs.dataset_file_names import pairs_folder
from ..render.pairs.pair_folder import read_pair
from ..render.workers.watched_thread import Calculation
from ..settings import change_announcements
from ..settings.blender import scene_properties
from ..settings.table import TOPICS
from ..stereo.ground_errors import read_depth_errors
from ..stereo.matchers.methods import describe_method
from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from ..support.printer import show_controls
from .build import leave_edit_mode
from .coloured_views import hide_errors, show_colours, shows_errors
from .job_operators import JobOperator
from .jobs import Job
from .operator_type import ExplainedOperator
from .render import plan_pairs
from .results import (
    ResultOperator,
    explain_missing_results,
    find_disparity_files,
    find_measured_dataset,
    find_point_files,
    list_methods_with_disparities,
    list_methods_with_points,
)
from .sidebar_text import format_for_window
from .window_areas import find_scene
from .window_events import make_registration


class ICYMOON_OT_show_surface(ResultOperator, bpy.types.Operator):
    """Show the surface that a matcher measured, coloured by its error: red is too far, blue is too near, white is within 1 cm"""  # noqa: E501

    bl_idname = "icymoon.show_surface"
    bl_label = "Show Measured Surface"
    bl_options = {"REGISTER", "UNDO"}

    method: bpy.props.StringProperty(name="Matcher", description="Matcher of the surface; empty for the most accurate")

    def execute(self, context: bpy.types.Context) -> set[str]:
        method = self.method or next(iter(list_methods_with_points(context.scene)), "")
        try:
            paths = find_point_files(context.scene, method)
            if not paths:
                raise IcyMoonError(
                    "This evaluation has no measured surfaces; press Evaluate to measure the surfaces of the present "
                    "scene."
                )
            item = measured_surface.build_points(
                context.scene, paths, describe_method(method), context.scene.icymoon.error_range_m
            )
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        show_colours(context, [item])
        points = format_count(len(item.data.polygons), "point")
        self.report({"INFO"}, show_controls(f"{points} measured by {describe_method(method)}"))
        return {"FINISHED"}


class ICYMOON_OT_paint_errors(JobOperator, bpy.types.Operator):
    """Paint the depth errors of a matcher on the ground and its rocks, in Solid shading: red is too far, blue is too near, white is within 1 cm"""  # noqa: E501

    bl_idname = "icymoon.paint_errors"
    bl_label = "Paint Errors on Ground"
    bl_options = {"UNDO"}

    method: bpy.props.StringProperty(name="Matcher", description="Matcher of the errors; empty for the most accurate")

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return explain_missing_results(context.scene) or super().find_obstacle(context)

    def start(self, context: bpy.types.Context) -> Job:
        """Let a thread find the errors of all vertices."""
        scene = context.scene
        self._scene_uid = scene.session_uid
        self._method = self.method or next(iter(list_methods_with_disparities(scene)), "")
        leave_edit_mode()  # a mesh that is being edited has no attributes
        built, sources = _find_errors(scene, self._method)
        meshes = painted_errors.read_meshes(built)
        work = partial(_compute_errors, meshes, sources, scene.icymoon.error_range_m)
        return Job(self.bl_label, Calculation(work, "the errors", reports=True), if_stopped="nothing is painted")

    def report_success(self, context: bpy.types.Context) -> None:
        """Paint the errors."""
        scene, title = find_scene(self._scene_uid), describe_method(self._method)
        if scene is None:
            return
        leave_edit_mode()
        collection = painted_errors.show_errors(
            scene, find_current_build(scene), self._job.result["value"], title, scene.icymoon.error_range_m
        )
        show_colours(context, list(collection.objects), solid=True)
        self.report({"INFO"}, show_controls(f"Depth errors of {title} painted on the ground"))


def _find_errors(scene: bpy.types.Scene, method: str) -> tuple[scenes.Built, list[tuple[Path, Path]]]:
    """Find the built scene, and folder and disparities of its evaluated pairs: those of the present settings, else
    pairs of the same ground and cameras.

    Raises IcyMoonError if there is no such pair.
    """
    files = find_disparity_files(scene, method)
    if not files:
        raise IcyMoonError("This evaluation has no stored disparities; press Evaluate again.")
    built = find_current_build(scene)
    pairs = pairs_folder(find_measured_dataset(scene))
    return built, [(pairs / name, files[name]) for name in find_shown_pairs(scene, built, pairs, sorted(files))]


def _compute_errors(
    meshes: painted_errors.MeshesToPaint,
    sources: Sequence[tuple[Path, Path]],
    full_m: float,
    report: Callable[[float, str], object],
) -> painted_errors.FoundErrors:
    """Read the depth errors of pairs, and find those of the vertices; a thread calls this, since reading takes long."""
    found = [read_depth_errors(folder, file) for folder, file in sources]
    return painted_errors.find_errors(meshes, found, full_m, report)


def find_current_build(scene: bpy.types.Scene) -> scenes.Built:
    """The built scene. Raises IcyMoonError if its ground or camera differs from the present settings."""
    built = scenes.find_built(scene)
    if built is None or built.preview:
        raise IcyMoonError("The built ground differs from the ground of the evaluated pair; press Build Scene first.")
    scenes.separate_from_copies(built)
    settings = scene_properties.read_settings(scene.icymoon)
    if changed := [name for name in scenes.list_changed_settings(built, settings) if _changes_ground_or_camera(name)]:
        raise IcyMoonError(f"{changed[0]} has changed since the scene was built; press Build Scene first.")
    return built


def find_shown_pairs(scene: bpy.types.Scene, built: scenes.Built, folder: Path, names: Sequence[str]) -> list[str]:
    """The pairs with these ids in a folder that show the built scene: pairs of the present settings, or else of the
    same ground and cameras. Raises IcyMoonError, with the reason, if no pair shows the scene."""
    settings = scene_properties.read_settings(scene.icymoon)
    found = [pair.id for pair in plan_pairs(scene, settings) if pair.id in names]
    return found or _find_same_views(built, int(settings.dataset.headings), [folder / name for name in names])


def _changes_ground_or_camera(name: str) -> bool:
    topic, _, key = name.partition(".")
    return TOPICS[topic][key].effect in ("geometry", "camera")


def _find_same_views(built: scenes.Built, headings: int, folders: Sequence[Path]) -> list[str]:
    """Ids of pairs of the built scene, one for each heading.

    Raises IcyMoonError, with the reason, if no pair shows the scene.
    """
    found: dict[float, str] = {}
    reasons = []
    for folder in folders:
        pair = read_pair(folder)
        if why := painted_errors.why_not_shown(built, headings, pair):
            reasons.append(why)
        else:
            found.setdefault(float(pair.settings.rig.heading_deg), pair.id)
    if not found:
        raise IcyMoonError(f"{reasons[0]} Set it back, or render and evaluate again.")
    return list(found.values())


class ICYMOON_OT_hide_surface(ExplainedOperator, bpy.types.Operator):
    """Remove the measured surface and the painted errors, and restore the earlier view"""

    bl_idname = "icymoon.hide_surface"
    bl_label = "Remove Errors"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if shows_errors(context.scene) else "No measured surface and no painted errors are shown"

    def execute(self, context: bpy.types.Context) -> set[str]:
        hide_errors(context.scene)
        return {"FINISHED"}


def follow_colour_range(scene: bpy.types.Scene, effects: frozenset[str]) -> None:
    """Colour the shown errors again when the range of the colours changes."""
    if scene is not None and change_announcements.COLOURS in effects:
        measured_surface.recolour_points(scene, scene.icymoon.error_range_m)
        painted_errors.recolour_errors(scene, scene.icymoon.error_range_m)


CLASSES = (ICYMOON_OT_show_surface, ICYMOON_OT_paint_errors, ICYMOON_OT_hide_surface)


register, unregister = make_registration(follow_colour_range)
