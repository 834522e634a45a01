"""Build Scene and Clear Scene.

In a window Build Scene shows the scene coarsely, and its ground at full resolution follows (``refine_ground``). A
thread computes the coarse ground. Meanwhile the window is the user's, and Esc gives up. Then the objects are made in
steps, with turns of the event loop between them. For this part of a second keys and clicks wait, since undo would
remove the objects.
"""

from __future__ import annotations

from functools import partial

import bpy

from ..nodes import build_scene as scenes
from ..nodes import preview
from ..nodes.ground.user_ground import is_from_file, warn_of_cost
from ..nodes.scene_objects import ComputedGround
from ..render.workers.watched_thread import Calculation
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.steps import Steps, finish
from . import jobs, live_preview, refine_ground, view_resolution
from .build import LIT_AZIMUTH_DEG, BuildFrame, build_and_report, light_untouched_scene, restore_views
from .coloured_views import hide_errors
from .job_operators import JobOperator
from .presets import find_picture, read_with_preset, write_preset
from .session import session
from .user_render import restore_render
from .window_areas import find_scene


class ICYMOON_OT_build_scene(JobOperator, bpy.types.Operator):
    """Build ground, rocks, Sun and stereo camera from the settings. Your own objects stay, but F12 leaves them out until Clear Scene"""  # noqa: E501

    bl_idname = "icymoon.build_scene"
    bl_label = "Build Scene"
    bl_options = {"UNDO"}

    interval_s = 0.02
    # Loaded with the build, in the same step of undo; empty for the settings as they are.
    preset: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})
    _holds = False  # the window, while objects are made

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return True

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        try:
            settings = read_with_preset(context.scene.icymoon, self.preset)
            warnings = warn_of_cost(settings)
        except IcyMoonError as error:
            return self.fail(error)
        if warnings and not bpy.app.background:
            return set(
                context.window_manager.invoke_confirm(
                    self, event, title="Load a Large Mesh?", message=warnings[0], confirm_text="Load"
                )
            )
        if not self.preset and light_untouched_scene(context.scene):
            self.report({"INFO"}, f"Sun Azimuth is {LIT_AZIMUTH_DEG:g}° now, because its default leaves this view dark")
        if is_from_file(settings):
            return self.execute(context)
        if session.job is not None:
            return self._build_at_once(context)
        return super().invoke(context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Build the scene in full, as scripts expect; of a preset that was chosen the window gets a coarse one."""
        return self._build_at_once(context) if self.preset else build_and_report(self, context)

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return {"RUNNING_MODAL"} if self._holds and event.type != "TIMER" else super().modal(context, event)

    def start(self, context: bpy.types.Context) -> jobs.Job:
        self._scene_uid = context.scene.session_uid
        settings = read_with_preset(context.scene.icymoon, self.preset)
        work = jobs.StepsOfTurns(self._wait_and_build(settings))
        return jobs.Job("Build Scene", work, if_stopped="the scene is as before")

    def _build_at_once(self, context: bpy.types.Context) -> set[str]:
        self._scene_uid = context.scene.session_uid
        try:
            settings = read_with_preset(context.scene.icymoon, self.preset)
            finish(self._build(settings, preview.compute_coarse_ground(settings)))
        except IcyMoonError as error:
            return self.fail(error)
        self.report_success(context)
        return {"FINISHED"}

    def _wait_and_build(self, settings: Settings) -> Steps[None]:
        """Build the scene coarsely from complete settings, after a thread has computed its ground."""
        work = Calculation(partial(preview.compute_coarse_ground, settings), "the ground")
        while work.running:
            yield
        (message,) = work.poll()
        if "value" not in message:
            raise IcyMoonError(message["message"])
        yield from self._build(settings, message["value"])

    def _build(self, settings: Settings, ground: ComputedGround) -> Steps[None]:
        """Build the scene coarsely on its computed coarse ground."""
        scene = find_scene(self._scene_uid)
        if scene is None:
            raise IcyMoonError("The scene was removed while it was built.")
        self._holds = True
        frame = BuildFrame(bpy.context, scene)
        built = yield from preview.build_coarse_in_steps(scene, settings, ground)
        if self.preset:
            write_preset(self, scene.icymoon, self.preset)
        yield
        frame.show(self, bpy.context, built)

    def report_success(self, context: bpy.types.Context) -> None:
        """Let the ground at full resolution follow."""
        scene = find_scene(self._scene_uid)
        if scene is None:
            return
        live_preview.update_scene(scene)  # what has changed meanwhile
        if self.preset:
            session.picture.show(scene, find_picture(self.preset))
            if preview.awaits_ground(scene, scene_properties.read_unchecked(scene.icymoon)) is None:
                session.picture.count(scene)
        refine_ground.begin_refining()


class ICYMOON_OT_clear_scene(bpy.types.Operator):
    """Remove what Build Scene made, and restore the earlier camera, world, render settings and view"""

    bl_idname = "icymoon.clear_scene"
    bl_label = "Clear Scene"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        found = scenes.find_collection(context.scene) is not None
        if not found:
            cls.poll_message_set("Nothing has been built in this scene")
        return found

    def execute(self, context: bpy.types.Context) -> set[str]:
        hide_errors(context.scene)
        session.picture.remove()
        collection = scenes.find_collection(context.scene)
        restore_render(context.scene, collection)
        view_resolution.restore_resolution(context.scene, collection)
        scenes.clear_scene(context.scene)
        restore_views()
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_build_scene, ICYMOON_OT_clear_scene)
