"""The verb ``study``: render a preregistered study, measure it and write its tables; a second run continues an
interrupted one.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..render.cost.blender_abilities import check_abilities
from ..render.pairs.pair_folder import is_complete
from ..render.plans.frozen_plan import freeze_plan
from ..render.plans.render_order import order_pairs
from ..render.workers.process import report_errors
from ..stereo.study.design import Study, find_study, list_study_names, read_study
from ..support import printer
from ..support.errors import IcyMoonError
from ..support.files import refuse_file_as_folder, write_text
from ..support.terminal import as_path, show_count, show_progress
from .batch import Say, add_worker_options, parse_workers, render_missing

if TYPE_CHECKING:
    from ..stereo.matchers.methods import Method


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``study``."""
    parser.add_argument("study", help=f"{' or '.join(list_study_names())}, or a TOML file of that form")
    parser.add_argument("--out", type=as_path, required=True, metavar="FOLDER", help="folder of its pairs and tables")
    parser.add_argument(
        "--methods", help="matchers, separated by commas, instead of the study's: another set makes another study"
    )
    parser.add_argument("--measure", action="store_true", help="render nothing: measure the existing pairs")
    parser.add_argument(
        "--page", type=as_path, metavar="FILE", help="page of the manual between whose marks the tables are put"
    )
    add_worker_options(parser)
    parser.set_defaults(run=_run_study)


def _run_study(options: argparse.Namespace) -> int:
    from ..stereo.environment import packages

    packages.require_modules(*packages.PACKAGES)
    from ..stereo.matchers.methods import parse_methods

    study, out = read_study(find_study(options.study)), options.out.absolute()
    with report_errors(options.json):
        refuse_file_as_folder(out, "--out")
        methods = parse_methods(options.methods or study.methods)  # before an hour of rendering
        status = 0 if options.measure else _render_missing(study, out, options)
        page = _measure_views(study, out, methods, options)
    if options.json:
        printer.emit("result", page=str(page))
    else:
        printer.say(str(page))
    return status


def _render_missing(study: Study, out: Path, options: argparse.Namespace) -> int:
    """Render the missing pairs, round by round. Returns the exit status: 1 if pairs were set aside, else 0."""
    rounds = [
        order_pairs([pair for view in views for pair in study.pairs_of(view).values()]) for views in study.rounds()
    ]
    how = parse_workers(options)
    freeze_plan(out, [pair for pairs in rounds for pair in pairs], study.text)
    status = 0
    for pairs in rounds:
        missing = [pair for pair in pairs if not is_complete(pair.folder(out))]
        if missing:
            check_abilities((pair.settings for pair in missing), options.blender)
            with show_progress("Starting Blender") as show:
                status |= render_missing(out, pairs, how, printer.emit if options.json else _make_teller(show))
    return status


def _make_teller(show: Callable[[dict[str, Any]], None]) -> Say:
    """Make a function that reports renders to a progress bar."""
    return lambda kind, **facts: show({"type": kind, **facts})


def _measure_views(study: Study, out: Path, methods: list[Method], options: argparse.Namespace) -> Path:
    """Measure the views that have new pairs, write all tables, and return the path of the page."""
    from ..stereo.study.conclusions import draw_conclusions
    from ..stereo.study.tables import replace_between_marks, write_study
    from ..stereo.study.view_measurements import read_or_measure_cell

    cells = []
    with show_count("Measuring") as show:
        for k, view in enumerate(study.views):
            show(k, len(study.views))
            cell = read_or_measure_cell(study, view, out, methods)
            if cell is not None:
                cells.append(cell)
    if not cells:
        raise IcyMoonError(f"{out} has no view with a complete converged render; run the study without --measure.")
    text = write_study(study, draw_conclusions(study, cells, [method.label for method in methods]), out)
    if options.page:
        write_text(options.page, replace_between_marks(options.page, text))
    return out / "study.md"
