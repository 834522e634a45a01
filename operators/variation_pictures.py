"""Make small, rough pictures of the first and the last pair of Vary This Scene, before the pairs are rendered."""

from __future__ import annotations

import json
import math
from pathlib import Path

import bpy
import numpy as np

from ..nodes import preview
from ..nodes.datablocks.blend_file_paths import make_paths_absolute
from ..render.plans.planned_pair import expand_headings
from ..render.plans.vary_scene import make_end_settings
from ..render.workers.job_commands import Job as JobFiles
from ..render.workers.job_commands import blender_command
from ..render.workers.process import Message
from ..settings import rebuilt_parts
from ..settings.blender import scene_properties
from ..settings.description import merged
from ..settings.topics.scene import Settings
from ..stereo.pair_views import read_pair_views
from ..support.arrays import Array
from ..support.blender import compat
from ..support.system import remove_folder
from ..support.temporary_folders import make_scratch_folder
from . import jobs
from .job_operators import JobOperator
from .window_areas import ButtonPictures, redraw_panels
from .window_events import keep_until_change

#: Maximum number of columns or rows of a picture, and light paths per pixel, each with and without a denoiser. The
#: sidebar shows a picture only 100 px wide, so few columns are enough and leave time for more paths per pixel.
SIDE_PX, SAMPLES = (128, 96), (8, 48)
#: Minimum of ``quality.walk_px``: paths inside the snow that are shorter than a pixel cost four times the rest.
_WALK_PX = 1.0
#: Maximum number of scenes whose pictures of both ends are kept.
_MAX_SCENES = 32
#: Maximum number of vertices of the ground of a picture.
_MAX_VERTICES = 20000
_pictures = ButtonPictures()  # under the names in ``_made``
_made: dict[str, tuple[str, str]] = {}  # names of the pictures of the first and last pair, by the shown settings


def make_rough_settings(settings: Settings) -> Settings:
    """Make settings for a fast picture of a pair: few pixels and light paths, a coarse ground and its largest rocks."""
    rig, mesh, denoises = settings.rig, settings.mesh, compat.has_oidn()
    size = 0 if denoises else 1
    share = min(1.0, SIDE_PX[size] / max(rig.width_px, rig.height_px))
    smaller = {
        "width_px": max(2, round(share * rig.width_px)),
        "height_px": max(2, round(share * rig.height_px)),
        "principal_x_px": share * rig.principal_x_px,
        "principal_y_px": share * rig.principal_y_px,
    }
    return merged(
        settings,
        {
            "rig": smaller,
            "dataset": {"headings": 1},
            "hapke": {"backend": "NODES", "accuracy": "FAST"},
            "terrain": {"resolution": min(settings.terrain.resolution, math.isqrt(_MAX_VERTICES))},
            "mesh": {"most": min(mesh.most, _MAX_VERTICES)},
            "rocks": {"most": min(settings.rocks.most, preview.MAX_ROCKS), "beyond_px": 0.0},
            "quality": {
                "samples": SAMPLES[size],
                "denoiser": "OIDN" if denoises else "NONE",
                "walk_px": max(_WALK_PX, settings.quality.walk_px),
                "noise_threshold": 0.0,
                "diffuse_bounces": 2,
                "truth": "DEPTH",
                "device": "CPU",
            },
        },
    )


def find_icons(scene: bpy.types.Scene) -> tuple[int, ...]:
    """Return the icons of the first and the last pair as they would be rendered now; empty if they have not been
    made."""
    if not _made:
        return ()
    settings = scene_properties.read_for_display(scene.icymoon)
    key = keep_until_change(("ends", scene.session_uid), lambda: _make_picture_key(scene, settings))
    return tuple(int(_pictures.collection[name].icon_id) for name in _made.get(key, ()))


def _make_picture_key(scene: bpy.types.Scene, settings: Settings) -> str:
    shown = {topic: values for topic, values in settings.items() if topic not in ("quality", "dataset")}
    wanted = settings.dataset
    return json.dumps([shown, wanted.seed, wanted.headings, repr(scene_properties.read_variations(scene.icymoon))])


def draw_icons(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> bool:
    """Draw the pictures of the first and the last pair. Returns whether pictures exist."""
    found = find_icons(scene)
    if not found:
        return False
    row = layout.row(align=True)
    for icon, title in zip(found, ("First", "Last"), strict=True):
        column = row.column(align=True)
        column.template_icon(icon_value=icon, scale=5.0)
        column.label(text=title)
    return True


class ICYMOON_OT_show_ends(JobOperator, bpy.types.Operator):
    """Make small, rough pictures of the first and the last pair. Takes some seconds, in a separate process; Esc twice stops it"""  # noqa: E501

    bl_idname = "icymoon.show_ends"
    bl_label = "Show First and Last"

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        variations = scene_properties.read_variations(context.scene.icymoon)
        if not variations.varied and variations.seeds == 1:
            return "No setting varies yet; press + above, or raise Variations by Seed"
        return super().find_obstacle(context)

    def start(self, context: bpy.types.Context) -> jobs.Job:
        scene = context.scene
        settings = scene_properties.read_settings(scene.icymoon)
        ends = make_end_settings(make_paths_absolute(settings), scene_properties.read_variations(scene.icymoon))
        pairs = [expand_headings(make_rough_settings(end))[0] for end in ends]
        self._key, self._response = _make_picture_key(scene, settings), rebuilt_parts.select_response(settings)
        self._ids, self._found = [pair.id for pair in pairs], dict[str, Array]()
        folder = make_scratch_folder()
        files = JobFiles(folder, pairs=list({pair.id: pair for pair in pairs}.values()))

        def clean_up() -> None:
            files.remove()
            remove_folder(folder)

        command = blender_command(jobs.find_this_blender(), "worker", str(files.file))
        kept = "there are no new pictures"
        device = settings.quality.device
        return _PictureJob.start(
            self.bl_label, command, self._hear, clean_up, device=device, clean=False, if_stopped=kept
        )

    def _hear(self, message: Message) -> None:
        if message["type"] == "pair":
            views = read_pair_views(Path(message["folder"]), self._response, max(SIDE_PX))
            self._found[str(message["id"])] = views.pictures("LEFT")[0]

    def report_success(self, context: bpy.types.Context) -> None:
        _keep_pictures(self._key, [self._found[name] for name in self._ids])
        redraw_panels()


class _PictureJob(jobs.Job):
    """A job that gives no warnings, because they would be about the coarse ground."""

    def hear(self, message: Message) -> None:
        if message["type"] != "warning":
            super().hear(message)


def _keep_pictures(key: str, pictures: list[Array]) -> None:
    """Keep the pictures, uint8 RGB, under a key."""
    if len(_made) >= _MAX_SCENES:
        _pictures.collection.clear()
        _made.clear()
    first, last = (f"{len(_made)} {end}" for end in ("first", "last"))
    for name, picture in zip((first, last), pictures, strict=True):
        shown = _pictures.collection.new(name)
        shown.image_size = picture.shape[1::-1]
        rgba = np.ones((*picture.shape[:2], 4), np.float32)
        rgba[..., :3] = picture[::-1] / np.float32(255)
        shown.image_pixels_float.foreach_set(rgba.ravel())
    _made[key] = first, last


CLASSES = (ICYMOON_OT_show_ends,)


def unregister() -> None:
    """Remove the pictures."""
    _made.clear()
    _pictures.remove()
