"""Build Scene and Clear Scene."""

from __future__ import annotations

from typing import Any

import bpy

from ..nodes import build_scene as scenes
from ..nodes import preview
from ..nodes.ground.user_ground import warn_of_cost
from ..nodes.measured_surface import find_points
from ..settings import description
from ..settings.blender import scene_properties
from ..settings.rebuilt_parts import select_scene
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from . import view_exposure, view_resolution
from .coloured_views import hide_errors
from .session import session
from .sidebar_text import format_for_window
from .user_render import prepare_render, restore_render
from .window_areas import list_areas, override_area
from .window_events import call_later, make_registration


def frame_and_expose(scene: bpy.types.Scene, settings: Settings, before: Settings | None = None) -> None:
    """Set the frame and exposure of the view from ``settings``.

    With the settings ``before`` the change, values that the user has set by hand stay. Images do not depend on them:
    they contain radiance and are rendered in a separate scene.
    """
    if before is None or (before.rig.width_px, before.rig.height_px) == (
        scene.render.resolution_x,
        scene.render.resolution_y,
    ):
        scene.render.resolution_x, scene.render.resolution_y = settings.rig.width_px, settings.rig.height_px
    view_exposure.expose_view(scene, settings, anew=before is None)


#: Azimuth of the Sun at which the default view is lit from the side.
LIT_AZIMUTH_DEG = 300.0
_SHADING_PROPERTIES = ("type", "use_scene_lights_render", "use_scene_world_render")


def show_scene(context: bpy.types.Context, built: scenes.Built) -> None:
    """Look through the stereo camera in the 3D View with the button, with rendered shading and without overlays.

    The local view hides the user's objects in this view. They are not changed.
    """
    space: bpy.types.Space = context.space_data
    if context.area is None or context.area.type != "VIEW_3D":
        return
    session.views_left.discard(space.as_pointer())
    session.views_before.setdefault(
        space.as_pointer(),
        {
            "shading": {key: getattr(space.shading, key) for key in _SHADING_PROPERTIES},
            "overlays": space.overlay.show_overlays,
            "perspective": space.region_3d.view_perspective,
            "local": space.local_view is not None,
        },
    )
    space.shading.type = "RENDERED"
    space.shading.use_scene_lights_render = space.shading.use_scene_world_render = True
    space.overlay.show_overlays = False
    points = find_points(context.scene)
    ours = set(built.collection.all_objects) | ({points} if points else set())
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


def restore_views() -> None:
    """Restore the 3D Views that showed a built scene; undo or redo may show the scene there again."""
    session.views_left.update(session.views_before)
    for window, area in list(list_areas("VIEW_3D")):
        space = area.spaces.active
        before = session.views_before.get(space.as_pointer())
        if before is None:
            continue
        for key, value in before["shading"].items():
            setattr(space.shading, key, value)
        space.overlay.show_overlays = before["overlays"]
        space.use_local_camera = False
        if space.region_3d.view_perspective == "CAMERA":
            space.region_3d.view_perspective = before["perspective"]
        if space.local_view is not None and not before["local"]:
            with override_area(window, area):
                bpy.ops.view3d.localview(frame_selected=False)
    session.views_before.clear()


def _follow_undo() -> None:
    """Restore the views if undo has removed the built scene, and show it again if redo has brought it back."""
    there = any(scenes.find_collection(scene) for scene in bpy.data.scenes)
    if session.views_before and not there:
        restore_views()
    elif session.views_left and there:
        for window, area in list(list_areas("VIEW_3D")):
            built = scenes.find_built(window.scene)
            if built is not None and area.spaces.active.as_pointer() in session.views_left:
                with override_area(window, area):
                    show_scene(bpy.context, built)
        session.views_left.clear()


def _check_after_undo() -> None:
    if session.views_before or session.views_left:
        call_later(_follow_undo)  # no operator runs inside undo


def find_views_through(context: bpy.types.Context, camera: bpy.types.Object | None) -> list[Any]:
    """The 3D Views, in all windows, that look through ``camera``."""
    return [
        space
        for space in (area.spaces.active for _, area in list_areas("VIEW_3D"))
        if camera is not None
        and space.region_3d.view_perspective == "CAMERA"
        and (space.camera if space.use_local_camera else context.scene.camera) is camera
    ]


def look_through(spaces: list[Any], built: scenes.Built) -> None:
    """Make 3D Views look through the camera of a scene that was built again."""
    for space in spaces:
        space.camera = built.camera  # in a local view Blender does not set it, even to the scene's camera
        space.region_3d.view_perspective = "CAMERA"
        for item in built.collection.all_objects if space.local_view else ():
            item.local_view_set(space, True)


def leave_edit_mode() -> None:
    """Go to Object Mode: the builders cannot replace an object that is being edited."""
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def build_and_report(operator: bpy.types.Operator, context: bpy.types.Context, coarse: bool = False) -> set[str]:
    """Build the scene from its settings, show it and report it; the result of the operator.

    With ``coarse`` the ground is made coarsely, and marked for ``refine`` to follow.
    """
    build = preview.build_coarse if coarse else scenes.build_scene
    leave_edit_mode()
    earlier = scenes.find_built(context.scene)
    before = earlier.settings if earlier else None
    views = find_views_through(context, earlier.camera if earlier else None)
    try:
        built = build(context.scene, scene_properties.read_settings(context.scene.icymoon))
    except IcyMoonError as error:
        operator.report({"ERROR"}, format_for_window(error))
        return {"CANCELLED"}
    prepare_render(context.scene, built)
    hide_errors(context.scene)  # they are of the previous scene
    for warning in built.warnings:
        operator.report({"WARNING"}, format_for_window(warning))
    frame_and_expose(context.scene, built.settings, before)
    view_resolution.begin_coarse(context.scene)
    session.picture.remove()
    if not bpy.app.background:
        if before is None:
            show_scene(context, built)
        else:
            look_through(views, built)
    mesh = built.terrain.data
    operator.report(
        {"INFO"},
        f"Built {format_count(len(mesh.loops) - 2 * len(mesh.polygons), 'ground triangle')} "
        f"and {format_count(built.rock_count, 'rock')}",
    )
    return {"FINISHED"}


def light_untouched_scene(scene: bpy.types.Scene) -> bool:
    """Turn the Sun of a scene whose settings are all the defaults, before its first build, so that its view is lit.

    The default view is in the shadow of a rise. The defaults stay, because old data sets have them. Returns whether the
    Sun was turned.
    """
    settings, untouched = scene_properties.read_unchecked(scene.icymoon), description.defaults()
    if scenes.find_collection(scene) is not None or select_scene(settings) != select_scene(untouched):
        return False
    if settings.light != untouched.light or settings.rig != untouched.rig:
        return False
    scene.icymoon.light.sun_azimuth_deg = LIT_AZIMUTH_DEG
    return True


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
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        return build_and_report(self, context)


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


register, unregister = make_registration(
    timers=(_follow_undo,), undo_post=_check_after_undo, redo_post=_check_after_undo
)
