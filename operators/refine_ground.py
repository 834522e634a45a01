"""Show a newly chosen scene at once with coarse ground, and make its ground at full resolution meanwhile.

Another Blender builds the scene, and a timer takes it over from its file, in pieces that do not hold the window. If a
setting of the ground changes, this stops at once. The fine ground adds no undo step: one undo reverts the choice of the
scene, and redo stays possible. If undo or redo shows the coarse ground again, the fine ground is made again.
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
from ..nodes.datablocks.fingerprint import list_meshes_of
from ..nodes.scene_objects import MadeObjects
from ..nodes.stored_build import read_build_in_steps
from ..render.workers.job_commands import Job as JobFiles
from ..render.workers.job_commands import blender_command
from ..settings import rebuilt_parts
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.steps import Steps
from . import jobs, keep_marks, view_resolution
from .build import find_views_through, look_through
from .full_undo import require_full_undo
from .session import SIDES, session
from .settled_steps import settle
from .window_areas import find_scene, pause_rendered_views, redraw_panels
from .window_events import call_later, make_registration
from .work_in_pieces import PIECES_INTERVAL_S, WorkInPieces

#: Text in the sidebar while the fine ground is computed.
NOTE = "Coarse ground; the fine one follows"
#: Prefixes of the names of operators that hold the data they change, or that a wait would disturb.
_BUSY_OPERATORS = ("TRANSFORM_OT_", "VIEW3D_OT_", "SCULPT_OT_", "PAINT_OT_", "MESH_OT_")


def start_refining() -> None:
    """Schedule the build of the fine ground of every scene that shows a preview."""
    call_later(_refine_next, jobs.INTERVAL_S)


def describe_refining(scene: bpy.types.Scene) -> str:
    """Return the text for the sidebar while the ground of the scene is made at full resolution; empty otherwise."""
    if not bpy.app.timers.is_registered(_refine_next):
        return ""
    if not preview.find_preview_of(scene, scene_properties.read_for_display(scene.icymoon)):
        return ""
    return f"{NOTE}{session.meshing.so_far}" if session.meshing is not None else NOTE


def _find_next() -> tuple[scenes.Built, Settings] | None:
    """Find a built scene that awaits its fine ground. Returns the scene and its settings, or None."""
    for scene in bpy.data.scenes:
        with suppress(IcyMoonError):  # settings that no panel can make
            settings = scene_properties.read_settings(scene.icymoon)
            if built := preview.find_preview_of(scene, settings):
                return built, settings
    return None


def _is_busy() -> bool:
    """Return whether Blender renders, or the user drags something."""
    return bpy.app.is_job_running("RENDER") or any(
        operator.bl_idname.startswith(_BUSY_OPERATORS)
        for window in bpy.context.window_manager.windows
        for operator in window.modal_operators
    )


def start_building(settings: Settings) -> jobs.Job:
    """Let another Blender build the scene of complete settings. The job's ``result`` names the file.

    Raises IcyMoonError if that Blender cannot be started.
    """
    files = JobFiles(Path(tempfile.gettempdir()), make_paths_absolute(settings))  # it renders no pair
    command = blender_command(jobs.find_this_blender(), "build", str(files.file), str(files.blend))
    return jobs.Job.start("Fine Ground", command, clean_up=files.discard, clean=False)


def _end_building() -> None:
    """End the building process and the takeover of its scene, if they run, and remove their files."""
    _stop_placing()
    if session.meshing is not None:
        session.meshing.close()
    session.meshing = None


def _refine_next() -> float | None:
    """Build the fine ground of a scene that awaits it, then show it. The timer stops when no scene waits."""
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
            return _take_over(built, of, job)
        else:
            session.show_seconds(job.past_s)
    except IcyMoonError as error:
        _give_up(built, error)
    return jobs.INTERVAL_S


def _take_over(built: scenes.Built, of: Settings, job: jobs.Job) -> float:
    """Run the next piece of the work that shows the scene as built ``of`` settings. Returns the seconds until the next
    piece."""
    if session.placing is None:
        session.placing = WorkInPieces(_show_refined(built.scene.session_uid, of, job), "the fine ground")
    messages = session.placing.poll()
    if session.placing.running:
        return PIECES_INTERVAL_S
    _end_building()
    for message in messages:
        if message["type"] == "error":
            _give_up(built, IcyMoonError(message["message"]))
    view_resolution.begin_coarse(built.scene)
    session.picture.count(built.scene)
    redraw_panels()
    return jobs.INTERVAL_S


def _give_up(built: scenes.Built, error: IcyMoonError) -> None:
    """Leave a scene with its coarse ground, and note the reason."""
    del built.collection[scenes.REFINED]
    preview.set_notes(built, [str(error)])


def _show_refined(scene_uid: int, of: Settings, job: jobs.Job) -> Steps[None]:
    """Show, in steps, a scene at full resolution as it was built ``of`` earlier settings, then apply later changes and
    record its warnings. ``_refine_next`` stops the steps if the scene was deleted.

    Raises IcyMoonError if the scene cannot be shown or was edited by hand.
    """
    if job.failure:
        raise IcyMoonError(job.failure)
    made = yield from read_build_in_steps(Path(job.result["scene"]))
    made.keep_unused_sky(True)  # the live preview removes worlds without users
    try:
        yield None
        marks = yield from _read_marks(made)
        built = yield from settle(partial(_find_unedited, scene_uid))
    except BaseException:
        made.remove()
        raise
    made.keep_unused_sky(False)
    _put_refined(built, of, made)
    bpy.context.view_layer.update()  # Blender announces the new meshes
    keep_marks.keep_marks(marks)


def _read_marks(made: MadeObjects) -> Steps[keep_marks.Marks]:
    """Read the marks of the made meshes in steps, because a slider may need them as soon as the ground is shown. Empty
    if a mesh was removed meanwhile, for example by *Purge Unused Data*."""
    with suppress(ReferenceError):
        return (yield from keep_marks.read_marks_in_steps(list_meshes_of(made.objects)))
    return {}


def _find_unedited(scene_uid: int) -> Steps[scenes.Built]:
    """Find the built scene in steps. Raises IcyMoonError if it was edited by hand."""
    scene = find_scene(scene_uid)
    built = scenes.find_built(scene) if scene is not None else None
    if built is None or built.terrain.mode != "OBJECT" or (yield from built.find_edited_parts()):
        raise IcyMoonError("The scene was edited while its ground was coarse; press Build Scene to build it again.")
    return built


def _put_refined(built: scenes.Built, of: Settings, made: MadeObjects) -> None:
    views = find_views_through(bpy.context, built.camera)
    require_full_undo()
    with pause_rendered_views():
        fine = scenes.put_in_scene(built.scene, of, made)
    look_through(views, fine)
    session.preview_side = SIDES[0]
    settings = scene_properties.read_settings(fine.scene.icymoon)
    if fine.scene.icymoon.live and scenes.list_changed_settings(fine, settings):
        preview.show_settings(fine, settings, session.preview_side)
    preview.set_notes(fine, list(fine.warnings))  # no operator runs that could report them


def _note_change() -> None:
    """Count the changes of the file."""
    session.changes += 1


def _stop_placing() -> None:
    """Stop taking over the fine scene, and remove its objects, before undo reads the file anew."""
    if session.placing is not None:
        session.placing.stop()
        session.placing = None


def _resume_refining() -> None:
    """Start refining again, because undo, redo or opening a file may show a coarse ground."""
    _note_change()
    if not bpy.app.background:
        start_refining()


register, unregister = make_registration(
    timers=(_refine_next,),
    depsgraph_update_post=_note_change,
    undo_pre=_stop_placing,
    redo_pre=_stop_placing,
    undo_post=_resume_refining,
    redo_post=_resume_refining,
    load_post=_resume_refining,
)
