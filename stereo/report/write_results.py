"""Write the results of an evaluation: CSV, JSON and the HTML report."""

from __future__ import annotations

import csv
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TextIO

from ...settings.shared_settings import find_shared, remove_shared
from ...support.errors import IcyMoonError
from ...support.file_schemas import read_record
from ...support.files import escape_cell, write_atomically, write_json
from ...support.number_text import format_count
from ..environment import packages
from ..inference.scene_means import FEWEST_EXACT, FEWEST_FOR_MEAN
from ..matchers.methods import Method
from ..measure import common_pixels
from ..measure.confidence_metrics import list_confidence_columns, list_confidence_numbers
from ..measure.metrics import ERROR_STEPS_M, KEPT_SHARES
from ..measure.plug_in import load_plugin_metrics
from ..measure.row_metrics import NUMBERS, REGIONS
from .by_setting import find_swept_settings, name_scene
from .conditions import find_preset_title, join_by_scene, list_conditions, make_pair_titles, name_levels
from .html import choose_pairs, write_report
from .notes import Notes
from .ranking_table import make_ranking_table
from .rare_failures import describe_rare_failures
from .row_log import LazyRows, Row, RowLog
from .schema import FACTS, LONG, Comparison, Failure, Report
from .summary import ResultTable, compare_methods, summarise_method
from .sweep_charts import write_curves
from .verdict_text import describe_typical, describe_verdicts

FORMAT = "icymoon-report"
VERSION = 4
#: Entries of the report that grow with the number of pairs, so ``summary.json`` lacks them.
_LONG_ENTRIES = ("rows", "pairs")


def write_results(
    log: RowLog,
    names: Sequence[str],
    methods: Sequence[Method],
    out: Path,
    failed: list[Failure],
    suspect: list[Failure],
    source: Mapping[str, Any],
    seed: int,
    guiss: bool,
    faults: Sequence[str] = (),
) -> Report:
    """Write ``results.csv``, ``comparisons.csv``, ``report.json``, ``summary.json`` and ``report.html`` for the pairs
    ``names``; return the report. ``faults`` are sentences about plug-ins that were left out.
    """
    labels = [method.label for method in methods]
    rows = LazyRows(
        len(names) * len(labels), lambda k: _shorten_row(log.read(names[k // len(labels)], labels[k % len(labels)]))
    )
    usable = [name for name in names if find_facts(out, name) and not _make_all_failed_error(log, name, labels)]
    facts = LazyRows(len(usable), lambda k: read_facts(out, usable[k]))
    table, notes, places = ResultTable(labels, names), Notes(methods, faults), {name: k for k, name in enumerate(names)}
    ran_on = _fill_table_and_notes(table, notes, log, facts, places)
    comparisons, ranks = compare_methods(table, seed, with_means=True)
    summary = [summarise_method(table, k) | {"ranks": own} for k, own in enumerate(ranks)]
    sweeps = join_by_scene(find_swept_settings(facts, places), facts, places)
    verdicts = describe_verdicts(comparisons, table)
    report: Report = {
        "format": FORMAT,
        "version": VERSION,
        "summary": summary,
        "curves": write_curves(summary, table, sweeps, out),
        "comparisons": comparisons,
        "verdicts": verdicts,
        "typical_differences": describe_typical(comparisons),
        "rare_failures": [each for each in describe_rare_failures(table) if each in verdicts],
        "rows": rows,
        "pairs": facts,
        "failed": failed,
        "suspect": suspect,
        "notes": [note.sentence for note in notes.found()],
        "briefs": [note.brief for note in notes.found()],
        "doubts": [note.sentence for note in notes.found() if note.doubtful],
        "noise_doubt": notes.noise_doubt,
        "plug_ins": [metric.to_json() for metric in load_plugin_metrics()[0]],
        "provenance": _describe_provenance(methods, ran_on, source, seed),
    }
    chosen = choose_pairs(table, usable)
    _write_files(out, report, [rows[places[name] * len(labels) + k] for name in chosen for k in range(len(labels))])
    levels = name_levels(sweeps, facts, places)
    titles = make_pair_titles(sweeps, levels, len(names)) if sweeps else [_find_preset_title(facts)] * len(names)
    conditions = list_conditions(sweeps, levels)
    ranking = make_ranking_table(table, summary, verdicts, conditions, seed)
    write_report(report, ranking, chosen, titles, conditions, table, sweeps, methods, out, guiss)
    return report


def _fill_table_and_notes(
    table: ResultTable, notes: Notes, log: RowLog, facts: Iterable[Mapping[str, Any]], places: Mapping[str, int]
) -> dict[str, list[Any]]:
    """Add the facts of all pairs and all rows to a table and to notes. Return the distinct facts on the runs of each
    method.
    """
    scenes: dict[str, int] = {}
    for pair in facts:
        place = places[pair["pair"]]
        table.by_noise[place] = notes.add_pair(pair)
        table.scenes[place] = scenes.setdefault(pair.get("scene") or name_scene(pair), len(scenes))
    ran_on: dict[str, list[Any]] = {label: [] for label in table.methods}
    for place, name in enumerate(table.pairs):
        for label in table.methods:
            row = log.read(name, label)
            notes.add(row)
            table.add(place, row)
            if row["facts"] and row["facts"] not in ran_on[label]:
                ran_on[label].append(row["facts"])
    return ran_on


def _write_files(out: Path, report: Report, shown: list[Row]) -> None:
    """Write all files except the page; ``shown`` are the rows of the pairs that the page shows."""
    metrics = [metric["name"] for metric in report["plug_ins"]]
    measures = {measure for entry in report["summary"] for measure in entry["confidence"]}
    write_atomically(out / "results.csv", lambda part: _write_csv(part, report["rows"], metrics, measures))
    write_atomically(out / "comparisons.csv", lambda part: _write_comparisons(part, report["comparisons"]))
    write_atomically(out / "report.json", lambda part: _write_report_json(part, report, report["pairs"]))
    few = {key: value for key, value in report.items() if key not in _LONG_ENTRIES}
    write_json(out / "summary.json", few | {"shown": shown})


def _find_preset_title(facts: Sequence[Mapping[str, Any]]) -> str:
    return find_preset_title(facts[0]["settings"]) if facts else ""


def find_facts(out: Path, pair: str) -> dict[str, Any] | None:
    """Find the facts of a pair; None if they are missing or damaged."""
    with suppress(OSError, IcyMoonError):
        return dict(read_facts(out, pair))
    return None


def read_facts(out: Path, pair: str) -> dict[str, Any]:
    """Read the facts of a pair. Raises IcyMoonError if they cannot be read."""
    facts: dict[str, Any] = read_record(out / "pairs" / pair / "facts.json", FACTS, "evaluate again")
    return facts


def _make_all_failed_error(log: RowLog, pair: str, labels: Sequence[str]) -> bool:
    return all(log.read(pair, label)["status"] == "failed" and not log.read(pair, label)["images"] for label in labels)


def _shorten_row(row: Row) -> Row:
    return {key: value for key, value in row.items() if key not in LONG}


def _write_csv(part: Path, rows: Iterable[Row], metrics: Sequence[str], measures: Collection[str]) -> None:
    """Write all rows as CSV with a header line. After our numbers come the ``metrics`` of plug-ins and the metrics of
    the ``measures`` of confidence; undefined numbers are empty.
    """
    stated = list_confidence_columns(measures)
    with part.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(
            stream,
            ("pair", "method", "status", *NUMBERS, *metrics, *stated, "error"),
            extrasaction="ignore",
            lineterminator="\n",
        )
        writer.writeheader()
        texts = ("pair", "method", "error")
        writer.writerows(
            {**row.get("plug_ins", {}), **list_confidence_numbers(row), **row}
            | {key: escape_cell(row[key]) for key in texts}
            for row in rows
        )


def _write_comparisons(part: Path, comparisons: Sequence[Comparison]) -> None:
    """Write the comparisons of every two methods as CSV with a header line; undefined numbers are empty."""
    with part.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, tuple(Comparison.__annotations__), extrasaction="raise", lineterminator="\n")
        writer.writeheader()
        writer.writerows(
            dict(entry)
            | {"a": escape_cell(entry["a"]), "b": escape_cell(entry["b"]), "better": escape_cell(entry["better"] or "")}
            for entry in comparisons
        )


def _write_report_json(part: Path, report: Report, facts: Sequence[Mapping[str, Any]]) -> None:
    """Write the report as JSON, row by row. Raises ValueError for NaN, which JSON does not have.

    Settings that all pairs share are in ``shared_settings``, and ``settings`` of each pair are its own.
    """
    shared = find_shared(pair["settings"] for pair in facts)

    def shorten(pair: Mapping[str, Any]) -> Row:
        return {**pair, "settings": remove_shared(pair["settings"], shared)}

    own = LazyRows(len(facts), lambda k: shorten(facts[k]))
    written = {**report, "pairs": own, "shared_settings": shared}
    with part.open("w", encoding="utf-8", newline="\n") as stream:
        for k, (key, value) in enumerate(written.items()):
            stream.write(f"{',' if k else '{'}\n {json.dumps(key)}: ")
            if isinstance(value, LazyRows):
                _write_list(stream, value)
            else:
                stream.write(json.dumps(value, allow_nan=False))
        stream.write("\n}\n")


def _write_list(stream: TextIO, entries: Iterable[Row]) -> None:
    stream.write("[")
    for k, entry in enumerate(entries):
        stream.write(("," if k else "") + "\n  " + json.dumps(entry, allow_nan=False))
    stream.write("\n ]")


def _describe_provenance(
    methods: Sequence[Method], facts: Mapping[str, list[Any]], source: Mapping[str, Any], seed: int
) -> dict[str, Any]:
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        **source,
        "methods": [
            {"label": method.label, "name": method.name, "options": method.options, "facts": facts[method.label]}
            for method in methods
        ],
        "versions": packages.find_versions(),
        "error_curve_steps_m": list(ERROR_STEPS_M),
        "sparsification_shares": list(KEPT_SHARES),
        "averages": "mean over pairs, each pair with equal weight; pooled_* over the pixels of all pairs",
        "intervals": f"95 %, over scenes: of shares from 2 scenes on, of other means from "
        f"{format_count(FEWEST_FOR_MEAN, 'scene')} on, approximate below {FEWEST_EXACT}",
        "verdicts": "typical scene (pseudomedian), signed ranks, random signs of scenes, 5 % for all "
        f"comparisons by a metric, seed {seed}",
        "pixels": REGIONS
        | {
            f"common_{prefix}": f"pixels that both compared methods measured, {which}"
            for prefix, which in common_pixels.REGIONS.items()
        },
        "seconds": "CPU seconds of matching, one thread",
    }
