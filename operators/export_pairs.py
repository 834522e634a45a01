"""Export Pair or Data Set: write pairs in the layouts of other programs, by the exports of the command line."""

from __future__ import annotations

import time
from functools import lru_cache
from pathlib import Path

import bpy

from ..render.pairs.dataset_file_names import pairs_folder
from ..render.pairs.pair_folder import has_pairs
from ..render.workers.job_commands import blender_command, python_command
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings, typed
from ..stereo.export import OPTIONS, exports_with_blender, list_headings, list_options, list_titles
from ..support.errors import IcyMoonError
from ..support.files import absolute_path
from ..support.printer import show_controls
from . import dialogs, jobs, last_variations
from .evaluate import make_response_arguments
from .job_operators import JobOperator
from .kept_pairs import find_kept_pairs
from .preferences import find_evaluator_python
from .render import find_dataset_folder
from .session import Exported, session
from .sidebar_text import format_for_window

#: The choice in the list of formats that stands for --for-prediction of the command line.
_FOR_PREDICTION = "for-prediction"
HEADINGS = {**list_headings(), _FOR_PREDICTION: "Matching Elsewhere"}


def _list_formats() -> list[tuple[str, str, str]]:
    """Make the entries of the list of formats, with a heading above each group."""
    entries = [(name, title, content[:1].upper() + content[1:]) for name, (title, content) in list_titles().items()]
    entries.append((_FOR_PREDICTION, "For Prediction", "Only images and camera of each pair, for a matcher elsewhere"))
    found = []
    for entry in entries:
        if heading := HEADINGS.get(entry[0]):
            found.append(("", heading, ""))
        found.append(entry)
    return found


def find_format_title(kind: str) -> str:
    """Return the title that a format has in the list of formats."""
    return next((title for name, title, _ in _list_formats() if name == kind), kind)


_SOURCES = (
    (
        "SCENE",
        "Pairs of This Scene",
        "The pairs that were rendered last from this scene, with the present camera response",
    ),
    ("DATASET", "Whole Data Set", "Every pair in the data set folder"),
    (last_variations.SCOPE, "These Variations", "Every pair of the variations that were rendered last"),
)
#: Seconds after which a data set folder is read again, although neither it nor its folder of pairs has changed.
_REREAD_S = 5.0
#: Numbers for some formats only, as properties of the dialog. 0 stands for the default of the command line.
_OptionFields = type(
    "_OptionFields",
    (),
    {
        "__annotations__": {
            option.key: bpy.props.FloatProperty(
                name=option.label,
                description=option.tooltip,
                min=0.0,
                precision=4,
                subtype="DISTANCE" if option.key.endswith("_m") else "NONE",
            )
            for option in OPTIONS
        }
    },
)


def is_developed(kind: str) -> bool:
    """Return whether a format has images, for which the camera response counts."""
    return kind not in exports_with_blender()


def find_sources(scene: bpy.types.Scene) -> dict[str, list[Path]]:
    """Find the folders of a scene that can be exported: its last pairs, and its data set and its variations if they
    have pairs."""
    try:
        dataset = find_dataset_folder(typed({"dataset": {"folder": scene.icymoon.dataset.folder}}))
    except IcyMoonError:
        return {}
    varied = last_variations.find_folder(scene)
    found = {
        "SCENE": find_kept_pairs(scene),
        "DATASET": [dataset] if _has_pairs_now(dataset) else [],
        last_variations.SCOPE: [varied] if varied is not None and _has_pairs_now(varied) else [],
    }
    return {source: paths for source, paths in found.items() if paths}


def _has_pairs_now(dataset: Path) -> bool:
    """Return ``has_pairs`` for the window, which asks at every redraw. The folder is read again only after it has
    changed or some seconds have passed."""
    changed_ns = []
    for folder in (dataset, pairs_folder(dataset)):
        try:
            changed_ns.append(folder.stat().st_mtime_ns)
        except OSError:
            changed_ns.append(0)
    return _read_has_pairs(dataset, tuple(changed_ns), int(time.monotonic() / _REREAD_S))


@lru_cache(maxsize=8)
def _read_has_pairs(dataset: Path, changed_ns: tuple[int, ...], period: int) -> bool:
    return has_pairs(dataset)


def find_export(scene: bpy.types.Scene, source: str) -> Exported | None:
    """Return the last export if its pairs are still the pairs of ``source``, else None.

    The reason of a failed export is dropped once a setting changes, since that may be the remedy.
    """
    done = session.exported.get((scene.session_uid, source))
    if done is None or find_sources(scene).get(source) != [*done.paths]:
        return None
    is_past = not done.folder and done.settings != scene_properties.read_for_display(scene.icymoon)
    return None if is_past else done


class ICYMOON_OT_export_pairs(JobOperator, _OptionFields, bpy.types.Operator):  # type: ignore[misc]
    """Write the last pairs or the whole data set as other programs read them: KITTI, Middlebury, COLMAP, ROS 2, meshes and others"""  # noqa: E501

    bl_idname = "icymoon.export_pairs"
    bl_label = "Export Pair or Data Set"

    filepath: dialogs.file_property("Folder for the exported files")
    source: bpy.props.EnumProperty(name="Export", description="Pairs to export", items=_SOURCES)
    kind: bpy.props.EnumProperty(name="Format", description="Layout to write", items=_list_formats(), default="png16")
    response: bpy.props.BoolProperty(
        name="Present Camera Response",
        description="Develop all images with the sensor of the present settings in place of each pair's own",
    )

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        if not find_sources(context.scene):
            return "There is no rendered pair; press Render Stereo Pair first"
        return super().find_obstacle(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Let the user choose the folder, the format and its options."""
        sources = find_sources(context.scene)
        if not self.properties.is_property_set("source") or self.source not in sources:
            self.source = next(iter(sources))
        if not self.filepath:
            dataset = find_dataset_folder(scene_properties.read_settings(context.scene.icymoon))
            self.filepath = str(dataset.parent / f"{dataset.name}_export")
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the choices beside the folders."""
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(self, "kind")
        for option in list_options(self.kind):
            layout.prop(self, option.key)
        layout.prop(self, "source")
        if is_developed(self.kind) and self.source != "SCENE":
            layout.prop(self, "response")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the job, once the folder is chosen."""
        return super().execute(context) if bpy.app.background else super().invoke(context, None)

    def start(self, context: bpy.types.Context) -> jobs.Job:
        settings = scene_properties.read_settings(context.scene.icymoon)
        paths = find_sources(context.scene).get(self.source)
        if not paths:
            raise IcyMoonError("There is no rendered pair; press Render Stereo Pair first.")
        self._out = absolute_path(self.filepath, "the folder", bpy.path.abspath("//"))
        self._paths, self._settings = tuple(paths), scene_properties.read_for_display(context.scene.icymoon)
        present = is_developed(self.kind) and (self.source == "SCENE" or self.response)
        command = self._make_command(
            "export",
            *map(str, paths),
            *(["--for-prediction"] if self.kind == _FOR_PREDICTION else ["--format", self.kind]),
            *(
                word
                for o in list_options(self.kind)
                if (value := getattr(self, o.key))
                for word in (o.flag, repr(value))
            ),
            *(make_response_arguments(settings) if present else []),
            "--blender",
            jobs.find_this_blender(),
            "--out",
            str(self._out),
            "--json-lines",
        )
        self._exported_as = context.scene.session_uid, self.source
        session.exported.pop(self._exported_as, None)
        return jobs.Job.start("Export", command, if_stopped="what was written is kept")

    def _make_command(self, *arguments: str) -> list[str]:
        """Make the command in the evaluator's Python. Without an evaluator, make the command in this Blender if the
        format needs only Blender."""
        try:
            return python_command(find_evaluator_python(), "stereo", *arguments)
        except IcyMoonError:
            if is_developed(self.kind):
                raise
            return blender_command(jobs.find_this_blender(), "stereo", *arguments)

    def report_end(self, context: bpy.types.Context) -> None:
        self._keep_outcome()
        super().report_end(context)

    def _keep_outcome(self) -> None:
        """Keep the folder and the sentences of the export for the sidebar."""
        job = self._job
        sentences = [format_for_window(each) for each in (*job.warnings, *filter(None, [job.failure]))]
        folder = "" if job.failure else str(self._out)
        session.exported[self._exported_as] = Exported(
            folder, tuple(sentences), self._paths, self._settings, find_format_title(self.kind)
        )

    def report_success(self, context: bpy.types.Context) -> None:
        self.report({"INFO"}, show_controls(f"Exported to {self._out}"))

    _out: Path
    _paths: tuple[Path, ...]
    _settings: Settings
    _exported_as: tuple[int, str]


CLASSES = (ICYMOON_OT_export_pairs,)
