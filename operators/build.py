"""Build a scene in the window, and show it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import bpy

from ..nodes import build_scene as scenes
from ..nodes import lidar_in_view, preview
from ..nodes.measured_surface import find_points
from ..settings import description
from ..settings.blender import scene_properties
from ..settings.rebuilt_parts import select_scene
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from . import shadow_warning, view_exposure, view_resolution
from .coloured_views import hide_colours
from .operator_type import OperatorMixin
from .session import SIDES, session
from .sidebar_text import format_for_window
from .user_render import prepare_render
from .window_areas import list_areas, override_area, pause_rendered_views
from .window_events import call_later, make_registration


def frame_and_expose(scene: bpy.types.Scene, settings: Settings, before: Settings | None = None) -> None:
    """Set the frame and exposure of the view from ``settings``.

    If the settings ``before`` the change are given, values that the user has set by hand stay. Pairs do not use the
    view's frame and exposure: they contain radiance and are rendered in a separate scene.
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
#: Properties of Blender's default view; a view gets them if it showed a built scene when its file was saved.
_PLAIN_VIEW: dict[str, Any] = {
    "shading": {"type": "SOLID", "use_scene_lights_render": True, "use_scene_world_render": True},
    "overlays": True,
    "perspective": "PERSP",
    "local": False,
}


def show_scene(context: bpy.types.Context, built: scenes.Built) -> int:
    """Look through the stereo camera in the 3D View with the button, with rendered shading and without overlays.

    A local view hides the user's objects in this 3D View, without changing them. Returns the number of objects that
    were hidden.
    """
    space: bpy.types.Space = context.space_data
    if context.area is None or context.area.type != "VIEW_3D":
        return 0
    uid = context.scene.session_uid
    session.views_left.discard((space.as_pointer(), uid))
    before = session.views_before.setdefault(
        space.as_pointer(),
        {
            "shading": {key: getattr(space.shading, key) for key in _SHADING_PROPERTIES},
            "overlays": space.overlay.show_overlays,
            "perspective": space.region_3d.view_perspective,
            "local": space.local_view is not None,
        },
    )
    before["scene"] = uid
    space.shading.type = "RENDERED"
    space.shading.use_scene_lights_render = space.shading.use_scene_world_render = True
    space.overlay.show_overlays = False
    shown = find_points(context.scene), lidar_in_view.find_shown(context.scene)
    ours = {*built.collection.all_objects, *(item for item in shown if item is not None)}
    foreign = [o for o in context.scene.objects if o not in ours and o.visible_get()]
    hides = bool(foreign) and space.local_view is None
    if hides:
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
    return len(foreign) if hides else 0


def _restore_view(window: bpy.types.Window, area: bpy.types.Area) -> None:
    """Restore a 3D View that showed a built scene. The view is recorded, because undo, redo or a change of the scene
    may bring the built scene back."""
    space = area.spaces.active
    before = session.views_before.pop(space.as_pointer())
    session.views_left.add((space.as_pointer(), before["scene"]))
    for key, value in before["shading"].items():
        setattr(space.shading, key, value)
    space.overlay.show_overlays = before["overlays"]
    space.use_local_camera = False
    if space.region_3d.view_perspective == "CAMERA":
        space.region_3d.view_perspective = before["perspective"]
    if space.local_view is not None and not before["local"]:
        with override_area(window, area):
            bpy.ops.view3d.localview(frame_selected=False)


def _adopt_views() -> None:
    """Record which views of the opened file show a built scene, to restore them when the scene is removed."""
    for window, area in list_areas("VIEW_3D"):
        space, built = area.spaces.active, scenes.find_built(window.scene)
        through = space.camera if space.use_local_camera else window.scene.camera
        is_ours = built is not None and through == built.camera and space.region_3d.view_perspective == "CAMERA"
        if is_ours and not space.overlay.show_overlays:
            session.views_before[space.as_pointer()] = {**_PLAIN_VIEW, "scene": window.scene.session_uid}


def _find_turned_views() -> tuple[list[Any], list[Any]]:
    """Return two lists of 3D Views, as (window, area). The first has the views to restore: their scene is no longer
    built, or they show another scene. The second has the views that had left a built scene and show it again."""
    gone, back = [], []
    for window, area in list_areas("VIEW_3D"):
        view, uid = area.spaces.active.as_pointer(), window.scene.session_uid
        before = session.views_before.get(view)
        built = scenes.find_collection(window.scene) is not None
        if before is not None and (not built or before["scene"] != uid):
            gone.append((window, area))
        if built and (view, uid) in session.views_left:
            back.append((window, area))
    return gone, back


def restore_views() -> None:
    """Restore the 3D Views whose scene is no longer built or that show another scene now."""
    for window, area in _find_turned_views()[0]:
        _restore_view(window, area)


def _follow_views() -> None:
    """Restore views, and show the built scene again in views that return to it."""
    restore_views()
    for window, area in _find_turned_views()[1]:
        built = scenes.find_built(window.scene)
        if built is not None:
            with override_area(window, area):
                show_scene(bpy.context, built)


def _check_views() -> None:
    """Schedule ``_follow_views`` after undo, redo and changes of the scene that a window shows."""
    if (session.views_before or session.views_left) and any(_find_turned_views()):
        call_later(_follow_views)  # no operator runs inside undo


def find_views_through(context: bpy.types.Context, camera: bpy.types.Object | None) -> list[Any]:
    """List the 3D Views, in all windows, that look through ``camera``."""
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
    """Switch to Object Mode, because the builders cannot replace an object that is being edited."""
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def build_and_report(operator: bpy.types.Operator, context: bpy.types.Context, coarse: bool = False) -> set[str]:
    """Build the scene from its settings, show it, report it, and return the result of the operator.

    With ``coarse`` the ground is made coarsely, and marked so that ``refine_ground`` refines it.
    """
    build, scene = preview.build_coarse if coarse else scenes.build_scene, context.scene
    session.stop_building()
    leave_edit_mode()
    try:
        settings = scene_properties.read_settings(scene.icymoon)
        report_sentences(operator, build_and_show(context, scene, partial(build, scene, settings)))
    except IcyMoonError as error:
        operator.report({"ERROR"}, format_for_window(error))
        return {"CANCELLED"}
    return {"FINISHED"}


def build_and_show(
    context: bpy.types.Context, scene: bpy.types.Scene, build: Callable[[], scenes.Built]
) -> list[tuple[str, str]]:
    """Build a scene by ``build``, and show it. Returns (kind, sentence) pairs to report. Raises IcyMoonError if
    ``build`` does."""
    earlier = scenes.find_built(scene)
    before = earlier.settings if earlier else None
    views = find_views_through(context, earlier.camera if earlier else None)
    with pause_rendered_views():
        built = build()
    prepare_render(scene, built)
    hide_colours(scene)  # the painted errors are of the previous scene
    frame_and_expose(scene, built.settings, before)
    view_resolution.begin_coarse(scene)
    session.picture.remove()
    session.preview_side = SIDES[0]
    shadow_warning.schedule_check(scene)
    hidden = 0
    if not bpy.app.background:
        if before is not None:
            look_through(views, built)
        elif context.scene == scene:
            hidden = show_scene(context, built)
    return [
        *(("WARNING", format_for_window(warning)) for warning in built.warnings),
        ("INFO", describe_build(built, hidden)),
    ]


def report_sentences(operator: OperatorMixin, sentences: list[tuple[str, str]]) -> None:
    """Let an operator report (kind, sentence) pairs."""
    for kind, sentence in sentences:
        operator.report({kind}, sentence)


def describe_build(built: scenes.Built, hidden: int) -> str:
    """State how many ground triangles and rocks were built, and how many of the user's objects the view hides."""
    mesh = built.terrain.data
    said = (
        f"Built {format_count(len(mesh.loops) - 2 * len(mesh.polygons), 'ground triangle')} "
        f"and {format_count(built.rock_count, 'rock')}"
    )
    if hidden:
        said += f"; this view hides {format_count(hidden, 'object')} of your own, numpad / shows all"
    return said


def light_untouched_scene(scene: bpy.types.Scene) -> bool:
    """Rotate the Sun of a scene with default settings, before its first build, so that its view is lit.

    The default view is in the shadow of a rise. The defaults stay, because old data sets rely on them. Returns whether
    the Sun was rotated.
    """
    settings, untouched = scene_properties.read_unchecked(scene.icymoon), description.defaults()
    if scenes.find_collection(scene) is not None or select_scene(settings) != select_scene(untouched):
        return False
    if settings.light != untouched.light or settings.rig != untouched.rig:
        return False
    scene.icymoon.light.sun_azimuth_deg = LIT_AZIMUTH_DEG
    return True


register, unregister = make_registration(
    timers=(_follow_views,),
    undo_post=_check_views,
    redo_post=_check_views,
    depsgraph_update_post=_check_views,  # Blender does not report that a window shows another scene
    load_post=_adopt_views,
)
