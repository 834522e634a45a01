"""Reproduce the tables and figures of the GUISS paper by a job."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..render.workers.job_commands import python_command
from ..settings.blender import scene_properties
from ..stereo.paper import PAPER_PAGE
from ..support.printer import show_controls
from . import jobs
from .job_operators import DialogJobOperator
from .preferences import count_workers, find_evaluator_python
from .render import find_dataset_folder


class ICYMOON_OT_reproduce(DialogJobOperator, bpy.types.Operator):
    """Render and evaluate the data set of the GUISS paper into the folder guiss of the data set folder, and write its tables and figures beside the printed ones. Takes hours; start it again to continue"""  # noqa: E501

    bl_idname = "icymoon.reproduce"
    bl_label = "Reproduce the GUISS Paper"
    stops_on_escape = False

    size: bpy.props.EnumProperty(
        name="Pairs",
        description="How many of the 5020 pairs to render",
        items=(
            ("QUICK", "A Tenth", "About 500 pairs, in which every value of each setting keeps its share"),
            ("ALL", "All", "All 5020 pairs"),
        ),
    )
    scale: bpy.props.FloatProperty(
        name="Image Scale",
        default=1.0,
        min=0.1,
        max=1.0,
        description="Scale of width and height of the images. Depth errors of small images are larger",
    )
    _page: Path

    def start(self, context: bpy.types.Context) -> jobs.Job:
        settings = scene_properties.read_settings(context.scene.icymoon)
        folder, count = find_dataset_folder(settings) / "guiss", settings.dataset.workers or count_workers()
        # For security, the page to open later is fixed here, and not taken from a message.
        self._page = folder / PAPER_PAGE
        command = python_command(
            find_evaluator_python(),
            "reproduce",
            "guiss",
            "--out",
            str(folder),
            "--scale",
            f"{self.scale:g}",
            "--blender",
            jobs.find_this_blender(),
            "--json",
            *(["--quick"] if self.size == "QUICK" else []),
            *(["--workers", str(count)] if count else []),
        )
        return jobs.Job.start(self.bl_label, command)

    def report_success(self, context: bpy.types.Context) -> None:
        self.report({"INFO"}, show_controls(f"The tables and figures are in {self._page}"))
        if not bpy.app.background:
            bpy.ops.wm.url_open(url=self._page.as_uri())


CLASSES = (ICYMOON_OT_reproduce,)
