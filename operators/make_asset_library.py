"""Make and remove the asset library, which offers the shipped presets in Blender's Asset Browser."""

from __future__ import annotations

import bpy

from ..formats.asset_library import uninstall_library
from ..render.workers.job_commands import blender_command
from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from ..support.printer import show_controls
from . import jobs
from .job_operators import JobOperator, find_running_job
from .operator_type import ExplainedOperator
from .preferences import (
    find_asset_folder,
    find_asset_libraries,
    has_assets,
    list_asset_library,
    unlist_asset_library,
)
from .sidebar_text import format_for_window
from .window_areas import list_areas, override_area


def _show_in_browsers(library: str = "") -> None:
    """Make open Asset Browsers read their libraries again. Browsers that do not show all libraries then show
    ``library``."""
    for window, area in list_areas("FILE_BROWSER"):
        if area.ui_type == "ASSETS":
            shown = area.spaces.active.params
            if library and shown is not None and shown.asset_library_reference != "ALL":
                shown.asset_library_reference = library
            with override_area(window, area):
                if bpy.ops.asset.library_refresh.poll():
                    bpy.ops.asset.library_refresh()


class ICYMOON_OT_make_asset_library(JobOperator, bpy.types.Operator):
    """Make assets of the shipped scenes, surfaces, stereo cameras, lights and a black sky, and add them to Blender's Asset Browser. Takes about a minute; Esc twice stops it"""  # noqa: E501

    bl_idname = "icymoon.make_asset_library"
    bl_label = "Make Asset Library"

    def start(self, context: bpy.types.Context) -> jobs.Job:
        command = blender_command(jobs.find_this_blender(), "assets", str(find_asset_folder()))
        kept = "the library is as it was before"
        return jobs.Job.start(self.bl_label, command, clean=False, if_stopped=kept)

    def report_success(self, context: bpy.types.Context) -> None:
        list_asset_library()
        name = find_asset_libraries()[0].name
        _show_in_browsers(name)
        made = format_count(int(self._job.result["assets"]), "asset")
        self.report({"INFO"}, f"Made {made}, the library {name} of the Asset Browser")


class ICYMOON_OT_remove_asset_library(ExplainedOperator, bpy.types.Operator):
    """Delete the asset library that Make Asset Library has made, and remove it from Blender's preferences. Your scenes keep the assets in them"""  # noqa: E501

    bl_idname = "icymoon.remove_asset_library"
    bl_label = "Remove Asset Library"

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        if not has_assets() and not find_asset_libraries():
            return "There is no asset library; press Make Asset Library first"
        return find_running_job()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return set(context.window_manager.invoke_confirm(self, event))

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            left = uninstall_library(find_asset_folder())
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        if left:
            self.report(
                {"WARNING"},
                show_controls(
                    f"{find_asset_folder()} still contains {len(left)} of your own files, such as {left[0].name}, so "
                    "it stays "
                    "an asset library"
                ),
            )
            _show_in_browsers()
            return {"FINISHED"}
        unlist_asset_library()
        _show_in_browsers()
        self.report({"INFO"}, "Removed the asset library")
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_make_asset_library, ICYMOON_OT_remove_asset_library)
