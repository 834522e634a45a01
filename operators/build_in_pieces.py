"""Build a scene without holding the window: with coarse ground, or in full if its ground is from a file.

A thread computes the coarse ground and the places of its rocks. The other work needs Blender and is cut into pieces,
few of which run in each turn of the event loop. If the ground is from a file, another Blender builds the scene, since
Blender reads meshes in one call, and its objects are read in pieces. The pieces make objects outside all scenes, and
the last piece puts them into the scene. If the build stops earlier, the scene and the file are unchanged.
"""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

import bpy

from ..nodes import build_scene as scenes
from ..nodes import preview
from ..nodes.ground.user_ground import is_from_file
from ..nodes.scene_objects import MadeObjects
from ..nodes.stored_build import read_build_in_steps
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.steps import Steps
from . import keep_marks, live_preview, refine_ground
from .build import build_and_show, leave_edit_mode, report_sentences
from .job_operators import KeyStoppedOperator
from .jobs import INTERVAL_S, Job
from .session import session
from .window_areas import find_scene, redo, redraw_panels
from .window_events import call_later, make_registration
from .work_in_pieces import PIECES_INTERVAL_S, WorkInPieces

#: Report of a build that finds the scene up to date: kind and sentence.
UNCHANGED = "INFO", "The scene is built already, and nothing has changed since"


def build_in_pieces(scene_uid: int, settings: Settings) -> Steps[list[tuple[str, str]]]:
    """Build the scene with this ``session_uid`` in steps, and show it. Procedural ground is coarse. Returns (kind,
    sentence) pairs to report.

    Raises IcyMoonError, without changing the scene, if ``preview.build_coarse`` does, or if the scene or an object made
    for it was deleted.
    """
    scene, made = yield from make_for_scene(scene_uid, settings)
    return build_and_show(bpy.context, scene, partial(put_in_scene, scene, settings, made))


def make_for_scene(scene_uid: int, settings: Settings) -> Steps[tuple[bpy.types.Scene, MadeObjects]]:
    """Make the objects of the scene with this ``session_uid`` in steps. Returns the scene and its objects.

    Raises IcyMoonError as ``build_in_pieces`` does.
    """
    try:
        made = yield from (_build_elsewhere(settings) if is_from_file(settings) else preview.make_coarse(settings))
    except ReferenceError:
        raise IcyMoonError("Parts of the new scene were removed while it was built; press Build Scene again.") from None
    scene = find_scene(scene_uid)
    if scene is None:
        made.remove()
        raise IcyMoonError("The scene was deleted while it was built; choose another scene, and press Build Scene.")
    return scene, made


def _build_elsewhere(settings: Settings) -> Steps[MadeObjects]:
    """Let another Blender build a scene in full, and read its objects in steps. Raises IcyMoonError if the build
    fails."""
    job = refine_ground.start_building(settings)
    try:
        while job.poll():
            yield partial(time.sleep, INTERVAL_S)
        if job.failure:
            raise IcyMoonError(job.failure)
        return (yield from read_build_in_steps(Path(job.result["scene"])))
    finally:
        job.close()


def put_in_scene(scene: bpy.types.Scene, settings: Settings, made: MadeObjects) -> scenes.Built:
    """Put made objects into a scene, and schedule a preview of settings that were changed meanwhile."""
    put = scenes.put_in_scene if is_from_file(settings) else preview.put_coarse_in_scene
    built = put(scene, settings, made)
    if bpy.context.scene == scene:
        leave_edit_mode()  # the view will show the scene, and not the user's edited object
    if scene_properties.read_unchecked(scene.icymoon) != settings:
        session.to_preview.add(scene.name)
        call_later(live_preview.show_waiting)
    return built


class PiecewiseBuildOperator(KeyStoppedOperator):
    """Mix-in: an operator that builds the scene in pieces. Blender adds one undo step at the end.

    Esc and Ctrl Z stop the build, and the operator then takes back its earlier changes.
    """

    interval_s = PIECES_INTERVAL_S
    _job: Job
    _scene_uid: int

    def start(self, context: bpy.types.Context) -> Job:
        """Start to build the scene of the window. Raises IcyMoonError if nothing can be built in it."""
        session.stop_building()
        leave_edit_mode()
        scenes.refuse_place(context.scene)
        self._scene_uid = context.scene.session_uid
        work = WorkInPieces(self.make_steps(context), "the ground")
        session.building = Job("Build Scene", work, if_stopped="the scene is as before")
        return session.building

    def make_steps(self, context: bpy.types.Context) -> Steps[list[tuple[str, str]]]:
        """Make the steps of the build, which return (kind, sentence) pairs to report. Raises IcyMoonError if the
        settings are invalid."""
        return build_in_pieces(self._scene_uid, scene_properties.read_settings(context.scene.icymoon))

    def look(self, context: bpy.types.Context) -> bool:
        """Check the build; the sidebar states how long it has run."""
        session.show_seconds(self._job.past_s)
        return super().look(context)

    def take_back(self, scene: bpy.types.Scene) -> None:
        """Restore the settings that the scene had before the operator."""

    def clean_up_after_stop(self) -> None:
        if (scene := find_scene(self._scene_uid)) is not None:
            self.take_back(scene)

    def report_end(self, context: bpy.types.Context) -> None:
        """Forget the job, and note for the sidebar how it ended."""
        if session.building is self._job:
            session.building = None
        session.note_end(self._job)
        redraw_panels()

    def report_success(self, context: bpy.types.Context) -> None:
        """Report the built scene, and start to make its ground at full resolution."""
        sentences = self._job.result["value"]
        report_sentences(self, sentences)
        if sentences == [UNCHANGED]:
            session.note_end(self._job, "nothing has changed")
        elif (scene := find_scene(self._scene_uid)) is not None:
            keep_marks.schedule_reading(scene)
        refine_ground.start_refining()


def _stop_before_undo() -> None:
    """Stop a running build, and note that the undo is meant for the build."""
    session.undone_build = session.building is not None
    session.stop_building()


def _return_after_undo() -> None:
    """Redo an undo that was meant for a running build. The build has no undo step yet, so the undo also took back the
    step before the build, and the redo restores it."""
    if session.undone_build:
        session.undone_build = False
        call_later(redo)


register, unregister = make_registration(
    undo_pre=_stop_before_undo, undo_post=_return_after_undo, redo_pre=session.stop_building, timers=(redo,)
)
