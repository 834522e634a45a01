"""The ground of a scene that was just chosen: coarse at once, then at full resolution while the user looks.

A thread computes the ground, and a timer builds the scene from it. This adds no undo step: undo takes the chosen scene
back as a whole. Where undo and redo show the coarse ground again, the fine ground follows again.
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial

import bpy

from ..nodes import build_scene as scenes
from ..nodes import preview
from ..nodes.ground.dug_ground import mesh_whole_ground
from ..render.workers.watched_thread import Calculation
from ..settings import rebuilt_parts
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from . import jobs, view_resolution
from .build import find_views_through, look_through
from .session import session
from .window_areas import redraw_panels
from .window_events import call_later, make_registration

#: Text in the sidebar while the fine ground is computed.
NOTE = "Coarse ground; the fine one follows"
#: First letters of the names of operators that hold the data they change, or that a wait would interrupt.
_BUSY_OPERATORS = ("TRANSFORM_OT_", "VIEW3D_OT_", "SCULPT_OT_", "PAINT_OT_", "MESH_OT_")


def begin_refining() -> None:
    """Let the fine ground follow wherever a scene awaits it."""
    call_later(_refine_next, jobs.INTERVAL_S)


def describe_refining(scene: bpy.types.Scene) -> str:
    """Text for the sidebar while the ground of the scene is made at full resolution; empty otherwise."""
    if not bpy.app.timers.is_registered(_refine_next):
        return ""
    return NOTE if preview.awaits_ground(scene, scene_properties.read_for_display(scene.icymoon)) else ""


def _find_next() -> tuple[scenes.Built, Settings] | None:
    """A built scene that awaits its ground, and its settings."""
    for scene in bpy.data.scenes:
        with suppress(IcyMoonError):  # settings that no panel can make
            settings = scene_properties.read_settings(scene.icymoon)
            if scene.icymoon.live and (built := preview.awaits_ground(scene, settings)):
                return built, settings
    return None


def _is_busy() -> bool:
    """Whether Blender renders, or the user drags something."""
    return bpy.app.is_job_running("RENDER") or any(
        operator.bl_idname.startswith(_BUSY_OPERATORS)
        for window in bpy.context.window_manager.windows
        for operator in window.modal_operators
    )


def _refine_next() -> float | None:
    """Compute the ground of a scene that awaits it, then build the scene. The timer stops when no scene waits."""
    found = _find_next()
    if found is None:
        session.meshing = None
        return None
    built, settings = found
    job = session.meshing
    if job is None or rebuilt_parts.select_scene(session.meshed_settings or settings) != rebuilt_parts.select_scene(
        settings
    ):
        work = Calculation(partial(mesh_whole_ground, scenes.make_ground, settings), "the ground")
        session.meshing, session.meshed_settings = jobs.Job("Fine Ground", work), settings
    elif not job.poll() and not _is_busy():
        session.meshing = None
        _show_refined(built, settings, job)
        redraw_panels()
    return jobs.INTERVAL_S


def _show_refined(built: scenes.Built, settings: Settings, job: jobs.Job) -> None:
    """Build a scene at full resolution from its ground and record its warnings, or the reason why it is not built.

    A scene that was edited by hand is not built.
    """
    views = find_views_through(bpy.context, built.camera)
    try:
        if job.failure:
            raise IcyMoonError(job.failure)
        if built.terrain.mode != "OBJECT" or built.edited_parts():
            raise IcyMoonError("The scene was edited while its ground was coarse; press Build Scene to build it again.")
        fine = scenes.build_scene(built.scene, settings, job.result["value"])
        look_through(views, fine)
        preview.set_notes(fine, list(fine.warnings))  # no operator runs that could report them
    except IcyMoonError as error:
        del built.collection[scenes.REFINED]
        preview.set_notes(built, [str(error)])
    view_resolution.begin_coarse(built.scene)
    session.picture.count(built.scene)


def _resume_refining() -> None:
    """Undo, redo and opening a file may show a coarse ground again."""
    if not bpy.app.background:
        begin_refining()


register, unregister = make_registration(
    timers=(_refine_next,), undo_post=_resume_refining, redo_post=_resume_refining, load_post=_resume_refining
)
