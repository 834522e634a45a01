"""Data sets: choose a plan, estimate its cost, and render it in a process that may outlive Blender."""

from __future__ import annotations

import os
import tempfile
import time
import zlib
from pathlib import Path
from typing import Any

import bpy

from ..render.pairs.pair_folder import is_complete
from ..render.plans.frozen_plan import read_frozen_plan
from ..render.plans.plan_file import find_plan, read_plan_header
from ..render.workers.detached_process import DetachedProcess, find_unwatched_process
from ..render.workers.job_commands import blender_command
from ..render.workers.process import Message, clean_environment
from ..settings.blender import scene_properties
from ..settings.preset_files import plan_names
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.files import absolute_path
from ..support.printer import show_controls
from ..support.system import find_user_key
from . import dialogs, evaluate, jobs, last_variations
from .job_operators import JobOperator
from .preferences import count_workers, find_evaluator_python, find_extension_folder
from .render import find_dataset_folder
from .session import session
from .show_pair import ShowsPair
from .sidebar_text import format_for_window
from .window_areas import push_undo
from .window_events import call_later, make_registration

_JOB_TITLE = "Render Data Set"
_LOOK_S = 0.5
_plans: list[tuple[str, str, str]] = []
#: The plan and the lines of the last dry run, the pairs that were set aside with the reasons, and the last rendered
#: pair.
readout: dict[str, Any] = {"plan": "", "lines": [], "set_aside": [], "last": None}


def list_plan_items(_self: object = None, _context: object = None) -> list[tuple[str, str, str]]:
    """List (name, title, description) of the shipped plans. They are read once and kept, because Blender requires that
    Python keeps the strings."""
    if not _plans:
        _plans.extend((name, *read_plan_header(find_plan(name))) for name in plan_names())
    return _plans


def find_chosen_plan(settings: Settings) -> str:
    """Find the plan of the settings: the name of a shipped plan, or the absolute path of a file.

    Raises IcyMoonError if there is no such plan.
    """
    name = str(settings.dataset.plan)
    if name in plan_names():
        return name
    saved = os.path.dirname(bpy.data.filepath) if bpy.data.filepath else None
    path = find_plan(str(absolute_path(name, "dataset.plan", saved)) if name.endswith(".toml") else name)
    return str(path.absolute())  # an absolute path cannot look like an option of a command


def find_plan_title(name: str) -> str:
    """Return the title of a shipped plan, or the name of a plan's file."""
    return next((title for known, title, _ in list_plan_items() if known == name), Path(name).name)


def find_state_folder() -> Path:
    """Return the folder whose files record running data sets, so that the next Blender session finds them."""
    try:
        return find_extension_folder() / "running"
    except IcyMoonError:  # not installed as an extension
        return Path(tempfile.gettempdir()) / f"icymoon-running-{find_user_key()}"


def make_verb_command(*arguments: str) -> list[str]:
    """Make the command that runs a verb in this Blender, or in its Python if Blender is a module."""
    return blender_command(jobs.find_this_blender(), *arguments)


class ICYMOON_OT_choose_plan(dialogs.SearchDialog, bpy.types.Operator):
    """Choose one of the shipped plans of data sets"""

    bl_idname = "icymoon.choose_plan"
    bl_label = "Choose Plan"
    bl_options = {"REGISTER", "UNDO"}
    bl_property = "plan"

    plan: bpy.props.EnumProperty(
        items=list_plan_items,
        name="Plan",
        description="Plan to render",
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.scene.icymoon.dataset.plan = self.plan
        return {"FINISHED"}


class ICYMOON_OT_open_plan(dialogs.TomlFileDialog, bpy.types.Operator):
    """Choose your own plan, a TOML file"""

    bl_idname = "icymoon.open_plan"
    bl_label = "Open Plan"
    bl_options = {"REGISTER", "UNDO"}

    filepath: dialogs.file_property("Plan of a data set")

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            read_plan_header(Path(bpy.path.abspath(self.filepath)))
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        context.scene.icymoon.dataset.plan = self.filepath
        return {"FINISHED"}


class ICYMOON_OT_plan_dry_run(JobOperator, bpy.types.Operator):
    """Check the plan without rendering it, and estimate its number of pairs, time and disk space"""

    bl_idname = "icymoon.plan_dry_run"
    bl_label = "Dry Run"

    def start(self, context: bpy.types.Context) -> jobs.Job:
        settings = scene_properties.read_settings(context.scene.icymoon)
        plan = find_chosen_plan(settings)
        readout.update(plan=settings.dataset.plan, lines=[])
        blender, folder = jobs.find_this_blender(), str(find_dataset_folder(settings))
        command = make_verb_command("plan", plan, "--dry-run", "--json", "--out", folder, "--blender", blender)
        return jobs.Job.start(self.bl_label, command)

    def report_success(self, context: bpy.types.Context) -> None:
        readout["lines"] = list(self._job.result["lines"])
        for line in readout["lines"]:
            self.report({"INFO"}, format_for_window(line))


def _note_pairs(message: Message) -> None:
    """Note the last pair and the pairs that were set aside, for the sidebar."""
    if message["type"] == "pair":
        readout["last"] = Path(message["folder"])
    elif message["type"] == "error" and "pair" in message:
        readout["set_aside"].append(f"{message['pair']}: {message['message']}")


class DatasetJob(jobs.Job):
    """A job that renders a data set. A pair that is set aside does not end it.

    If the job ``evaluates``, its progress starts again when all pairs are rendered.
    """

    evaluates = False

    def hear(self, message: Message) -> None:
        if message["type"] == "done" and self.evaluates:
            self.started, self.fraction = time.monotonic(), 0.0
        elif message["type"] != "error" or "pair" not in message:
            super().hear(message)

    @property
    def failure(self) -> str:
        if self.result and readout["set_aside"]:
            n = len(readout["set_aside"])
            return f"{n} pair{'s were' if n > 1 else ' was'} set aside, first {readout['set_aside'][0]}"
        return super().failure


def make_batch_command(scene: bpy.types.Scene, settings: Settings, plan: str) -> list[str]:
    """Make the command that renders a plan into the data set folder, and then evaluates the pairs if the settings ask
    for it.

    Raises IcyMoonError if an evaluation is wanted but there is no evaluator.
    """
    wanted, folder = settings.dataset, find_dataset_folder(settings)
    count = wanted.workers or count_workers()
    # The same process evaluates, so that the evaluation runs even after this Blender is closed.
    after = (
        [
            *evaluate.make_matcher_arguments(settings, "--evaluate"),
            "--evaluator",
            find_evaluator_python(),
            *evaluate.make_response_arguments(settings),
            *evaluate.make_map_arguments(scene, settings),
        ]
        if wanted.evaluate
        else []
    )
    return make_verb_command(
        "batch",
        plan,
        "--out",
        str(folder),
        "--json",
        "--blender",
        jobs.find_this_blender(),
        *(["--workers", str(count)] if count else []),
        *after,
    )


def start_batch(settings: Settings, command: list[str], plan: str, scope: str = "DATASET") -> DetachedProcess:
    """Start a command from ``make_batch_command``. ``plan`` is the value of the setting ``dataset.plan``, and ``scope``
    one of ``evaluate.SCOPES``.

    Raises IcyMoonError if the data set is being rendered already.
    """
    folder = find_dataset_folder(settings)
    return DetachedProcess.start(
        command,
        find_state_folder() / f"{zlib.crc32(str(folder).encode()):08x}",
        {
            "title": _JOB_TITLE,
            "dataset": str(folder),
            "plan": plan,
            "evaluate": settings.dataset.evaluate,
            "scope": scope,
        },
        jobs.make_environment_with_cards("GPU", clean_environment()),
    )


class DatasetOperator(JobOperator):
    """Mix-in: an operator that watches the rendering of a data set."""

    stops_on_escape = False
    _process: DetachedProcess
    _keeper: evaluate.ResultKeeper

    def watch(self, context: bpy.types.Context) -> None:
        self._process.leave = bool(context.scene.icymoon.dataset.leave_running)

    def _make_job(self, process: DetachedProcess, context: bpy.types.Context) -> jobs.Job:
        readout.update(set_aside=[], last=None)
        self._process = process
        # An earlier Blender may have started it.
        began = time.monotonic() - (time.time() - process.facts["started"])
        settings = scene_properties.read_settings(context.scene.icymoon)
        settings.dataset.folder = process.facts["dataset"]
        self._keeper = evaluate.ResultKeeper(context.scene, process.facts.get("scope", "DATASET"), settings)

        def handle(message: Message) -> None:
            self._keeper(message)
            _note_pairs(message)

        job = DatasetJob(_JOB_TITLE, process, handle, started=began)
        job.evaluates = bool(process.facts.get("evaluate"))
        return job

    def report_success(self, context: bpy.types.Context) -> None:
        dataset, evaluated = self._process.facts["dataset"], self._process.facts.get("evaluate")
        button = "Evaluate These Variations" if self._is_of_variations else "Evaluate Whole Data Set"
        following = "" if evaluated else f"; press {button} to measure it"
        self._keep_variations()
        self.report({"INFO"}, show_controls(f"The data set in {dataset} is rendered{following}"))
        if evaluated:
            self._keeper.report(self, context)

    @property
    def _is_of_variations(self) -> bool:
        return bool(self._process.facts.get("scope") == last_variations.SCOPE)

    def _keep_variations(self) -> None:
        """Store the ids of rendered variations with the scene, for the sidebar."""
        scene = self._keeper.scene
        if self._is_of_variations and scene is not None:
            pairs = read_frozen_plan(Path(self._process.facts["dataset"])).pairs
            last_variations.remember_pairs(scene, [pair.id for pair in pairs])
            push_undo(_JOB_TITLE)


class ICYMOON_OT_render_dataset(DatasetOperator, bpy.types.Operator):
    """Render the missing pairs of the plan into the data set folder, in separate processes. The present scene is neither used nor changed"""  # noqa: E501

    bl_idname = "icymoon.render_dataset"
    bl_label = _JOB_TITLE

    def start(self, context: bpy.types.Context) -> jobs.Job:
        settings = scene_properties.read_settings(context.scene.icymoon)
        process = start_batch(
            settings, make_batch_command(context.scene, settings, find_chosen_plan(settings)), settings.dataset.plan
        )
        return self._make_job(process, context)


class ICYMOON_OT_watch_dataset(DatasetOperator, bpy.types.Operator):
    """Show the progress of a data set that an earlier Blender left running"""

    bl_idname = "icymoon.watch_dataset"
    bl_label = "Watch Data Set"

    def start(self, context: bpy.types.Context) -> jobs.Job:
        process = find_unwatched_process(find_state_folder())
        if process is None:
            raise IcyMoonError("No data set was left running; press Render Data Set to start one.")
        group, facts = context.scene.icymoon.dataset, process.facts
        if facts.get("scope") == last_variations.SCOPE:
            last_variations.remember_folder(context.scene, Path(facts["dataset"]))
        else:
            group.folder, group.plan, group.evaluate = facts["dataset"], facts["plan"], facts["evaluate"]
        group.leave_running = True
        push_undo(self.bl_label)
        return self._make_job(process, context)


class ICYMOON_OT_show_last_pair(ShowsPair, bpy.types.Operator):
    """Show the camera images and the true depth of the pair of the data set that was rendered last"""

    bl_idname = "icymoon.show_last_pair"
    bl_label = "Show Last Pair"

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "No pair of a data set has been rendered yet" if readout["last"] is None else ""

    def find_folder(self, context: bpy.types.Context) -> Path:
        folder: Path = readout["last"]
        if not is_complete(folder):
            raise IcyMoonError(f"{folder} no longer exists; render the data set again.")
        return folder


def _watch_again() -> None:
    """Watch a data set that an earlier Blender, or this Blender before it opened another file, left running."""
    manager = bpy.context.window_manager
    if session.job is not None or not manager.windows or not any(find_state_folder().glob("*.lock")):
        return
    with bpy.context.temp_override(window=manager.windows[0]):
        if ICYMOON_OT_watch_dataset.poll(bpy.context):
            process = find_unwatched_process(find_state_folder())
            if process is not None:
                process.leave = True
                process.stop()  # this stops only the watching; the operator finds the data set again
                bpy.ops.icymoon.watch_dataset("INVOKE_DEFAULT")


def _check_after_load() -> None:
    if not bpy.app.background:
        call_later(_watch_again, _LOOK_S)


CLASSES = (
    ICYMOON_OT_choose_plan,
    ICYMOON_OT_open_plan,
    ICYMOON_OT_plan_dry_run,
    ICYMOON_OT_render_dataset,
    ICYMOON_OT_watch_dataset,
    ICYMOON_OT_show_last_pair,
)


_register, unregister = make_registration(timers=(_watch_again,), load_post=_check_after_load)


def register() -> None:
    """Look for a data set that was left running, now and after each file is opened."""
    _register()
    _check_after_load()
