"""The ranking table, the report's first table: methods by metrics, over three sets of pixels, for all pairs and for
each condition.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..matchers.methods import describe_method
from .conditions import Condition
from .summary import ResultTable, compare_methods, summarise_method
from .table_columns import (
    METRIC_NAMES,
    NO_RESULT,
    SECONDS_COLUMN,
    TOTAL_COLUMNS,
    Column,
    format_interval,
    format_rank,
    format_result,
    is_best,
)
from .verdict_text import describe_verdicts


@dataclass(frozen=True)
class RankedColumn:
    """A column, whose number is found in a summary, and the comparison that ranks it ("" for no rank)."""

    column: Column
    compared: str


@dataclass(frozen=True)
class PixelSet:
    """A set of pixels, and the columns of the table with numbers over it."""

    key: str
    name: str
    doc: str
    columns: tuple[RankedColumn, ...]


def _make_measured_columns(prefix: str) -> tuple[RankedColumn, ...]:
    """Make the columns over measured pixels, whose keys begin with ``prefix``. They are ranked on common pixels."""
    keys = ("epe_px", "bad_1", "d1", "l1_m", "rmse_m", "l1_rate_10", "si_rmse", "dod")
    return (
        RankedColumn(replace(TOTAL_COLUMNS[0], key=f"{prefix}coverage"), f"{prefix}coverage"),
        *(
            RankedColumn(replace(METRIC_NAMES[key], key=prefix + key), f"common_{prefix}{key}" if key != "dod" else "")
            for key in keys
        ),
        RankedColumn(SECONDS_COLUMN, "seconds"),
    )


def _make_total_column(key: str, heading: str, doc: str) -> RankedColumn:
    return RankedColumn(
        Column(f"total_{key}", heading, "%", 1, f"share of all true pixels that are missing or {doc}"), f"total_{key}"
    )


VIEWS = (
    PixelSet(
        "total",
        "Missing is wrong",
        "All pixels with a true depth. One without a measurement counts as wrong, so measuring less gains nothing.",
        (
            RankedColumn(TOTAL_COLUMNS[0], "coverage"),
            _make_total_column("bad_0_5", "> 0.5 px", "wrong by more than 0.5 px"),
            _make_total_column("bad_1", "> 1 px", "wrong by more than 1 px"),
            _make_total_column("bad_2", "> 2 px", "wrong by more than 2 px"),
            _make_total_column("d1", "D1", "wrong by more than 3 px and 5 % of the disparity"),
            _make_total_column("l1_rate_10", "> 10 cm", "wrong by more than 10 cm"),
            RankedColumn(
                Column(
                    "total_dod",
                    "DOD",
                    "%",
                    2,
                    "share of all pairs of pixels of which one is missing or that are in the wrong depth order",
                ),
                "total_dod",
            ),
            RankedColumn(SECONDS_COLUMN, "seconds"),
        ),
    ),
    PixelSet(
        "measured",
        "Measured",
        "The pixels that each method measured: read the errors with the coverage. Ranks and bold compare every two "
        "methods on the pixels that both measured.",
        _make_measured_columns(""),
    ),
    PixelSet(
        "visible",
        "Not hidden",
        "The measured pixels that the right eye sees too. Ranks and bold compare every two methods on those of them "
        "that both measured.",
        _make_measured_columns("visible_"),
    ),
)
#: The view and the index of the column by which the table is sorted at first.
FIRST_SORTING = ("total", 2)


def make_ranking_table(
    table: ResultTable, summary: Sequence[Mapping[str, Any]], verdicts: str, conditions: Sequence[Condition], seed: int
) -> dict[str, Any]:
    """Make the ranking table as JSON: ``views``, ``methods``, and ``conditions``, all pairs first.

    A condition has a note on each method, and states whether there are ``intervals`` and whether methods are
    ``ranked``. Its ``cells``, by view, method and column, are [text, interval, rank, bold, number].
    """
    found = [_make_condition("All pairs", table, summary, verdicts)]
    for condition in conditions:
        part = table.where(condition.pairs)
        comparisons, ranks = compare_methods(part, seed)
        own = [summarise_method(part, k) | {"ranks": ranks[k]} for k in range(len(part.methods))]
        found.append(_make_condition(condition.name, part, own, describe_verdicts(comparisons, part)))
    views = [
        {
            "key": view.key,
            "name": view.name,
            "doc": view.doc,
            "columns": [
                [each.column.title, each.column.doc, each.column.key.endswith("coverage")] for each in view.columns
            ],
        }
        for view in VIEWS
    ]
    return {
        "methods": list(map(describe_method, table.methods)),
        "first": FIRST_SORTING,
        "conditions": found,
        "views": views,
    }


def _make_condition(
    name: str, table: ResultTable, summary: Sequence[Mapping[str, Any]], verdicts: str
) -> dict[str, Any]:
    return {
        "name": name,
        "pairs": int(table.counts.any(axis=0).sum()),
        "verdicts": verdicts,
        "intervals": any(entry["intervals"] for entry in summary),
        "ranked": any(entry["ranks"] for entry in summary),
        "notes": [_note_on_pairs(entry) for entry in summary],
        "cells": _make_cells(summary),
    }


def _note_on_pairs(entry: Mapping[str, Any]) -> str:
    """Write a note on the pairs of a method that are excluded from the numbers, and on a method without any number."""
    parts = [f"{entry[key]} {key}" for key in ("failed", "suspect") if entry[key]]
    return ", ".join([NO_RESULT] * (entry["n"] == 0) + parts)


def _make_cells(summary: Sequence[Mapping[str, Any]]) -> dict[str, list[list[list[Any]]]]:
    return {
        view.key: [[_make_cell(entry, ranked, summary) for ranked in view.columns] for entry in summary]
        for view in VIEWS
    }


def _make_cell(entry: Mapping[str, Any], ranked: RankedColumn, summary: Sequence[Mapping[str, Any]]) -> list[Any]:
    column = ranked.column
    text = format_result(entry, column)
    if text == "–":
        return [text, "", "", False, None]
    rank = format_rank(entry, ranked.compared) if ranked.compared in entry["ranks"] else ""
    return [
        text,
        format_interval(entry["intervals"].get(column.key), column),
        rank,
        is_best(entry, ranked.compared, summary),
        entry.get(column.key),
    ]
