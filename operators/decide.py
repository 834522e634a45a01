"""Decide Where to Dig: a lander's decisions by each matcher, computed in the evaluator's Python."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..render.workers.job_commands import python_command
from ..settings.blender import scene_properties
from ..support.printer import show_controls
from . import jobs, trusted_reports
from .evaluate import MeasuringJob, check_has_pairs, make_matcher_arguments, make_response_arguments
from .job_operators import JobOperator
from .preferences import find_evaluator_python
from .render import find_dataset_folder


class ICYMOON_OT_decide(JobOperator, bpy.types.Operator):
    """Find where a lander would dig and stand by each chosen matcher, compare it with the truth and open a report"""

    bl_idname = "icymoon.decide"
    bl_label = "Decide Where to Dig"

    def start(self, context: bpy.types.Context) -> jobs.Job:
        settings = scene_properties.read_settings(context.scene.icymoon)
        dataset = find_dataset_folder(settings)
        check_has_pairs(dataset)  # before an evaluator is asked for
        # For security, the page to open later is fixed here, and not taken from a message.
        self._page = dataset / "decisions" / "decisions.html"
        command = python_command(
            find_evaluator_python(),
            "stereo",
            "decide",
            str(dataset),
            *make_matcher_arguments(settings),
            *make_response_arguments(settings),
            "--out",
            str(self._page.parent),
            "--json-lines",
        )
        return MeasuringJob.start("Decide", command)

    def report_success(self, context: bpy.types.Context) -> None:
        trusted_reports.remember_report(self._page)
        for sentence in self._job.result["head"]:
            self.report({"INFO"}, show_controls(sentence))
        if not bpy.app.background:
            bpy.ops.wm.url_open(url=self._page.as_uri())

    _page: Path


CLASSES = (ICYMOON_OT_decide,)
