"""Charts of the mean error against each setting that varies.

With two settings that were varied on purpose, the chart of one has a line for each value of the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

from ...settings.table import TOPICS
from ...support.arrays import Array
from ...support.files import write_atomically
from ...support.number_text import format_count
from .averaged_settings import describe_averaging
from .by_setting import SCENE_SWEEP, VariedSetting, average_by_level, find_noisy_levels
from .charts import (
    METHOD_DASHES,
    METHOD_MARKS,
    STYLE,
    Summary,
    add_legend,
    add_panel,
    iterate_methods,
    make_figure,
    start_axis_at_zero,
)
from .summary import ResultTable
from .varied_on_purpose import FactorLines, choose_lines

#: Metrics that are drawn against varied settings, with factor and name.
SWEPT_METRICS = (("l1_m", 1.0, "Mean absolute depth error (m)"), ("total_bad_1", 100.0, "% missing or > 1 px"))
#: Maximum number of settings that are drawn.
MAX_SWEEPS = 16
#: Maximum number of methods for charts with a line for each value of another setting: each method has separate charts.
_MAX_SPLIT = 6
#: Maximum number of settings that are named as varying together with another one.
_MAX_NAMED = 5
#: Height of a chart in inches, and shares by which a method's colour is made lighter and darker for its lines.
_HEIGHT_IN, _LIGHTER_SHARE, _DARKER_SHARE = 2.9, 0.55, 0.12
#: Characters in a line of a tick's label, and most characters of the label.
_TICK_LINE_CHARACTERS, _MAX_TICK_CHARACTERS = 14, 28
#: For a picture, which no page colours.
ON_WHITE: dict[Any, Any] = {
    "axes.edgecolor": "#888888",
    "axes.labelcolor": "#222222",
    "text.color": "#222222",
    "xtick.color": "#222222",
    "ytick.color": "#222222",
    "grid.color": "#dddddd",
}
_DPI = 120


@dataclass(frozen=True)
class SweepCharts:
    """The charts of a setting that varies, as SVG in rows, with a caption.

    ``of_all`` is true if every chart shows all methods, which then need a legend.
    """

    caption: str
    rows: list[list[str]]
    of_all: bool


def draw_sweeps(summary: Summary, table: ResultTable, sweeps: Sequence[VariedSetting]) -> list[SweepCharts]:
    """Draw mean error and wrong pixels against each setting that varies, with 95 % intervals.

    ``sweeps`` are all settings that vary; the first ``MAX_SWEEPS`` are drawn.
    """
    drawn = []
    with matplotlib.rc_context(STYLE):
        for sweep in sweeps[:MAX_SWEEPS]:
            lines = _choose_sweep_lines(sweep, sweeps, summary)
            rows = (
                _draw_methods_apart(sweep, lines, summary, table)
                if lines
                else [_draw_methods_together(sweep, summary, table)]
            )
            drawn.append(SweepCharts(_make_caption(sweep, lines, sweeps, table), rows, lines is None))
    return drawn


def write_curves(summary: Summary, table: ResultTable, sweeps: Sequence[VariedSetting], out: Path) -> dict[str, str]:
    """Write a picture of the mean error against each varied setting; return the paths relative to ``out``, by setting.

    The pictures are for programs that show no HTML, such as Blender.
    """
    curves = {}
    for sweep in sweeps[:MAX_SWEEPS]:
        topic, _, key = sweep.name.partition(".")
        if topic not in TOPICS or key not in {s.key for s in TOPICS[topic].settings}:
            continue  # a setting of another version, whose name may not be the name of a file
        lines = _choose_sweep_lines(sweep, sweeps, summary)
        with matplotlib.rc_context({**STYLE, **ON_WHITE}):
            figure, axes = make_figure(2, len(summary) if lines else 1, width=9.6, height=3.6 if lines else 4.2)
            for column, metric in zip(axes.T, SWEPT_METRICS, strict=True):
                if lines:
                    for axis, (k, _, look) in zip(column, iterate_methods(summary), strict=True):
                        _draw_lines(sweep, lines, axis, metric, table, k, look)
                        axis.set_title(look["label"], loc="left")
                        axis.set_ylim(0, _find_axis_top(sweep, lines, metric, len(summary), table))
                else:
                    _draw_sweep(sweep, column[0], metric, summary, table)
            if lines:
                _add_line_legend(axes[0, 0], lines)
            else:
                add_legend(figure, axes[0, 0], len(summary))
            curves[sweep.name] = f"curves/{sweep.name}.png"
            write_picture(figure, out / curves[sweep.name])
    return curves


def write_picture(figure: Figure, path: Path) -> None:
    """Write a figure that was drawn with ``ON_WHITE`` as PNG."""
    write_atomically(path, partial(figure.savefig, format="png", dpi=_DPI, facecolor="white"))


def _choose_sweep_lines(sweep: VariedSetting, sweeps: Sequence[VariedSetting], summary: Summary) -> FactorLines | None:
    """Choose the lines of a setting's charts, one for each value of another setting. None without such a setting or
    with too many methods.
    """
    return choose_lines(sweep, sweeps) if len(summary) <= _MAX_SPLIT else None


def _draw_methods_together(sweep: VariedSetting, summary: Summary, table: ResultTable) -> list[str]:
    """Draw a chart of each metric with all methods."""
    found: list[str] = []
    for metric in SWEPT_METRICS:
        with add_panel(found, f"sweeps-{sweep.name}-", "", height=_HEIGHT_IN) as axis:
            _draw_sweep(sweep, axis, metric, summary, table)
    return found


def _draw_methods_apart(
    sweep: VariedSetting, lines: FactorLines, summary: Summary, table: ResultTable
) -> list[list[str]]:
    """Draw, for each metric, a chart of each method, all in one scale, with a line for each value of another
    setting.
    """
    rows = []
    for metric in SWEPT_METRICS:
        found: list[str] = []
        top = _find_axis_top(sweep, lines, metric, len(summary), table)
        for k, _, look in iterate_methods(summary):
            with add_panel(found, f"sweeps-{sweep.name}-{metric[0]}-", look["label"], height=_HEIGHT_IN + 0.5) as axis:
                _draw_lines(sweep, lines, axis, metric, table, k, look)
                axis.set_ylim(0, top)
                _add_line_legend(axis, lines)
        rows.append(found)
    return rows


def _make_caption(
    sweep: VariedSetting, lines: FactorLines | None, sweeps: Sequence[VariedSetting], table: ResultTable
) -> str:
    """Make the caption of a setting's charts: its title, the pairs of the means, and settings that vary together."""
    point = sweep.levels()[2]
    if lines:
        point = np.where((point >= 0) & (lines.of >= 0), point * len(lines.names) + lines.of, -1)
    used = [sweep, *([lines.factor] if lines else [])]
    parts = [f"{sweep.title}. {describe_averaging(point, used, sweeps, table)}"]
    if lines:
        groups = f", whose values form {len(lines.names)} groups" if lines.grouped else ""
        others = format_count(len(lines.factor.together), "more setting")
        joined = f", with which {others} {'varies' if len(lines.factor.together) == 1 else 'vary'}"
        parts.append(
            f"A line for each {'group' if lines.grouped else 'value'} of {lines.factor.title}{groups}"
            f"{joined if lines.factor.together else ''}."
        )
    if sweep.together:
        named = list(sweep.together[:_MAX_NAMED])
        if more := len(sweep.together) - len(named):
            named.append(format_count(more, "more setting"))
        parts.append(
            f"It varies together with {' and '.join(filter(None, [', '.join(named[:-1]), named[-1]]))}, so "
            "their effects cannot be separated."
        )
    return " ".join(parts)


def _draw_sweep(
    sweep: VariedSetting, axis: Axes, metric: tuple[str, float, str], summary: Summary, table: ResultTable
) -> None:
    """Draw one of ``SWEPT_METRICS`` against a setting that varies, with 95 % intervals."""
    for k, _, look in iterate_methods(summary):
        _draw_means(sweep, axis, metric, table, k, (k, len(summary)), {**look, "linestyle": _make_line_style(sweep)})
    _finish_axis(sweep, axis, metric[2], table)
    start_axis_at_zero(axis)


def _draw_lines(
    sweep: VariedSetting,
    lines: FactorLines,
    axis: Axes,
    metric: tuple[str, float, str],
    table: ResultTable,
    method: int,
    look: dict[str, Any],
) -> None:
    """Draw one of ``SWEPT_METRICS`` for one method, with a line for each value of another setting."""
    for n, (name, colour) in enumerate(zip(lines.names, _make_shades(look["color"], len(lines.names)), strict=True)):
        style = {
            "color": colour,
            "marker": METHOD_MARKS[n % len(METHOD_MARKS)],
            "label": name,
            "linestyle": METHOD_DASHES[n % len(METHOD_DASHES)] if sweep.numeric else "",
        }
        _draw_means(sweep, axis, metric, table, method, (n, len(lines.names)), style, lines.of == n)
    _finish_axis(sweep, axis, metric[2], table)


def _draw_means(
    sweep: VariedSetting,
    axis: Axes,
    metric: tuple[str, float, str],
    table: ResultTable,
    method: int,
    place: tuple[int, int],
    look: dict[str, Any],
    among: Array | None = None,
) -> None:
    """Draw the means of a method with their intervals; ``place`` is (k, n), its position k beside n methods or
    lines.
    """
    _, places, _ = sweep.levels()
    key, factor, _ = metric
    mean, bounds = average_by_level(sweep, table, method, key, among)
    step = (0.012 if sweep.numeric else 0.05) * float(np.ptp(places)) or 0.1
    known = ~np.isnan(mean)  # a line goes on over a value that it lacks
    bars = np.nan_to_num(np.abs(bounds.T - mean))
    axis.errorbar(
        (places + (place[0] - (place[1] - 1) / 2) * step)[known],
        factor * mean[known],
        factor * bars[:, known],
        capsize=2.5,
        elinewidth=1,
        **look,
    )


def _make_line_style(sweep: VariedSetting) -> str:
    return "-" if sweep.numeric else ""


def _finish_axis(sweep: VariedSetting, axis: Axes, label: str, table: ResultTable) -> None:
    """Label the axes of a chart, and mark the values at which noise of the render decides."""
    names, places, _ = sweep.levels()
    noisy = find_noisy_levels(sweep, table)
    if not sweep.numeric or len(names) <= 6:
        axis.set_xticks(places, list(map(_wrap_tick_label, names)))
    axis.margins(x=0.08 if sweep.numeric else 0.25)
    half = 0.35 * float(np.diff(np.sort(places)).min()) if len(places) > 1 else 0.1
    for place in places[noisy]:
        axis.axvspan(
            place - half, place + half, color=matplotlib.rcParams["grid.color"], alpha=0.6, linewidth=0, zorder=0
        )
    others = f", and {len(sweep.together)} more that vary with it" if sweep.together else ""
    title = "" if sweep.name == SCENE_SWEEP else sweep.title + others
    axis.set_xlabel(title + ("\nbands: noise of the render decides" if noisy.any() else ""))
    axis.set_ylabel(label)


def _wrap_tick_label(name: str) -> str:
    """Wrap a name below an axis to two lines if it is long."""
    short = name if len(name) <= _MAX_TICK_CHARACTERS else f"{name[: _MAX_TICK_CHARACTERS - 1]}…"
    space = short.rfind(" ", 0, _TICK_LINE_CHARACTERS + 1)
    return short if len(short) <= _TICK_LINE_CHARACTERS or space < 0 else f"{short[:space]}\n{short[space + 1 :]}"


def _find_axis_top(
    sweep: VariedSetting, lines: FactorLines, metric: tuple[str, float, str], methods: int, table: ResultTable
) -> float:
    """Find the upper limit of the axis of a metric, the same for all methods."""
    key, factor, _ = metric
    tops = [0.0]
    for method in range(methods):
        for n in range(len(lines.names)):
            mean, bounds = average_by_level(sweep, table, method, key, lines.of == n)
            tops += [float(value) for value in (*mean, *bounds[:, 1]) if np.isfinite(value)]
    return 1.08 * factor * max(tops) or 1.0


def _add_line_legend(axis: Axes, lines: FactorLines) -> None:
    """Add a legend of the lines above a chart, titled with the setting whose values they show."""
    handles, labels = axis.get_legend_handles_labels()
    axis.figure.legend(
        handles,
        labels,
        title=lines.factor.title,
        loc="outside upper left",
        alignment="left",
        ncols=6 if max(map(len, labels)) < 6 else 3 if max(map(len, labels)) < 14 else 2,
        handlelength=2.6,
    )


def _make_shades(colour: str, count: int) -> list[str]:
    """Make ``count`` shades of a colour, from a lighter one to a darker one."""
    base = np.array(to_rgb(colour))
    parts = np.linspace(_LIGHTER_SHARE, -_DARKER_SHARE, count) if count > 1 else np.zeros(1)
    return [to_hex(base + part * (1 - base) if part > 0 else base * (1 + part)) for part in parts]
