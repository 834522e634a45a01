"""The table of Stereo Error: for each matcher, its rank, its metrics and the buttons that show its errors. The meanings
of the names are below."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import bpy

from ..nodes import measured_surface, painted_errors
from ..operators import results
from ..stereo.inference.typical_scene import count_scenes_for_methods
from ..stereo.matchers.methods import describe_method
from ..stereo.report.table_columns import NO_RESULT, RANKING_METRIC, format_rank, is_best
from .fields import draw_lines, draw_sentence, draw_start

#: Share of a line that the name of a metric takes.
_NAME_SHARE = 0.62
#: Definition of wrong pixels, drawn above the table.
WRONG = "Wrong: off by over 1 px, or missing"


def draw_errors(layout: bpy.types.UILayout, scene: bpy.types.Scene, rows: Sequence[Mapping[str, Any]]) -> None:
    """Draw the matchers, fewest wrong pixels first. A star marks the best if the scenes allow a ranking.

    The meanings of shown colours are below the buttons of their matcher, where the user looks. The matchers are not in
    boxes, because text in a box has too little contrast in the light theme.
    """
    legends = _list_legends(scene)
    for row in rows:
        layout.separator(factor=0.5)
        column = layout.column(align=True)
        _draw_name(column, row, rows)
        if row["n"]:
            for name, value in _list_main_metrics(row):
                _draw_metric(column, name, value)
            column.separator(factor=0.5)
            for name, value in _list_other_metrics(row):  # not grey: the light theme's grey cannot be read
                _draw_metric(column, name, value)
        _draw_buttons(column, scene, row["method"])
        _draw_legends(column, scene, legends.pop(describe_method(row["method"]), ()))
    for lines in legends.values():  # legends of matchers that are not in the last evaluation
        _draw_legends(layout.column(align=True), scene, lines)


def _list_legends(scene: bpy.types.Scene) -> dict[str, tuple[tuple[str, str], ...]]:
    """List the lines of the legends of the shown errors and surface, by the name of their matcher."""
    found: dict[str, tuple[tuple[str, str], ...]] = {}
    for shown in (painted_errors, measured_surface):
        if lines := shown.make_legend(scene):
            title = shown.find_title(scene)
            found[title] = (*found.get(title, ()), *lines)
    return found


def _draw_legends(column: bpy.types.UILayout, scene: bpy.types.Scene, lines: Sequence[tuple[str, str]]) -> None:
    """Draw the error that has the full colour, and the lines of a legend; without lines, nothing."""
    if not lines:
        return
    column.prop(scene.icymoon, "error_range_m", slider=True)
    for meaning, icon in lines:
        draw_sentence(column, meaning, icon)


def explain_errors(layout: bpy.types.UILayout, scene: bpy.types.Scene, rows: Sequence[Mapping[str, Any]]) -> None:
    """Draw the meanings of the names in the table, and sentences on typical differences and rare heavy failures."""
    draw_sentence(layout, "Metrics below Covered are of covered pixels.")
    draw_sentence(
        layout,
        "Wrong order (DOD): share of pairs of pixels of which the wrong one is nearer. Shape "
        "error (si-RMSE): spread of the ratio of measured to true depth, blind to scale.",
    )
    if any(row["ranks"] for row in rows):
        draw_sentence(
            layout,
            "Rank: by wrong pixels in the typical scene; a range if the scenes leave it open. "
            "Star: no matcher is significantly better, and at least one is significantly worse.",
        )
    elif (count := sum(bool(row["n"]) for row in rows)) > 1:
        draw_sentence(layout, f"A ranking needs {count_scenes_for_methods(count)} scenes.")
    for sentence in results.list_typical_differences(scene):
        draw_sentence(layout, sentence)
    for sentence in results.list_rare_failures(scene):
        draw_lines(layout, (sentence,), "ERROR")


def _draw_name(column: bpy.types.UILayout, row: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> None:
    line = column.row()
    line.label(text=describe_method(row["method"]))
    if not row["n"]:
        line.label(text=NO_RESULT)
    elif row["ranks"]:
        line.label(
            text=f"Rank {format_rank(row, RANKING_METRIC)}",
            icon="SOLO_ON" if is_best(row, RANKING_METRIC, rows) else "NONE",
        )


def _list_main_metrics(row: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    return ("Wrong", results.format_percent(row["total_bad_1"])), ("Covered", results.format_percent(row["coverage"]))


def _list_other_metrics(row: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    return (
        ("Mean L1 error", results.format_metres(row["l1_m"])),
        ("Over 10 cm off", results.format_percent(row["l1_rate_10"])),
        ("Wrong order", results.format_percent(row["dod"])),
        ("Shape error", results.format_number(row["si_rmse"], 4)),
    )


def _draw_metric(column: bpy.types.UILayout, name: str, value: str) -> None:
    """Draw a name, and its value at the right of the line, so that the values of all lines are aligned."""
    line = column.split(factor=_NAME_SHARE)
    line.label(text=name)
    right = line.row()
    right.alignment = "RIGHT"
    right.label(text=value)


def _draw_buttons(column: bpy.types.UILayout, scene: bpy.types.Scene, method: str) -> None:
    """Draw a button for each way to see the errors of a matcher. It is grey if the evaluation kept no file for it."""
    buttons = column.column(align=True)  # in one row, words with a verb would be cut

    def draw_part(methods: Collection[str]) -> bpy.types.UILayout:
        part = buttons.row(align=True)
        part.enabled = method in methods
        return part

    images, disparities = results.list_methods_with_error_images(scene), results.list_methods_with_disparities(scene)
    draw_part(images).operator("icymoon.show_error", text="Show Error Image").method = method
    draw_start(draw_part(disparities), "icymoon.paint_errors", "Paint Errors on Ground", method=method)
    surface = draw_part(results.list_methods_with_points(scene))
    surface.operator("icymoon.show_surface", text="Show Surface").method = method
