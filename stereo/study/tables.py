"""The files of a study: ``study.json``, ``cells.csv``, ``study.md`` and charts as SVG and PNG."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from ...support.errors import IcyMoonError
from ...support.files import read_text, to_json_text, write_atomically, write_text
from ..matchers.methods import describe_method
from ..report.charts import METHOD_COLOURS, METHOD_MARKS, STYLE, set_logarithmic_beyond
from .design import CONVERGED, Study
from .view_measurements import LIGHTS

#: Lines that enclose the tables of a study on a page.
BEGIN, END = "<!-- study: begin -->", "<!-- study: end -->"
_NO_NUMBER = "–"
#: Most characters of a line of text.
_LINE_WIDTH = 120
#: Columns on the noise of a render, measured against a converged render, see ``view_measurements.Cell``.
_TOLD_OF_NOISE = {
    "truly_hidden": "pixels whose texture is weaker than what differs from the converged render around them",
    "distance": "root mean square difference of the light over its mean",
}
#: Colours of a chart in a separate file, and not in a page.
_ON_WHITE = dict.fromkeys(("text.color", "axes.labelcolor", "xtick.color", "ytick.color"), "#202428") | {
    "axes.edgecolor": "#909aa4",
    "grid.color": "#d8dde2",
    "svg.hashsalt": "icymoon",
}


def write_study(study: Study, found: Mapping[str, Any], out: Path) -> str:
    """Write all files to ``out``; return the text of the page."""
    parts = (
        _make_header(study, found),
        _make_change_tables(found),
        _make_hypothesis_table(found),
        _make_order_table(found),
        _make_view_table(study, found),
    )
    lines = [line if line[:1] in "|*" else fill(line, _LINE_WIDTH) for part in parts for line in part]
    text = "\n".join(lines) + "\n"
    write_text(out / "study.json", to_json_text(dict(found)))
    write_text(out / "cells.csv", _make_csv(found))
    write_text(out / "study.md", text)
    with matplotlib.rc_context(STYLE | _ON_WHITE):
        for name, draw in (("changes", draw_changes), ("noise", _draw_noise)):
            figure = draw(found)
            for kind in ("svg", "png"):
                dated = {"Date": None} if kind == "svg" else None  # without it an SVG states its time of creation
                write_atomically(
                    out / f"{name}.{kind}",
                    partial(figure.savefig, format=kind, dpi=160, facecolor="white", metadata=dated),
                )
    return text


def replace_between_marks(page: Path, text: str) -> str:
    """Return the content of a page with a text between its marks. Raises IcyMoonError if it has no marks."""
    before = read_text(page)
    if BEGIN not in before or END not in before:
        raise IcyMoonError(f"{page} has no lines {BEGIN} and {END}; add them where the tables are to stand.")
    return f"{before.split(BEGIN)[0]}{BEGIN}\n\n{text}\n{END}{before.split(END)[1]}"


def _make_header(study: Study, found: Mapping[str, Any]) -> list[str]:
    cells = found["cells"]
    complete = sum(len(study.recipes) + 1 == len(cell["errors"]) for cell in cells)
    counted = [cell for cell in cells if cell["counts"]]
    suns = sorted(cell["sun_deg"] for cell in counted)
    noises = sorted(cell["reference_noise"] for cell in counted)
    return [
        f"{study.question} {len(cells)} of {len(study.views)} views were run, {complete} of them with all "
        f"{len(study.recipes)} recipes. {len(counted)} views count"
        + (
            f", of {len({cell['ground'] for cell in counted})} grounds, under Suns of {suns[0]:g} to {suns[-1]:g}°, "
            f"{' and '.join(str(width) for width in sorted({cell['width_px'] for cell in counted}))} px wide. Noise of "
            f"their converged renders is {100 * noises[0]:.1f} to {100 * noises[-1]:.1f} % of the mean light."
            if counted
            else "."
        ),
        "",
        *(f"* `{recipe.name}`: {recipe.title}" for recipe in study.recipes),
        "",
    ]


def _make_change_tables(found: Mapping[str, Any]) -> list[str]:
    """Make the tables of the changes of errors and gaps, then of the changes in light and in shadow."""
    methods = found["methods"]
    gaps = [name for name in found["comparisons"][0]["changes"] if name not in methods]
    lines = [
        "### Changes of the error",
        "",
        "Points of pixels that are missing or wrong by more than 1 px, in the typical ground, with bounds that hold "
        "for all errors and gaps of a row at once. **Bold**: the interval does not contain 0, and the noise of the "
        "converged render is below a tenth of the change. *Italic*: the interval does not contain 0, but that noise "
        "is more. The last column is the largest noise among the methods, in points.",
        "",
        *_make_change_table(found, "changes", methods),
        "### Changes of the gaps between methods",
        "",
        *_make_change_table(found, "changes", gaps),
    ]
    for light, title in zip(LIGHTS, ("In the light", "In shadow"), strict=True):
        names = [f"{method}, {light}" for method in methods]
        lines += [f"### {title}", "", *_make_change_table(found, "by_light", names, methods)]
    return lines


def _make_change_table(
    found: Mapping[str, Any], kind: str, names: Sequence[str], titles: Sequence[str] | None = None
) -> list[str]:
    lines = [
        "| recipe | against | grounds | " + " | ".join(titles or names) + " | noise |",
        "|---" * (4 + len(names)) + "|",
    ]
    for each in found["comparisons"]:
        changes = [each[kind][name] for name in names]
        noise = max((abs(change["noise"] or 0.0) for change in changes), default=0.0)
        lines.append(
            f"| `{each['of']}` | `{each['with']}` | {min(change['grounds'] for change in changes)} | "
            + " | ".join(map(_format_interval, changes))
            + f" | {f'{noise:.2f}' if CONVERGED in (each['of'], each['with']) else _NO_NUMBER} |"
        )
    return [*lines, ""]


def _format_interval(change: Mapping[str, Any]) -> str:
    if change["typical"] is None:
        return _NO_NUMBER
    typical = f"{change['typical']:+.1f}"
    if change["low"] is None:
        return typical
    mark = "**" if change["claimed"] else "*" if change["found"] else ""
    return f"{mark}{typical}{mark} ({change['low']:+.1f} to {change['high']:+.1f})"


def _make_hypothesis_table(found: Mapping[str, Any]) -> list[str]:
    if not found["hypotheses"]:
        return []
    lines = ["### Hypotheses", "", "| hypothesis | change | verdict |", "|---|---|---|"]
    for each in found["hypotheses"]:
        why = f": the converged render has {abs(each['noise']):.2f} points of noise" if each["loud"] else ""
        bounds = "" if each["low"] is None else f" ({each['low']:+.1f} to {each['high']:+.1f})"
        typical = _NO_NUMBER if each["typical"] is None else f"{each['typical']:+.1f}{bounds}"
        lines.append(f"| {each['says']} | {typical} | {each['verdict']}{why} |")
    return [*lines, ""]


def _make_order_table(found: Mapping[str, Any]) -> list[str]:
    lines = [
        "### Order of the methods",
        "",
        "| recipe | against | views | mean Kendall's tau | views with the same order |",
        "|---|---|---|---|---|",
    ]
    for each in found["comparisons"]:
        order = each["order"]
        if order["tau"] is None:
            continue
        bounds = "" if order["low"] is None else f" ({100 * order['low']:.0f} to {100 * order['high']:.0f})"
        lines.append(
            f"| `{each['of']}` | `{each['with']}` | {order['views']} | {order['tau']:.2f} | "
            f"{100 * order['same']:.0f} %{bounds} |"
        )
    lines += [
        "",
        "### Order of the noise",
        "",
        "Kendall's tau between the share of pixels that the verdict calls hidden and what the converged render tells.",
        "",
        "| | all pairs together | pairs | mean over views |",
        "|---|---|---|---|",
    ]
    for key, title in _TOLD_OF_NOISE.items():
        order = found["noise_order"][key]
        together, mean = (
            _NO_NUMBER if order[which] is None else f"{order[which]:+.2f}" for which in ("together", "mean")
        )
        lines.append(f"| {title} | {together} | {order['pairs']} | {mean} |")
    return [*lines, ""]


def _make_view_table(study: Study, found: Mapping[str, Any]) -> list[str]:
    """Make a table of the views: errors on the converged render, its noise, and tau of the noise verdict."""
    methods = found["methods"]
    lines = [
        "### Views",
        "",
        "Errors are those on the converged render, in %. A view whose converged render has more noise than "
        f"{100 * study.reference_noise:g} % (in brackets) does not count: no render of it is converged.",
        "",
        "| view | Sun | in shadow | noise of the converged render | recipes | "
        + " | ".join(methods)
        + " | tau of the noise, hidden | light |",
        "|---" * (7 + len(methods)) + "|",
    ]
    for cell in found["cells"]:
        taus = [found["noise_order"][key]["views"].get(cell["view"]) for key in _TOLD_OF_NOISE]
        noise = f"{100 * cell['reference_noise']:.1f} %"
        lines.append(
            f"| {cell['ground']} | {cell['sun_deg']:g}° | {100 * cell['shadow']:.0f} % | "
            f"{noise if cell['counts'] else f'({noise})'} | {len(cell['errors']) - 1} of {len(study.recipes)} | "
            + " | ".join(f"{cell['errors'][CONVERGED][method]['all']:.1f}" for method in methods)
            + "".join(f" | {_NO_NUMBER if tau is None else f'{tau:+.2f}'}" for tau in taus)
            + " |"
        )
    return lines


def _make_csv(found: Mapping[str, Any]) -> str:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(
        [
            "view",
            "ground",
            "sun_deg",
            "recipe",
            "method",
            "error",
            *LIGHTS,
            "hidden",
            "truly_hidden",
            "distance",
            "cpu_s",
        ]
    )
    for cell in found["cells"]:
        for recipe, errors in cell["errors"].items():
            noise, cost = cell["noise"].get(recipe, {}), cell["cpu_s"].get(recipe, {})
            for method, error in errors.items():
                table.writerow(
                    [
                        cell["view"],
                        cell["ground"],
                        cell["sun_deg"],
                        recipe,
                        method,
                        error["all"],
                        *(error[light] for light in LIGHTS),
                        noise.get("hidden"),
                        noise.get("truly_hidden"),
                        noise.get("distance"),
                        sum(cost.values()) if cost else None,
                    ]
                )
    return text.getvalue()


def draw_changes(found: Mapping[str, Any]) -> Figure:
    """Draw the typical change of every method's error by each comparison, with its interval."""
    methods, comparisons = found["methods"], found["comparisons"]
    figure = Figure(figsize=(7.2, 1.0 + 0.42 * len(comparisons)))
    axis = figure.subplots()
    for k, method in enumerate(methods):
        for row, each in enumerate(comparisons):
            change = each["changes"][method]
            if change["typical"] is None:
                continue
            height = -row + 0.16 * ((len(methods) - 1) / 2 - k)
            if change["low"] is not None:
                axis.plot([change["low"], change["high"]], [height, height], color=METHOD_COLOURS[k], linewidth=1.2)
            axis.plot(
                change["typical"],
                height,
                METHOD_MARKS[k],
                color=METHOD_COLOURS[k],
                markerfacecolor=METHOD_COLOURS[k] if change["claimed"] else "white",
                label=describe_method(method) if row == 0 else None,
            )
    axis.axvline(0.0, color="#6f7f8f", linewidth=0.8)
    axis.set_yticks(
        [-row for row in range(len(comparisons))], [f"{each['of']} – {each['with']}" for each in comparisons]
    )
    axis.set_xscale("symlog", linthresh=2.0)
    axis.set_xticks(
        [-50, -20, -10, -5, -2, 0, 2, 5, 10, 20, 50], ["-50", "-20", "-10", "-5", "-2", "0", "2", "5", "10", "20", "50"]
    )
    axis.set_xlabel("change of the pixels that are missing or wrong, points (filled: claimed)")
    figure.legend(loc="outside upper left", ncols=len(methods))
    return figure


def _draw_noise(found: Mapping[str, Any]) -> Figure:
    """Draw the share of pixels that noise hides by the verdict against the share by the converged render, by recipe."""
    figure = Figure(figsize=(7.2, 3.6))
    axis = figure.subplots()
    for k, recipe in enumerate(dict.fromkeys(name for cell in found["cells"] for name in cell["noise"])):
        rows = [cell["noise"][recipe] for cell in found["cells"] if recipe in cell["noise"]]
        shares = [(row["truly_hidden"], row["hidden"]) for row in rows]
        known = [(100 * true, 100 * told) for true, told in shares if None not in (true, told)]
        if known:
            axis.plot(
                *zip(*known, strict=True),
                METHOD_MARKS[k % len(METHOD_MARKS)],
                color=METHOD_COLOURS[k % len(METHOD_COLOURS)],
                label=recipe,
            )
    axis.set_xlabel("pixels that noise hides, by the converged render, %")
    axis.set_ylabel("by the verdict, %")
    if axis.has_data():
        for which in "xy":
            set_logarithmic_beyond(axis, which, 0.1)
        figure.legend(loc="outside right upper")
    return figure
