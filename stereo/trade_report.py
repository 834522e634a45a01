"""What a trade found: CSV, JSON, and a page with Pareto fronts that says in words which setting to use."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import matplotlib
from matplotlib.ticker import FuncFormatter

from ..files import write_json, write_text
from ..render.variants import SHAPES
from .charts import COLOURS, STYLE, drawing, legend, logarithmic, svg
from .columns import Column, shown
from .trade import STEREO, front, number

FORMAT = "icymoon-trade"
VERSION = 1
#: Extra disparity error, px, up to which advice is given.
TOLERANCES_PX = (0.01, 0.02, 0.05, 0.1)
#: What a light error may be to be called none, and to be recommended to matchers, as a share of the light.
_UNSEEN, _RECOMMENDED = 0.002, 0.01

COLUMNS = (Column("cpu_s", "CPU", "s", 1, "processor seconds of a pair: build, both eyes, truth, files"),
           Column("wall_s", "Wall", "s", 1, "seconds of a pair on this machine"),
           Column("memory_mib", "Memory", "MiB", 0, "most memory of the rendering process"),
           Column("bias", "Bias", "%", 2, "mean radiance against the reference"),
           Column("rmse", "RMSE", "%", 2, "root mean square difference of a pixel, over the mean radiance"),
           Column("noise", "Noise", "%", 2, "its random part, between renders of other seeds"),
           Column("structure", "Structure", "%", 2, "its other part: what is there in every render"),
           Column("depth_px", "Depth", "px", 3, "95 % of the true depths are this near to the reference's"))
STEREO_COLUMNS = {"coverage": Column("coverage", "coverage", "%", 1), "epe_px": Column("epe_px", "EPE", "px", 3),
                  "bad_1": Column("bad_1", "bad-1", "%", 1)}


def write_trade(rows: Sequence[Mapping[str, Any]], methods: Sequence[str], references: Sequence[Mapping[str, Any]],
                groups: Mapping[str, str], provenance: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """Write ``trade.json``, ``trade.csv`` and ``trade.html`` to ``out``; return what is in the JSON.

    ``rows``: per variant ``group``, ``name``, ``changed`` (settings by topic.key) and what ``trade.measure`` found.
    ``references``: ``name``, ``noise``, ``cpu_s`` and ``stereo`` of each. ``groups``: what each group is about.
    """
    report = {"format": FORMAT, "version": VERSION, "methods": list(methods), "references": list(references),
              "rows": [dict(row) for row in rows], "advice": advice(rows, methods),
              "fronts": {label: [rows[k]["name"] for k in front(rows, "cpu_s", path)]
                         for label, path in _errors(methods)}, "provenance": dict(provenance)}
    write_json(out / "trade.json", report)
    write_text(out / "trade.csv", _csv(rows, methods))
    here = Path(__file__).parent
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(here), autoescape=True,
                                     undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    used = [group for group in groups if any(row["group"] == group for row in rows)]
    scene = [row for row in rows if row["group"] == "scene"]
    html = environment.get_template("trade.html.j2").render(
        report=report, columns=COLUMNS, stereo_columns=STEREO_COLUMNS, shown=shown, chart=_chart(rows, methods),
        best={rows[k]["key"] for _, path in _errors(methods) for k in front(rows, "cpu_s", path)},
        tables=[(group, groups[group], (scene if group not in SHAPES else []) + [
            row for row in rows if row["group"] == group]) for group in used],
        settings=json.dumps(provenance, indent=1))
    write_text(out / "trade.html", html)
    return report


def advice(rows: Sequence[Mapping[str, Any]], methods: Sequence[str]) -> list[str]:
    """In words: the cheapest variant within each tolerance for each matcher, and what each group is worth."""
    scene = next(row for row in rows if row["group"] == "scene")
    said = []
    for method in methods:
        steps: list[tuple[float, Mapping[str, Any]]] = []
        for tolerance in TOLERANCES_PX:
            good = [row for row in rows if _fits(row, method, tolerance)]
            best = min(good, key=lambda row: row["cpu_s"], default=None)
            if best is not None and (not steps or steps[-1][1] is not best):
                steps.append((tolerance, best))
        if not steps:
            said.append(f"{method}: nothing tried stays within {TOLERANCES_PX[-1]:g} px of the reference; give more "
                        "samples.")
            continue
        said.append(f"{method}: " + "; ".join(
            f"within {tolerance:g} px of the reference with “{best['name']}”, {best['cpu_s']:.1f} CPU seconds a pair"
            f"{_ratio(scene, best)}" for tolerance, best in steps) + ".")
    return said + _about_groups(rows, scene)


def _fits(row: Mapping[str, Any], method: str, tolerance_px: float) -> bool:
    """Whether a variant shows this scene's shape and light, and loses no more than that."""
    loss = number(row, "loss", method, "epe_px")
    return (row["group"] not in SHAPES and abs(row["bias"]) <= _RECOMMENDED and row["cpu_s"] is not None
            and loss is not None and loss <= tolerance_px)


def _ratio(scene: Mapping[str, Any], best: Mapping[str, Any]) -> str:
    if best is scene or not scene["cpu_s"] or not best["cpu_s"]:
        return ""
    ratio = scene["cpu_s"] / best["cpu_s"]
    return f" ({ratio:.1f} times less than as described)" if ratio > 1 else f" ({1 / ratio:.1f} times as much)"


def _about_groups(rows: Sequence[Mapping[str, Any]], scene: Mapping[str, Any]) -> list[str]:
    """Of each group but the samples: the cheapest variant whose light is that of the scene, if it saves anything."""
    said = []
    for group in dict.fromkeys(row["group"] for row in rows if row["group"] not in ("scene", "samples")):
        own = [row for row in rows if row["group"] == group and row["cpu_s"] and row["bias"] is not None]
        same = [row for row in own if abs(row["bias"]) <= _UNSEEN and (row["depth_px"] or 0.0) <= TOLERANCES_PX[0]]
        best = min(same, key=lambda row: row["cpu_s"], default=None)
        if best is None or not scene["cpu_s"]:
            said.append(f"{group}: every variant changes the light by more than {100 * _UNSEEN:g} % or the depth by "
                        f"more than {TOLERANCES_PX[0]:g} px.")
        elif best["cpu_s"] < 0.97 * scene["cpu_s"]:
            said.append(f"{group}: “{best['name']}” changes the light by {100 * best['bias']:+.2f} % and saves "
                        f"{100 * (1 - best['cpu_s'] / scene['cpu_s']):.0f} % of the time.")
        else:
            said.append(f"{group}: nothing here is cheaper without changing the light; leave it as it is.")
    return said


def _errors(methods: Sequence[str]) -> list[tuple[str, tuple[str, ...]]]:
    """The errors that fronts are drawn of: their names and where they stand in a row."""
    return [("radiance", ("rmse",)), *((method, ("loss", method, "epe_px")) for method in methods)]


def _csv(rows: Sequence[Mapping[str, Any]], methods: Sequence[str]) -> str:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["group", "name", *(column.key for column in COLUMNS), "depth_m",
                    *(f"{method} {key}" for method in methods for key in STEREO),
                    *(f"{method} loss {key}" for method in methods for key in STEREO), "changed"])
    for row in rows:
        table.writerow([row["group"], row["name"], *(row[column.key] for column in COLUMNS), row["depth_m"],
                        *(row[kind][method][key] for kind in ("stereo", "loss") for method in methods
                          for key in STEREO), json.dumps(row["changed"])])
    return text.getvalue()


def _chart(rows: Sequence[Mapping[str, Any]], methods: Sequence[str]) -> str:
    """Every variant by cost and error, the front joined by a line."""
    groups = list(dict.fromkeys(row["group"] for row in rows))
    errors = _errors(methods)
    with matplotlib.rc_context(STYLE):
        figure, axes = drawing(2, (len(errors) + 1) // 2, height=3.4)
        for axis in axes.flat[len(errors):]:
            axis.set_visible(False)
        for (label, path), axis in zip(errors, axes.flat, strict=False):
            for k, group in enumerate(groups):
                own = [(row["cpu_s"], number(row, *path)) for row in rows if row["group"] == group]
                known = [(cost, error) for cost, error in own if cost is not None and error is not None]
                axis.plot([p[0] for p in known], [p[1] for p in known], "osD^vPX*"[k % 8], label=group,
                          color=COLOURS[k % len(COLOURS)])
            best = [rows[k] for k in front(rows, "cpu_s", path)]
            axis.plot([row["cpu_s"] for row in best], [number(row, *path) for row in best], color="#6f7f8f",
                      linewidth=1.1, zorder=0)
            logarithmic(axis, "x")
            if label == "radiance":
                logarithmic(axis, "y")
            else:  # linear near zero, where losses may be gains, logarithmic beyond
                axis.set_yscale("symlog", linthresh=0.01)
                axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_xlabel("CPU seconds per pair")
            axis.set_ylabel("RMSE of the radiance" if label == "radiance" else "more disparity error (px)")
            axis.set_title("Radiance" if label == "radiance" else label, loc="left")
        legend(figure, axes.flat[0], len(groups))
        return svg(figure, "trade", "Cost against error of every variant")
