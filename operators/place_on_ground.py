"""Place by Click: place the camera, the trench, the workspace or the site of the map by a click on the ground."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import bpy
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d
from mathutils import Vector

from ..nodes import build_scene as scenes
from ..nodes.eyes_above_ground import cast_ray
from ..physics.excavation.dig_site import REFUSED_FILE
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.printer import show_controls
from ..support.steps import Steps
from .build_in_pieces import build_in_pieces
from .change_and_build import ChangeAndBuildOperator
from .job_operators import WatchingOperator
from .operator_type import ExplainedOperator
from .render import find_whether_edited, require_scene
from .session import session
from .settled_steps import settle
from .sidebar_text import format_for_window
from .window_areas import list_areas

TARGETS = (
    ("CAMERA", "Camera", "Put the left camera above the place"),
    ("TRENCH", "Trench", "Let the scoop start at the place"),
    ("WORKSPACE", "Workspace", "Put the centre of the workspace on the place"),
    ("SITE", "Site on the Map", "Move the ground so that the place is the origin of the scene"),
)
_HINT = "Click on the ground to place the {}; Esc or right click to cancel"
#: Events that cancel the operator. Blender handles the events that turn and move the view.
_CANCELS = ("ESC", "RIGHTMOUSE")
_NOT_DUG = "; press Build Scene to dig it"
_DIGITS = 3  # digits of a place in metres: a millimetre
#: Cell size, m, of a workspace that had none: as in the shipped workspaces, a quarter of the scoop's width.
_FIRST_CELL_M = 0.02


def check_target(target: str, settings: Settings) -> None:
    """Raise IcyMoonError if a target cannot be placed with the present settings."""
    if target == "TRENCH" and settings.source.kind != "PROCEDURAL":
        raise IcyMoonError(REFUSED_FILE)
    if target == "TRENCH" and settings.excavation.path not in ("NONE", "LINE", "ARC"):
        raise IcyMoonError("The path of the scoop is recorded; set excavation.path to LINE to place a trench.")
    if target == "SITE" and settings.source.kind == "PROCEDURAL":
        raise IcyMoonError("Procedural ground has no site; place the camera instead, or import a height map.")


def make_placed(target: str, settings: Settings, x_m: float, y_m: float) -> Mapping[str, Mapping[str, Any]]:
    """Make the settings that put a target at ``x_m`` east and ``y_m`` north of the origin, in metres.

    Raises IcyMoonError if the target cannot be placed with the present settings.
    """
    check_target(target, settings)
    x, y = round(x_m, _DIGITS), round(y_m, _DIGITS)
    if target == "CAMERA":
        return {"rig": {"x_m": x, "y_m": y}}
    if target == "WORKSPACE":
        cells = {} if settings.workspace.cell_m > 0 else {"cell_m": _FIRST_CELL_M}
        return {"workspace": {"east_m": x, "north_m": y, **cells}}
    if target == "TRENCH":
        path = {"path": "LINE"} if settings.excavation.path == "NONE" else {}
        return {"excavation": {"start_x_m": x, "start_y_m": y, **path}}
    source = settings.source
    return {
        "source": {
            "origin_x_m": round(source.origin_x_m + x_m, _DIGITS),
            "origin_y_m": round(source.origin_y_m + y_m, _DIGITS),
        }
    }


def find_view(screen: bpy.types.Screen, x: int, y: int) -> tuple[bpy.types.Region, bpy.types.RegionView3D] | None:
    """Find the region of the 3D View at a window position, in px from below left; None outside all 3D Views."""
    for area in screen.areas:
        if area.type != "VIEW_3D":
            continue
        region = next(each for each in area.regions if each.type == "WINDOW")
        over = (each for each in area.regions if each.type != "WINDOW" and each.width > 1 and each.height > 1)
        if _contains(region, x, y) and not any(_contains(each, x, y) for each in over):
            return region, area.spaces.active.region_3d
    return None


def _contains(region: bpy.types.Region, x: int, y: int) -> bool:
    return region.x <= x < region.x + region.width and region.y <= y < region.y + region.height


def find_ground(context: bpy.types.Context, x: int, y: int) -> Vector | None:
    """Find the point of the built ground, in m, under a window position in px; None if there is no ground."""
    found = find_view(context.screen, x, y)
    if found is None:
        return None
    region, view = found
    at = (x - region.x, y - region.y)
    start, toward = region_2d_to_origin_3d(region, view, at), region_2d_to_vector_3d(region, view, at)
    role, distance, _ = cast_ray(context.scene, context.evaluated_depsgraph_get(), start, toward)
    return start + distance * toward if role else None


def _show_hint(context: bpy.types.Context, hint: str | None) -> None:
    """Show a hint in the status bar and in the headers of the 3D Views; None removes the hint."""
    context.workspace.status_text_set(hint)
    for _, area in list_areas("VIEW_3D"):
        area.header_text_set(hint)


def _describe_place(x_m: float, y_m: float) -> str:
    return f"Placed {x_m:.3f} m east and {y_m:.3f} m north of the origin"


class ICYMOON_OT_place_on_ground(ExplainedOperator, bpy.types.Operator):
    """Click on the ground to place something there. The view can be turned and moved before"""

    bl_idname = "icymoon.place_on_ground"
    bl_label = "Place by Click"
    bl_options = {"REGISTER", "UNDO"}

    target: bpy.props.EnumProperty(name="Target", description="What to place", items=TARGETS)
    x_m: bpy.props.FloatProperty(name="East", description="Metres east of the origin", subtype="DISTANCE")
    y_m: bpy.props.FloatProperty(name="North", description="Metres north of the origin", subtype="DISTANCE")

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return next(f"Click on the ground. {text}" for name, _, text in TARGETS if name == properties.target)

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if scenes.find_built(context.scene) else "There is no ground to click on; press Build Scene first"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Wait for a click on the ground."""
        try:
            check_target(self.target, scene_properties.read_settings(context.scene.icymoon))
        except IcyMoonError as error:
            return self._fail(error)
        context.window.cursor_modal_set("CROSSHAIR")
        label = next(label for name, label, _ in TARGETS if name == self.target)
        _show_hint(context, _HINT.format(label.lower()))
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type in _CANCELS and event.value == "PRESS":
            self._end(context)
            return {"CANCELLED"}
        if event.type != "LEFTMOUSE" or event.value != "PRESS":
            return {"PASS_THROUGH"}
        place = find_ground(context, event.mouse_x, event.mouse_y)
        if place is None:
            self.report({"WARNING"}, "There is no ground under the mouse; click on the ground, or press Esc")
            return {"RUNNING_MODAL"}
        self._end(context)
        if self.target == "TRENCH" and context.scene.icymoon.live:
            bpy.ops.icymoon.dig_trench("INVOKE_DEFAULT", x_m=place.x, y_m=place.y)
            return {"CANCELLED"}  # the undo step is the other operator's
        self.x_m, self.y_m = place.x, place.y
        return self.execute(context)

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop waiting. Blender calls this when the window closes or another file is opened."""
        self._end(context)

    def _end(self, context: bpy.types.Context) -> None:
        context.window.cursor_modal_restore()
        _show_hint(context, None)

    def _fail(self, error: IcyMoonError) -> set[str]:
        self.report({"ERROR"}, format_for_window(error))
        return {"CANCELLED"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        group = context.scene.icymoon
        try:
            placed = make_placed(self.target, scene_properties.read_settings(group), self.x_m, self.y_m)
            scene_properties.write_settings(group, placed)
        except IcyMoonError as error:
            return self._fail(error)
        said = _describe_place(self.x_m, self.y_m)
        if "cell_m" in placed.get("workspace", {}):
            said += f"; cells are {_FIRST_CELL_M:g} m wide"
        if self.target == "TRENCH":
            said += _NOT_DUG
        self.report({"INFO"}, show_controls(said))
        label = next(label for name, label, _ in TARGETS if name == self.target)
        place = f"{self.x_m:.2f} m east, {self.y_m:.2f} m north"
        session.note(f"{label} placed", place, context.scene.session_uid)  # its report is soon gone
        return {"FINISHED"}


class ICYMOON_OT_dig_trench(ChangeAndBuildOperator, bpy.types.Operator):
    """Let the scoop start at a place, and build the scene with its trench, which the live preview does not dig"""

    bl_idname = "icymoon.dig_trench"
    bl_label = "Place Trench"
    bl_options = {"UNDO", "INTERNAL"}

    x_m: bpy.props.FloatProperty(name="East", description="Metres east of the origin", subtype="DISTANCE")
    y_m: bpy.props.FloatProperty(name="North", description="Metres north of the origin", subtype="DISTANCE")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event | None) -> set[str]:
        """Build in pieces; without a window, at once."""
        try:
            settings = scene_properties.read_settings(context.scene.icymoon)
            self.change_settings(context.scene, make_placed("TRENCH", settings, self.x_m, self.y_m))
        except IcyMoonError as error:
            return self.fail(error)
        if bpy.app.background:
            return self.build_at_once(context)
        return WatchingOperator.invoke(self, context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.invoke(context, None)

    def make_steps(self, context: bpy.types.Context) -> Steps[list[tuple[str, str]]]:
        """Make the steps of the build. A scene that was edited by hand is not built again, since that would revert the
        edits."""
        if (yield from settle(partial(find_whether_edited, self._scene_uid))):
            return [("WARNING", f"{_describe_place(self.x_m, self.y_m)}; the scene was edited by hand{_NOT_DUG}")]
        settings = scene_properties.read_settings(require_scene(self._scene_uid).icymoon)
        return [
            *(yield from build_in_pieces(self._scene_uid, settings)),
            ("INFO", f"{_describe_place(self.x_m, self.y_m)}, and dug the trench"),
        ]


CLASSES = (ICYMOON_OT_place_on_ground, ICYMOON_OT_dig_trench)
