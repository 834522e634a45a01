"""Writes the study of sensor suites as CSV, as JSON, and as a page with charts and a table."""

from __future__ import annotations

import csv
import io
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib

from ...support.files import escape_cell, write_json, write_text
from ...support.number_text import format_count, show_rounded
from ...support.version import version
from ..inference.risk_control import bound_risk, count_fewest_grounds
from ..matchers.methods import describe_method
from ..report.charts import METHOD_COLOURS, METHOD_MARKS, STYLE, add_legend, make_figure, render_svg, set_logarithmic
from ..report.page_templates import read_template
from .compare_suites import (
    BEATEN,
    DOUBT,
    ENERGY,
    FAILS,
    FRONT,
    HOLDS,
    PARTS,
    QUANTITIES,
    RISK,
    STABLE_TAU,
    TIME,
    Measured,
    collect_numbers,
    compare,
    compare_rankings,
    compute_energy,
    compute_loss,
    find_front,
    summarise,
)
from .measure_suites import LANDFORM, OWN, Study, group_split_rows
from .read_design import Design, Suite

FORMAT, VERSION = "icymoon-design", 1
LOG_FILE = "design.jsonl"
#: The files of a study, and the first bytes of each.
FIRST_BYTES = {
    LOG_FILE: b'{"pair": ',
    "design.csv": b"ground,landform,suite,",
    "design.json": b'{\n "format": "icymoon-design',
    "design.html": b'<!DOCTYPE html>\n<html lang="en">\n<head>\n',
}
#: The column headings of the table, in a terminal and on the page.
COLUMNS = (
    "Suite",
    "Place",
    "Acts",
    "Unsafe",
    "Dangerous",
    "Risk",
    "Risk, landforms",
    "Safe lost (%)",
    "Energy (J)",
    "CPU (s)",
)
_CSV_COLUMNS = (
    "ground",
    "landform",
    "suite",
    "status",
    "acts",
    "unsafe",
    "dangerous",
    "no_site",
    "fails",
    "loss",
    "safe",
    "safe_taken",
    "cpu_s",
    *(f"{part}_j" for part in PARTS),
)
#: Largest difference of two means that counts as rounding.
_ROUNDING = 1e-12
_Row = Mapping[str, Any]


def write_design(out: Path, study: Study, rows: Sequence[_Row], seed: int) -> dict[str, Any]:
    """Write ``design.csv``, ``.json`` and ``.html``; return the content of the JSON, whose keys the manual lists."""
    report = make_report(study, rows, seed)
    write_text(out / "design.csv", _make_csv(study.design, rows))
    write_json(out / "design.json", report)
    write_text(out / "design.html", _render_page(report))
    return report


def make_report(study: Study, rows: Sequence[_Row], seed: int) -> dict[str, Any]:
    """Make the content of ``design.json``."""
    design = study.design
    own, landforms = (collect_numbers(design, group_split_rows(rows, split)) for split in (OWN, LANDFORM))
    bounds = compare(own)
    ranked = len(design.suites) > 2 and landforms.grounds and own.grounds
    ranking = compare_rankings(own.loss, landforms.loss, seed) if ranked else None
    suites = _list_suites(design, own, landforms, bounds) if own.grounds else []
    return {
        "format": FORMAT,
        "version": VERSION,
        "title": design.title,
        "head": [*_make_front_sentences(suites), *_make_ranking_sentences(ranking, landforms)],
        "grounds": len(own.grounds),
        "landforms": len(landforms.grounds),
        "suites": suites,
        "differences": _list_differences(design, bounds),
        "ranking": ranking,
        "abstain_loss": design.abstain_loss,
        "costs": asdict(design.costs),
        "lamp": asdict(design.lamp) if design.lamp else None,
        "sources": dict(design.sources),
        "rules": study.rules.to_json(),
        "failed": [
            {"ground": row["pair"], "suite": row["method"], "message": row["error"]} for row in rows if row["error"]
        ],
        "notes": _make_notes(own, landforms),
        "provenance": {
            "design": str(design.path),
            "text": design.text,
            "seed": seed,
            "terrains": list(design.variety.terrains),
            "suns_deg": list(design.variety.suns_deg),
            "icymoon": version(),
            "created": datetime.now(UTC).isoformat(" ", "seconds"),
            "processor": platform.processor() or platform.machine(),
        },
    }


def _list_suites(design: Design, own: Measured, landforms: Measured, bounds: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Make the entry ``suites`` of the report."""
    names = [suite.name for suite in design.suites]
    here = summarise(design, own)
    elsewhere: list[_Row | None] = [None] * len(here)
    if landforms.grounds:
        elsewhere = [*summarise(design, landforms)]
    return [
        {
            **entry,
            "method": suite.method.label,
            "suns": suite.suns,
            "lamp_w": suite.lamp.power_w if suite.lamp else None,
            "camera": _describe_camera(suite),
            "place": front["place"],
            "beaten_by": [names[k] for k in front["by"]],
            "open_against": [names[k] for k in front["against"]],
            "landforms": other,
        }
        for suite, entry, front, other in zip(design.suites, here, find_front(bounds), elsewhere, strict=True)
    ]


def _describe_camera(suite: Suite) -> dict[str, float]:
    rig = suite.settings.rig
    return {"baseline_m": rig.baseline_m, "width_px": rig.width_px, "height_px": rig.height_px}


def _list_differences(design: Design, bounds: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List the bounds of each paired difference, a suite minus another; None without enough grounds."""
    return [
        {
            "suite": design.suites[i].name,
            "other": design.suites[k].name,
            **{
                quantity: [None if each != each else float(each) for each in bounds[quantity][i, k]]
                for quantity in QUANTITIES
            },
        }
        for i, k in combinations(range(len(design.suites)), 2)
    ]


def _make_front_sentences(suites: Sequence[_Row]) -> Iterable[str]:
    """Yield sentences on the least risk and on the place of each suite."""
    if not suites:
        return
    best = min(suites, key=lambda entry: entry[RISK]["mean"])
    (low, high), risk = best[RISK]["interval"], best[RISK]["mean"]
    stated, grounds = f"{risk:.3f} (95 %: {_show(low)} to {_show(high)})", format_count(best["grounds"], "ground")
    if len(suites) == 1:
        yield f"On {grounds}, {best['suite']} has a risk of {stated}; there is no other suite to compare with."
        return
    names = [entry["suite"] for entry in suites if entry[RISK]["mean"] <= risk + _ROUNDING]
    yield (
        f"Of {len(suites)} suites on {grounds}, {', '.join(names)} {'has' if len(names) == 1 else 'have'} the least "
        f"measured risk, {stated}; as the least of several it is rather too low."
    )
    on_front = [entry["suite"] for entry in suites if entry["place"] == FRONT]
    yield (
        f"On the front beyond doubt: {', '.join(on_front)}."
        if on_front
        else "The grounds put no suite on the front beyond doubt."
    )
    for entry in suites:
        if entry["place"] == BEATEN:
            yield f"{entry['suite']} has more risk than {', '.join(entry['beaten_by'])}, and costs no less."
    still_open = [entry["suite"] for entry in suites if entry["open_against"]]
    if still_open:
        yield f"The grounds leave open whether the front contains {', '.join(still_open)}."


def _show(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _make_ranking_sentences(ranking: _Row | None, landforms: Measured) -> Iterable[str]:
    """Yield sentences on whether the ranking by risk is the same on held-out landforms."""
    if ranking is None:
        return
    low, high = ranking["interval"]
    if ranking["tau"] is None:
        yield "The ranking by risk cannot be compared with the held-out landforms, because all suites have one risk."
        return
    ends = {
        HOLDS: f"The ranking is stable: tau is at least {STABLE_TAU:g}.",
        FAILS: f"The ranking is not stable: tau is below {STABLE_TAU:g}.",
    }
    yield (
        f"Kendall's tau-b of the rankings by risk, on these grounds and on {len(landforms.grounds)} of held-out "
        f"landforms, is {ranking['tau']:.2f} (95 %: {low:.2f} to {high:.2f}); of random halves of these grounds it is "
        f"{_show_tau(ranking['halves'])}. "
        + ends.get(
            ranking["verdict"],
            f"So the grounds leave open whether the ranking is stable, with a tau of at least {STABLE_TAU:g}.",
        )
    )


def _show_tau(tau: float | None) -> str:
    return "undefined" if tau is None else f"{tau:.2f}"


def _make_notes(own: Measured, landforms: Measured) -> list[str]:
    """Describe the limits of the numbers."""
    left_out = own.left_out + landforms.left_out
    grounds, fewest = len(own.grounds), count_fewest_grounds(DOUBT, DOUBT)
    return [
        *([f"{format_count(left_out, 'ground')} on which a suite failed count nowhere."] if left_out else []),
        *(
            [
                f"{format_count(grounds, 'ground')} without an unsafe choice would show a share of at most "
                f"{100 * bound_risk(0, grounds, DOUBT):.1f} %; to show {100 * DOUBT:g} % takes {fewest} grounds."
            ]
            if grounds < fewest
            else []
        ),
        "Processor seconds are those of matching and joining on the processor that made the rows, one thread; energy "
        "takes the stated factor for a flight computer.",
        "Waiting for another Sun or for the night, motion and heating cost nothing here.",
    ]


def list_cells(entry: _Row) -> tuple[str, ...]:
    """List the cells of a suite under ``COLUMNS``."""
    grounds, other = entry["grounds"], entry["landforms"]
    return (
        entry["suite"],
        _describe_place(entry),
        f"{entry['acted']} of {grounds}",
        f"{entry['unsafe']}, at most {100 * entry['unsafe_bound']:.0f} %",
        str(entry["dangerous"]),
        _show_interval(entry[RISK], 1, 2),
        "–" if other is None else _show_interval(other[RISK], 1, 2),
        _show_interval(entry["lost"], 100, 0),
        _show_rounded_interval(entry[ENERGY]),
        _show_rounded_interval(entry[TIME]),
    )


def _show_interval(found: _Row, factor: float, decimals: int) -> str:
    """Format a mean with its interval in brackets, if it has one. The page breaks the line before the bracket."""
    if found["mean"] is None:
        return "–"
    low, high = found["interval"]
    between = "" if low is None else f" ({factor * low:.{decimals}f} to {factor * high:.{decimals}f})"
    return f"{factor * found['mean']:.{decimals}f}{between}"


def _show_rounded_interval(found: _Row) -> str:
    low, high = found["interval"]
    between = "" if low is None else f" ({show_rounded(low, 3)} to {show_rounded(high, 3)})"
    return f"{show_rounded(found['mean'], 3)}{between}"


def _describe_place(entry: _Row) -> str:
    """Describe the place of a suite, with the suites that beat it."""
    return f"beaten by {', '.join(entry['beaten_by'])}" if entry["place"] == BEATEN else str(entry["place"])


def _make_csv(design: Design, rows: Sequence[_Row]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(_CSV_COLUMNS)
    suites = {suite.name: suite for suite in design.suites}
    for row in rows:
        landform = int(row["pair"].startswith(f"{LANDFORM}-"))
        numbers = _list_numbers(row["numbers"], suites[row["method"]], design) if row["numbers"] else []
        numbers += [""] * (len(_CSV_COLUMNS) - 4 - len(numbers))
        writer.writerow([escape_cell(row["pair"]), landform, escape_cell(row["method"]), row["status"], *numbers])
    return stream.getvalue()


def _list_numbers(numbers: _Row, suite: Suite, design: Design) -> list[str]:
    energy = compute_energy(numbers, suite, design.costs)
    return [
        *("" if each is None else f"{each:g}" for each in (float(numbers["unsafe_choice"] is not None),)),
        *(
            "" if numbers[key] is None else f"{numbers[key]:g}"
            for key in ("unsafe_choice", "dangerous_choice", "no_site")
        ),
        numbers["fails"] or "",
        f"{compute_loss(numbers, design.abstain_loss):g}",
        str(numbers["cells"][1]),
        str(numbers["cells"][3]),
        f"{numbers['cpu_s']:.6g}",
        *(f"{energy[part]:.6g}" for part in PARTS),
    ]


def _render_page(report: _Row) -> str:
    return read_template("design.html.j2", Path(__file__).parent).render(
        report=report,
        columns=COLUMNS,
        cells=list_cells,
        describe=describe_method,
        charts=[_draw_front(report["suites"], *each) for each in _CHARTS] if report["suites"] else [],
        stated=_list_sourced_numbers(report),
    )


def _list_sourced_numbers(report: _Row) -> list[tuple[str, str, str]]:
    """List the numbers of the design file with their sources."""
    numbers = {"design.abstain_loss": report["abstain_loss"]} | {
        f"{table}.{key}": value for table in ("costs", "lamp") for key, value in (report[table] or {}).items()
    }
    return [
        (name, show_rounded(value, 7), report["sources"].get(name, "Stated by the design"))
        for name, value in numbers.items()
    ]


def _find_bars(found: _Row) -> list[list[float]]:
    """Return the lengths of the error bars from a mean to its bounds; 0 with too few grounds for an interval."""
    low, high = found["interval"]
    return [[0.0], [0.0]] if low is None else [[max(found["mean"] - low, 0)], [max(high - found["mean"], 0)]]


#: The charts: quantity of the horizontal axis, its label, and the name of the chart.
_CHARTS = ((ENERGY, "Energy of a decision (J)", "energy"), (TIME, "Processor seconds of a decision", "time"))


def _draw_front(suites: Sequence[_Row], quantity: str, label: str, name: str) -> str:
    """Draw the risk of the suites against a cost, with their intervals, as SVG."""
    with matplotlib.rc_context(STYLE):
        figure, axes = make_figure(1, width=5.6, height=4.2)
        axis = axes[0, 0]
        for k, entry in enumerate(suites):
            middle = entry[RISK]["mean"]
            cost = entry[quantity]["mean"]
            colour = METHOD_COLOURS[k % len(METHOD_COLOURS)]
            axis.errorbar(
                [cost],
                [middle],
                xerr=_find_bars(entry[quantity]),
                yerr=_find_bars(entry[RISK]),
                color=colour,
                marker=METHOD_MARKS[(k + k // len(METHOD_COLOURS)) % len(METHOD_MARKS)],
                markerfacecolor="none" if entry["place"] == BEATEN else colour,
                elinewidth=1.0,
                capsize=2,
                linestyle="",
                label=entry["suite"][:24],
            )
        set_logarithmic(axis, "x")
        axis.set_ylim(bottom=0)
        axis.margins(x=0.08)
        axis.set_xlabel(label)
        axis.set_ylabel("Risk of a decision")
        add_legend(figure, axis, 5)
        return render_svg(figure, f"design-{name}", f"Risk against {label.lower()}, means with 95 % intervals")
