"""Build Scene and Clear Scene.

In a window Build Scene builds in pieces (``build_in_pieces``): procedural ground is coarse at first, and its ground at
full resolution follows (``refine_ground``).
"""

from __future__ import annotations

from functools import partial

import bpy

from ..nodes import build_scene as scenes
from ..nodes import preview
from ..nodes.ground.user_ground import warn_of_cost
from ..nodes.remove_objects import remove_leftovers
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.steps import Steps
from . import refine_ground, view_resolution
from .build import LIT_AZIMUTH_DEG, build_and_report, light_untouched_scene, restore_views
from .build_in_pieces import UNCHANGED, PiecewiseBuildOperator, build_in_pieces
from .coloured_views import hide_colours, is_shown
from .operator_type import ExplainedOperator
from .painted_masks import leave_sheet
from .render import require_scene
from .session import session
from .settled_steps import settle
from .user_render import restore_render


class ICYMOON_OT_build_scene(PiecewiseBuildOperator, bpy.types.Operator):
    """Build ground, rocks, Sun and stereo camera from the settings. Your own objects stay, but F12 leaves them out until Clear Scene"""  # noqa: E501

    bl_idname = "icymoon.build_scene"
    bl_label = "Build Scene"
    bl_options = {"REGISTER", "UNDO"}

    _asked = False  # the user is asked whether to load a large mesh
    _azimuth_deg: float | None = None  # of the Sun, if the operator has rotated it

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        try:
            settings = scene_properties.read_settings(context.scene.icymoon)
            warnings = warn_of_cost(settings)
        except IcyMoonError as error:
            return self.fail(error)
        if warnings and not bpy.app.background:
            self._asked = True
            return set(
                context.window_manager.invoke_confirm(
                    self, event, title="Load a Large Mesh?", message=warnings[0], confirm_text="Load"
                )
            )
        if light_untouched_scene(context.scene):
            self._azimuth_deg = settings.light.sun_azimuth_deg
            self.report({"INFO"}, f"Sun Azimuth is {LIT_AZIMUTH_DEG:g}° now, because its default leaves this view dark")
        if not bpy.app.background:
            return super().invoke(context, event)
        result = build_and_report(self, context, coarse=True)
        refine_ground.start_refining()
        return result

    def make_steps(self, context: bpy.types.Context) -> Steps[list[tuple[str, str]]]:
        """Make the steps of the build. If the scene is up to date already, they only return ``UNCHANGED``."""
        settings = scene_properties.read_settings(context.scene.icymoon)
        if (yield from settle(partial(_is_up_to_date, self._scene_uid, settings))):
            remove_leftovers()  # of scenes that were deleted, as each build does
            return [UNCHANGED]
        return (yield from build_in_pieces(self._scene_uid, settings))

    def take_back(self, scene: bpy.types.Scene) -> None:
        """Rotate the Sun back."""
        if self._azimuth_deg is not None:
            scene.icymoon.light.sun_azimuth_deg = self._azimuth_deg

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Build the scene in full, as scripts expect, or in pieces after a question to the user."""
        if self._asked:
            self._asked = False
            return super().invoke(context, None)
        return build_and_report(self, context)


def _is_up_to_date(scene_uid: int, settings: Settings) -> Steps[bool]:
    """Return, in steps, whether a scene shows these settings, no object was edited by hand, and no colours of errors,
    decisions or a scan cover it, which a build removes. The ground may be coarse while the fine ground is made."""
    built = scenes.find_built(require_scene(scene_uid))
    if built is None or built.outdated or scenes.why_shared(built) or is_shown(built.scene):
        return False
    is_left_coarse = built.preview and preview.find_preview_of(built.scene, settings) is None
    if is_left_coarse or scenes.list_changed_settings(built, settings):
        return False
    return not (yield from built.is_edited_in_steps())


class ICYMOON_OT_clear_scene(ExplainedOperator, bpy.types.Operator):
    """Remove everything that Build Scene made, and restore the earlier camera, world, render settings and view"""

    bl_idname = "icymoon.clear_scene"
    bl_label = "Clear Scene"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if scenes.find_collection(context.scene) else "Nothing has been built in this scene"

    def execute(self, context: bpy.types.Context) -> set[str]:
        session.stop_building()
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
