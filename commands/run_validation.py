"""Runs the verb ``validate``: makes the requested comparisons, prints and writes them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..stereo.environment import packages
from ..support import printer
from ..support.errors import IcyMoonError
from ..support.files import refuse_file_as_folder, to_json_text, write_text
from ..support.foreign_bytes import MAX_TEXT_BYTES, read
from ..support.suggestions import suggest_nearest
from ..support.terminal import parse_list_option, show_progress
from ..validation.all_comparisons import load_comparisons
from ..validation.comparison import (
    DATA_OPTIONS,
    FAILS,
    Bench,
    Comparison,
    Result,
    Say,
    load_own_comparison,
    run_comparison,
)
from ..validation.tables import list_sources, make_markdown_section, make_row_cells, replace_sections, summarise_result


def choose_comparisons(only: Sequence[str], own: Sequence[Path], quick: bool) -> list[Comparison]:
    """Return the selected comparisons. Raises IcyMoonError for an unknown comparison, and for two with the same
    name."""
    known = [*load_comparisons(), *(load_own_comparison(path) for path in own)]
    names = [each.name for each in known]
    if double := next((name for name in names if names.count(name) > 1), None):
        raise IcyMoonError(f"--own: two comparisons have the name {double!r}; rename yours.")
    for name in only:
        if name not in names:
            raise IcyMoonError(f"--only: no comparison is called {name!r}; {suggest_nearest(name, names)}")
    return [each for each in known if (each.name in only if only else each.quick or not quick)]


def run_validate(options: argparse.Namespace) -> int:
    """Run the verb and return the exit status: 0 if all comparisons pass. Raises IcyMoonError for bad options."""
    packages.require_modules("numpy", "cv2", "OpenEXR")
    only = parse_list_option(options.only)
    chosen = choose_comparisons(only, options.own_files, options.quick)
    without = [each for each in chosen if each.needs and each.name not in only and getattr(options, each.needs) is None]
    for each in without:
        printer.warn(f"{each.title}: left out, because it needs data; give their folder by --{each.needs}.")
    chosen = [each for each in chosen if each not in without]
    if options.page and not options.page.is_file():
        raise IcyMoonError(f"--page: there is no page {options.page}; give one that exists.")
    out = options.out.absolute()
    refuse_file_as_folder(out, "--out")
    results = [_run_one(each, out, options) for each in chosen]
    out.mkdir(parents=True, exist_ok=True)
    report = {
        "passes": all(result.passes for result in results),
        "quick": options.quick,
        "comparisons": [result.to_json() for result in results],
    }
    write_text(out / "validation.json", to_json_text(report))
    write_text(out / "validation.md", "\n".join(make_markdown_section(result) for result in results))
    if options.page:
        page = _read_page(options.page)
        write_text(options.page, replace_sections(page, results))
    if options.json:
        printer.emit_json(report)
    else:
        printer.say(str(out / "validation.md"))
    return 0 if report["passes"] else 1


def _read_page(path: Path) -> str:
    return read(path, lambda foreign: foreign.text(), "a page", "give --page another", most=MAX_TEXT_BYTES)


def _make_bench(out: Path, options: argparse.Namespace, say: Say = lambda message: None) -> Bench:
    return Bench(out, options.blender, options.quick, say, **{name: getattr(options, name) for name in DATA_OPTIONS})


def _run_one(comparison: Comparison, out: Path, options: argparse.Namespace) -> Result:
    if options.json:
        return run_comparison(comparison, _make_bench(out, options))
    with show_progress(comparison.title) as show:

        def say(message: dict[str, Any]) -> None:
            if message["type"] == "progress":
                show(message)

        result = run_comparison(comparison, _make_bench(out, options, say))
        show({"type": "done"})
    _print_result(result)
    return result


def _print_result(result: Result) -> None:
    if result.rows:
        rows: list[list[str | tuple[str, str]]] = []
        for row in result.rows:
            quantity, *numbers, verdict = make_row_cells(row)
            rows.append([quantity.replace("`", ""), *numbers, (verdict, "red" if row.verdict == FAILS else "")])
        printer.print_table(("", "here", "held against", "allowed", "off by", "verdict"), rows, left=range(6))
    for source in list_sources(result.rows):
        printer.say(f"  Source: {source}")
    for row in result.rows:
        if row.note:
            printer.say(f"  {row.quantity.replace('`', '')}: {row.note}")
    printer.say(summarise_result(result))
