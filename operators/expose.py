"""Show Camera Image: develop the rendered pair by the present camera response."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy

from ..render.workers.job import python_command
from ..render.workers.process import Message, Process, clean_environment
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.number_text import count_of
from ..support.printer import show_controls
from . import jobs, results
from .evaluate import rendered_pairs, response_arguments
from .preferences import find_evaluator_python
from .render import dataset_folder


def start_developing(settings: Settings, pairs: list[Path], handle: Callable[[Message], None]) -> jobs.Job:
    """Start a process that develops pairs by the camera response of ``settings``, into the folder ``exposed``."""
    command = python_command(
        find_evaluator_python(),
        "stereo",
        "develop",
        *map(str, pairs),
        *response_arguments(settings),
        "--out",
        str(dataset_folder(settings) / "exposed"),
        "--json-lines",
    )
    return jobs.Job("Expose", Process(command, clean_environment()), handle, lambda: None)


class ICYMOON_OT_expose(jobs.JobOperator, bpy.types.Operator):
    """Develop the rendered pair by the present camera response and show the camera images. Needs no new render"""

    bl_idname = "icymoon.expose"
    bl_label = "Show Camera Image"

    def start(self, context: bpy.types.Context) -> jobs.Job:
        settings = scene_properties.read_settings(context.scene.icymoon)
        self._images: list[Path] = []
        return start_developing(settings, rendered_pairs(context, settings), self._handle)

    def _handle(self, message: Message) -> None:
        if message["type"] == "result":
            self._images = [Path(folder) / f"{eye}.png" for folder in message["folders"] for eye in ("left", "right")]

    def report_success(self, context: bpy.types.Context) -> None:
        images = count_of(len(self._images), "image")
        self.report({"INFO"}, show_controls(f"{images} in {self._images[0].parent.parent}"))
        results.show_images(context, self._images, open_window=True)


CLASSES = (ICYMOON_OT_expose,)
