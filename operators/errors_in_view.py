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
from ..settings.blender import scene_properties
from ..settings.table import TOPICS
from ..stereo.ground_errors import read_depth_errors
from ..stereo.matchers.methods import describe_method
from ..support.errors import IcyMoonError, describe_error
from ..support.number_text import format_count
from ..support.printer import show_controls
from ..support.steps import Steps
from .build import leave_edit_mode
from .coloured_views import hide_errors, show_colours, shows_errors
from .job_operators import JobOperator, PiecewiseOperator
from .operator_type import ExplainedOperator
from .render import plan_pairs_in_steps, require_scene
from .results import (
    ResultOperator,
    explain_missing_results,
    find_disparity_files,
    find_measured_dataset,
    find_point_files,
    list_methods_with_disparities,
    list_methods_with_points,
)
from .settled_steps import settle
from .sidebar_text import format_for_window


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
        show_colours(context, [item], solid=True)
        points = format_count(len(item.data.polygons), "point")
        self.report({"INFO"}, show_controls(f"{points} measured by {describe_method(method)}"))
        return {"FINISHED"}


class ICYMOON_OT_paint_errors(PiecewiseOperator, JobOperator, bpy.types.Operator):
    """Paint the depth errors of a matcher on the ground and its rocks, in Solid shading: red is too far, blue is too near, white is within 1 cm"""  # noqa: E501

    bl_idname = "icymoon.paint_errors"
    bl_label = "Paint Errors on Ground"
    bl_options = {"UNDO"}

    method: bpy.props.StringProperty(name="Matcher", description="Matcher of the errors; empty for the most accurate")

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return explain_missing_results(context.scene) or super().find_obstacle(context)

    def make_steps(self, context: bpy.types.Context, report: Callable[[float, str], object]) -> Steps[None]:
        """Find and paint the errors of all vertices in steps."""
        scene = context.scene
        uid, method = scene.session_uid, self.method or next(iter(list_methods_with_disparities(scene)), "")
        sources = yield from settle(partial(_find_error_sources, uid, method))
        meshes = yield from settle(partial(_read_meshes, uid))
        full_m = require_scene(uid).icymoon.error_range_m
        errors = yield partial(_compute_errors, meshes, sources, full_m, report)
        collection = yield from painted_errors.show_errors(
            partial(find_current_build, uid),
            errors,
            title := describe_method(method),
            lambda: require_scene(uid).icymoon.error_range_m,
        )
        show_colours(context, list(collection.objects), solid=True)
        self.report({"INFO"}, show_controls(f"Depth errors of {title} painted on the ground"))


def _find_error_sources(scene_uid: int, method: str) -> Steps[list[tuple[Path, Path]]]:
    """Find, in steps, the evaluated pairs of a built scene. Returns the folder and the disparity file of each pair.

    The pairs have the present settings; if there are none, the same ground and cameras. Raises IcyMoonError if there is
    no such pair.
    """
    scene = require_scene(scene_uid)
    files = find_disparity_files(scene, method)
    if not files:
        raise IcyMoonError("This evaluation has no stored disparities; press Evaluate again.")
    pairs = pairs_folder(find_measured_dataset(scene))
    shown = yield from find_shown_pairs(find_current_build(scene_uid), pairs, sorted(files))
    return [(pairs / name, files[name]) for name in shown]


def _read_meshes(scene_uid: int) -> Steps[painted_errors.MeshesToPaint]:
    """Read the meshes of a built scene in steps."""
    return (yield from painted_errors.read_meshes(find_current_build(scene_uid)))


def _compute_errors(
    meshes: painted_errors.MeshesToPaint,
    sources: Sequence[tuple[Path, Path]],
    full_m: float,
    report: Callable[[float, str], object],
) -> painted_errors.FoundErrors:
    """Read the depth errors of pairs, and find the errors of the vertices. A thread calls it, since reading takes long.

    Raises IcyMoonError for any error.
    """
    try:
        found = [read_depth_errors(folder, file) for folder, file in sources]
        return painted_errors.find_errors(meshes, found, full_m, report)
    except Exception as error:
        raise IcyMoonError(describe_error(error, "the errors")) from error


def find_current_build(scene_uid: int) -> scenes.Built:
    """Return the built scene with this ``session_uid``, in Object Mode.

    Raises IcyMoonError if the scene is not built in full, or if its ground or camera differs from the present settings.
    """
    scene = require_scene(scene_uid)
    leave_edit_mode()  # a mesh that is being edited has no attributes
    built = scenes.find_built(scene)
    if built is None or built.preview:
        raise IcyMoonError("The built ground differs from the ground of the evaluated pair; press Build Scene first.")
    scenes.separate_from_copies(built)
    settings = scene_properties.read_settings(scene.icymoon)
    if changed := [name for name in scenes.list_changed_settings(built, settings) if _changes_ground_or_camera(name)]:
        raise IcyMoonError(f"{changed[0]} has changed since the scene was built; press Build Scene first.")
    return built


def find_shown_pairs(built: scenes.Built, folder: Path, names: Sequence[str]) -> Steps[list[str]]:
    """Find, in steps, the ids of the pairs in a folder that show the built scene, among ``names``.

    The pairs have the present settings; if there are none, the same ground and cameras. Raises IcyMoonError, with the
    reason, if no pair shows the scene.
    """
    settings = scene_properties.read_settings(built.scene.icymoon)
    planned = yield from plan_pairs_in_steps(built.scene, settings)
    if found := [pair.id for pair in planned if pair.id in names]:
        return found
    return (yield from _find_same_views(built, int(settings.dataset.headings), [folder / name for name in names]))


def _changes_ground_or_camera(name: str) -> bool:
    topic, _, key = name.partition(".")
    return TOPICS[topic][key].effect in ("geometry", "camera")


def _find_same_views(built: scenes.Built, headings: int, folders: Sequence[Path]) -> Steps[list[str]]:
    """Find, in steps, pairs that show the built scene. Returns one id for each heading.

    Raises IcyMoonError, with the reason, if no pair shows the scene.
    """
    found: dict[float, str] = {}
    reasons = []
    for folder in folders:
        pair = read_pair(folder)
        if why := (yield from painted_errors.why_not_shown(built, headings, pair)):
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


CLASSES = (ICYMOON_OT_show_surface, ICYMOON_OT_paint_errors, ICYMOON_OT_hide_surface)
