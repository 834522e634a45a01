"""What the evaluator found, brought back into Blender."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import bpy

from ..errors import IcyMoonError

_report: dict[str, Any] = {}
_folder: Path | None = None


def load(folder: Path) -> None:
    """Take in the ``report.json`` of a finished evaluation."""
    global _folder
    _report.clear()
    _report.update(json.loads((folder / "report.json").read_text(encoding="utf-8")))
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


def error_images() -> list[Path]:
    """The error images of the last evaluation that are on disk, those of the best matcher first."""
    if _folder is None:
        return []
    l1 = {row["method"]: row["l1_m"] for row in summary()}
    rows = [row for row in _report.get("rows", []) if row.get("images")]
    rows.sort(key=lambda row: math.inf if l1[row["method"]] is None else l1[row["method"]])
    paths = [_folder / row["images"]["error"] for row in rows]
    return [path for path in paths if path.is_file()]


def show_error_image(context: bpy.types.Context, open_window: bool) -> bool:
    """``show_images`` of the error images."""
    return show_images(context, error_images(), open_window)


def show_images(context: bpy.types.Context, paths: list[Path], open_window: bool) -> bool:
    """Load images and show the first in an Image Editor; False if there is no place.

    Without an Image Editor on the screen, ``open_window`` opens a window with one.
    """
    images = [bpy.data.images.load(str(path), check_existing=True) for path in paths]
    if not images or bpy.app.background:
        return False
    for image in images:
        image.reload()
    areas = [a for w in context.window_manager.windows for a in w.screen.areas if a.type == "IMAGE_EDITOR"]
    if not areas and open_window:
        before = set(context.window_manager.windows)
        bpy.ops.wm.window_new()
        window = next(w for w in context.window_manager.windows if w not in before)
        areas = [window.screen.areas[0]]
        areas[0].type = "IMAGE_EDITOR"
    for area in areas[:1]:
        area.spaces.active.image = images[0]
        window = next(w for w in context.window_manager.windows if area in w.screen.areas[:])
        region = next(r for r in area.regions if r.type == "WINDOW")
        with context.temp_override(window=window, area=area, region=region):
            bpy.ops.image.view_all(fit_view=True)
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


CLASSES = (ICYMOON_OT_show_error, ICYMOON_OT_open_report)
