"""Speed and accuracy: measure this machine and the present scene, and find the cheapest sufficient quality."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import bpy

from ..nodes.build_scene import find_built
from ..nodes.datablocks.blend_file_paths import make_paths_absolute
from ..render.cost import error_tolerance, machine_speed, measure_speed
from ..render.workers.job_commands import Job, blender_command, python_command
from ..render.workers.process import Message
from ..settings import toml_text
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings, typed
from ..support.blender import compat
from ..support.errors import IcyMoonError
from ..support.files import write_text
from ..support.printer import show_controls
from ..support.system import remove_folder
from ..support.temporary_folders import make_scratch_folder
from . import jobs, results, sidebar_text
from .evaluate import make_matcher_arguments
from .job_operators import DialogJobOperator, JobOperator
from .operator_type import ExplainedOperator
from .preferences import find_evaluator_python
from .render import find_dataset_folder
from .window_areas import find_scene

#: Lines for the panel on the last measurement or search, by the name of the scene.
last_results: dict[str, tuple[str, ...]] = {}


def _find_folder(settings: Settings) -> Path:
    """Return the folder of the measurements."""
    return find_dataset_folder(settings) / "trade"


def _start_measuring(context: bpy.types.Context, verb: str, title: str, *arguments: str) -> jobs.Job:
    """Start ``icymoon trade`` or ``icymoon auto`` on the settings of the scene. Raises IcyMoonError if it cannot
    start."""
    settings = make_paths_absolute(scene_properties.read_settings(context.scene.icymoon))
    built = find_built(context.scene)
    if built is not None and built.edited:
        raise IcyMoonError(
            "The scene was edited by hand, but measurements use the settings only; press Build Scene to undo the edits."
        )
    python, matchers = find_evaluator_python(), make_matcher_arguments(settings)
    folder = make_scratch_folder()
    file = folder / "scene.toml"
    write_text(file, toml_text.to_toml(settings))
    command = python_command(
        python,
        verb,
        "--settings",
        str(file),
        "--blender",
        jobs.find_this_blender(),
        *matchers,
        "--out",
        str(_find_folder(settings)),
        "--json-lines",
        *arguments,
    )
    return jobs.Job.start(title, command, clean_up=partial(remove_folder, folder), device=settings.quality.device)


class _MeasureDialog(DialogJobOperator):
    """Mix-in: an operator with a job and a dialog for the scale of the images and the samples of the reference."""

    scale: bpy.props.FloatProperty(
        name="Image Scale",
        default=0.5,
        min=0.01,
        max=1.0,
        description="Scale of width and height of the measured images. A scale of 0.5 takes a quarter of the time",
    )
    reference_samples: bpy.props.IntProperty(
        name="Reference Samples",
        default=1024,
        min=2,
        max=65536,
        description="Samples per pixel of the reference image, with which all others are compared",
    )

    def _common_arguments(self) -> list[str]:
        return ["--scale", f"{self.scale:g}", "--reference-samples", str(self.reference_samples)]


class ICYMOON_OT_trade(_MeasureDialog, bpy.types.Operator):
    """Render the scene at cheaper qualities, measure the errors of light, depth and stereo, and write a report. Takes minutes to hours"""  # noqa: E501

    bl_idname = "icymoon.trade"
    bl_label = "Compare Qualities"

    def start(self, context: bpy.types.Context) -> jobs.Job:
        self._scene_name = context.scene.name
        # For security, the page to open later is fixed here, and not taken from a message.
        self._page = _find_folder(scene_properties.read_settings(context.scene.icymoon)) / "trade.html"
        return _start_measuring(context, "trade", self.bl_label, *self._common_arguments())

    def report_success(self, context: bpy.types.Context) -> None:
        last_results[self._scene_name] = tuple(self._job.result["advice"])
        show_chart(context, open_window=False)
        self.report({"INFO"}, show_controls(f"The report is {self._page}"))
        if not bpy.app.background:
            bpy.ops.wm.url_open(url=self._page.as_uri())

    _page: Path
    _scene: str


def find_chart(scene: bpy.types.Scene) -> Path | None:
    """Find the chart of the last comparison in a scene's data set folder; None without a comparison."""
    try:
        path = _find_folder(typed({"dataset": {"folder": scene.icymoon.dataset.folder}})) / "trade.png"
    except IcyMoonError:
        return None
    return path if path.is_file() else None


def show_chart(context: bpy.types.Context, open_window: bool) -> bool:
    """Show the chart in an Image Editor, see ``results.show_images``."""
    path = find_chart(context.scene)
    return path is not None and results.show_images([path], open_window, {path: "Speed and Accuracy"})


class ICYMOON_OT_show_trade(ExplainedOperator, bpy.types.Operator):
    """Show cost against error of all qualities that were compared, in an Image Editor. A line joins the best"""

    bl_idname = "icymoon.show_trade"
    bl_label = "Show Chart"

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if find_chart(context.scene) else "No qualities were compared yet; press Compare Qualities"

    def execute(self, context: bpy.types.Context) -> set[str]:
        show_chart(context, open_window=True)
        return {"FINISHED"}


class ICYMOON_OT_auto_quality(_MeasureDialog, bpy.types.Operator):
    """Find and set the cheapest quality whose stereo error is within the tolerance in this scene"""

    bl_idname = "icymoon.auto_quality"
    bl_label = "Find Cheapest Quality"
    bl_options = {"UNDO"}

    judged_by: bpy.props.EnumProperty(
        name="Error",
        description="The error of a matcher that must be within the tolerance",
        items=(
            ("PX", "Mean Error", "Mean disparity error of the measured pixels"),
            ("BAD_1", "Wrong Pixels", "Share of the pixels that are missing or wrong by more than 1 px"),
            ("BOTH", "Both", "Both errors must be within their tolerances"),
        ),
    )
    tolerance_px: bpy.props.FloatProperty(
        name="Added Error (px)",
        default=error_tolerance.PX,
        min=error_tolerance.PX_LEAST,
        max=error_tolerance.PX_MOST,
        precision=3,
        description="Tolerance: mean disparity error above that of a noise-free image",
    )
    tolerance_bad_1: bpy.props.FloatProperty(
        name="Added Bad-1 (%)",
        default=100 * error_tolerance.BAD_1,
        min=100 * error_tolerance.BAD_1_LEAST,
        max=100 * error_tolerance.BAD_1_MOST,
        precision=2,
        description="Tolerance: per cent of wrong pixels above that of a noise-free image",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the dialog, with only the tolerances in use."""
        layout: bpy.types.UILayout = self.layout
        layout.use_property_split = True
        layout.prop(self, "judged_by")
        for name in ("px", "bad_1"):
            if self.judged_by in (name.upper(), "BOTH"):
                layout.prop(self, f"tolerance_{name}")
        layout.prop(self, "scale")
        layout.prop(self, "reference_samples")

    def start(self, context: bpy.types.Context) -> jobs.Job:
        self._scene_uid = context.scene.session_uid
        given = {"px": f"{self.tolerance_px:g}", "bad-1": f"{self.tolerance_bad_1:g}%"}
        wanted = ("px", "bad-1") if self.judged_by == "BOTH" else (self.judged_by.lower().replace("_", "-"),)
        tolerances = [word for name in wanted for word in (f"--tolerance-{name}", given[name])]
        return _start_measuring(context, "auto", self.bl_label, *tolerances, *self._common_arguments())

    def report_success(self, context: bpy.types.Context) -> None:
        found = self._job.result
        if (scene := find_scene(self._scene_uid)) is not None:
            steps = (f"{step['name']}: {step['cpu_s']:.1f} CPU s" for step in found["tried"])
            last_results[scene.name] = (found["said"][-1], *steps)
            scene_properties.write_settings(scene.icymoon, found["settings"])
        self.report({"INFO" if found["chosen"] else "WARNING"}, sidebar_text.format_for_window(found["said"][-1]))

    _scene_uid: int


class ICYMOON_OT_measure_machine(JobOperator, bpy.types.Operator):
    """Render a small pair and record its time, to estimate render times on this machine"""

    bl_idname = "icymoon.measure_machine"
    bl_label = "Measure This Machine"

    def start(self, context: bpy.types.Context) -> jobs.Job:
        self._device = str(context.scene.icymoon.quality.device)
        folder = make_scratch_folder()
        job = Job(folder, measure_speed.make_small_render(self._device, compat.has_oidn()))

        def hear(message: Message) -> None:
            if message["type"] == "done":
                self._speed = measure_speed.read_speed(
                    [Path(pair) for pair in message["folders"]], self._device, compat.has_oidn()
                )

        def clean() -> None:
            job.remove()
            remove_folder(folder)

        command = blender_command(jobs.find_this_blender(), "worker", str(job.file))
        return jobs.Job.start(self.bl_label, command, hear, clean, device=self._device)

    def report_success(self, context: bpy.types.Context) -> None:
        sidebar_text.keep_speed(self._speed)
        self.report(
            {"INFO"}, f"This machine takes {self._speed.factor:.2g} times as long as the machine of the estimates"
        )

    _device: str = "CPU"
    _speed: machine_speed.Speed


CLASSES = (ICYMOON_OT_trade, ICYMOON_OT_show_trade, ICYMOON_OT_auto_quality, ICYMOON_OT_measure_machine)
