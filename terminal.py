"""What a command shows at a terminal: its progress, and why it ended. Imports no Blender."""

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
    """Print on standard error what has ended a command, and return its exit status.

    An error that neither the user nor the system can cause is a defect of ours, and is raised again.
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
        print(f"{program}: {where}the system refuses it ({error.strerror or error}); fix that or choose another "
              "place.", file=sys.stderr)
        return 1
    raise error


@contextmanager
def show_progress(title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Show a progress bar of renders; gives the function that takes the messages of a worker or a runner.

    A message moves the bar or becomes a line above it.
    """
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


@contextmanager
def show_count(title: str) -> Iterator[Callable[[int, int], None]]:
    """Show a line on standard error that counts what is done, if that is a terminal; gives the function that takes how
    many of how many are."""
    def show(done: int, total: int) -> None:
        if sys.stderr.isatty():
            print(f"\r\033[K{title}: {done} of {total}", end="", file=sys.stderr, flush=True)

    try:
        yield show
    finally:
        if sys.stderr.isatty():
            print("\r\033[K", end="", file=sys.stderr, flush=True)


@contextmanager
def show_counted_progress(title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Show a bar on standard error that counts what is done; gives the function that takes the events.

    Standard output stays free for results. Where standard error is no terminal there is no bar, but warnings and
    errors are printed all the same.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(title)

        def show(event: dict[str, Any]) -> None:
            if event["type"] == "progress":
                progress.update(task, total=event["total"], completed=event["done"], description=event["message"])
            else:
                progress.console.print(event["message"], markup=False, highlight=False)

        yield show
