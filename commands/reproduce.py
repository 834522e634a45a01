"""The verb ``reproduce``: the tables and figures of the GUISS paper, rendered and measured from the start, in one
folder."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from ..render.cost.blender_abilities import check_abilities
from ..render.cost.estimate import estimate_plan, format_duration, format_size
from ..render.cost.machine_speed import recall_speed
from ..render.plans.frozen_plan import PLAN, FrozenPlan, freeze_plan
from ..render.plans.stand_in_replacements import describe_own_files, find_own_files
from ..render.workers.process import report_errors
from ..settings.description import merged, override
from ..stereo.environment import packages
from ..stereo.paper import OUTPUT_FILES
from ..support import printer
from ..support.errors import IcyMoonError
from ..support.files import refuse_file_as_folder
from ..support.number_text import format_count
from ..support.terminal import as_path, check_least, show_progress
from .batch import add_worker_options, parse_workers, render_missing

if TYPE_CHECKING:
    from pathlib import Path

    from ..render.plans.planned_pair import PlannedPair
    from ..stereo.matchers.methods import Method
    from ..stereo.paper.paper_datasets import Part

Event = Callable[[dict[str, Any]], None]
#: The papers that can be reproduced.
PAPERS = ("guiss",)
#: Processor seconds of measuring a megapixel by the paper's matchers without the networks, of writing a report, and
#: bytes of the results of a megapixel (2-core x86 server, a pair of 640 x 480 px).
_MEASURE_S_PER_MPX, _REPORT_S, _MEASURE_BYTES_PER_MPX = 4.5, 30.0, 6.5e6
#: Smallest share of the paper's 640 x 480 px: 32 x 24 px, with the least window of StereoBM.
_MIN_SCALE = 0.05
#: Cost of matching a pair relative to rendering it, for the progress.
_MATCHING_COST = 0.3


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``reproduce``."""
    parser.add_argument("paper", choices=PAPERS, help="the paper: guiss, whose tables and figures are made again")
    parser.add_argument(
        "--out", type=as_path, required=True, metavar="FOLDER", help="folder for the data sets, the tables and figures"
    )
    parser.add_argument("--dry-run", action="store_true", help="print the estimated cost, and end")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="a tenth of the pairs, in which every value keeps its share")
    size.add_argument("--pairs", type=int, metavar="N", help="about N pairs of the 5020, chosen in the same way")
    parser.add_argument("--scale", type=float, default=1.0, help="share of the images' width and height (%(default)s)")
    parser.add_argument("--no-figures", action="store_true", help="leave out the grids of images")
    parser.add_argument(
        "--glossy",
        action="store_true",
        help="with the materials and the sampling of the paper's public code, traced: days",
    )
    parser.add_argument(
        "--files", type=as_path, metavar="FOLDER", help="your own textures and meshes in place of stand-ins"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="TOPIC.KEY=VALUE", help="one setting of all pairs; may repeat"
    )
    parser.add_argument(
        "--option",
        action="append",
        default=[],
        metavar="MATCHER.KEY=VALUE",
        help="option of bm, jplv, dsmnet, igev or icynet, as in igev.checkpoint=FILE; may repeat",
    )
    add_worker_options(parser)
    parser.set_defaults(run=_run_reproduce)


def _run_reproduce(options: argparse.Namespace) -> int:
    packages.require_modules(*packages.PACKAGES)
    from ..stereo.paper.methods import find_methods
    from ..stereo.paper.paper_datasets import QUICK_SHARE, make_parts
    from ..stereo.paper.printed import PAIRS_BY_GROUP

    check_least(options, 1, "pairs")
    _check_options(options)
    with report_errors(options.json):
        how = parse_workers(options)
        methods, missing = find_methods(options.scale, options.option)
        overrides = merged(*map(override, options.set))
        count = round(QUICK_SHARE * PAIRS_BY_GROUP["All"]) if options.quick else options.pairs
        parts = make_parts(count, options.scale, overrides, options.files, options.glossy)
        if options.no_figures:
            del parts["figures"]
        for why in missing.values():
            printer.warn(why)
        if options.files:
            own = _find_own_files(parts, options.files)
            if not options.json:
                printer.say(describe_own_files(own, [options.files]))
        if options.dry_run:
            return _print_estimate(parts, options)
        frozen = {name: _freeze_part(part, options) for name, part in parts.items()}
        with _open_output(options.json) as tell:
            steps = _Steps(tell, parts)
            failed = 0
            for name, part in parts.items():
                folder = options.out.absolute() / part.folder
                failed |= render_missing(
                    folder, list(frozen[name].pairs), how, steps.begin(f"Rendering {name}", len(part.pairs))
                )
            page = _write_paper(options, parts, methods, missing, steps)
    if options.json:
        printer.emit("result", report=str(page))
    else:
        printer.say(str(page))
    return failed


def _check_options(options: argparse.Namespace) -> None:
    """Raise IcyMoonError for an impossible scale or folder of files, and for an output folder that is a file or has
    other tables."""
    if not _MIN_SCALE <= options.scale <= 1:  # refuses NaN too
        raise IcyMoonError(f"--scale is {options.scale:g}; give {_MIN_SCALE:g} to 1.")
    if options.files and not options.files.is_dir():
        raise IcyMoonError(f"--files: {options.files} is not a folder; give the folder with your textures and meshes.")
    refuse_file_as_folder(options.out, "--out")
    if not (options.out / "data" / PLAN).exists():
        for name in OUTPUT_FILES:
            if (options.out / name).exists():
                raise IcyMoonError(
                    f"--out: {options.out / name} already exists and is not from an earlier run; give another folder."
                )


def _find_own_files(parts: dict[str, Part], folder: Path) -> set[Path]:
    """Find the user's files that replace stand-ins. Raises IcyMoonError if no file does."""
    own = find_own_files([pair for part in parts.values() for pair in part.pairs], [folder.absolute()])
    if not own:
        raise IcyMoonError(
            f"--files: no file in {folder} replaces a stand-in; name them as docs/datasets.md does under Stand-ins."
        )
    return own


def _freeze_part(part: Part, options: argparse.Namespace) -> FrozenPlan:
    """Freeze the data set of a part into its folder. Raises IcyMoonError if Blender cannot render it, or if the folder
    has pairs of another data set."""
    dataset = options.out.absolute() / part.folder
    frozen = freeze_plan(dataset, part.pairs, part.text)
    if frozen.note:  # pairs of another version, which the tables do not hold
        raise IcyMoonError(frozen.note)
    check_abilities((pair.settings for pair in frozen.find_missing(dataset)), options.blender)
    return frozen


def _write_paper(
    options: argparse.Namespace,
    parts: dict[str, Part],
    methods: list[Method],
    missing: dict[str, str],
    steps: _Steps,
) -> Path:
    """Match the pairs, and write tables and figures. Returns the path of the page."""
    from ..stereo.evaluate import evaluate
    from ..stereo.paper.page import write_paper
    from ..stereo.paper.paper_datasets import EVALUATIONS
    from ..stereo.paper.results import read_measured

    out = options.out.absolute()
    labels = [method.label for method in methods]
    measured = {}
    for name, (part, folder, response) in EVALUATIONS.items():
        tell = steps.begin(f"Measuring {name.replace('_', ', ')}", _MATCHING_COST * len(parts[part].pairs))
        evaluation = out / part / folder
        report = evaluate([out / part], methods, evaluation, response, partial(_forward_event, tell), guiss=True)
        measured[name] = read_measured(evaluation, [pair["pair"] for pair in report["pairs"]], labels)
    return write_paper(out, parts, measured, missing, options.scale, len(parts["data"].pairs))


def _forward_event(tell: Callable[..., None], event: dict[str, Any]) -> None:
    tell(event.pop("type"), **event)


class _Steps:
    """Shows the progress of consecutive steps as one progress."""

    def __init__(self, tell: Event, parts: dict[str, Part]) -> None:
        self._tell = tell
        matched = _list_matched_pairs(parts)
        self._total = sum(len(part.pairs) for part in parts.values()) + _MATCHING_COST * len(matched)
        self._before = self._work = 0.0

    def begin(self, title: str, work: float) -> Callable[..., None]:
        """Begin a step of ``work``; return the function that receives its messages."""
        self._before += self._work
        self._work = work
        before = self._before

        def hear(kind: str, **facts: Any) -> None:
            if kind == "progress":
                fraction = (before + work * facts["fraction"]) / self._total
                facts |= {"fraction": min(1.0, fraction), "message": f"{title}: {facts['message']}"}
            if kind == "error":  # of one pair, which is set aside
                kind, facts = "warning", {"message": facts["message"]}
            if kind != "done":  # of this step only
                self._tell({"type": kind, **facts})

        return hear


@contextmanager
def _open_output(as_json: bool) -> Iterator[Event]:
    """Open the output for messages: standard output as JSON lines, or a progress bar."""
    if as_json:
        yield printer.emit_json
        return
    with show_progress("Starting Blender") as show:
        yield show


def _list_matched_pairs(parts: dict[str, Part]) -> list[PlannedPair]:
    """List the pairs of each evaluation. Pairs of the figures are left out, because no matcher evaluates them."""
    from ..stereo.paper.paper_datasets import EVALUATIONS

    return [pair for part, _, _ in EVALUATIONS.values() for pair in parts[part].pairs]


def _print_estimate(parts: dict[str, Part], options: argparse.Namespace) -> int:
    """Print the estimated cost of the parts, and of all parts together."""
    from ..stereo.paper.paper_datasets import EVALUATIONS

    lines, hours, seconds, space = [], 0.0, 0.0, 0.0
    for name, part in parts.items():
        dataset = options.out.absolute() / part.folder
        found = estimate_plan(part.pairs, dataset, recall_speed(str(part.pairs[0].settings.quality.device)))
        lines.append(f"{name}: {', '.join(found.lines())}")
        hours, seconds, space = hours + found.left_wall_s, seconds + found.left_s, space + found.left_bytes
    mpx = sum(pair.settings.rig.width_px * pair.settings.rig.height_px / 1e6 for pair in _list_matched_pairs(parts))
    measure_s = mpx * _MEASURE_S_PER_MPX + _REPORT_S * len(EVALUATIONS)
    lines.append(
        f"measuring without networks: {format_duration(measure_s / found.processors)} on "
        f"{format_count(found.processors, 'processor')}, {format_size(mpx * _MEASURE_BYTES_PER_MPX)} on the disk"
    )
    hours, space = hours + measure_s / found.processors, space + mpx * _MEASURE_BYTES_PER_MPX
    lines.append(
        f"together about {format_duration(hours)} on {format_count(found.processors, 'processor')}, "
        f"{format_duration(seconds + measure_s)} of a processor, {format_size(space)} on the disk"
    )
    if options.json:
        printer.emit("result", lines=lines, seconds=seconds + measure_s, wall_seconds=hours, bytes=space)
    else:
        for line in lines:
            printer.say(line)
    return 0
