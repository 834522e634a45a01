"""Write the results of a trade: CSV, JSON, and a page with Pareto fronts and advice on the variant to use."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...render.cost.quality_variants import SHAPES
from ...support.files import write_json, write_text
from ..matchers.methods import describe_method
from ..report.charts import (
    METHOD_COLOURS,
    STYLE,
    add_legend,
    make_figure,
    render_svg,
    set_logarithmic,
    set_logarithmic_beyond,
)
from ..report.page_templates import read_template
from ..report.sweep_charts import ON_WHITE, write_picture
from ..report.table_columns import Column, format_number
from .advice import (
    find_distinct_steps,
    find_pareto_fronts,
    format_loss,
    make_decision_advice,
    make_fusion_advice,
    make_variant_advice,
)
from .quality_losses import STEREO_KEYS, find_number, find_plain_methods
from .same_decisions import MAX_REGRET, RULE

FORMAT = "icymoon-trade"
VERSION = 3
COLUMNS = (
    Column("cpu_s", "CPU", "s", 1, "processor seconds of a pair: build, both eyes, truth, files"),
    Column("wall_s", "Wall", "s", 1, "seconds of a pair on this machine"),
    Column("memory_mib", "Memory", "MiB", 0, "peak memory of the rendering process"),
    Column("megabytes", "Files", "MB", 2, "size of a pair's files"),
    Column("bias", "Bias", "%", 2, "difference of the mean radiance from that of the reference"),
    Column("rmse", "RMSE", "%", 2, "root mean square difference of a pixel, over the mean radiance"),
    Column("noise", "Noise", "%", 2, "random part of the RMSE, which differs between renders"),
    Column("structure", "Structure", "%", 2, "other part of the RMSE, the same in every render"),
    Column("depth_px", "Depth", "px", 3, "95 % of the true depths differ from the reference by at most this"),
)
#: Columns on the differences of a matcher's decisions from its decisions on the reference.
DECISION_COLUMNS = (
    Column("otherwise", "otherwise", "%", 1, "share of the cells in reach that are decided otherwise"),
    Column("unsafe", "unsafe", "%", 1, "more unsafe cells taken for safe, as a share of all"),
    Column("shift_m", "site", "m", 2, "distance of the chosen site from that on the reference"),
    Column("regret", "regret", "", 2, f"how much larger its regret is; {MAX_REGRET:g} is allowed"),
)
#: The verdict on the decisions of a matcher, by whether they are the same.
SAME_VERDICTS = {True: "same", False: "other", None: "open"}
STEREO_COLUMNS = {
    "coverage": Column("coverage", "coverage", "%", 1),
    "epe_px": Column("epe_px", "EPE", "px", 3),
    "bad_1": Column("bad_1", "bad-1", "%", 1),
}


#: The change against the matcher without range points, in the CSV.
_FUSED_COLUMNS = ("in place of the matcher alone", "in place of the matcher alone ±")
#: The numbers of decisions in the CSV.
_DECISION_COLUMNS = ("otherwise", "otherwise_doubt", "unsafe", "unsafe_doubt", "shift_m", "regret", "same")


def _make_tables(rows: Sequence[Mapping[str, Any]], groups: Mapping[str, str]) -> list[tuple[str, str, list[Any]]]:
    """Make a table for each group that has variants: its key, its description, and its rows after the scene with which
    they are compared.
    """
    found = {group: [row for row in rows if row["group"] == group] for group in ("scene", *groups)}
    scene = found.pop("scene")
    return [(group, groups[group], ([] if group in SHAPES else scene) + own) for group, own in found.items() if own]


def write_trade(
    rows: Sequence[Mapping[str, Any]],
    methods: Sequence[str],
    references: Sequence[Mapping[str, Any]],
    groups: Mapping[str, str],
    provenance: Mapping[str, Any],
    out: Path,
) -> dict[str, Any]:
    """Write ``trade.json``, ``trade.csv``, ``trade.html`` and ``trade.png`` to ``out``; return the content of the JSON.

    ``rows``: per variant ``group``, ``name``, ``changed`` (settings by topic.key) and the result of
    ``quality_losses.measure_variant``. ``references``: per reference ``name``, ``noise``, ``cpu_s``, ``stereo``,
    ``own``, ``own_decisions`` and ``undecided``. ``groups``: a description of each group of variants, by its key.
    """
    best = find_pareto_fronts(rows, methods)
    report = {
        "format": FORMAT,
        "version": VERSION,
        "methods": list(methods),
        "references": list(references),
        "rows": [dict(row) for row in rows],
        "advice": make_variant_advice(rows, methods),
        "fusion_advice": make_fusion_advice(rows, methods),
        "decision_advice": make_decision_advice(rows, methods, references),
        "decision_rule": RULE,
        "fronts": {label: [row["name"] for row in found] for label, found in best.items()},
        "provenance": dict(provenance),
    }
    write_json(out / "trade.json", report)
    write_text(out / "trade.csv", _make_csv(rows, methods))
    html = read_template("trade.html.j2", Path(__file__).parent).render(
        report=report,
        columns=COLUMNS,
        stereo_columns=STEREO_COLUMNS,
        format_number=format_number,
        decision_columns=DECISION_COLUMNS,
        same=SAME_VERDICTS,
        decided=[row for row in rows if row["decisions"]],
        chart=_draw_chart(rows, methods, best),
        lost=_format_loss,
        fronts={label: find_distinct_steps(found, label) for label, found in best.items()},
        best={row["key"] for found in best.values() for row in found},
        tables=_make_tables(rows, groups),
        settings=json.dumps(provenance, indent=1),
    )
    write_text(out / "trade.html", html)
    _write_picture(rows, methods, best, out / "trade.png")
    return report


def _list_errors(methods: Sequence[str]) -> list[tuple[str, tuple[str, ...]]]:
    """List the errors that are drawn: their names and their paths in a row."""
    return [("radiance", ("rmse",)), *((method, ("loss", method, "epe_px")) for method in methods)]


def _format_loss(row: Mapping[str, Any], label: str) -> str:
    """Format the error of a variant on a front: the RMSE of the radiance, or the loss of a matcher."""
    return f"{100 * row['rmse']:.1f} %" if label == "radiance" else format_loss(row, label)


def _make_csv(rows: Sequence[Mapping[str, Any]], methods: Sequence[str]) -> str:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(
        [
            "group",
            "name",
            *(column.key for column in COLUMNS),
            "depth_m",
            *(f"{method} {key}" for method in methods for key in STEREO_KEYS),
            *(f"{method} {what} {key}" for what in ("loss", "loss ±") for method in methods for key in STEREO_KEYS),
            "bias ±",
            *(f"{fused} {what}" for fused in find_plain_methods(methods) for what in _FUSED_COLUMNS),
            *(f"{method} decisions {key}" for method in methods for key in _DECISION_COLUMNS),
            "changed",
        ]
    )
    for row in rows:
        table.writerow(
            [
                row["group"],
                row["name"],
                *(row[column.key] for column in COLUMNS),
                row["depth_m"],
                *(
                    row[kind][method][key]
                    for kind in ("stereo", "loss", "loss_doubt")
                    for method in methods
                    for key in STEREO_KEYS
                ),
                row["bias_doubt"],
                *(
                    row["fused"][fused][what]["wrong_or_missing"]
                    for fused in find_plain_methods(methods)
                    for what in ("loss", "doubt")
                ),
                *(row["decisions"].get(method, {}).get(key) for method in methods for key in _DECISION_COLUMNS),
                json.dumps(row["changed"]),
            ]
        )
    return text.getvalue()


_Rows = Sequence[Mapping[str, Any]]


def _draw_chart(rows: _Rows, methods: Sequence[str], best: Mapping[str, _Rows]) -> str:
    """Draw the chart of all variants for the page, as SVG."""
    with matplotlib.rc_context(STYLE):
        return render_svg(_make_chart(rows, methods, best), "trade", "Cost against error of every variant")


def _write_picture(rows: _Rows, methods: Sequence[str], best: Mapping[str, _Rows], path: Path) -> None:
    """Write the chart of all variants as a picture, for programs that show no HTML, such as Blender."""
    with matplotlib.rc_context({**STYLE, **ON_WHITE}):
        write_picture(_make_chart(rows, methods, best), path)


def _make_chart(rows: _Rows, methods: Sequence[str], best: Mapping[str, _Rows]) -> Figure:
    """Draw every variant by cost and error, with its uncertainty. A line joins the variants on the front."""
    groups = list(dict.fromkeys(row["group"] for row in rows))
    errors = _list_errors(methods)
    figure, axes = make_figure(2, (len(errors) + 1) // 2, height=3.4)
    for axis in axes.flat[len(errors) :]:
        axis.set_visible(False)
    for (label, path), axis in zip(errors, axes.flat, strict=False):
        for k, group in enumerate(groups):
            own = [
                (row["cpu_s"], find_number(row, *path), find_number(row, "loss_doubt", *path[1:]) or 0.0)
                for row in rows
                if row["group"] == group
            ]
            known = [point for point in own if None not in point[:2]]
            look = {"color": METHOD_COLOURS[k % len(METHOD_COLOURS)], "marker": "osD^vPX*"[k % 8], "label": group}
            axis.errorbar(*np.array(known, float).T.reshape(3, -1), linestyle="", elinewidth=0.8, **look)
        axis.plot(
            [row["cpu_s"] for row in best[label]],
            [find_number(row, *path) for row in best[label]],
            color="#6f7f8f",
            linewidth=1.1,
            zorder=0,
        )
        _finish_axis(axis, label)
    add_legend(figure, axes.flat[0], len(groups))
    return figure


def _finish_axis(axis: Axes, label: str) -> None:
    set_logarithmic(axis, "x")
    if label == "radiance":
        set_logarithmic(axis, "y")
    else:  # linear near zero, as a loss may be negative, logarithmic beyond
        set_logarithmic_beyond(axis, "y", 0.01)
    axis.set_xlabel("CPU seconds per pair")
    axis.set_ylabel("RMSE of the radiance" if label == "radiance" else "more disparity error (px)")
    axis.set_title("Radiance" if label == "radiance" else describe_method(label), loc="left")
