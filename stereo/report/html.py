"""The HTML report: one file that contains everything and opens without a network.

Its size is bounded, so it stays readable for any number of pairs. It contains the pictures of selected pairs, and a
table of all pairs, page by page. A click in the table loads the pictures of a pair from the folder beside the report.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from ...settings.toml_text import to_toml
from ...support.files import write_text
from ...support.number_text import format_count
from ..images import colours
from ..inference.scene_means import FEWEST_FOR_MEAN
from ..matchers.methods import Method, describe_method
from ..measure.row_metrics import REGION_METRICS, REGIONS
from .by_setting import SCENE_SWEEP, VariedSetting
from .charts import draw_charts, list_method_keys
from .conditions import Condition
from .confidence_table import CONFIDENCE_COLUMNS, list_confidence_rows
from .page_templates import read_template
from .phase_curves import compute_phase_curves
from .pictures import (
    MAX_IN_MATRIX,
    MAX_PICTURES,
    choose_typical_pairs,
    embed_left_image,
    embed_picture,
    make_picture_matrix,
)
from .summary import ResultTable
from .sweep_charts import MAX_SWEEPS, draw_sweeps
from .table_columns import (
    COMPARED_COLUMNS,
    GUISS_COLUMNS,
    MEASURED_COLUMNS,
    METRIC_NAMES,
    RANKING_METRIC,
    SECONDS_COLUMN,
    SUMMARY_COLUMNS,
    TOTAL_COLUMNS,
    format_interval,
    format_mean,
    format_number,
    format_plugin,
    make_plugin_columns,
)

#: Most pairs shown with pictures; half of them are the worst ones. The CSV file contains all.
MAX_PAIRS = 24
#: Most scenes that the head of the report names.
_MAX_SCENES = 8
_TEMPLATE_FOLDER = Path(__file__).parent
#: Number of pictures of a pair, and of each method on it besides its confidence.
_PICTURES_PER_PAIR, _PICTURES_PER_METHOD = 2, 3
#: The columns of the table of all pairs, for each method: key, heading, decimals, factor.
_PAGED_COLUMNS = (
    ("total_bad_1", "> 1 px or missing (%)", 1, 100.0),
    ("coverage", "coverage (%)", 1, 100.0),
    ("epe_px", "EPE of measured (px)", 3, 1.0),
)
#: Facts about pairs of which the report lists the distinct values.
_MIXED_FACTS: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "data": lambda facts: facts.get("layout", "rendered here"),
    "image (px)": lambda facts: f"{facts['width_px']} × {facts['height_px']}",
    "f·B (px·m)": lambda facts: f"{facts['focal_baseline_px_m']:.6g}",
    "Blender": lambda facts: str(facts["rendered"].get("versions", {}).get("blender", "unknown")),
    "samples per pixel": lambda facts: str(facts["settings"].get("quality", {}).get("samples", "unknown")),
    "denoiser": lambda facts: str(facts["rendered"].get("denoiser", "unknown")),
    "device": lambda facts: str(facts["rendered"].get("device", "unknown")),
    "bits": lambda facts: str(facts["settings"].get("sensor", {}).get("bits", "unknown")),
    "edited by hand": lambda facts: "yes" if facts["rendered"].get("edited_by_hand") else "no",
}
#: Entries that pairs of other data sets have too.
_OF_ALL = ("data", "image (px)", "f·B (px·m)")


@cache
def _read_template() -> jinja2.Template:
    """Read the template of the page, compiled once per process."""
    return read_template("report.html.j2")


def write_report(
    report: Mapping[str, Any],
    ranking: Mapping[str, Any],
    chosen: Sequence[str],
    titles: Sequence[str],
    conditions: Sequence[Condition],
    table: ResultTable,
    sweeps: Sequence[VariedSetting],
    methods: Sequence[Method],
    out: Path,
    guiss: bool,
) -> None:
    """Write ``out/report.html`` from the result of ``evaluate`` and the pictures in ``out``.

    It contains the pictures of the pairs ``chosen`` and of a typical pair of each condition. ``ranking`` is from
    ``make_ranking_table``, and ``titles`` are the titles of all pairs, see ``conditions``.
    """
    script = (_TEMPLATE_FOLDER / "report.js").read_text(encoding="utf-8").strip()
    typical = choose_typical_pairs(table, conditions)
    names = {*chosen, *(table.pairs[pair] for _, pair in typical)}
    facts_of = {facts["pair"]: facts for facts in report["pairs"] if facts["pair"] in names}
    html = _read_template().render(
        report=report,
        ranking=ranking,
        keys=list_method_keys(table.methods),
        regions=REGIONS,
        region_metrics=REGION_METRICS,
        metric_names=METRIC_NAMES,
        columns=SUMMARY_COLUMNS,
        totals=(*TOTAL_COLUMNS, SECONDS_COLUMN),
        measured=MEASURED_COLUMNS,
        compared=_make_comparison_rows(report["comparisons"]),
        compared_columns=COMPARED_COLUMNS,
        compared_methods=len({entry[side] for entry in report["comparisons"] for side in "ab"}),
        fewest_for_mean=FEWEST_FOR_MEAN,
        format_number=format_number,
        format_interval=format_interval,
        guiss=GUISS_COLUMNS if guiss else (),
        confidence=list_confidence_rows(report["summary"]),
        confidence_columns=CONFIDENCE_COLUMNS,
        plugin_columns=make_plugin_columns(report["plug_ins"]),
        format_plugin=format_plugin,
        format_mean=format_mean,
        charts=draw_charts(report["summary"], table, compute_phase_curves(report["pairs"]), report["comparisons"]),
        sweeps=draw_sweeps(report["summary"], table, sweeps),
        other_sweeps=[sweep.title for sweep in sweeps[MAX_SWEEPS:]],
        scenes=_list_scenes(sweeps, table),
        mixed=count_values(report["pairs"]),
        warned=count_sentences(report["pairs"], "warnings"),
        told=count_sentences(report["pairs"], "notes"),
        error_bar=_describe_colour_bar(colours.ERROR_SCALE),
        confidence_bar=_describe_colour_bar(colours.CONFIDENCE_SCALE),
        invalid=colours.INVALID_GREY,
        sky=colours.SKY_GREY,
        matrix=make_picture_matrix(typical, table, facts_of, report["rows"], out),
        left_out=len(conditions) - len(typical),
        pairs=[
            _make_pair_section(facts_of[name], report, table, out) for name in sorted(chosen, key=table.pairs.index)
        ],
        titles=dict(zip(table.pairs, titles, strict=True)),
        data=_make_page_data(table, titles, ranking, methods),
        script=script,
        script_hash=_hash_script(script),
    )
    write_text(out / "report.html", html)


def _list_scenes(sweeps: Sequence[VariedSetting], table: ResultTable) -> str:
    """List the scenes of the pairs, as in "2 scenes: Enceladus suncups, Europa chaos"; "" if they are not from
    presets.
    """
    names = [name for sweep in sweeps if sweep.name == SCENE_SWEEP for name in sweep.levels()[0]]
    if not names:
        return ""
    grounds = len(np.unique(table.scenes[table.scenes >= 0]))
    more = [f"{len(names) - _MAX_SCENES} more"] if len(names) > _MAX_SCENES else []
    presets = f" from {len(names)} presets" if grounds > len(names) else ""
    count = format_count(max(grounds, len(names)), "scene")
    return f"{count}{presets}: {', '.join([*names[:_MAX_SCENES], *more])}"


def choose_pairs(table: ResultTable, names: Sequence[str]) -> list[str]:
    """Choose the pairs to show, by name: all pairs, or if there are too many, the worst pairs and an equal number of
    others at equal steps.

    The worst pairs have the most wrong or missing pixels by any method that measured anything. Pairs that count in no
    average are the worst of all.
    """
    room = MAX_PICTURES - MAX_IN_MATRIX
    per_method = _PICTURES_PER_METHOD + table.confidence.is_known()
    most = max(2, min(MAX_PAIRS, room // (_PICTURES_PER_PAIR + per_method * len(table.methods))))
    if len(names) <= most:
        return list(names)
    measured = [k for k in range(len(table.methods)) if np.nansum(table.column(k, "n")) > 0]
    errors = np.stack([table.column(k, RANKING_METRIC) for k in measured or range(len(table.methods))])
    badness = dict(zip(table.pairs, np.where(np.isnan(errors), np.inf, errors).max(axis=0).tolist(), strict=True))
    worst = sorted(names, key=badness.__getitem__, reverse=True)[: most // 2]
    rest = [name for name in names if name not in set(worst)]
    even = np.linspace(0, len(rest) - 1, most - len(worst)).round().astype(int)
    return [*worst, *(rest[i] for i in even)]


def count_values(facts: Iterable[Mapping[str, Any]]) -> dict[str, list[tuple[str, int]]]:
    """Count the provenance of the pairs: for each of _MIXED_FACTS, the distinct values and the number of pairs with
    each.
    """
    found: dict[str, dict[str, int]] = {name: {} for name in _MIXED_FACTS}
    for pair in facts:
        for name, get in _MIXED_FACTS.items():
            if "layout" in pair and name not in _OF_ALL:
                continue
            value = get(pair)
            found[name][value] = found[name].get(value, 0) + 1
    return {name: sorted(counts.items(), key=lambda entry: -entry[1])[:8] for name, counts in found.items()}


def count_sentences(facts: Iterable[Mapping[str, Any]], kind: str) -> list[tuple[str, int]]:
    """Count the pairs with each sentence of a ``kind``: the "warnings" about pairs, or the "notes" on them."""
    found: dict[str, int] = {}
    for text in (text for pair in facts for text in pair.get(kind, ())):
        found[text] = found.get(text, 0) + 1
    return sorted(found.items(), key=lambda entry: -entry[1])


def _make_comparison_rows(comparisons: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Make a row for every two methods, with their comparison by each metric."""
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    for entry in comparisons:
        rows.setdefault((entry["a"], entry["b"]), {"a": entry["a"], "b": entry["b"], "metrics": {}})["metrics"][
            entry["metric"]
        ] = entry
    return list(rows.values())


def _make_page_data(
    table: ResultTable, titles: Sequence[str], ranking: Mapping[str, Any], methods: Sequence[Method]
) -> str:
    """Make the ranking and the table of all pairs for the script of the page: JSON that is safe inside a script
    element.
    """
    columns = [[table.column(k, key) * factor for key, _, _, factor in _PAGED_COLUMNS] for k in range(len(methods))]
    counted, failed = table.counts.any(axis=0), table.failed.any(axis=0)
    rows = []
    for p, name in enumerate(table.pairs):
        status = "failed" if failed[p] else "" if counted[p] else "suspect"
        rows.append(
            [
                name,
                titles[p],
                status,
                *(
                    None if np.isnan(column[p]) else round(float(column[p]), decimals)
                    for own in columns
                    for column, (_, _, decimals, _) in zip(own, _PAGED_COLUMNS, strict=True)
                ),
            ]
        )
    text = json.dumps(
        {
            "methods": [[describe_method(method.label), method.file_name] for method in methods],
            "columns": [[heading, decimals] for _, heading, decimals, _ in _PAGED_COLUMNS],
            "pairs": rows,
            "ranking": ranking,
        },
        separators=(",", ":"),
        allow_nan=False,
    )
    return text.replace("<", "\\u003c")


def _hash_script(script: str) -> str:
    """Make the hash by which the page's security policy allows its one script."""
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")


def _make_pair_section(
    facts: Mapping[str, Any], report: Mapping[str, Any], table: ResultTable, out: Path
) -> dict[str, Any]:
    height = facts["height_px"]
    low, high = facts["depth_scale_m"]
    nearest, _, farthest = facts["depth_m"] or (low, low, high)
    scale = colours.name_depth_scale(low, high, nearest, farthest)
    start = table.pairs.index(facts["pair"]) * len(table.methods)
    rows = report["rows"][start : start + len(table.methods)]
    return {
        "facts": facts,
        "left": embed_left_image(facts, out),
        "true_depth": embed_picture(out / facts["images"]["true_depth"], height),
        "depth_bar": _describe_colour_bar(scale),
        "settings": to_toml(facts["settings"]),
        "methods": [
            {
                "row": row,
                "outcomes": colours.make_outcome_legend(row["counts"]),
                **{
                    kind: embed_picture(out / row["images"][kind], height)
                    for kind in ("depth", "error", "confidence", "flags")
                    if kind in row["images"]
                },
            }
            for row in rows
        ],
    }


def _describe_colour_bar(scale: colours.Scale) -> dict[str, Any]:
    ticks: Sequence[tuple[float, str]] = [(100 * share, text) for share, text in scale.labels]
    return {"title": scale.title, "gradient": ", ".join(scale.gradient()), "ticks": ticks}
