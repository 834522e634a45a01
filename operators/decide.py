"""Decide Where to Dig: a lander's decisions by each matcher, computed in the evaluator's Python."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..render.workers.job_commands import python_command
from ..settings.blender import scene_properties
from ..support.files import absolute_path
from ..support.printer import show_controls
from . import dialogs, jobs, trusted_reports
from .evaluate import MeasuringJob, check_has_pairs, make_matcher_arguments, make_response_arguments
from .job_operators import JobOperator
from .preferences import find_evaluator_python
from .render import find_dataset_folder
from .session import session

#: Title of the jobs that decide.
TITLE = "Decide"


class DecidingOperator(JobOperator):
    """Mix-in: an operator that decides on the pairs of the data set by the chosen matchers."""

    fuse_suns: bpy.props.BoolProperty(
        name="Fuse Suns",
        description="Decide once on the pairs of a site that one camera took in one pose under several Suns",
        options={"SKIP_SAVE"},  # otherwise the button without this property would get the last choice
    )

    def make_file_arguments(self) -> tuple[str, ...]:
        """Return the command's arguments for a file of the user; empty for the shipped rules without a guarantee."""
        return ()

    def start(self, context: bpy.types.Context) -> jobs.Job:
        self._scene_uid = context.scene.session_uid
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
            *self.make_file_arguments(),
            *(["--fuse-suns"] if self.fuse_suns else []),
            "--out",
            str(self._page.parent),
            "--json-lines",
        )
        return MeasuringJob.start(TITLE, command)

    def report_success(self, context: bpy.types.Context) -> None:
        trusted_reports.remember_report(self._page)
        found = [show_controls(sentence) for sentence in self._job.result["head"] if sentence]
        told = (*found,) or ("No pair shows ground in reach; see the report.",)
        session.decided[self._scene_uid] = told
        for sentence in told:
            self.report({"INFO"}, sentence)
        if not bpy.app.background:
            bpy.ops.wm.url_open(url=self._page.as_uri())

    _page: Path
    _scene_uid: int


class ICYMOON_OT_decide(DecidingOperator, bpy.types.Operator):
    """Find where a lander would dig and stand by each chosen matcher, compare it with the truth and open a report"""

    bl_idname = "icymoon.decide"
    bl_label = "Decide Where to Dig"

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Return the tooltip, with a sentence on several Suns if they are fused."""
        suns = properties.rna_type.properties["fuse_suns"].description
        return f"{cls.__doc__}. {suns}" if properties.fuse_suns else str(cls.__doc__)


class DecidingByFile(DecidingOperator):
    """Mix-in: an operator that asks for a file, and then decides in the background."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the job, once the file is chosen."""
        if bpy.app.background:
            return DecidingOperator.execute(self, context)
        return DecidingOperator.invoke(self, context, None)


class ICYMOON_OT_decide_by_rules(dialogs.TomlFileDialog, DecidingByFile, bpy.types.Operator):
    """Decide Where to Dig by a TOML file with rules of your own, such as the slope, the albedo or the share of salt"""

    bl_idname = "icymoon.decide_by_rules"
    bl_label = "Decide by Own Rules"

    filepath: dialogs.file_property("TOML file with rules of your own for sites and pads")

    def make_file_arguments(self) -> tuple[str, ...]:
        return "--rules", str(absolute_path(self.filepath, "the file of rules", bpy.path.abspath("//")))


class ICYMOON_OT_decide_with_guarantee(dialogs.JsonFileDialog, DecidingByFile, bpy.types.Operator):
    """Decide Where to Dig by a calibration on other grounds: a chosen site is guaranteed, or the lander abstains"""

    bl_idname = "icymoon.decide_with_guarantee"
    bl_label = "Decide with Guarantee"

    filepath: dialogs.file_property("File that icymoon decide --calibrate wrote")

    def make_file_arguments(self) -> tuple[str, ...]:
        return "--calibration", str(absolute_path(self.filepath, "the file of a calibration", bpy.path.abspath("//")))


CLASSES = (ICYMOON_OT_decide, ICYMOON_OT_decide_by_rules, ICYMOON_OT_decide_with_guarantee)
