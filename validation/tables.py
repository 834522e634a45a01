"""Results of comparisons as text: lines for a terminal, sections of the page."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence

from ..support.number_text import format_count
from .comparison import FAILS, NOT_JUDGED, PASSES, Comparison, Result, Row

#: The verdicts in the order in which a summary counts them, and its words.
_VERDICT_WORDS = ((PASSES, "pass"), (FAILS, "fail"), (NOT_JUDGED, "are not judged"))
_COLUMN_HEADS = ("quantity", "here", "held against", "allowed", "off by", "verdict", "notes")


def format_number(value: float) -> str:
    """Format a number with four significant digits."""
    return f"{value:.4g}"


def make_row_cells(row: Row) -> tuple[str, ...]:
    """Make the cells of a row in a table, without its source and its note."""
    unit = f" {row.unit}" if row.unit else ""
    return (
        row.quantity,
        format_number(row.ours) + unit,
        format_number(row.theirs) + unit,
        f"± {format_number(row.allowed)}",
        f"{row.difference:+.2g}",
        row.verdict,
    )


def list_row_notes(rows: Sequence[Row]) -> list[str]:
    """List the causes of rows that fail, and the reasons of rows that are not judged, each once."""
    return list(dict.fromkeys(row.note for row in rows if row.note))


def list_sources(rows: Sequence[Row]) -> list[str]:
    """List the sources of the rows, each once."""
    return list(dict.fromkeys(row.source for row in rows))


def summarise_result(result: Result) -> str:
    """Summarise a comparison in one line."""
    if result.error:
        return f"{result.comparison.title}: not made. {result.error}"
    counted = [row.verdict for row in result.rows]
    parts = [f"{counted.count(verdict)} {words}" for verdict, words in _VERDICT_WORDS if verdict in counted]
    return (
        f"{result.comparison.title}: {'passes' if result.passes else 'FAILS'}; of "
        f"{format_count(len(counted), 'number')} "
        f"{', '.join(parts)}."
    )


def make_markdown_section(result: Result) -> str:
    """Make the section of a comparison on the page, without values that differ from run to run."""
    comparison = result.comparison
    command = f"`{comparison.command}`"
    lines = [f"## {comparison.title}", "", *_wrap_text(comparison.text), "", command, ""]
    if comparison.figure:
        lines += [*_wrap_text(comparison.figure), ""]
    if result.error:
        return "\n".join([*lines, f"Not made: {result.error}", ""])
    notes = [*list_sources(result.rows), *list_row_notes(result.rows)]
    numbered = [
        (*make_row_cells(row), ", ".join(str(notes.index(note) + 1) for note in [row.source, *list_row_notes([row])]))
        for row in result.rows
    ]
    table = [
        "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"
        for row in [_COLUMN_HEADS, ("---",) * len(_COLUMN_HEADS), *numbered]
    ]
    listed = [line for number, note in enumerate(notes, 1) for line in _wrap_text(f"{number}. {note}.")]
    return "\n".join([*lines, *table, "", *listed, ""])


def _wrap_text(text: str) -> list[str]:
    """Wrap a text whose own lines are paragraphs, items of lists or empty."""
    lines = []
    for part in map(str.strip, text.split("\n")):
        indent = "    " if re.match(r"(\*|\d+\.) ", part) else ""
        lines += textwrap.wrap(part, 120, subsequent_indent=indent, break_on_hyphens=False) or [""]
    return lines


def replace_sections(page: str, results: Sequence[Result]) -> str:
    """Replace the sections of these results in the page. A new section is inserted before the last section."""
    for result in results:
        new = make_markdown_section(result)
        found = _find_section(page, result.comparison)
        if found:
            page = page[: found[0]] + new + "\n" + page[found[1] :]
        else:
            last = page.rfind("\n## ") + 1
            page = page[:last] + new + "\n" + page[last:] if last else page.rstrip("\n") + "\n\n" + new
    return page.rstrip("\n") + "\n"


def _find_section(page: str, comparison: Comparison) -> tuple[int, int] | None:
    """Find the start and the end of a comparison's section, if the page has one."""
    head = f"## {comparison.title}\n"
    start = 0 if page.startswith(head) else page.find(f"\n{head}") + 1
    if not page.startswith(head, start):
        return None
    end = page.find("\n## ", start)
    return start, end + 1 if end >= 0 else len(page)
