"""The start, progress and end of a command at a terminal. Imports no Blender."""

from __future__ import annotations

import argparse
import math
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from . import printer
from .errors import IcyMoonError
from .files import parse_path, shorten
from .system import is_broken_pipe

if TYPE_CHECKING:
    from rich.console import Console

#: Seconds between lines of progress if there is no terminal.
_PROGRESS_LINE_S = 15.0

#: The word that help prints as the default of an option whose default is all.
ALL_WORD = "all"


class Parser(argparse.ArgumentParser):
    """A parser of a command line whose messages are printed like all others."""

    def error(self, message: str) -> NoReturn:
        """Print the usage and the error, and exit with status 2."""
        super().error(printer.show_controls(message))

    def _print_message(self, message: str, file: object = None) -> None:
        printer.print_usage(message, file is not sys.stdout)


def as_path(text: str) -> Path:
    """Return a path of the command line, for argparse."""
    try:
        return parse_path(text, "the path")
    except IcyMoonError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def add_repeatable_option(
    parser: argparse.ArgumentParser, flag: str, metavar: str | None, words: str, **more: Any
) -> None:
    """Add an option that may be given several times; its value is the list of all given values."""
    parser.add_argument(flag, action="append", default=[], metavar=metavar, help=words, **more)


def add_own_matchers(parser: argparse.ArgumentParser, where: str = "--methods") -> None:
    """Add ``--own``, by which the option ``where`` can name the user's own matchers."""
    words = f"option of your own matcher, which {where} then names as own:NAME; may repeat"
    add_repeatable_option(parser, "--own", "NAME:METHOD:KEY=VALUE", words)


def add_json_lines(parser: argparse.ArgumentParser) -> None:
    """Add ``--json-lines``."""
    parser.add_argument("--json-lines", action="store_true", help="progress and result as JSON lines on stdout")


def add_maps_option(command: argparse.ArgumentParser) -> None:
    """Add ``--maps`` of a command that evaluates: None, or the size of a cell in metres, 0 for a suitable one."""
    command.add_argument(
        "--maps",
        nargs="?",
        const=0.0,
        type=float,
        metavar="CELL_M",
        help="also write height, height error and missing areas as GeoTIFF in the coordinate system of the ground's "
        "file, in cells of this size in metres (three pixels or more)",
    )


def check_least(options: argparse.Namespace, least: int, *names: str) -> None:
    """Raise IcyMoonError if an option is less than ``least`` or is not a finite number."""
    for name in names:
        value = getattr(options, name)
        if value is not None and not (math.isfinite(value) and value >= least):
            raise IcyMoonError(f"--{name.replace('_', '-')} is {value}; give {least} or more.")


def parse_list_option(names: Sequence[str]) -> list[str]:
    """Return the names of a repeatable option; an empty list for ``ALL_WORD``."""
    return [] if list(names) == [ALL_WORD] else list(names)


def run_verb(
    parser: argparse.ArgumentParser,
    arguments: Sequence[str] | None,
    program: str,
    stopped: str,
    tell: Callable[[argparse.Namespace, IcyMoonError], None] = lambda options, error: None,
) -> int:
    """Run the verb that the arguments name. Returns its exit status: the verb's own, 1 after a reported error, 130 if
    stopped. ``tell`` is called with an error before it is printed. Raises SystemExit for wrong usage."""
    options = parser.parse_args(arguments)
    try:
        try:
            status = int(options.run(options))
            printer.flush()
            return status
        except IcyMoonError as error:
            tell(options, error)
            raise
    except (IcyMoonError, OSError, KeyboardInterrupt) as error:
        return report_end(error, program, stopped)


def report_end(error: BaseException, program: str, stopped: str) -> int:
    """Print on standard error why a command has ended. Returns its exit status. An error that neither the user nor the
    system can cause is a defect and is raised again."""
    if isinstance(error, OSError) and is_broken_pipe(error):
        printer.discard_output()
        return 1
    if isinstance(error, KeyboardInterrupt):
        printer.warn(stopped, program)
        return 130
    if isinstance(error, IcyMoonError):
        printer.warn(str(error), program)
        return 1
    if isinstance(error, OSError):
        where = f"{shorten(str(error.filename))}: " if error.filename is not None else ""
        printer.warn(
            f"{where}the system refuses it ({error.strerror or error}); fix that or choose another place.", program
        )
        return 1
    raise error


@contextmanager
def _lines_without_terminal(console: Console, describe: Callable[[], str]) -> Iterator[None]:
    """Print the progress as a line every ``_PROGRESS_LINE_S`` seconds, instead of a bar, if there is no terminal."""
    if console.is_terminal:
        yield
        return
    ended = threading.Event()

    def tick() -> None:
        while not ended.wait(_PROGRESS_LINE_S):
            printer.print_line(console, describe())

    ticking = threading.Thread(target=tick, daemon=True)
    ticking.start()
    try:
        yield
    finally:
        ended.set()
        ticking.join()


def _print_warning(console: Console, message: dict[str, Any]) -> None:
    printer.print_line(console, ("Warning:", "yellow"), f" {message['message']}")


@contextmanager
def show_progress(title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Show a progress bar of renders. Yields the function that receives the messages of a worker or a runner.

    A message moves the bar or becomes a line above it.
    """
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = printer.make_console()
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %", markup=False),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=False,
    ) as bar:
        task = bar.add_task(printer.show_controls(title), total=1.0)
        shown = bar.tasks[0]

        def show(message: dict[str, Any]) -> None:
            kind = message["type"]
            if kind == "progress":
                bar.update(task, completed=message["fraction"], description=printer.show_controls(message["message"]))
            elif kind == "warning":
                _print_warning(console, message)
            elif kind == "pair":
                done = f"rendered in {message['seconds']:.0f} s" if message["rendered"] else "was already there"
                printer.print_line(console, f"  {message['folder']} {done}")
            elif kind == "error" and "pair" in message:
                printer.print_line(console, ("Set aside:", "red"), f" {message['message']}")
            elif kind == "done":
                bar.update(task, completed=1.0)

        with _lines_without_terminal(console, lambda: f"{shown.description}: {shown.percentage:.0f} %"):
            yield show


def keep_progress(show: Callable[[dict[str, Any]], None]) -> Callable[[dict[str, Any]], None]:
    """Make a function that passes only progress messages on to ``show``."""
    return lambda message: show(message) if message["type"] == "progress" else None


def tell_events(title: str, as_json: bool) -> AbstractContextManager[Callable[[dict[str, Any]], None]]:
    """Print events as JSON lines, or show them as ``show_counted_progress`` does. Yields the function that receives the
    events."""
    return nullcontext(printer.emit_json) if as_json else show_counted_progress(title)


@contextmanager
def show_count(title: str) -> Iterator[Callable[[int, int], None]]:
    """Show a line on standard error that counts finished items, if standard error is a terminal.

    Yields a function to call with the numbers of finished items and of all items.
    """
    try:
        yield lambda done, total: printer.rewrite_line(f"{title}: {done} of {total}")
    finally:
        printer.rewrite_line("")


@contextmanager
def show_counted_progress(title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Show a bar on standard error that counts finished items. Yields the function that receives the events.

    Standard output stays free for results. If standard error is no terminal, there is a line every ``_PROGRESS_LINE_S``
    instead of a bar; warnings and errors are printed all the same.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = printer.make_console(to_error=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(printer.show_controls(title))
        shown = progress.tasks[0]

        def show(event: dict[str, Any]) -> None:
            if event["type"] == "progress":
                progress.update(
                    task,
                    total=event["total"],
                    completed=event["done"],
                    description=printer.show_controls(event["message"]),
                )
            elif event["type"] == "warning":
                _print_warning(console, event)
            else:
                printer.print_line(console, event["message"])

        with _lines_without_terminal(console, lambda: f"{title}: {shown.completed:.0f} of {shown.total or 0:.0f}"):
            yield show
