"""Scan with LiDAR: scan in a separate process, and show the points and beams in the 3D View."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import bpy

from ..formats.lidar_file import LidarFile, read_lidar
from ..nodes import build_scene as scenes
from ..nodes import lidar_in_view
from ..nodes.datablocks.blend_file_paths import make_paths_absolute
from ..physics.lidar.scene_light import find_scene_media
from ..render.pairs.dataset_file_names import check_no_link, folder_of_pair
from ..render.pairs.pair_folder import is_complete
from ..render.plans.planned_pair import PlannedPair
from ..render.workers.job_commands import Job as JobFiles
from ..render.workers.job_commands import blender_command
from ..render.workers.lidar_request import ScanRequest
from ..render.workers.watched_thread import Calculation
from ..settings.blender import scene_properties
from ..settings.change_announcements import LIDAR_POINTS
from ..settings.preset_files import LIDARS
from ..stereo.export.lidar import discard_points
from ..stereo.lidar_view import MAX_POINTS, read_shown_points
from ..support.errors import IcyMoonError
from ..support.files import absolute_path
from ..support.number_text import format_count
from ..support.printer import show_controls
from . import jobs
from .build import leave_edit_mode
from .coloured_views import give_back_views, show_colours
from .job_operators import JobOperator
from .operator_type import ExplainedOperator
from .render import find_dataset_folder, plan_pairs
from .session import session
from .sidebar_text import format_for_window
from .window_areas import find_scene
from .window_events import make_registration

_NO_SCENE_MESSAGE = "There is no built scene; press Build Scene first"
_NO_SCAN_MESSAGE = "There is no scan of the present settings yet; press Scan with LiDAR"


def find_scanner_file(scene: bpy.types.Scene) -> Path:
    """Return the file of the chosen scanner. Raises IcyMoonError if the user's own scanner is chosen but has no
    file."""
    group = scene.icymoon.lidar
    if group.scanner != scene_properties.OWN_SCANNER:
        return LIDARS / f"{group.scanner}.toml"
    if not group.file:
        raise IcyMoonError("There is no file of a scanner; choose one under Scanner File, or a shipped scanner.")
    return absolute_path(group.file, "the file of the scanner", bpy.path.abspath("//"))


def make_request(scene: bpy.types.Scene) -> ScanRequest:
    """Make the request for a scan from the panel's choices."""
    group = scene.icymoon.lidar
    without = [name for name in ("ice", "detector") if not getattr(group, name)]
    samples = None if group.waveforms == "NONE" else int(group.waveforms)
    return ScanRequest(
        rows=group.rows or None, columns=group.columns or None, without=tuple(without), waveforms=samples
    )


def read_scanner(scene: bpy.types.Scene) -> LidarFile:
    """Read the chosen scanner, with the panel's choices applied. Raises IcyMoonError for an impossible scanner."""
    return make_request(scene).change(read_lidar(find_scanner_file(scene)))


def find_scan_folders(planned: Sequence[PlannedPair]) -> list[Path]:
    """Return the folder for the returns of each pair. These are the pairs' own folders if all pairs are rendered, else
    folders beside the data set."""
    dataset = find_dataset_folder(planned[0].settings)
    pairs = [folder_of_pair(dataset, each.id) for each in planned]
    beside = dataset.parent / f"{dataset.name}_lidar"
    return pairs if all(map(is_complete, pairs)) else [beside / each.id for each in planned]


def plan_scans(scene: bpy.types.Scene) -> list[PlannedPair]:
    """Plan the pairs at whose left eyes the ground is scanned, one for each heading of the present settings.

    Raises IcyMoonError for a scene that was edited by hand, because the settings do not describe it.
    """
    built = scenes.find_built(scene)
    if built is not None and built.edited:
        raise IcyMoonError(
            "The scene was edited by hand, and a scan shows the settings; press Build Scene to build it from them."
        )
    return plan_pairs(scene, scene_properties.read_settings(scene.icymoon))


class ICYMOON_OT_scan_lidar(JobOperator, bpy.types.Operator):
    """Scan the scene with the chosen laser scanner at the left eye, once for each heading, and show the points. Runs in a separate process; Esc twice stops it"""  # noqa: E501

    bl_idname = "icymoon.scan_lidar"
    bl_label = "Scan with LiDAR"

    def start(self, context: bpy.types.Context) -> jobs.Job:
        scene = context.scene
        planned, asked, file = plan_scans(scene), make_request(scene), find_scanner_file(scene)
        lidar = asked.read_scanner(file)
        if "ice" not in asked.without:
            find_scene_media(planned[0].settings, lidar.instrument.wavelength_m * 1e9, None, None)
        self._scene_uid, folders = scene.session_uid, find_scan_folders(planned)
        for folder in folders:
            check_no_link(folder)
            discard_points(folder, ())
        files = JobFiles(
            find_dataset_folder(planned[0].settings),
            pairs=[replace(each, settings=make_paths_absolute(each.settings)) for each in planned],
        )
        command = blender_command(
            jobs.find_this_blender(),
            "scan",
            str(files.file),
            str(folders[0].parent),
            str(file),
            asked.to_json(),
        )
        return jobs.Job.start(self.bl_label, command, clean_up=files.discard, if_stopped="an earlier scan is kept")

    def report_success(self, context: bpy.types.Context) -> None:
        folders = self._job.result["folders"]
        of = f" and {format_count(len(folders) - 1, 'more folder')}" if len(folders) > 1 else ""
        self.report({"INFO"}, show_controls(f"Returns in {folders[0]}{of}"))
        if find_scene(self._scene_uid) == context.scene:
            bpy.ops.icymoon.show_scan("INVOKE_DEFAULT")

    _scene_uid: int


class ICYMOON_OT_show_scan(JobOperator, bpy.types.Operator):
    """Show the points of the last scan of the present settings, of all headings, as squares coloured by a value"""

    bl_idname = "icymoon.show_scan"
    bl_label = "Show LiDAR Points"
    bl_options = {"UNDO"}

    def start(self, context: bpy.types.Context) -> jobs.Job:
        """Start to read the points in a thread, since a scan may have millions."""
        scene = context.scene
        folders = [each for each in find_scan_folders(plan_scans(scene)) if (each / "lidar.npz").is_file()]
        if not folders:
            raise IcyMoonError(f"{_NO_SCAN_MESSAGE}.")
        self._scene_uid = scene.session_uid
        work = partial(read_shown_points, folders, MAX_POINTS)
        return jobs.Job(self.bl_label, Calculation(work, folders[0], reports=True), if_stopped="nothing is shown")

    def report_success(self, context: bpy.types.Context) -> None:
        scene = find_scene(self._scene_uid)
        if scene is None:
            return
        leave_edit_mode()
        points, group = self._job.result["value"], scene.icymoon.lidar
        item = lidar_in_view.show_points(scene, points, group.colour, group.points)
        show_colours(context, [item], solid=True)  # sunlit ice is so bright that the points would be dark and noisy
        counted = f"{format_count(points.total, 'point')} of {points.title}"
        told = f"{counted}; {points.returned} of {format_count(points.beams, 'beam')} returned"
        self.report({"INFO"}, show_controls(told))
        session.note_end(self._job, f"{points.returned} of {format_count(points.beams, 'beam')} returned")

    _scene_uid: int


class ICYMOON_OT_show_beams(ExplainedOperator, bpy.types.Operator):
    """Draw some beams of the chosen laser scanner to where they meet the built scene: green, or grey where they meet nothing"""  # noqa: E501

    bl_idname = "icymoon.show_beams"
    bl_label = "Show LiDAR Beams"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if scenes.find_collection(context.scene) else _NO_SCENE_MESSAGE

    def execute(self, context: bpy.types.Context) -> set[str]:
        leave_edit_mode()
        built = scenes.find_built(context.scene)
        try:
            if built is None:
                raise IcyMoonError(f"{_NO_SCENE_MESSAGE}.")
            item = lidar_in_view.show_beams(context.scene, built, read_scanner(context.scene))
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        show_colours(context, [item])
        self.report(
            {"INFO"}, show_controls("; ".join(text for text, _ in lidar_in_view.make_legend(context.scene, "")))
        )
        return {"FINISHED"}


class ICYMOON_OT_hide_scan(ExplainedOperator, bpy.types.Operator):
    """Remove the points and beams of the LiDAR, and restore the earlier view. The files of the scan stay"""

    bl_idname = "icymoon.hide_scan"
    bl_label = "Remove LiDAR Points"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if lidar_in_view.find_shown(context.scene) else "No points or beams of a LiDAR are shown"

    def execute(self, context: bpy.types.Context) -> set[str]:
        leave_edit_mode()
        lidar_in_view.clear_scan(context.scene)
        give_back_views(context.scene)
        return {"FINISHED"}


def _follow_choices(scene: bpy.types.Scene, effects: frozenset[str]) -> None:
    """Update the shown points to the number and colours that the panel states."""
    if scene is not None and LIDAR_POINTS in effects:
        lidar_in_view.limit_points(scene, scene.icymoon.lidar.points)
        lidar_in_view.recolour(scene, scene.icymoon.lidar.colour)


CLASSES = (ICYMOON_OT_scan_lidar, ICYMOON_OT_show_scan, ICYMOON_OT_show_beams, ICYMOON_OT_hide_scan)


register, unregister = make_registration(_follow_choices)
