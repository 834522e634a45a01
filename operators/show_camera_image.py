"""Show Camera Image: develop the rendered pair by the present camera response."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..render.workers.job_commands import python_command
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.number_text import format_count
from ..support.printer import show_controls
from . import jobs, results
from .camera_image_notes import name_camera_image, note_camera_image
from .evaluate import find_rendered_pairs, make_response_arguments
from .job_operators import JobOperator
from .preferences import find_evaluator_python
from .render import find_dataset_folder


def start_developing(settings: Settings, pairs: list[Path]) -> jobs.Job:
    """Start a process that develops pairs by the camera response of ``settings``, into the folder ``exposed``."""
    command = python_command(
        find_evaluator_python(),
        "stereo",
        "develop",
        *map(str, pairs),
        *make_response_arguments(settings),
        "--out",
        str(find_dataset_folder(settings) / "exposed"),
        "--json-lines",
    )
    return jobs.Job.start("Expose", command)


class ICYMOON_OT_expose(JobOperator, bpy.types.Operator):
    """Develop the rendered pair by the present camera response and show the camera images. Needs no new render"""

    bl_idname = "icymoon.expose"
    bl_label = "Show Camera Image"

    def start(self, context: bpy.types.Context) -> jobs.Job:
        settings = scene_properties.read_settings(context.scene.icymoon)
        return start_developing(settings, find_rendered_pairs(context, settings))

    def report_success(self, context: bpy.types.Context) -> None:
        folders = map(Path, self._job.result["folders"])
        names = {
            folder / f"{eye}.png": name_camera_image(folder.name, eye)
            for folder in folders
            for eye in ("left", "right")
        }
        images = list(names)
        self.report({"INFO"}, show_controls(f"{format_count(len(images), 'image')} in {images[0].parent.parent}"))
        results.show_images(images, open_window=True, names=names, note=note_camera_image)


CLASSES = (ICYMOON_OT_expose,)
