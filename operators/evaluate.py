"""Evaluate: the matchers run in the evaluator's own Python."""

from __future__ import annotations

from pathlib import Path

import bpy

from .. import settings as description
from ..errors import IcyMoonError
from ..preferences import evaluator_python, own_matchers
from ..properties import all_settings
from ..render.launch import python_command
from ..render.pair import is_complete
from ..render.queue import Message, Process, clean_environment
from . import jobs, results
from .render import dataset_folder, planned_pairs


def rendered_pairs(context: bpy.types.Context, settings: description.Settings) -> list[Path]:
    """The pairs of the present settings that are there. Raises IcyMoonError if none is."""
    dataset = dataset_folder(settings)
    paths = [path for path in (p.folder(dataset) for p in planned_pairs(context.scene, settings)) if is_complete(path)]
    if not paths:
        raise IcyMoonError(f"The present settings have no rendered pair in {dataset}; press Render Stereo Pair first.")
    return paths


def response_arguments(settings: description.Settings) -> list[str]:
    """The settings that need no new render as arguments of the evaluator."""
    texts = [f"{topic}.{s.key}={settings[topic][s.key]}".replace("True", "true").replace("False", "false")
             for topic, s in all_settings() if s.effect == "response"]
    return [word for text in texts for word in ("--set", text)]


def matcher_arguments(settings: description.Settings, flag: str = "--methods") -> list[str]:
    """The matchers that the settings name, as arguments of the evaluator: ``flag`` with their list, and what those of
    the person's own are. Raises IcyMoonError if one of these is not set up."""
    methods = str(settings["dataset"]["methods"])
    return [flag, methods, *own_matchers(methods)]


def hear(message: Message) -> None:
    """Take up the report that an evaluation has written."""
    if message["type"] == "result":
        results.load(Path(message["report"]).parent)


def told(operator: bpy.types.Operator, context: bpy.types.Context) -> None:
    """Tell the person what the evaluation has measured."""
    for row in results.summary():
        operator.report({"INFO"}, f"{row['method']}: L1 {results.number(row['l1_m'], 3)} m, "
                                  f"coverage {results.percent(row['coverage'])}")
    results.show_error_image(context, open_window=False)


class ICYMOON_OT_evaluate(jobs.JobOperator, bpy.types.Operator):
    """Match the rendered pairs with every chosen stereo matcher, measure the error against the truth and write a report"""  # noqa: E501

    bl_idname = "icymoon.evaluate"
    bl_label = "Evaluate"

    scope: bpy.props.EnumProperty(name="Scope", default="SCENE", items=(  # type: ignore[valid-type]
        ("SCENE", "This Scene", "The pairs that the present settings make"),
        ("DATASET", "Whole Data Set", "Every pair in the data set folder")), description="Which pairs to evaluate")

    def _command(self, context: bpy.types.Context) -> list[str]:
        settings = description.from_group(context.scene.icymoon)
        dataset = dataset_folder(settings)
        paths = [dataset] if self.scope == "DATASET" else rendered_pairs(context, settings)
        return python_command(evaluator_python(), "stereo", "evaluate", *map(str, paths),
                              *matcher_arguments(settings), *response_arguments(settings),
                              *(["--points"] if self.scope == "SCENE" else []),
                              "--out", str(self._out(dataset)), "--json-lines")

    def _out(self, dataset: Path) -> Path:
        return dataset / ("evaluation" if self.scope == "DATASET" else "evaluation_scene")

    def start(self, context: bpy.types.Context) -> jobs.Job:
        command = self._command(context)
        return jobs.Job("Evaluate", Process(command, clean_environment()), hear, lambda: None)

    def succeeded(self, context: bpy.types.Context) -> None:
        told(self, context)


CLASSES = (ICYMOON_OT_evaluate,)
