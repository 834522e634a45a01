"""Build Scene and Clear Scene."""

from __future__ import annotations

from typing import Any

import bpy

from ..nodes import preview
from ..nodes import scene as scenes
from ..nodes.ground.user_ground import cost_warnings
from ..nodes.measured_surface import find_points
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.number_text import count_of
from . import first_picture, view_exposure, view_resolution
from .coloured_views import hide_errors
from .sidebar_text import in_window
from .user_render import prepare_render, restore_render


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
    view_exposure.expose(scene, settings, anew=before is None)


#: What 3D Views were like before they showed a built scene, by their addresses; the window's layout knows no undo.
_views_before: dict[int, dict[str, Any]] = {}
#: Addresses of the views that a built scene was taken from, by undo or Clear Scene.
_left: set[int] = set()
_SHADING = ("type", "use_scene_lights_render", "use_scene_world_render")


def show_scene(context: bpy.types.Context, built: scenes.Built) -> None:
    """Look through the stereo camera in the 3D View with the button, with rendered shading and without overlays.

    The local view hides the user's objects in this view. They are not changed.
    """
    space: Any = context.space_data
    if context.area is None or context.area.type != "VIEW_3D":
        return
    _left.discard(space.as_pointer())
    _views_before.setdefault(
        space.as_pointer(),
        {
            "shading": {key: getattr(space.shading, key) for key in _SHADING},
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
    _left.update(_views_before)
    places = [
        (window, area)
        for window in bpy.context.window_manager.windows
        for area in window.screen.areas
        if area.type == "VIEW_3D" and area.spaces.active.as_pointer() in _views_before
    ]
    for window, area in places:
        space = area.spaces.active
        before = _views_before[space.as_pointer()]
        for key, value in before["shading"].items():
            setattr(space.shading, key, value)
        space.overlay.show_overlays = before["overlays"]
        space.use_local_camera = False
        if space.region_3d.view_perspective == "CAMERA":
            space.region_3d.view_perspective = before["perspective"]
        if space.local_view is not None and not before["local"]:
            region = next(r for r in area.regions if r.type == "WINDOW")
            with bpy.context.temp_override(window=window, area=area, region=region):
                bpy.ops.view3d.localview(frame_selected=False)
    _views_before.clear()


def _follow_undo() -> None:
    """Restore the views if undo has removed the built scene, and show it again if redo has brought it back."""
    there = any(scenes.find_collection(scene) for scene in bpy.data.scenes)
    if _views_before and not there:
        restore_views()
    elif _left and there:
        for window in bpy.context.window_manager.windows:
            built = scenes.find(window.scene)
            if built is None:
                continue
            for area in window.screen.areas:
                if area.type == "VIEW_3D" and area.spaces.active.as_pointer() in _left:
                    region = next(r for r in area.regions if r.type == "WINDOW")
                    with bpy.context.temp_override(window=window, area=area, region=region):
                        show_scene(bpy.context, built)
        _left.clear()


@bpy.app.handlers.persistent
def _look_after_undo(*_: Any) -> None:
    if (_views_before or _left) and not bpy.app.timers.is_registered(_follow_undo):
        bpy.app.timers.register(_follow_undo, first_interval=0.0)  # no operator runs inside undo


@bpy.app.handlers.persistent
def _forget_views(*_: Any) -> None:
    _views_before.clear()
    _left.clear()


def views_through(context: bpy.types.Context, camera: bpy.types.Object | None) -> list[Any]:
    """The 3D Views, in all windows, that look through ``camera``."""
    spaces = [
        area.spaces.active
        for window in context.window_manager.windows
        for area in window.screen.areas
        if area.type == "VIEW_3D"
    ]
    return [
        space
        for space in spaces
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
    build = preview.build_coarse if coarse else scenes.build
    leave_edit_mode()
    earlier = scenes.find(context.scene)
    before = earlier.settings if earlier else None
    views = views_through(context, earlier.camera if earlier else None)
    try:
        built = build(context.scene, scene_properties.read_settings(context.scene.icymoon))
    except IcyMoonError as error:
        operator.report({"ERROR"}, in_window(error))
        return {"CANCELLED"}
    prepare_render(context.scene, built)
    hide_errors(context.scene)  # they are of the previous scene
    for warning in built.warnings:
        operator.report({"WARNING"}, in_window(warning))
    frame_and_expose(context.scene, built.settings, before)
    view_resolution.begin(context.scene)
    first_picture.remove()
    if not bpy.app.background:
        if before is None:
            show_scene(context, built)
        else:
            look_through(views, built)
    mesh = built.terrain.data
    operator.report(
        {"INFO"},
        f"Built {count_of(len(mesh.loops) - 2 * len(mesh.polygons), 'ground triangle')} "
        f"and {count_of(built.rock_count, 'rock')}",
    )
    return {"FINISHED"}


class ICYMOON_OT_build_scene(bpy.types.Operator):
    """Build ground, rocks, Sun and stereo camera from the settings. Your own objects stay, but F12 leaves them out until Clear Scene"""  # noqa: E501

    bl_idname = "icymoon.build_scene"
    bl_label = "Build Scene"
    bl_options = {"REGISTER", "UNDO"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        try:
            warnings = cost_warnings(scene_properties.read_settings(context.scene.icymoon))
        except IcyMoonError as error:
            self.report({"ERROR"}, in_window(error))
            return {"CANCELLED"}
        if warnings and not bpy.app.background:
            return set(
                context.window_manager.invoke_confirm(
                    self, event, title="Load a Large Mesh?", message=warnings[0], confirm_text="Load"
                )
            )
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
        first_picture.remove()
        collection = scenes.find_collection(context.scene)
        restore_render(context.scene, collection)
        view_resolution.restore(context.scene, collection)
        scenes.clear(context.scene)
        restore_views()
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_build_scene, ICYMOON_OT_clear_scene)


def register() -> None:
    """Follow undo and new files, so that no view stays on a scene that is gone."""
    bpy.app.handlers.undo_post.append(_look_after_undo)
    bpy.app.handlers.redo_post.append(_look_after_undo)
    bpy.app.handlers.load_pre.append(_forget_views)


def unregister() -> None:
    """Stop following them."""
    bpy.app.handlers.load_pre.remove(_forget_views)
    if bpy.app.timers.is_registered(_follow_undo):
        bpy.app.timers.unregister(_follow_undo)
    bpy.app.handlers.redo_post.remove(_look_after_undo)
    bpy.app.handlers.undo_post.remove(_look_after_undo)
