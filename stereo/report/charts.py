"""The charts of the report as SVG text, drawn by Matplotlib in the colours of the page."""

from __future__ import annotations

import html
import io
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ...support.arrays import Array
from ...support.printer import show_lines
from ..inference.scene_means import average_by_scene
from ..matchers.methods import describe_method
from ..measure import by_pixel_class
from ..measure.confidence_metrics import CALIBRATION_SUMS, LEFT_RIGHT, OWN, RIGHT_PX, SWEEP
from ..measure.disparity_histograms import ERROR_BOUNDS_PX, FRACTION_BINS
from ..measure.metrics import ERROR_STEPS_M, KEPT_SHARES
from .phase_curves import PHASE_DEG
from .summary import ResultTable

#: Colours after Okabe and Ito: distinct for colour-blind eyes, and visible on a white and on a black page.
METHOD_COLOURS = ("#2a86c8", "#d55e00", "#009e73", "#c0699a", "#c98a00", "#6f7f8f")
METHOD_MARKS = ("o", "s", "^", "D", "v", "P")
_MARK_SHAPES = {
    "o": "M1 5a4 4 0 1 0 8 0a4 4 0 1 0-8 0",
    "s": "M1.5 1.5h7v7h-7z",
    "^": "M5 1l4.5 8h-9z",
    "D": "M5 .5l4.5 4.5l-4.5 4.5l-4.5-4.5z",
    "v": "M5 9L.5 1h9z",
    "P": "M3.5 1h3v2.5h2.5v3h-2.5v2.5h-3v-2.5h-2.5v-3h2.5z",
}
#: The groups of charts in the report.
CHARTS = ("typical", "front", "errors", "confidence", "signed", "range", "strata", "phase")
_INK_PLACEHOLDER, _LINE_PLACEHOLDER = (
    "#010203",
    "#040506",
)  # placeholders for the colours of the page, which the browser fills in
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.edgecolor": _LINE_PLACEHOLDER,
    "axes.labelcolor": _INK_PLACEHOLDER,
    "text.color": _INK_PLACEHOLDER,
    "xtick.color": _INK_PLACEHOLDER,
    "ytick.color": _INK_PLACEHOLDER,
    "grid.color": _LINE_PLACEHOLDER,
    "axes.grid": True,
    "grid.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "lines.linewidth": 1.8,
    "lines.markersize": 4,
    "axes.titlesize": 9.5,
    "figure.constrained_layout.use": True,
    # Text from a data set is no formula, and a file called matplotlibrc in the current folder must not start LaTeX.
    "text.parse_math": False,
    "text.usetex": False,
}
#: Width of a separate chart in inches: text is legible from a width of 360 px on.
_PANEL_WIDTH = 4.8
METHOD_DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1)), (0, (1, 3)))
#: The line style of each measure of confidence; the page names the measures.
MEASURE_DASHES = {OWN: "-", LEFT_RIGHT: "--", SWEEP: "-."}
#: Most scenes that are drawn as separate dots, and most characters of a method's name in a chart.
_MAX_DOTS, _LONGEST_LABEL = 60, 24
#: Colour of an interval over few scenes, its note in the title of the chart, and the fewest scenes for a box.
_INTERVAL_GREY, _GREY_TEXT, _FEWEST_IN_BOX = "#8a94a0", "; grey: mean, 95 %", 6
#: Metrics whose typical differences are drawn, with factor and name.
_DIFFERENCE_METRICS = (
    ("total_bad_1", 100.0, "points of pixels missing or off by > 1 px"),
    ("common_epe_px", 1.0, "ratio of mean disparity errors"),
)
#: Most comparisons in the chart, and the height of each in inches.
_MAX_COMPARED, _COMPARISON_HEIGHT_IN = 15, 0.3
#: Fewest true pixels of a class that is drawn.
_FEWEST_CLASS_PX = 200

Summary = Sequence[Mapping[str, Any]]


def iterate_methods(summary: Summary) -> Iterator[tuple[int, Mapping[str, Any], dict[str, Any]]]:
    """Yield (number, entry, style of its curve) of each method."""
    for k, entry in enumerate(summary):
        colour, mark = _choose_look(k)
        yield k, entry, {"color": colour, "marker": mark, "label": describe_method(entry["method"])}


def _choose_look(k: int) -> tuple[str, str]:
    """Choose the colour and the mark of a method; together they are distinct for 36 methods."""
    return METHOD_COLOURS[k % len(METHOD_COLOURS)], METHOD_MARKS[(k + k // len(METHOD_COLOURS)) % len(METHOD_MARKS)]


def make_figure(columns: int, rows: int = 1, width: float = 10.4, height: float = 3.1) -> tuple[Figure, Array]:
    """Make a figure of axes (rows, columns) without background, ``width`` inches wide and ``height`` per row."""
    figure = Figure(figsize=(width, height * rows), facecolor="none")
    FigureCanvasSVG(figure)
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_facecolor("none")
    return figure, axes


def render_svg(figure: Figure, name: str, title: str) -> str:
    """Render a figure for an HTML page: without prologue, as wide as its place, with text and lines in the page's
    colours.
    """
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = stream.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    named = f'class="chart" role="img" aria-label="{title}"'
    text = re.sub(r'(<svg [^>]*?)width="[^"]*"', lambda found: found[1] + named, text, count=1)
    text = re.sub(r'(<svg [^>]*?)height="[^"]*"', r"\1", text, count=1)
    text = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font: \1px var(--sans)", text)
    text = re.sub(
        r'\bid="(figure|axes|patch|line2d|text|xtick|ytick|matplotlib\.axis|LineCollection|legend|'
        r'PathCollection|FillBetweenPolyCollection|PolyCollection)_\d+"',
        "",
        text,
    )
    return show_lines(text.replace(_INK_PLACEHOLDER, "var(--soft)").replace(_LINE_PLACEHOLDER, "var(--line)"))


def add_legend(figure: Figure | SubFigure, axis: Axes, count: int) -> None:
    """Add a legend above the figure, for the curves of ``axis``."""
    handles, labels = axis.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=min(5, max(1, count)), handlelength=1.6)


def _set_percent_axis(axis: Axes, label: str) -> None:
    axis.set_ylim(-2, 102)
    axis.set_ylabel(label)


def start_axis_at_zero(axis: Axes) -> None:
    """Start the y axis at 0, with room for whole marks at both ends."""
    top = axis.get_ylim()[1]
    axis.set_ylim(-0.02 * top, 1.06 * top)


def set_logarithmic(axis: Axes, which: str) -> None:
    """Make the axis ``which`` ("x" or "y") logarithmic if it shows anything above zero."""
    if not np.isfinite(getattr(axis.dataLim, f"minpos{which}")):
        return  # Matplotlib cannot draw a logarithmic axis without a value on it
    getattr(axis, f"set_{which}scale")("log")
    along = getattr(axis, f"{which}axis")
    along.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=12))
    _write_plain_numbers(along)


def set_logarithmic_beyond(axis: Axes, which: str, threshold: float) -> None:
    """Make the axis ``which`` ("x" or "y") linear up to ``threshold`` on both sides of 0, and logarithmic beyond."""
    getattr(axis, f"set_{which}scale")("symlog", linthresh=threshold)
    _write_plain_numbers(getattr(axis, f"{which}axis"))


def _write_plain_numbers(along: Axis) -> None:
    """Write plain numbers such as 0.1 and 100, because powers of ten would be formulas, which our charts do not set."""
    along.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    along.set_minor_formatter(NullFormatter())


def draw_charts(
    summary: Summary, table: ResultTable, laws: Mapping[str, Array], comparisons: Sequence[Mapping[str, Any]]
) -> dict[str, list[str]]:
    """Draw all charts, except the charts of varied settings. Return the SVG texts by name of ``CHARTS``, [] if a group
    has nothing to draw.

    The methods have the colours and marks of ``list_method_keys``. ``laws``: see ``phase_curves.compute_phase_curves``,
    ``comparisons``: ``summary.compare_methods``.
    """
    with matplotlib.rc_context(STYLE):
        return {
            "typical": _draw_differences(comparisons),
            "front": [*_draw_front(summary), *_draw_spreads(summary, table)],
            "errors": _draw_errors(summary),
            "confidence": _draw_confidence(summary),
            "signed": _draw_histograms(summary),
            "range": _draw_range(summary),
            "strata": _draw_pixel_classes(summary),
            "phase": _draw_phase_curves(laws),
        }


def list_method_keys(methods: Sequence[str]) -> list[tuple[str, str, str]]:
    """List (method, colour, shape as an SVG path in a square of 10) of each method, for the legend of the page."""
    return [
        (describe_method(method), colour, _MARK_SHAPES[mark])
        for method, (colour, mark) in zip(methods, map(_choose_look, range(len(methods))), strict=True)
    ]


@contextmanager
def add_panel(found: list[str], name: str, title: str, height: float = 3.3) -> Iterator[Axes]:
    """Yield the axes of a separate chart, and add the finished chart to ``found``. A narrow page sets charts below each
    other.
    """
    figure, ((axis,),) = make_figure(1, width=_PANEL_WIDTH, height=height)
    yield axis
    axis.set_title(title, loc="left")
    found.append(render_svg(figure, f"{name}{len(found)}", html.escape(title, quote=True)))


def _draw_phase_curves(laws: Mapping[str, Array]) -> list[str]:
    """Draw phase curves, near opposition and over all phase angles."""
    found: list[str] = []
    for title, last in (("Opposition", 8.0), ("All phases", PHASE_DEG[-1])) if laws else ():
        with add_panel(found, "phase", title, height=3.4 + 0.22 * (len(laws) - 1)) as axis:  # with a line for each law
            for (name, bright), colour, dash in zip(
                laws.items(), itertools.cycle(METHOD_COLOURS), itertools.cycle(METHOD_DASHES)
            ):
                shown = last >= PHASE_DEG
                axis.plot(PHASE_DEG[shown], bright[shown], color=colour, linestyle=dash, label=name)
            axis.set_xlabel("phase angle (°)")
            axis.set_ylabel("disc brightness over that at 0°")
            if last == PHASE_DEG[-1]:
                start_axis_at_zero(axis)
            handles, labels = axis.get_legend_handles_labels()
            axis.figure.legend(handles, labels, loc="outside upper left", ncols=1, handlelength=2.4)
    return found


def _draw_differences(comparisons: Sequence[Mapping[str, Any]]) -> list[str]:
    """Draw the typical difference between every two methods, with its interval, if there are enough scenes for one."""
    found: list[str] = []
    for key, factor, label in _DIFFERENCE_METRICS:
        entries = [
            entry
            for entry in comparisons
            if entry["metric"] == key and entry["typical_low"] is not None and entry["typical_high"] is not None
        ][:_MAX_COMPARED]
        if not entries:
            continue
        with add_panel(
            found, f"typical-{key}-", "Typical scene; filled: they differ", 1.2 + _COMPARISON_HEIGHT_IN * len(entries)
        ) as axis:
            for place, entry in enumerate(entries):
                middle, low, high = (factor * entry[name] for name in ("typical", "typical_low", "typical_high"))
                axis.errorbar(
                    [middle],
                    [place],
                    xerr=[[max(middle - low, 0.0)], [max(high - middle, 0.0)]],
                    color=METHOD_COLOURS[0],
                    marker="o",
                    capsize=3,
                    elinewidth=1.4,
                    markerfacecolor=METHOD_COLOURS[0] if entry["better"] else "none",
                )
            axis.axvline(1.0 if entries[0]["kind"] == "ratio" else 0.0, color=_INK_PLACEHOLDER, linewidth=0.8)
            axis.set_yticks(
                range(len(entries)),
                [" / ".join(describe_method(entry[side])[:_LONGEST_LABEL] for side in "ab") for entry in entries],
            )
            axis.set_ylim(len(entries) - 0.4, -0.6)
            axis.set_xlabel(label)
    return found


def _draw_front(summary: Summary) -> list[str]:
    """Draw wrong or missing pixels against time, with the front of methods that no other method beats in both."""
    points = [
        (look, entry["seconds"], 100 * entry["total_bad_1"])
        for _, entry, look in iterate_methods(summary)
        if entry["n"] and entry["total_bad_1"] is not None and entry["seconds"]
    ]
    found: list[str] = []
    if len(points) > 1:
        with add_panel(found, "front", "Accuracy against time; line: no method is better in both") as axis:
            best: list[tuple[float, float]] = []
            for look, seconds, wrong in points:
                axis.plot(seconds, wrong, **look, linestyle="", zorder=3)
                axis.annotate(look["label"][:_LONGEST_LABEL], (seconds, wrong), (5, 4), textcoords="offset points")
            for seconds, wrong in sorted((seconds, wrong) for _, seconds, wrong in points):
                if not best or wrong < best[-1][1]:
                    best.append((seconds, wrong))
            axis.step(*zip(*best, strict=True), where="post", color=_INK_PLACEHOLDER, linewidth=1, zorder=2)
            set_logarithmic(axis, "x")
            axis.margins(x=0.25, y=0.15)
            start_axis_at_zero(axis)
            axis.set_xlabel("processor seconds a pair")
            axis.set_ylabel("% missing or off by > 1 px")
    return found


def _draw_spreads(summary: Summary, table: ResultTable) -> list[str]:
    """Draw the spread over scenes of the wrong or missing share, and of the error of the measured pixels."""
    found: list[str] = []
    for title, key, factor, label in (
        ("Spread over scenes", "total_bad_1", 100.0, "% missing or off by > 1 px"),
        ("Spread over scenes, measured pixels", "epe_px", 1.0, "mean disparity error (px)"),
    ):
        columns = [average_by_scene(table.column(k, key)[:, None], table.scenes)[:, 0] for k in range(len(summary))]
        values = [
            factor * column[np.isfinite(column)] if entry["n"] else column[:0]
            for column, entry in zip(columns, summary, strict=True)
        ]
        most = max(map(len, values), default=0)
        if most < 2:
            continue
        with add_panel(found, "spread", title + _GREY_TEXT * _has_bars(values, summary, key)) as axis:
            for k, entry, look in iterate_methods(summary):
                bounds = entry["intervals"].get(key)
                if len(values[k]) < _FEWEST_IN_BOX and bounds:
                    middle, low, high = (factor * each for each in (entry[key], *bounds))
                    axis.errorbar(
                        [k + 0.3],
                        [middle],
                        [[middle - low], [high - middle]],
                        color=_INTERVAL_GREY,
                        marker="_",
                        markersize=9,
                        capsize=4,
                        elinewidth=1.2,
                    )
                _draw_spread(axis, k, values[k], look)
            axis.set_xticks(
                range(len(summary)),
                [look["label"][:_LONGEST_LABEL] for *_, look in iterate_methods(summary)],
                rotation=25 if len(summary) > 4 else 0,
            )
            start_axis_at_zero(axis)
            axis.set_ylabel(label)
    return found


def _has_bars(values: Sequence[Array], summary: Summary, key: str) -> bool:
    """Return whether a method has an interval and too few scenes for a box, so that its mean and interval stand beside
    its points.
    """
    return any(
        len(own) < _FEWEST_IN_BOX and key in entry["intervals"] for own, entry in zip(values, summary, strict=True)
    )


def _draw_spread(axis: Axes, place: int, values: Array, look: dict[str, Any]) -> None:
    """Draw the value of each scene and, if there are enough scenes, a box of the quartiles with whiskers from 5 to 95
    %.
    """
    if len(values) >= _FEWEST_IN_BOX:
        axis.boxplot(
            values,
            positions=[place],
            widths=0.5,
            whis=(5, 95),
            showfliers=False,
            manage_ticks=False,
            boxprops={"color": look["color"]},
            medianprops={"color": look["color"], "linewidth": 2.4},
            whiskerprops={"color": look["color"]},
            capprops={"color": look["color"]},
        )
    if 0 < len(values) <= _MAX_DOTS:
        aside = np.linspace(-0.12, 0.12, len(values)) if len(values) > 1 else np.zeros(1)
        axis.plot(place + aside, values, **look | {"label": "_"}, linestyle="", alpha=0.7)


def _draw_histograms(summary: Summary) -> list[str]:
    """Draw the signed disparity errors, the fractional parts of the disparities, and the error by fractional part."""
    entries = [
        (look, entry["histograms"])
        for _, entry, look in iterate_methods(summary)
        if entry["histograms"] and sum(entry["histograms"]["true_part"])
    ]
    found: list[str] = []
    if not entries:
        return found
    with add_panel(found, "signed", "Signed disparity error") as axis:
        middle = (ERROR_BOUNDS_PX[1:] + ERROR_BOUNDS_PX[:-1]) / 2
        for look, counts in entries:
            share = 100 * np.array(counts["error"]) / sum(counts["error"])
            axis.plot(middle, share[1:-1], **look | {"marker": ""})
        axis.axvline(0, color=_INK_PLACEHOLDER, linewidth=0.8)
        set_logarithmic(axis, "y")
        axis.set_xlabel("measured minus true disparity (px)")
        axis.set_ylabel("% of the measured pixels in 0.05 px")
    part = np.arange(FRACTION_BINS + 1) / FRACTION_BINS
    with add_panel(found, "signed", "Pixel locking; 1: as often as in the true disparities") as axis:
        for look, counts in entries:
            axis.plot(part, _average_by_fraction(counts["part"], counts["true_part"]), **look)
        axis.axhline(1, color=_INK_PLACEHOLDER, linewidth=0.8)
        start_axis_at_zero(axis)
        axis.set_xlabel("part of a pixel in the disparity")
        axis.set_ylabel("measured over true frequency")
    with add_panel(found, "signed", "Bias by part of a pixel; errors below 1 px") as axis:
        for look, counts in entries:
            axis.plot(part, _average_by_fraction(counts["fine_error_px"], counts["fine"]), **look)
        axis.axhline(0, color=_INK_PLACEHOLDER, linewidth=0.8)
        axis.set_xlabel("part of a pixel in the true disparity")
        axis.set_ylabel("mean signed error (px)")
    return found


def _average_by_fraction(sums: Sequence[float], counts: Sequence[float]) -> Array:
    """Divide ``sums`` by ``counts`` by the fractional part, from one whole pixel to the next; NaN where nothing
    counts.
    """
    ratio = np.divide(sums, counts, out=np.full(FRACTION_BINS, np.nan), where=np.array(counts) > 0)
    return np.append(ratio, ratio[0])


def _draw_errors(summary: Summary) -> list[str]:
    """Draw the cumulative error, and the error against the share of kept measurements, the most textured first."""
    found: list[str] = []
    if not any(entry["error_curve"] for entry in summary):
        return found
    lines = [(entry, look | {"marker": ""}) for _, entry, look in iterate_methods(summary)]
    with add_panel(found, "errors", "Cumulative error; ends at the coverage") as axis:
        for entry, line in lines:
            if entry["error_curve"]:
                axis.plot(ERROR_STEPS_M, 100 * np.array(entry["error_curve"]), **line)
        set_logarithmic(axis, "x")
        _set_percent_axis(axis, "% of all true pixels within it")
        axis.set_xlabel("depth error (m)")
    with add_panel(found, "errors", "Error against coverage; dotted: best order") as axis:
        for entry, line in lines:
            if entry["sparsification"]["texture"]:
                axis.plot(100 * np.array(KEPT_SHARES), entry["sparsification"]["texture"], **line)
                axis.plot(
                    100 * np.array(KEPT_SHARES),
                    entry["sparsification"]["best"],
                    **line | {"label": "_", "linestyle": ":"},
                )
        axis.set_xlabel("% of measurements kept, the most textured first")
        axis.set_ylabel("mean disparity error (px)")
        start_axis_at_zero(axis)
    return found


def _draw_confidence(summary: Summary) -> list[str]:
    """Draw the error against the share of kept measurements, the surest first, and the calibration of confidences."""
    curves = [
        (look | {"marker": ""}, measure, values)
        for _, entry, look in iterate_methods(summary)
        for measure, values in entry["confidence"].items()
    ]
    found: list[str] = []
    if not curves:
        return found
    with add_panel(found, "confidence", "Error against coverage; thin: ideal order") as axis:
        for line, measure, values in curves:
            if values["curve"]:
                axis.plot(100 * np.array(KEPT_SHARES), values["curve"], **line | {"linestyle": MEASURE_DASHES[measure]})
                axis.plot(100 * np.array(KEPT_SHARES), values["best"], **line | {"label": "_", "linewidth": 0.7})
        axis.set_xlabel("% of measurements kept, the surest first")
        axis.set_ylabel("mean disparity error (px)")
        start_axis_at_zero(axis)
    with add_panel(found, "confidence", "Calibration") as axis:
        for line, measure, values in curves:
            n, right, stated = (np.array(values["calibration"][key]) for key in CALIBRATION_SUMS)
            known = n >= _FEWEST_CLASS_PX
            axis.plot(
                (100 * stated / np.maximum(n, 1))[known],
                (100 * right / np.maximum(n, 1))[known],
                **line | {"linestyle": MEASURE_DASHES[measure]},
            )
        axis.plot([0, 100], [0, 100], color=_INK_PLACEHOLDER, linewidth=0.8)
        axis.set_xlabel("% stated, mean of a fifteenth of the scale")
        _set_percent_axis(axis, f"% within {RIGHT_PX:g} px")
    return found


def _has_enough_pixels(sums: Mapping[str, Any]) -> Array:
    return np.array(sums["true"]) >= _FEWEST_CLASS_PX


def _compute_measured_percent(sums: Mapping[str, Any]) -> Array:
    return np.asarray(100 * (np.array(sums["n"]) / np.maximum(sums["true"], 1)))


def _compute_wrong_percent(sums: Mapping[str, Any]) -> Array:
    """Compute the percentage of the true pixels of each class that are missing or wrong by more than 1 px."""
    true = np.maximum(np.array(sums["true"]), 1)
    return np.asarray(100 * (true - np.array(sums["n"]) + np.array(sums["bad_1"])) / true)


def _draw_range(summary: Summary) -> list[str]:
    """Draw error against range, with the law Z² / (f·B) · σ, and coverage and wrong pixels against range."""
    entries = [
        (look, entry["strata"]["range"])
        for _, entry, look in iterate_methods(summary)
        if "range" in entry["strata"] and _has_enough_pixels(entry["strata"]["range"]).any()
    ]
    found: list[str] = []
    if not entries:
        return found
    bounds = by_pixel_class.RANGE.bounds
    middle = np.array([bounds[0] / 1.2, *np.sqrt(np.multiply(bounds[1:], bounds[:-1])), bounds[-1] * 1.2])

    def finish(axis: Axes) -> None:
        set_logarithmic(axis, "x")
        axis.set_xlabel("true depth (m)")

    with add_panel(found, "range", "Error; dashed: Z² / (f·B) · σ") as axis:
        for look, sums in entries:
            known = _has_enough_pixels(sums) & (np.array(sums["n"]) > 0)
            n = np.maximum(np.array(sums["n"]), 1)
            axis.plot(middle[known], (np.array(sums["l1_m"]) / n)[known], **look)
            fine = sum(sums["fine"])
            if fine:
                sigma = sum(sums["fine_epe_px"]) / fine
                law = sigma * np.array(sums["m_per_px"]) / n
                axis.plot(middle[known], law[known], color=look["color"], linestyle="--", linewidth=1.1)
        finish(axis)
        set_logarithmic(axis, "y")
        axis.set_ylabel("mean depth error (m)")
    for title, label, percent in (
        ("Coverage", "% measured", _compute_measured_percent),
        ("Wrong or missing", "% missing or off by > 1 px", _compute_wrong_percent),
    ):
        with add_panel(found, "range", title) as axis:
            for look, sums in entries:
                known = _has_enough_pixels(sums)
                axis.plot(middle[known], percent(sums)[known], **look)
            finish(axis)
            _set_percent_axis(axis, label)
    return found


def _draw_pixel_classes(summary: Summary) -> list[str]:
    """Draw the wrong and missing pixels of each class, for every factor except range."""
    found: list[str] = []
    for factor in by_pixel_class.FACTORS:
        if factor.key == "range" or not any(
            _has_enough_pixels(entry["strata"][factor.key]).sum() > 1
            for entry in summary
            if factor.key in entry["strata"]
        ):
            continue
        with add_panel(found, "strata", factor.title) as axis:
            places = np.arange(len(factor.classes))
            shown = np.zeros(len(places), bool)
            for k, entry, look in iterate_methods(summary):
                sums = entry["strata"].get(factor.key)
                if sums is not None:
                    known = _has_enough_pixels(sums)
                    shown |= known
                    aside = (k - (len(summary) - 1) / 2) * 0.12 if factor.names else 0.0
                    axis.plot(
                        places[known] + aside,
                        _compute_wrong_percent(sums)[known],
                        **look,
                        linestyle="" if factor.names else "-",
                    )
            axis.set_xticks(places[shown], np.array(factor.classes)[shown], rotation=0 if factor.names else 35)
            axis.set_xlim(places[shown].min() - 0.4, places[shown].max() + 0.4)
            start_axis_at_zero(axis)
            axis.set_ylabel("% missing or > 1 px")
    return found
