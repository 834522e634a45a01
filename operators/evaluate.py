"""Evaluate: run the matchers in the evaluator's Python."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import bpy

from ..formats.map_frame import map_frame_from_json
from ..nodes.build_scene import find_built
from ..render.pairs.pair_folder import has_pairs, is_complete
from ..render.workers.job_commands import python_command
from ..render.workers.process import Message
from ..settings.blender import scene_properties
from ..settings.table import list_all_settings
from ..settings.topics.scene import Settings
from ..settings.topics.trust_boundary import OWN_PREFIX
from ..stereo.matchers import get_matcher_needs, list_matcher_titles
from ..stereo.matchers.methods import toggle_method
from ..support.errors import IcyMoonError
from ..support.files import absolute_path
from ..support.printer import show_controls
from ..support.steps import Steps, finish
from . import jobs, last_variations, results, trusted_reports
from .job_operators import JobOperator, PreparingOperator
from .kept_pairs import find_kept_pairs, list_changes_since_render
from .preferences import find_evaluator_python, is_evaluator_missing, list_plugin_matchers, make_own_matcher_arguments
from .render import find_dataset_folder, plan_pairs_in_steps, require_scene
from .settled_steps import settle
from .sidebar_text import name_settings
from .window_areas import find_scene, push_undo

#: Scopes of an evaluation, as items of a choice.
SCOPES = (
    ("SCENE", "This Scene", "The pairs of the present settings"),
    ("DATASET", "Whole Data Set", "Every pair in the data set folder"),
    (last_variations.SCOPE, "These Variations", "Every pair of the variations that were rendered last"),
)


def find_rendered_pairs(context: bpy.types.Context, settings: Settings) -> list[Path]:
    """Find the folders of the rendered pairs of the present settings. Raises IcyMoonError if no pair is rendered."""
    return finish(find_rendered_pairs_in_steps(context.scene.session_uid, settings))


def find_rendered_pairs_in_steps(scene_uid: int, settings: Settings) -> Steps[list[Path]]:
    """Find the folders of the rendered pairs as ``find_rendered_pairs`` does, in steps."""
    dataset = find_dataset_folder(settings)
    planned = yield from plan_pairs_in_steps(require_scene(scene_uid), settings)
    paths = [path for path in (pair.folder(dataset) for pair in planned) if is_complete(path)]
    if not paths:
        raise IcyMoonError(
            f"The present settings have no rendered pair in {dataset}{_name_changes(require_scene(scene_uid))}; press "
            "Render Stereo Pair first."
        )
    return paths


def _name_changes(scene: bpy.types.Scene) -> str:
    """Return the end of a sentence that names the settings changed since a scene's pair was rendered; empty without a
    pair or a change."""
    changed = [each for folder in find_kept_pairs(scene)[:1] for each in list_changes_since_render(scene, folder)]
    return f", because {name_settings(changed)} changed after the last render" if changed else ""


def check_has_pairs(dataset: Path) -> None:
    """Raise IcyMoonError if a data set has no rendered pair."""
    if not has_pairs(dataset):
        raise IcyMoonError(f"{dataset} has no rendered pair; press Render Stereo Pair or Render Data Set first.")


def make_response_arguments(settings: Settings) -> list[str]:
    """Return the settings that change only the camera's response, and so need no new render, as arguments of the
    evaluator."""
    texts = [
        f"{topic}.{s.key}={settings[topic][s.key]}".replace("True", "true").replace("False", "false")
        for topic, s in list_all_settings()
        if s.effect == "response"
    ]
    return [word for text in texts for word in ("--set", text)]


def make_matcher_arguments(settings: Settings, flag: str = "--methods") -> list[str]:
    """Make the evaluator's arguments for the matchers of the settings: ``flag`` with their list, then the user's own.

    Raises IcyMoonError if one of the user's own matchers is not set up.
    """
    methods = str(settings.dataset.methods)
    return [flag, methods, *make_own_matcher_arguments(methods)]


def explain_missing_maps(scene: bpy.types.Scene) -> str:
    """Explain in a sentence why an evaluation cannot write maps of a scene's ground; empty if no reason is known."""
    source = scene_properties.read_for_display(scene.icymoon).source
    if source.kind != "HEIGHT_MAP":
        return "Maps need ground from a GeoTIFF with a coordinate system."
    built = find_built(scene)
    if built is None or built.settings.source != source or map_frame_from_json(built.ground) is not None:
        return ""
    return "The file of the ground has no coordinate system that maps could have."


def make_map_arguments(scene: bpy.types.Scene, settings: Settings) -> list[str]:
    """Return the evaluator's arguments for maps; empty if the settings ask for none or the scene's ground has no
    map."""
    if not settings.dataset.maps or explain_missing_maps(scene):
        return []
    cell_m = settings.dataset.map_cell_m
    return ["--maps", *([f"{cell_m:.6g}"] if cell_m > 0 else [])]


class ResultKeeper:
    """Handles the messages of an evaluation, and stores its results with the scene and the settings.

    A scene that knows no pair keeps the measured pairs too, so that they can be shown.
    """

    def __init__(self, scene: bpy.types.Scene, scope: str, settings: Settings, pairs: Sequence[str] = ()) -> None:
        self._uid = scene.session_uid
        self._scope, self._settings, self._pairs = scope, settings, pairs

    @property
    def scene(self) -> bpy.types.Scene | None:
        """The scene, if it still exists."""
        return find_scene(self._uid)

    def __call__(self, message: Message) -> None:
        """Store the results after the evaluator has written its report."""
        if message["type"] == "result" and self.scene is not None:
            results.keep_results(self.scene, self._scope, self._settings, self._pairs)
            if not self.scene.icymoon.pairs:  # after undo: the pairs of these settings were found in the data set
                self.scene.icymoon.pairs = " ".join(self._pairs)

    def report(self, operator: bpy.types.Operator, context: bpy.types.Context) -> None:
        """Report the metrics to the user, and show the error image if the context shows the scene."""
        push_undo("Evaluate")  # otherwise undo of the previous step would remove the results too
        for sentence in results.describe_results(results.read_summary(self.scene) if self.scene is not None else ()):
            operator.report({"INFO"}, show_controls(sentence))
        if self.scene == context.scene:
            results.show_error_image(context, open_window=False)


class MeasuringJob(jobs.Job):
    """A job of the evaluator. Its text shows counts instead of ids of pairs, and names the work that follows the last
    pair."""

    def hear(self, message: Message) -> None:
        """Handle one message of the evaluator."""
        super().hear(message)
        if message["type"] == "progress" and "done" in message:
            done, total = message["done"], message["total"]
            self.text = f"{done} of {total} measured" if done < total else "Writing the report"


class ICYMOON_OT_evaluate(PreparingOperator, bpy.types.Operator):
    """Run the chosen stereo matchers on the rendered pairs, compare the result with the truth and write a report"""

    bl_idname = "icymoon.evaluate"
    bl_label = "Evaluate"

    scope: bpy.props.EnumProperty(name="Scope", default="SCENE", items=SCOPES, description="Which pairs to evaluate")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Start the job. If there is a pair but no evaluator, offer to install the evaluator first."""
        if not bpy.app.background and is_evaluator_missing():
            try:
                settings = scene_properties.read_settings(context.scene.icymoon)
                if self.scope == "SCENE":
                    find_rendered_pairs(context, settings)
                else:
                    check_has_pairs(find_dataset_folder(results.select_dataset(context.scene, settings, self.scope)))
            except IcyMoonError as error:
                return self.fail(error)
            bpy.ops.icymoon.install_evaluator("INVOKE_DEFAULT", then_evaluate=self.scope)
            return {"CANCELLED"}
        return super().invoke(context, event)

    def _make_command(self, scene: bpy.types.Scene, settings: Settings, paths: Sequence[Path]) -> list[str]:
        return python_command(
            find_evaluator_python(),
            "stereo",
            "evaluate",
            *map(str, paths),
            *make_matcher_arguments(settings),
            *make_response_arguments(settings),
            *make_map_arguments(scene, settings),
            *(["--points"] if self.scope == "SCENE" else []),
            "--out",
            str(results.find_evaluation_folder(settings, self.scope)),
            "--json-lines",
        )

    def prepare(self, context: bpy.types.Context) -> Steps[jobs.Job]:
        uid, settings = context.scene.session_uid, scene_properties.read_settings(context.scene.icymoon)
        settings = results.select_dataset(context.scene, settings, self.scope)
        found = list[Path]()
        if self.scope == "SCENE":
            found = yield from settle(partial(find_rendered_pairs_in_steps, uid, settings))
        scene = require_scene(uid)
        command = self._make_command(scene, settings, found or [find_dataset_folder(settings)])
        self._keeper = ResultKeeper(scene, self.scope, settings, [folder.name for folder in found])
        return MeasuringJob.start("Evaluate", command, self._keeper)

    def report_success(self, context: bpy.types.Context) -> None:
        self._keeper.report(self, context)


class ICYMOON_OT_evaluate_folder(JobOperator, bpy.types.Operator):
    """Run the chosen stereo matchers on pairs that were not rendered here, such as KITTI, Middlebury or photographs of your own, and open the report"""  # noqa: E501

    bl_idname = "icymoon.evaluate_folder"
    bl_label = "Evaluate Other Pairs"

    directory: bpy.props.StringProperty(
        name="Folder", subtype="DIR_PATH", description="Folder of a data set as it was unpacked, or with a pairs.toml"
    )
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Let the user choose the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the choices beside the folders."""
        column = self.layout.column(align=True)
        for line in (
            "Choose a folder: a data set",
            "as it was unpacked, such as",
            "KITTI or Middlebury, or your",
            "photographs and a pairs.toml",
        ):
            column.label(text=line)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the job, once the folder is chosen."""
        return super().execute(context) if bpy.app.background else super().invoke(context, None)

    def start(self, context: bpy.types.Context) -> jobs.Job:
        folder = absolute_path(self.directory, "the folder", bpy.path.abspath("//"))
        # For security, the page to open later is fixed here, and not taken from a message.
        self._page = folder / "evaluation" / "report.html"
        command = python_command(
            find_evaluator_python(),
            "stereo",
            "evaluate",
            str(folder),
            *make_matcher_arguments(scene_properties.read_settings(context.scene.icymoon)),
            "--out",
            str(self._page.parent),
            "--json-lines",
        )
        return MeasuringJob.start("Evaluate", command)

    def report_success(self, context: bpy.types.Context) -> None:
        trusted_reports.remember_report(self._page)
        for sentence in results.describe_results(self._job.result["rows"]):
            self.report({"INFO"}, show_controls(sentence))
        if not bpy.app.background:
            bpy.ops.wm.url_open(url=self._page.as_uri())

    _page: Path


class ICYMOON_OT_toggle_matcher(bpy.types.Operator):
    """Evaluate with this matcher, or without it"""

    bl_idname = "icymoon.toggle_matcher"
    bl_label = "Toggle Matcher"
    bl_options = {"REGISTER", "UNDO"}

    matcher: bpy.props.StringProperty(
        name="Matcher", default="bm", description="Name of the matcher, such as sgbm or own:mine"
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Return the tooltip, with the requirements of the matcher, if any."""
        needs = get_matcher_needs(properties.matcher)
        return f"{cls.__doc__}. It needs {needs}" if needs else str(cls.__doc__)

    def execute(self, context: bpy.types.Context) -> set[str]:
        group = context.scene.icymoon.dataset
        known = (*list_matcher_titles(), *list_plugin_matchers())
        if not self.matcher.startswith(f"{OWN_PREFIX}:") and self.matcher not in known:
            self.report(
                {"ERROR"},
                show_controls(f"There is no matcher {self.matcher}; choose {', '.join(known)} or {OWN_PREFIX}:NAME."),
            )
            return {"CANCELLED"}
        group.methods = toggle_method(group.methods, self.matcher)
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_evaluate, ICYMOON_OT_evaluate_folder, ICYMOON_OT_toggle_matcher)
