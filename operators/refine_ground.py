"""The ground of a scene that was just chosen: coarse at once, then at full resolution while the user looks.

Another Blender builds the scene, and a timer takes it over from its file. A setting of the ground that changes ends
that process at once. The fine ground adds no undo step: one undo reverts the choice of the scene, and redo stays
possible. If undo or redo shows the coarse ground again, the fine ground follows again.
"""

from __future__ import annotations

import tempfile
from contextlib import suppress
from functools import partial
from pathlib import Path

import bpy

from ..nodes import build_scene as scenes
from ..nodes import preview
from ..nodes.datablocks.blend_file_paths import make_paths_absolute
from ..nodes.stored_build import read_build
from ..render.workers.job_commands import Job as JobFiles
from ..render.workers.job_commands import blender_command
from ..settings import rebuilt_parts
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from . import jobs, view_resolution
from .build import find_views_through, look_through
from .full_undo import require_full_undo
from .session import session
from .window_areas import pause_rendered_views, redraw_panels
from .window_events import call_later, make_registration

#: Text in the sidebar while the fine ground is computed.
NOTE = "Coarse ground; the fine one follows"
#: Prefixes of the names of operators that hold the data they change, or that a wait would interrupt.
_BUSY_OPERATORS = ("TRANSFORM_OT_", "VIEW3D_OT_", "SCULPT_OT_", "PAINT_OT_", "MESH_OT_")


def start_refining() -> None:
    """Start to build the fine ground of every scene that shows a preview."""
    call_later(_refine_next, jobs.INTERVAL_S)


def describe_refining(scene: bpy.types.Scene) -> str:
    """Text for the sidebar while the ground of the scene is made at full resolution; empty otherwise."""
    if not bpy.app.timers.is_registered(_refine_next):
        return ""
    return NOTE if preview.find_preview_of(scene, scene_properties.read_for_display(scene.icymoon)) else ""


def _find_next() -> tuple[scenes.Built, Settings] | None:
    """A built scene that awaits its ground, and its settings."""
    for scene in bpy.data.scenes:
        with suppress(IcyMoonError):  # settings that no panel can make
            settings = scene_properties.read_settings(scene.icymoon)
            if built := preview.find_preview_of(scene, settings):
                return built, settings
    return None


def _is_busy() -> bool:
    """Whether Blender renders, or the user drags something."""
    return bpy.app.is_job_running("RENDER") or any(
        operator.bl_idname.startswith(_BUSY_OPERATORS)
        for window in bpy.context.window_manager.windows
        for operator in window.modal_operators
    )


def start_building(settings: Settings) -> jobs.Job:
    """Let another Blender build the scene of complete settings; ``result`` names the file.

    Raises IcyMoonError if that Blender cannot be started.
    """
    files = JobFiles(Path(tempfile.gettempdir()), make_paths_absolute(settings))  # it renders no pair into a folder
    command = blender_command(jobs.find_this_blender(), "build", str(files.file), str(files.blend))
    return jobs.Job.start("Fine Ground", command, clean_up=files.discard, clean=False)


def _end_building() -> None:
    """End the process that builds, if there is one, and remove its files."""
    if session.meshing is not None:
        session.meshing.close()
    session.meshing = None


def _refine_next() -> float | None:
    """Let a scene that awaits its ground be built, then show it. The timer stops when no scene waits."""
    found = _find_next()
    if found is None:
        _end_building()
        return None
    built, settings = found
    job, of = session.meshing, session.meshed_settings or settings
    try:
        if job is None or rebuilt_parts.select_scene(of) != rebuilt_parts.select_scene(settings):
            _end_building()
            session.meshing, session.meshed_settings = start_building(settings), settings
        elif not job.poll() and not _is_busy():
            _show_refined(built, of, settings, job)
            _end_building()
            redraw_panels()
    except IcyMoonError as error:
        _give_up(built, error)
    return jobs.INTERVAL_S


def _give_up(built: scenes.Built, error: IcyMoonError) -> None:
    """Leave a scene with its coarse ground, and note the reason."""
    del built.collection[scenes.REFINED]
    preview.set_notes(built, [str(error)])


def _show_refined(built: scenes.Built, of: Settings, settings: Settings, job: jobs.Job) -> None:
    """Show a scene at full resolution as it was built ``of`` earlier settings, with what has changed since, and record
    its warnings, or the reason why it is not shown.

    A scene that was edited by hand is not built.
    """
    views = find_views_through(bpy.context, built.camera)
    try:
        if job.failure:
            raise IcyMoonError(job.failure)
        if built.terrain.mode != "OBJECT" or built.edited_parts():
            raise IcyMoonError("The scene was edited while its ground was coarse; press Build Scene to build it again.")
        require_full_undo()
        with pause_rendered_views():
            fine = scenes.build_scene(built.scene, of, take_over=partial(read_build, Path(job.result["scene"])))
        look_through(views, fine)
        if fine.scene.icymoon.live and scenes.list_changed_settings(fine, settings):
            preview.show_settings(fine, settings, session.preview_side)
        preview.set_notes(fine, list(fine.warnings))  # no operator runs that could report them
    except IcyMoonError as error:
        _give_up(built, error)
    view_resolution.begin_coarse(built.scene)
    session.picture.count(built.scene)


def _resume_refining() -> None:
    """Undo, redo and opening a file may show a coarse ground again."""
    if not bpy.app.background:
        start_refining()


register, unregister = make_registration(
    timers=(_refine_next,), undo_post=_resume_refining, redo_post=_resume_refining, load_post=_resume_refining
)
