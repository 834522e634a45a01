"""The GUISS paper's two tables, printed and measured, as cells, CSV and LaTeX."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...support.number_text import format_count
from ..report.table_columns import GUISS_COLUMNS, TOTAL_COLUMNS, Column, format_interval, format_number
from .printed import PAIRS_BY_GROUP, PRINTED_METRICS, RENDERING_S, TABLE_METHODS, PrintedMethod
from .results import PaperResults

#: The text of a table cell without a number.
NO_NUMBER = "–"
#: LaTeX text for each special character.
_LATEX_ESCAPES = {
    "&": r"\&",
    "%": r"\%",
    "_": r"\_",
    "#": r"\#",
    "$": r"\$",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
}
_LATEX_ESCAPES |= {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "–": "--", "±": r"$\pm$", "×": r"$\times$"}
#: Columns of run times: the printed seconds, the measured processor seconds and the elapsed seconds.
RUNTIME_COLUMNS = ("", "printed (s)", "printed on", "measured (CPU s)", "measured (s)", "over")


@dataclass(frozen=True)
class ResultRow:
    """A method in a group of pairs. ``printed``, ``theirs`` (measured as the paper's code does) and ``ours`` are texts
    by PRINTED_METRICS, and ``intervals`` belong to ``ours``. ``numbers`` are the same in metres and shares, None if
    unknown.
    """

    group: str
    method: str
    printed: tuple[str, ...]
    theirs: tuple[str, ...]
    ours: tuple[str, ...]
    intervals: tuple[str, ...]
    coverage: str
    pairs: int
    numbers: Mapping[str, tuple[float | None, ...]]


def list_metric_columns() -> list[tuple[Column, Column]]:
    """List, for each of PRINTED_METRICS, the column of the paper's code and our column."""
    return [next(both for both in GUISS_COLUMNS if both[1].key == key) for key in PRINTED_METRICS]


def make_result_rows(measured: PaperResults, with_theirs: bool) -> list[ResultRow]:
    """Make the rows of the table of results: one for each group and method, also for methods that were not run.

    Without ``with_theirs`` the numbers of the paper's code are left out, because it works only for images of the
    paper's size.
    """
    found = []
    for group in PAIRS_BY_GROUP:
        for method in TABLE_METHODS:
            summary = measured.summary(method.matcher, group)
            printed = method.results[group] if isinstance(method, PrintedMethod) else (None,) * len(PRINTED_METRICS)
            numbers: dict[str, tuple[float | None, ...]] = {"printed": printed}
            for k, name in enumerate(("theirs", "ours")):
                known = summary is not None and (name == "ours" or with_theirs)
                numbers[name] = tuple(
                    summary[both[k].key] if known and summary else None for both in list_metric_columns()
                )
            columns = [ours for _, ours in list_metric_columns()]
            bounds = summary["intervals"] if summary else {}
            texts = {
                name: tuple(
                    format_number({c.key: v}, _round_as_printed(c)) for c, v in zip(columns, values, strict=True)
                )
                for name, values in numbers.items()
            }
            found.append(
                ResultRow(
                    group,
                    method.title,
                    texts["printed"],
                    texts["theirs"],
                    texts["ours"],
                    tuple(format_interval(bounds.get(c.key), _round_as_printed(c)) for c in columns),
                    format_number(summary, TOTAL_COLUMNS[0]) if summary else NO_NUMBER,
                    summary["pairs"] if summary else 0,
                    numbers | {"coverage": (summary["coverage"] if summary else None,)},
                )
            )
    return found


def _round_as_printed(column: Column) -> Column:
    """Return a column with as many decimals as the paper prints."""
    return Column(column.key, column.heading, column.unit, 1 if column.unit == "%" else 2, column.doc)


def make_runtime_rows(measured: PaperResults, rendering: Mapping[str, tuple[float, int]]) -> list[tuple[str, ...]]:
    """Make the rows of the table of run times, with ``RUNTIME_COLUMNS``: the matchers, then rendering; see
    ``measure_rendering_seconds``.
    """
    rows = []
    for method in TABLE_METHODS:
        printed = (f"{method.seconds:g}", method.machine) if isinstance(method, PrintedMethod) else (NO_NUMBER,) * 2
        summary = measured.summary(method.matcher, "All")
        took = [summary[key] if summary else None for key in ("seconds", "wall_seconds")]
        rows.append(
            (
                method.title,
                *printed,
                *(NO_NUMBER if each is None else f"{each:.3g}" for each in took),
                format_count(summary["pairs"], "pair") if summary else NO_NUMBER,
            )
        )
    for group, seconds in RENDERING_S.items():
        found = rendering.get(group)
        rows.append(
            (
                f"Rendering, {group.lower()}",
                f"about {seconds:g}",
                "i7 laptop",
                f"{found[0]:.3g}" if found else NO_NUMBER,
                NO_NUMBER,
                format_count(found[1], "pair") if found else NO_NUMBER,
            )
        )
    return rows


def make_results_csv(rows: Sequence[ResultRow]) -> str:
    """Write the table of results as CSV, a line for each number: metres and shares; unknown numbers are empty."""
    lines: list[Sequence[Any]] = [("group", "method", "metric", "printed", "paper_code", "measured", "pairs")]
    for row in rows:
        for k, metric in enumerate(PRINTED_METRICS):
            numbers = (row.numbers[name][k] for name in ("printed", "theirs", "ours"))
            lines.append((row.group, row.method, metric, *numbers, row.pairs))
        lines.append((row.group, row.method, "coverage", None, None, row.numbers["coverage"][0], row.pairs))
    return _make_csv(lines)


def make_runtimes_csv(rows: Sequence[Sequence[str]]) -> str:
    """Write the table of run times as CSV; unknown numbers are empty."""
    return _make_csv([RUNTIME_COLUMNS, *([text if text != NO_NUMBER else "" for text in row] for row in rows)])


def _make_csv(lines: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue()


def make_results_latex(rows: Sequence[ResultRow], caption: str) -> str:
    """Write the table of results in LaTeX, as a floating table over two columns, without packages."""
    metrics = [ours for _, ours in list_metric_columns()]
    head = [
        " & "
        + " & ".join(rf"\multicolumn{{3}}{{c}}{{{escape_latex(_round_as_printed(c).title)}}}" for c in metrics)
        + " & ",
        "Method" + " & printed & its code & measured" * len(metrics) + r" & coverage (\%)",
    ]
    body = []
    for group in PAIRS_BY_GROUP:
        body.append(rf"\multicolumn{{{2 + 3 * len(metrics)}}}{{l}}{{\textit{{{escape_latex(group)}}}}}")
        for row in rows:
            if row.group == group:
                cells = [text for each in zip(row.printed, row.theirs, row.ours, strict=True) for text in each]
                body.append(" & ".join(map(escape_latex, (row.method, *cells, row.coverage))))
    return _make_latex_table("l" + "r" * (3 * len(metrics) + 1), head, body, caption)


def make_runtimes_latex(rows: Sequence[Sequence[str]], caption: str) -> str:
    """Write the table of run times in LaTeX."""
    head = [" & ".join(map(escape_latex, RUNTIME_COLUMNS))]
    return _make_latex_table("lrlrrr", head, [" & ".join(map(escape_latex, row)) for row in rows], caption)


def _make_latex_table(columns: str, head: Sequence[str], body: Sequence[str], caption: str) -> str:
    end = r" \\"
    lines = [
        r"\begin{table*}",
        rf"\caption{{{escape_latex(caption)}}}",
        r"\centering\footnotesize",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\hline",
        *(line + end for line in head),
        r"\hline",
        *(line + end for line in body),
        r"\hline",
        r"\end{tabular}",
        r"\end{table*}",
    ]
    return "\n".join(lines) + "\n"


def escape_latex(text: str) -> str:
    """Escape the special characters of LaTeX in a text."""
    return "".join(_LATEX_ESCAPES.get(letter, letter) for letter in text)
