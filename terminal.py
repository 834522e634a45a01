"""What a worker or a runner says, shown to a person at a terminal. Imports no Blender."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .errors import IcyMoonError
from .files import parse_path, shorten
from .system import is_broken_pipe


def as_path(text: str) -> Path:
    """A path of the command line, for argparse."""
    try:
        return parse_path(text, "the path")
    except IcyMoonError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def report_end(error: BaseException, program: str, stopped: str) -> int:
    """Say on standard error what has ended a command, and return its exit status.

    Whatever is neither a person's to mend nor the system's is raised again: it is a defect of ours.
    """
    if isinstance(error, OSError) and is_broken_pipe(error):
        # Nobody listens any more; keep Python from complaining when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    if isinstance(error, KeyboardInterrupt):
        print(f"{program}: {stopped}", file=sys.stderr)
        return 130
    if isinstance(error, IcyMoonError):
        print(f"{program}: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    if isinstance(error, OSError):
        where = f"{shorten(str(error.filename))}: " if error.filename is not None else ""
        print(f"{program}: {where}the system refuses it ({error.strerror or error}); mend that or choose another "
              "place.", file=sys.stderr)
        return 1
    raise error


@contextmanager
def show_progress(title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
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
