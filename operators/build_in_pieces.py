"""Builds a scene with coarse ground without holding the window.

A thread computes the ground and the places of its rocks. The other work needs Blender and is cut into pieces, few of
which run in each turn of the event loop. They make objects outside all scenes, and the last piece puts these into the
scene. If the build stops before, the scene and the file are as they were.
"""

from __future__ import annotations

from functools import partial

import bpy

from ..nodes import build_scene as scenes
from ..nodes import preview
from ..nodes.scene_objects import MadeObjects
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.steps import Steps
from . import live_preview, refine_ground
from .build import build_and_show, leave_edit_mode, report_sentences
from .job_operators import KeyStoppedOperator
from .jobs import Job
from .session import session
from .window_areas import find_scene, redo
from .window_events import call_later, make_registration
from .work_in_pieces import PIECES_INTERVAL_S, WorkInPieces


def build_in_pieces(scene_uid: int, settings: Settings) -> Steps[list[tuple[str, str]]]:
    """Build the scene with this ``session_uid`` in steps, with coarse ground, and show it. Returns sentences to report.

    Raises IcyMoonError, without changing the scene, as ``preview.build_coarse`` does and if the scene or what was made
    for it is gone.
    """
    scene, made = yield from make_for_scene(scene_uid, settings)
    return build_and_show(bpy.context, scene, partial(put_in_scene, scene, settings, made))


def make_for_scene(scene_uid: int, settings: Settings) -> Steps[tuple[bpy.types.Scene, MadeObjects]]:
    """Make a scene with coarse ground in steps, for the scene with this ``session_uid``, which is returned too.

    Raises IcyMoonError as ``build_in_pieces`` does.
    """
    try:
        made = yield from preview.make_coarse(settings)
    except ReferenceError:
        raise IcyMoonError("Parts of the new scene were removed while it was built; press Build Scene again.") from None
    scene = find_scene(scene_uid)
    if scene is None:
        made.remove()
        raise IcyMoonError("The scene was deleted while it was built; choose another scene, and press Build Scene.")
    return scene, made


def put_in_scene(scene: bpy.types.Scene, settings: Settings, made: MadeObjects) -> scenes.Built:
    """Put what was made into a scene, and let settings follow that were changed meanwhile."""
    built = preview.put_coarse_in_scene(scene, settings, made)
    if bpy.context.scene == scene:
        leave_edit_mode()  # of an object of the user's, since the view will show the scene
    if scene_properties.read_unchecked(scene.icymoon) != settings:
        session.to_preview.add(scene.name)
        call_later(live_preview.show_waiting)
    return built


class PiecewiseBuildOperator(KeyStoppedOperator):
    """Mix-in: an operator that builds the scene with coarse ground in pieces. Blender adds one undo step at the end.

    Esc and Ctrl Z stop the build, and the operator then takes back what it has changed before.
    """

    interval_s = PIECES_INTERVAL_S
    _job: Job
    _scene_uid: int

    def start(self, context: bpy.types.Context) -> Job:
        """Start to build the scene of the window. Raises IcyMoonError if nothing can be built in it."""
        session.stop_building()
        leave_edit_mode()
        settings = scene_properties.read_settings(context.scene.icymoon)
        scenes.refuse_place(context.scene)
        self._scene_uid = context.scene.session_uid
        work = WorkInPieces(build_in_pieces(self._scene_uid, settings), "the ground")
        session.building = Job("Build Scene", work, if_stopped="the scene is as before")
        return session.building

    def take_back(self, scene: bpy.types.Scene) -> None:
        """Set the settings of the scene back to those before the operator."""

    def clean_up_after_stop(self) -> None:
        if (scene := find_scene(self._scene_uid)) is not None:
            self.take_back(scene)

    def report_end(self, context: bpy.types.Context) -> None:
        """Forget the job."""
        if session.building is self._job:
            session.building = None

    def report_success(self, context: bpy.types.Context) -> None:
        """Report what was built, and let the ground at full resolution follow."""
        report_sentences(self, self._job.result["value"])
        refine_ground.start_refining()


def _stop_before_undo() -> None:
    """Stop the build, and note that the undo is meant for it."""
    session.undone_build = session.building is not None
    session.stop_building()


def _return_after_undo() -> None:
    """Redo the undo that a menu started during a build. The build has no undo step yet, so the undo took back the step
    before it too; the redo comes to the state before the build."""
    if session.undone_build:
        session.undone_build = False
        call_later(redo)


register, unregister = make_registration(
    undo_pre=_stop_before_undo, undo_post=_return_after_undo, redo_pre=session.stop_building, timers=(redo,)
)
