"""Build Scene and Clear Scene.

In a window Build Scene shows the scene coarsely, and its ground at full resolution follows (``refine_ground``).
"""

from __future__ import annotations

import bpy

from ..nodes import build_scene as scenes
from ..nodes.ground.user_ground import warn_of_cost
from ..settings.blender import scene_properties
from ..support.errors import IcyMoonError
from . import refine_ground, view_resolution
from .build import LIT_AZIMUTH_DEG, build_and_report, light_untouched_scene, restore_views
from .coloured_views import hide_colours
from .operator_type import ExplainedOperator
from .painted_masks import leave_sheet
from .session import session
from .sidebar_text import format_for_window
from .user_render import restore_render


class ICYMOON_OT_build_scene(bpy.types.Operator):
    """Build ground, rocks, Sun and stereo camera from the settings. Your own objects stay, but F12 leaves them out until Clear Scene"""  # noqa: E501

    bl_idname = "icymoon.build_scene"
    bl_label = "Build Scene"
    bl_options = {"REGISTER", "UNDO"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        try:
            warnings = warn_of_cost(scene_properties.read_settings(context.scene.icymoon))
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        if warnings and not bpy.app.background:
            return set(
                context.window_manager.invoke_confirm(
                    self, event, title="Load a Large Mesh?", message=warnings[0], confirm_text="Load"
                )
            )
        if light_untouched_scene(context.scene):
            self.report({"INFO"}, f"Sun Azimuth is {LIT_AZIMUTH_DEG:g}° now, because its default leaves this view dark")
        result = build_and_report(self, context, coarse=True)
        refine_ground.start_refining()
        return result

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Build the scene in full, as scripts expect."""
        return build_and_report(self, context)


class ICYMOON_OT_clear_scene(ExplainedOperator, bpy.types.Operator):
    """Remove everything that Build Scene made, and restore the earlier camera, world, render settings and view"""

    bl_idname = "icymoon.clear_scene"
    bl_label = "Clear Scene"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if scenes.find_collection(context.scene) else "Nothing has been built in this scene"

    def execute(self, context: bpy.types.Context) -> set[str]:
        leave_sheet(context)
        hide_colours(context.scene)
        session.picture.remove()
        collection = scenes.find_collection(context.scene)
        restore_render(context.scene, collection)
        view_resolution.restore_resolution(context.scene, collection)
        scenes.clear_scene(context.scene)
        restore_views()
        self.report({"INFO"}, "The built scene is removed; Ctrl Z brings it back")
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_build_scene, ICYMOON_OT_clear_scene)
