"""What the evaluator found, brought back into Blender."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import bpy

from ..errors import IcyMoonError
from ..nodes.points import build_points, clear_points, find_points
from .jobs import push_undo

_report: dict[str, Any] = {}
_folder: Path | None = None


def load(folder: Path) -> None:
    """Take in a finished evaluation: its ``summary.json``, or where there is none its whole ``report.json``."""
    global _folder
    brief = folder / "summary.json"
    report = json.loads((brief if brief.is_file() else folder / "report.json").read_text(encoding="utf-8"))
    _report.clear()
    _report.update(report)
    _folder = folder


def clear() -> None:
    """Forget the last evaluation."""
    global _folder
    _report.clear()
    _folder = None


def summary() -> list[dict[str, Any]]:
    """One row of metrics per matcher of the last evaluation; empty if there was none."""
    return list(_report.get("summary", []))


def report_page() -> Path | None:
    """The HTML report of the last evaluation."""
    return _folder / "report.html" if _folder else None


def number(value: float | None, digits: int) -> str:
    """A metric for people; a metric over no pixels is a dash."""
    return "-" if value is None else f"{value:.{digits}f}"


def percent(value: float | None) -> str:
    """A fraction as per cent; a metric over no pixels is a dash."""
    return "-" if value is None else f"{100 * value:.1f} %"


def _files(kind: str) -> list[tuple[str, Path]]:
    """(matcher, file) of the files of a kind that are on disk, those of the best matcher first."""
    if _folder is None:
        return []
    l1 = {row["method"]: row["l1_m"] for row in summary()}
    rows = [row for row in _report.get("shown", _report.get("rows", [])) if kind in row.get("images", {})]
    rows.sort(key=lambda row: math.inf if l1[row["method"]] is None else l1[row["method"]])
    paths = [(row["method"], _folder / row["images"][kind]) for row in rows]
    return [(method, path) for method, path in paths if path.is_file()]


def error_images() -> list[Path]:
    """The error images of the last evaluation that are on disk, those of the best matcher first."""
    return [path for _, path in _files("error")]


def depth_images() -> list[Path]:
    """The measured depth images of the last evaluation that are on disk, those of the best matcher first."""
    return [path for _, path in _files("depth")]


def point_files(method: str) -> list[Path]:
    """The measured surfaces of a matcher, of each pair that was evaluated."""
    return [path for name, path in _files("points") if name == method]


def methods_with_points() -> list[str]:
    """The matchers whose measured surface can be shown, the best first."""
    return list(dict.fromkeys(method for method, _ in _files("points")))


def show_error_image(context: bpy.types.Context, open_window: bool) -> bool:
    """``show_images`` of the error images, with the depth images to choose from too."""
    errors = error_images()
    return show_images(context, [*errors, *depth_images()] if errors else [], open_window)


def show_images(context: bpy.types.Context, paths: list[Path], open_window: bool) -> bool:
    """Load images and show the first in an Image Editor, which is a step that undo takes back; False if there is no
    place.

    Without an Image Editor on the screen, ``open_window`` opens a window with one.
    """
    if not paths or bpy.app.background:
        return False
    areas = [a for w in context.window_manager.windows for a in w.screen.areas if a.type == "IMAGE_EDITOR"]
    if not areas and open_window:
        before = set(context.window_manager.windows)
        bpy.ops.wm.window_new()
        window = next(w for w in context.window_manager.windows if w not in before)
        areas = [window.screen.areas[0]]
        areas[0].type = "IMAGE_EDITOR"
    images = [bpy.data.images.load(str(path), check_existing=True) for path in paths if areas]
    for image in images:
        image.reload()
    for area in areas[:1]:
        area.spaces.active.image = images[0]
        window = next(w for w in context.window_manager.windows if area in w.screen.areas[:])
        region = next(r for r in area.regions if r.type == "WINDOW")
        with context.temp_override(window=window, area=area, region=region):
            bpy.ops.image.view_all(fit_view=True)
        push_undo("Show Images")
    return bool(areas)


class _ResultOperator:
    """Mix-in: there must be a result to show."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not _report:
            cls.poll_message_set("Nothing has been evaluated yet")  # type: ignore[attr-defined]
        return bool(_report)


class ICYMOON_OT_show_error(_ResultOperator, bpy.types.Operator):
    """Show where and by how much the matcher is wrong, in an Image Editor"""

    bl_idname = "icymoon.show_error"
    bl_label = "Show Error Image"

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not error_images():
            self.report({"ERROR"}, "The error images are gone from the disk; press Evaluate again.")
            return {"CANCELLED"}
        show_error_image(context, open_window=True)
        return {"FINISHED"}


class ICYMOON_OT_open_report(_ResultOperator, bpy.types.Operator):
    """Open the report of the last evaluation in the web browser"""

    bl_idname = "icymoon.open_report"
    bl_label = "Open Report"

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            page = report_page()
            if page is None or not page.is_file():
                raise IcyMoonError("The report is gone from the disk; press Evaluate again.")
        except IcyMoonError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        bpy.ops.wm.url_open(url=page.as_uri())
        return {"FINISHED"}


def show_points(context: bpy.types.Context, item: bpy.types.Object) -> None:
    """Let the 3D View the button was pressed in show an object's own colours, also beside a local view."""
    space = context.space_data
    if context.area is None or context.area.type != "VIEW_3D":
        return
    if space.local_view is not None:
        item.local_view_set(space, True)
    space.shading.color_type = "VERTEX"  # of Solid shading; the others show the material


class ICYMOON_OT_show_surface(_ResultOperator, bpy.types.Operator):
    """Show the surface that a matcher measured in front of the true ground, coloured by its error: red is too far, blue too near, full at 1 m, white below 1 cm"""  # noqa: E501

    bl_idname = "icymoon.show_surface"
    bl_label = "Show Measured Surface"
    bl_options = {"REGISTER", "UNDO"}

    method: bpy.props.StringProperty(name="Matcher", description="Whose surface; empty for the most accurate")  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        method = self.method or next(iter(methods_with_points()), "")
        try:
            paths = point_files(method)
            if not paths:
                raise IcyMoonError("There are no measured surfaces of this evaluation; press Evaluate, which writes "
                                   "those of the present scene.")
            item = build_points(context.scene, paths, method)
        except IcyMoonError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        show_points(context, item)
        self.report({"INFO"}, f"{len(item.data.polygons)} points measured by {method}")
        return {"FINISHED"}


class ICYMOON_OT_hide_surface(bpy.types.Operator):
    """Remove the measured surface"""

    bl_idname = "icymoon.hide_surface"
    bl_label = "Remove Measured Surface"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        found = find_points(context.scene) is not None
        if not found:
            cls.poll_message_set("No measured surface is shown")
        return found

    def execute(self, context: bpy.types.Context) -> set[str]:
        clear_points(context.scene)
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_show_error, ICYMOON_OT_open_report, ICYMOON_OT_show_surface, ICYMOON_OT_hide_surface)
