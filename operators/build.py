"""Build Scene and Clear Scene."""

from __future__ import annotations

import math
from typing import Any

import bpy

from .. import scene_properties
from ..errors import IcyMoonError
from ..nodes import scene as scenes
from ..nodes.ground.user_ground import cost_warnings
from ..nodes.measured_surface import clear_points
from ..physics.surfaces import albedos
from ..typed_settings import Settings
from . import sidebar_text

_BRIGHTNESS = 0.5  # of sunlit ground in the view, before the view transform


def _frame_and_exposure(settings: Settings) -> tuple[int, int, float | None]:
    """The stereo camera's frame, and an exposure at which sunlit ground is not white; None if nothing is lit."""
    rig = settings.rig
    found = albedos.albedos(settings.surface, settings.hapke)
    radiance = (sidebar_text.brightness_wm2(settings.light)
                * max(found.bond if found else settings.surface.albedo, 0.02) / math.pi)
    exposure = max(-10.0, min(10.0, math.log2(_BRIGHTNESS / radiance))) if radiance > 0 else None
    return rig.width_px, rig.height_px, exposure


def frame_and_expose(scene: bpy.types.Scene, settings: Settings,
                     before: Settings | None = None) -> None:
    """Give the view the frame and exposure of ``settings``; where ``before`` are given, what is not theirs stays.

    Only what the window shows: images are written as radiance, and rendered in a scene of their own.
    """
    had, wanted = _frame_and_exposure(before) if before else None, _frame_and_exposure(settings)
    if had is None or had[:2] == (scene.render.resolution_x, scene.render.resolution_y):
        scene.render.resolution_x, scene.render.resolution_y = wanted[:2]
    exposure = scene.view_settings.exposure
    if wanted[2] is not None and (had is None or (had[2] is not None and abs(had[2] - exposure) < 1e-4)):
        scene.view_settings.exposure = wanted[2]


def show_scene(context: bpy.types.Context, built: scenes.Built) -> None:
    """Look through the stereo camera, lit, in the 3D View the button was pressed in.

    Objects of the user that would stand in the picture are left out of this view only
    (Blender's local view); they are neither changed nor rendered.
    """
    space: Any = context.space_data
    if context.area is None or context.area.type != "VIEW_3D":
        return
    frame_and_expose(context.scene, built.settings)
    space.shading.type = "RENDERED"
    space.shading.use_scene_lights_render = space.shading.use_scene_world_render = True
    ours = set(built.collection.all_objects)
    foreign = [o for o in context.scene.objects if o not in ours and o.visible_get()]
    if foreign and space.local_view is None:
        selected = context.selected_objects
        bpy.ops.object.select_all(action="DESELECT")
        for item in ours:
            item.select_set(True)
        bpy.ops.view3d.localview(frame_selected=False)
        for item in ours:
            item.select_set(False)
        for item in selected:
            item.select_set(True)
    elif space.local_view is not None:
        for item in ours:
            item.local_view_set(space, True)
    space.use_local_camera = context.scene.camera is not built.camera
    if space.use_local_camera:
        space.camera = built.camera
    space.region_3d.view_perspective = "CAMERA"


def views_through(context: bpy.types.Context, camera: bpy.types.Object | None) -> list[Any]:
    """The 3D Views of all windows that look through a camera."""
    spaces = [area.spaces.active for window in context.window_manager.windows for area in window.screen.areas
              if area.type == "VIEW_3D"]
    return [space for space in spaces if camera is not None and space.region_3d.view_perspective == "CAMERA"
            and (space.camera if space.use_local_camera else context.scene.camera) is camera]


def look_through(spaces: list[Any], built: scenes.Built) -> None:
    """Let 3D Views that looked through the camera before it was built anew look through it again."""
    for space in spaces:
        space.camera = built.camera  # in a local view Blender does not, even where it is the scene's
        space.region_3d.view_perspective = "CAMERA"
        for item in built.collection.all_objects if space.local_view else ():
            item.local_view_set(space, True)


def leave_edit_mode() -> None:
    """Go to Object Mode, if something is being edited, as what is built anew must not be."""
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def build_and_report(operator: bpy.types.Operator, context: bpy.types.Context) -> set[str]:
    """Build what the scene's settings describe, show it, and let the operator report it; its result."""
    leave_edit_mode()
    try:
        built = scenes.build(context.scene, scene_properties.read_settings(context.scene.icymoon))
    except IcyMoonError as error:
        operator.report({"ERROR"}, str(error))
        return {"CANCELLED"}
    clear_points(context.scene)  # it was measured on what was there before
    for warning in built.warnings:
        operator.report({"WARNING"}, warning)
    if not bpy.app.background:
        show_scene(context, built)
    mesh = built.terrain.data
    operator.report({"INFO"}, f"Built {len(mesh.loops) - 2 * len(mesh.polygons)} ground triangles "
                             f"and {built.block_count} rocks")
    return {"FINISHED"}


class ICYMOON_OT_build_scene(bpy.types.Operator):
    """Make the ground, rocks, Sun and stereo camera that the settings describe; what was built before is replaced, nothing of yours is touched"""  # noqa: E501

    bl_idname = "icymoon.build_scene"
    bl_label = "Build Scene"
    bl_options = {"REGISTER", "UNDO"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        try:
            dear = cost_warnings(scene_properties.read_settings(context.scene.icymoon))
        except IcyMoonError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if dear and not bpy.app.background:
            return set(context.window_manager.invoke_confirm(self, event, title="Load a Large Mesh?",
                                                             message=dear[0], confirm_text="Load"))
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        return build_and_report(self, context)


class ICYMOON_OT_clear_scene(bpy.types.Operator):
    """Remove what Build Scene made and give the scene its earlier camera and world back"""

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
        clear_points(context.scene)
        scenes.clear(context.scene)
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_build_scene, ICYMOON_OT_clear_scene)
