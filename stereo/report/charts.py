"""The charts of the report as SVG text, drawn by Matplotlib in the colours of the page."""

from __future__ import annotations

import io
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ...files import write_atomically
from ...settings.table import TOPICS
from ..measure import by_pixel_class
from ..measure.metrics import ERROR_STEPS_M, SHARES
from .by_setting import Sweep, decided_by_noise, mean_by_level
from .phase_curves import PHASE_DEG
from .summary import Table

#: After Okabe and Ito, distinct for colour-blind eyes; visible on a white and on a black page.
COLOURS = ("#2a86c8", "#d55e00", "#009e73", "#c0699a", "#c98a00", "#6f7f8f")
_MARKS = ("o", "s", "^", "D", "v", "P")
_INK, _LINE = "#010203", "#040506"  # placeholders for the colours of the page, which the browser fills in
STYLE: dict[Any, Any] = {
    "font.size": 9, "axes.edgecolor": _LINE, "axes.labelcolor": _INK, "text.color": _INK, "xtick.color": _INK,
    "ytick.color": _INK, "grid.color": _LINE, "axes.grid": True, "grid.linewidth": 0.8, "axes.spines.top": False,
    "axes.spines.right": False, "legend.frameon": False, "svg.fonttype": "none", "lines.linewidth": 1.8,
    "lines.markersize": 4, "axes.titlesize": 9.5, "figure.constrained_layout.use": True,
    # Text from a data set is no formula, and a file called matplotlibrc in the current folder must not start LaTeX.
    "text.parse_math": False, "text.usetex": False}
#: The same for a picture, which no page colours.
_ON_WHITE: dict[Any, Any] = {"axes.edgecolor": "#888888", "axes.labelcolor": "#222222", "text.color": "#222222",
                             "xtick.color": "#222222", "ytick.color": "#222222", "grid.color": "#dddddd"}
_DPI = 120
#: Most settings that are drawn.
MOST_SWEEPS = 16
#: Classes with fewer true pixels than this are not drawn.
_FEWEST = 200

Summary = Sequence[Mapping[str, Any]]


def _methods(summary: Summary) -> Iterator[tuple[int, Mapping[str, Any], dict[str, Any]]]:
    """(number, entry, style of its curve) of each method."""
    for k, (entry, colour, mark) in enumerate(zip(summary, itertools.cycle(COLOURS), itertools.cycle(_MARKS))):
        yield k, entry, {"color": colour, "marker": mark, "label": entry["method"]}


def make_figure(columns: int, rows: int = 1, width: float = 10.4, height: float = 3.1) -> tuple[Figure, np.ndarray]:
    """Make a figure of axes (rows, columns) without background, ``width`` inches wide and ``height`` per row."""
    figure = Figure(figsize=(width, height * rows), facecolor="none")
    FigureCanvasSVG(figure)
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_facecolor("none")
    return figure, axes


def render_svg(figure: Figure, name: str, title: str) -> str:
    """Render a figure for an HTML page: without prologue, as wide as its place, in the page's colours of text and
    lines."""
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = stream.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg"):], flags=re.DOTALL)
    text = re.sub(r'(<svg [^>]*?)width="[^"]*"', rf'\1class="chart" role="img" aria-label="{title}"', text, count=1)
    text = re.sub(r'(<svg [^>]*?)height="[^"]*"', r"\1", text, count=1)
    text = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font: \1px var(--sans)", text)
    text = re.sub(r'\bid="(figure|axes|patch|line2d|text|xtick|ytick|matplotlib\.axis|LineCollection|legend|'
                  r'PathCollection|FillBetweenPolyCollection|PolyCollection)_\d+"', "", text)
    return text.replace(_INK, "var(--soft)").replace(_LINE, "var(--line)")


def add_legend(figure: Figure, axis: Axes, count: int) -> None:
    """Add a legend above the figure, of what ``axis`` shows."""
    handles, labels = axis.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=min(5, max(1, count)), handlelength=1.6)


def _set_percent_axis(axis: Axes, label: str) -> None:
    axis.set_ylim(-2, 102)
    axis.set_ylabel(label)


def set_logarithmic(axis: Axes, which: str) -> None:
    """Make the axis ``which`` ("x" or "y") logarithmic if it shows anything above zero."""
    if not any((np.asarray(getattr(line, f"get_{which}data")()) > 0).any() for line in axis.lines):
        return  # Matplotlib cannot draw a logarithmic axis without a value on it
    getattr(axis, f"set_{which}scale")("log")
    along = getattr(axis, f"{which}axis")
    along.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=12))
    along.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    along.set_minor_formatter(NullFormatter())


def draw_charts(summary: Summary, table: Table, sweeps: Sequence[Sweep],
                laws: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Draw all charts: SVG text by name, ``errors``, ``range``, ``strata``, ``sweeps`` and ``phase``; empty if there is
    nothing to draw. ``laws``: see ``phase_curves.phase_curves``."""
    with matplotlib.rc_context(STYLE):
        return {"errors": _draw_errors(summary), "range": _draw_range(summary), "strata": _draw_pixel_classes(summary),
                "sweeps": _draw_sweeps(summary, table, sweeps[:MOST_SWEEPS]), "phase": _draw_phase_curves(laws)}


def _draw_phase_curves(laws: Mapping[str, np.ndarray]) -> str:
    """Draw phase curves, over all phase angles and near opposition."""
    if not laws:
        return ""
    figure, ((near, all_),) = make_figure(2, height=3.4 + 0.22 * (len(laws) - 1))  # a line of the legend for each
    for (name, bright), colour in zip(laws.items(), itertools.cycle(COLOURS)):
        for axis, last in ((near, 8.0), (all_, PHASE_DEG[-1])):
            shown = last >= PHASE_DEG
            axis.plot(PHASE_DEG[shown], bright[shown], color=colour, label=name)
    for axis, title in ((near, "Opposition"), (all_, "All phases")):
        axis.set_xlabel("phase angle (°)")
        axis.set_title(title, loc="left")
    near.set_ylabel("disc brightness over that at 0°")
    all_.set_ylim(bottom=0)
    handles, labels = near.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=1, handlelength=1.6)
    return render_svg(figure, "phase", "Phase curves of the surfaces")


def _draw_errors(summary: Summary) -> str:
    """Draw the cumulative error, and the error against the share of measurements kept, the most textured first."""
    if not any(entry["error_curve"] for entry in summary):
        return ""
    figure, ((left, right),) = make_figure(2, height=3.4)
    for _, entry, look in _methods(summary):
        line = look | {"marker": ""}
        if entry["error_curve"]:
            left.plot(ERROR_STEPS_M, 100 * np.array(entry["error_curve"]), **line)
        if entry["sparsification"]["texture"]:
            right.plot(100 * np.array(SHARES), entry["sparsification"]["texture"], **line)
            right.plot(100 * np.array(SHARES), entry["sparsification"]["best"], **line | {"label": "_"}, linestyle=":")
    set_logarithmic(left, "x")
    _set_percent_axis(left, "% of all true pixels within it")
    left.set_xlabel("depth error (m)")
    left.set_title("Cumulative error; ends at the coverage", loc="left")
    right.set_xlabel("% of measurements kept, the most textured first")
    right.set_ylabel("mean disparity error (px)")
    right.set_ylim(bottom=0)
    right.set_title("Coverage against error; dotted: best possible order", loc="left")
    add_legend(figure, left, len(summary))
    return render_svg(figure, "errors", "Cumulative error, and error against coverage")


def _has_enough(sums: Mapping[str, Any]) -> np.ndarray:
    return np.array(sums["true"]) >= _FEWEST


def _wrong_percent(sums: Mapping[str, Any]) -> np.ndarray:
    """% of the true pixels of each class that are missing or wrong by more than 1 px."""
    true = np.maximum(np.array(sums["true"]), 1)
    return np.asarray(100 * (true - np.array(sums["n"]) + np.array(sums["bad_1"])) / true)


def _draw_range(summary: Summary) -> str:
    """Draw error against range, with the law Z² / (f·B) · σ, and coverage and wrong pixels against range."""
    entries = [entry for entry in summary if "range" in entry["strata"] and _has_enough(entry["strata"]["range"]).any()]
    if not entries:
        return ""
    bounds = by_pixel_class.RANGE.bounds
    middle = np.array([bounds[0] / 1.2, *np.sqrt(np.multiply(bounds[1:], bounds[:-1])), bounds[-1] * 1.2])
    figure, ((error, coverage, wrong),) = make_figure(3, height=3.3)
    for _, entry, look in _methods(summary):
        sums = entry["strata"].get("range")
        if sums is None:
            continue
        known = _has_enough(sums) & (np.array(sums["n"]) > 0)
        n = np.maximum(np.array(sums["n"]), 1)
        error.plot(middle[known], (np.array(sums["l1_m"]) / n)[known], **look)
        fine = sum(sums["fine"])
        if fine:
            sigma = sum(sums["fine_epe_px"]) / fine
            error.plot(middle[known], (sigma * np.array(sums["m_per_px"]) / n)[known], color=look["color"],
                       linestyle="--", linewidth=1.1)
        known = _has_enough(sums)
        coverage.plot(middle[known], 100 * (np.array(sums["n"]) / np.maximum(sums["true"], 1))[known], **look)
        wrong.plot(middle[known], _wrong_percent(sums)[known], **look)
    for axis in (error, coverage, wrong):
        set_logarithmic(axis, "x")
        axis.set_xlabel("true depth (m)")
    set_logarithmic(error, "y")
    error.set_ylabel("mean depth error (m)")
    error.set_title("Error; dashed: Z² / (f·B) · σ", loc="left")
    _set_percent_axis(coverage, "% measured")
    coverage.set_title("Coverage", loc="left")
    _set_percent_axis(wrong, "% missing or off by > 1 px")
    wrong.set_title("Wrong or missing", loc="left")
    add_legend(figure, error, len(summary))
    return render_svg(figure, "range", "Error, coverage and wrong pixels against range")


def _draw_pixel_classes(summary: Summary) -> str:
    """Draw wrong or missing pixels by their class, for all factors but range."""
    factors = [factor for factor in by_pixel_class.FACTORS if factor.key != "range" and any(
        _has_enough(entry["strata"][factor.key]).sum() > 1 for entry in summary if factor.key in entry["strata"])]
    if not factors:
        return ""
    columns = min(3, len(factors))
    rows = math.ceil(len(factors) / columns)
    figure, axes = make_figure(columns, rows, height=2.8)
    for factor, axis in itertools.zip_longest(factors, axes.flat):
        if factor is None:
            axis.set_visible(False)
            continue
        places = np.arange(len(factor.classes))
        shown = np.zeros(len(places), bool)
        for k, entry, look in _methods(summary):
            sums = entry["strata"].get(factor.key)
            if sums is not None:
                known = _has_enough(sums)
                shown |= known
                aside = (k - (len(summary) - 1) / 2) * 0.12 if factor.names else 0.0
                axis.plot(places[known] + aside, _wrong_percent(sums)[known], **look,
                          linestyle="" if factor.names else "-")
        axis.set_xticks(places[shown], np.array(factor.classes)[shown], rotation=0 if factor.names else 35)
        axis.set_xlim(places[shown].min() - 0.4, places[shown].max() + 0.4)
        axis.set_ylim(bottom=-1)
        axis.set_title(factor.title, loc="left")
        axis.set_ylabel("% missing or > 1 px")
    add_legend(figure, axes.flat[0], len(summary))
    return render_svg(figure, "strata", "Wrong or missing pixels by slope, texture, light, visibility and material")


def write_curves(summary: Summary, table: Table, sweeps: Sequence[Sweep], out: Path) -> dict[str, str]:
    """Write a picture of the mean error against each setting that varies; their paths relative to ``out`` by setting.

    They are for programs that show no HTML, such as Blender.
    """
    curves = {}
    for sweep in sweeps[:MOST_SWEEPS]:
        topic, _, key = sweep.name.partition(".")
        if topic not in TOPICS or key not in {s.key for s in TOPICS[topic].settings}:
            continue  # of another version, whose names may be no names of files
        with matplotlib.rc_context({**STYLE, **_ON_WHITE}):
            figure, axes = make_figure(2, width=9.6, height=4.2)
            _draw_sweep(sweep, axes[0], summary, table)
            add_legend(figure, axes[0][0], len(summary))
            curves[sweep.name] = f"curves/{sweep.name}.png"
            write_atomically(out / curves[sweep.name], partial(figure.savefig, format="png", dpi=_DPI,
                                                               facecolor="white"))
    return curves


def _draw_sweep(sweep: Sweep, axes: Sequence[Axes], summary: Summary, table: Table) -> None:
    """Draw mean error and wrong pixels against a setting that varies, with 95 % intervals, on two axes."""
    names, places, _ = sweep.levels()
    noisy = decided_by_noise(sweep, table)
    for axis, metric, factor in ((axes[0], "l1_m", 1.0), (axes[1], "total_bad_1", 100.0)):
        step = 0.012 * float(np.ptp(places)) or 0.1
        for k, _, look in _methods(summary):
            mean, bounds = mean_by_level(sweep, table, k, metric)
            bars = np.abs(bounds.T - mean)
            aside = (k - (len(summary) - 1) / 2) * step
            axis.errorbar(places + aside, factor * mean, factor * np.nan_to_num(bars), capsize=2.5, elinewidth=1,
                          linestyle="-" if sweep.numeric else "", **look)
        if not sweep.numeric or len(names) <= 6:
            axis.set_xticks(places, [name if len(name) < 16 else f"{name[:14]}…" for name in names])
        axis.margins(x=0.08)
        axis.set_ylim(bottom=0)
        half = 0.35 * float(np.diff(np.sort(places)).min()) if len(places) > 1 else 0.1
        for place in places[noisy]:
            axis.axvspan(place - half, place + half, color=_LINE, alpha=0.6, linewidth=0, zorder=0)
        others = f", and {len(sweep.together)} more that vary with it" if sweep.together else ""
        axis.set_xlabel(sweep.title + others + ("\nbands: noise of the render decides" if noisy.any() else ""))
    axes[0].set_ylabel("Mean absolute depth error (m)")
    axes[1].set_ylabel("% missing or > 1 px")


def _draw_sweeps(summary: Summary, table: Table, sweeps: Sequence[Sweep]) -> str:
    """Draw mean error and wrong pixels against each setting that varies, with 95 % intervals."""
    if not sweeps:
        return ""
    figure, axes = make_figure(2, len(sweeps), height=2.7)
    for sweep, row in zip(sweeps, axes, strict=True):
        _draw_sweep(sweep, row, summary, table)
    add_legend(figure, axes[0][0], len(summary))
    return render_svg(figure, "sweeps", "Error against each setting that was varied")
