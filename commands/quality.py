"""The verbs that weigh time against accuracy: ``quality``, ``trade`` and ``auto``."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ..render.cost.blender_abilities import Abilities, query_abilities
from ..render.cost.error_tolerance import PX, make_tolerance, parse_fraction
from ..render.workers.process import report_errors
from ..settings import description, toml_text
from ..support import printer
from ..support.errors import IcyMoonError
from ..support.temporary_folders import open_scratch_folder
from ..support.terminal import (
    add_json_lines,
    add_own_matchers,
    as_path,
    keep_progress,
    parse_list_option,
    show_progress,
    tell_events,
)
from .renderer_options import add_blender_option
from .scene_options import add_scene_options, read_settings

if TYPE_CHECKING:
    from ..stereo.trade.measure_variants import TradeBench


def add_quality_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``quality``."""
    add_scene_options(parser)
    add_blender_option(parser)
    parser.add_argument(
        "--measure", action="store_true", help="measure this machine again by a small render, not only the first time"
    )
    parser.add_argument("--json", action="store_true", help="print JSON lines")
    parser.set_defaults(run=_run_quality)


def add_trade_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``trade``."""
    add_scene_options(parser)
    add_blender_option(parser)
    _add_bench_options(parser)
    parser.add_argument(
        "--groups",
        default="",
        help="what to vary, separated by commas: samples, bounces, threshold, "
        "indirect, shortcuts, files, subsurface, glints, mesh, relief, hapke (all that the scene has)",
    )
    parser.add_argument("--repeats", type=int, default=2, help="renders of each variant (%(default)s)")
    add_json_lines(parser)
    parser.set_defaults(run=_run_trade)


def add_auto_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``auto``."""
    add_scene_options(parser)
    add_blender_option(parser)
    _add_bench_options(parser)
    parser.add_argument(
        "--tolerance-px",
        type=float,
        metavar="PX",
        help=f"mean disparity error that may be added ({PX:g}, or any if --tolerance-bad-1 is given)",
    )
    parser.add_argument(
        "--tolerance-bad-1",
        type=parse_fraction,
        metavar="SHARE",
        help="share of pixels that may be added to those missing or off by more than 1 px, as 0.5%% or 0.005 (any)",
    )
    add_json_lines(parser)
    parser.set_defaults(run=_run_auto)


def _parse_count(text: str) -> int:
    """Parse a number from 1 on. Raises ValueError for anything else."""
    if int(text) < 1:
        raise ValueError(text)
    return int(text)


def _add_bench_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--methods", default="sgbm,bm,jplv", help="matchers, separated by commas (%(default)s)")
    add_own_matchers(parser)
    parser.add_argument(
        "--reference-samples", type=int, default=1024, help="light paths per pixel of the reference (%(default)s)"
    )
    parser.add_argument("--scale", type=float, default=1.0, help="share of the image's width and height (%(default)s)")
    parser.add_argument(
        "--images",
        type=_parse_count,
        default=1,
        metavar="N",
        help="images of the ground under this Sun, which share the cost of baking its light (%(default)s)",
    )
    parser.add_argument("--out", type=as_path, required=True, help="folder for renders and report")


def _run_quality(options: argparse.Namespace) -> int:
    from ..render.cost.machine_speed import recall_speed
    from ..render.cost.measure_speed import measure_speed
    from ..render.cost.quality_presets import list_qualities
    from ..render.plans.triangle_count import count_triangles

    with report_errors(options.json):
        settings = read_settings(options)
        device = str(settings.quality.device)
        speed = None if options.measure else recall_speed(device)
        if speed is None:
            with open_scratch_folder() as folder, show_progress("Measuring this machine") as show:
                speed = measure_speed(options.blender, device, folder, keep_progress(show))
        found = list_qualities(settings, count_triangles(settings), speed, _ask_abilities(options.blender))
    if options.json:
        printer.emit("result", speed=asdict(speed), qualities=[asdict(each) for each in found])
        return 0
    printer.say(f"A pair of this scene takes ({speed.basis}, {speed.processors} processors):")
    for each in found:
        printer.say(
            f"  {each.name or each.title.lower():22} {each.cost:28} {'' if each.lacks else each.error}".rstrip()
        )
    measured = next((each.errors for each in found if each.errors), None)
    if measured:
        printer.say(f"Errors are those of {measured['scene']}; of this scene: icymoon auto, icymoon trade.")
    return 0


def _ask_abilities(blender: str) -> Abilities:
    """Ask a Blender for its abilities; assume all if it does not answer, since a render will report the fault."""
    try:
        return query_abilities(blender)
    except IcyMoonError:
        return Abilities()


def _run_bench(
    options: argparse.Namespace,
    title: str,
    work: Callable[[TradeBench], dict[str, Any]],
    show: Callable[[dict[str, Any]], None],
    repeats: int = 1,
) -> int:
    """Do ``work`` with a bench that the options describe, and show its progress. Then ``show`` its result."""
    from ..stereo.trade.measure_variants import TradeBench, scale_view

    with report_errors(options.json_lines), tell_events(title, options.json_lines) as on_event:
        view = description.merged(read_settings(options), {"dataset": {"headings": 1}})
        found = work(
            TradeBench(
                scale_view(view, options.scale),
                options.out.absolute(),
                options.blender,
                options.methods,
                options.reference_samples,
                repeats,
                on_event,
                tuple(options.own),
                options.images,
            )
        )
    if options.json_lines:
        printer.emit("result", **found)
    else:
        show(found)
    return 0


def _run_trade(options: argparse.Namespace) -> int:
    from ..stereo.trade.measure_variants import run_trade

    if options.repeats < 1:
        raise IcyMoonError(f"--repeats is {options.repeats}; give 1, or 2 to measure the noise.")
    page = options.out.absolute() / "trade.html"

    def show(report: dict[str, Any]) -> None:
        _print_all([*report["advice"], *report["fusion_advice"]])
        _print_decided(report)
        _print_all(report["decision_advice"])
        printer.say(str(page))

    groups = parse_list_option([group for group in options.groups.split(",") if group])
    return _run_bench(
        options, "Measuring", lambda bench: {**run_trade(bench, groups), "report": str(page)}, show, options.repeats
    )


def _print_decided(report: dict[str, Any]) -> None:
    """Print how the decisions of each variant differ from the reference's decisions, as a table, if there are
    decisions."""
    from ..stereo.matchers.methods import describe_method
    from ..stereo.report.table_columns import format_number
    from ..stereo.trade.report import DECISION_COLUMNS, SAME_VERDICTS

    rows = [row for row in report["rows"] if row["decisions"]]
    if not rows:
        return
    printer.print_table(
        ("Variant", "CPU (s)", "Matcher", "Decisions", *(column.title for column in DECISION_COLUMNS)),
        [
            (
                row["name"],
                f"{row['cpu_s'] or 0.0:.1f}",
                describe_method(method),
                SAME_VERDICTS[found["same"]],
                *(format_number(found, column) for column in DECISION_COLUMNS),
            )
            for row in sorted(rows, key=lambda row: row["cpu_s"] or 0.0)
            for method, found in row["decisions"].items()
        ],
        "Decisions against those on the reference",
        left=(0, 2),
        narrowest=160,
    )
    printer.say(report["decision_rule"])


def _print_all(sentences: Iterable[str]) -> None:
    for sentence in sentences:
        printer.say(sentence)


def _run_auto(options: argparse.Namespace) -> int:
    from ..stereo.trade.cheapest_quality import find_cheapest_quality

    allowed = make_tolerance(options.tolerance_px, options.tolerance_bad_1)

    def show(found: dict[str, Any]) -> None:
        *tried, last = found["said"]
        _print_all(tried)
        if found["chosen"] is None:
            raise IcyMoonError(last)
        printer.say(f"{last} Add --settings {found['file']} to a command to use it:")
        printer.say(toml_text.to_toml(found["settings"]).removesuffix("\n"))

    return _run_bench(options, "Trying", lambda bench: find_cheapest_quality(bench, allowed), show)
