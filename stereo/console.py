"""What a person at a terminal sees of an evaluation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from .report.table_columns import SUMMARY, shown


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
    """A progress bar on standard error; gives the function that takes events."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(title)

        def on_event(event: dict[str, Any]) -> None:
            if event["type"] == "progress":
                progress.update(task, total=event["total"], completed=event["done"], description=event["message"])
            else:
                progress.console.print(event["message"], markup=False, highlight=False)

        yield on_event


def print_summary(report: dict[str, Any]) -> None:
    """The summary of ``evaluate`` as a table on standard output."""
    table = Table(title="Mean over pairs, all pixels with a true depth", title_justify="left")
    table.add_column("Method")
    for column in SUMMARY:
        table.add_column(column.title, justify="right")
    for entry in report["summary"]:
        table.add_row(entry["method"], *(shown(entry, column) for column in SUMMARY))
    console = Console()
    if not console.is_terminal:
        console.width = max(console.width, 120)  # a pipe has no width; a wrapped table is of no use to it
    console.print(table)
