"""What a worker or a runner says, shown to a person at a terminal. Imports no Blender."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def shown(title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
    """A progress bar; messages that are given to it move it or become lines above it."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    with Progress(TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
                  TimeElapsedColumn(), TimeRemainingColumn(), transient=False) as bar:
        task = bar.add_task(title, total=1.0)

        def show(message: dict[str, Any]) -> None:
            kind = message["type"]
            if kind == "progress":
                bar.update(task, completed=message["fraction"], description=message["message"])
            elif kind == "warning":
                bar.console.print(f"[yellow]Warning:[/] {message['message']}")
            elif kind == "pair":
                done = f"rendered in {message['seconds']:.0f} s" if message["rendered"] else "was already there"
                bar.console.print(f"  {message['folder']} {done}", highlight=False)
            elif kind == "error" and "pair" in message:
                bar.console.print(f"[red]Set aside:[/] {message['message']}")
            elif kind == "done":
                bar.update(task, completed=1.0)

        yield show
