"""The verbs that make whole data sets: ``batch``, ``work`` (a shard of one) and ``verify``."""

from __future__ import annotations

import argparse
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..render.cost.blender_abilities import check_abilities
from ..render.pairs.pair_folder import is_complete
from ..render.plans import frozen_plan as datasets
from ..render.plans.planned_pair import PlannedPair
from ..render.plans.render_order import DEFAULT_MAX_SCENES, choose_shard, choose_worker_count, order_pairs
from ..render.workers.assign_cards import choose_cards
from ..render.workers.job_commands import python_command
from ..render.workers.manifest import write_manifest
from ..render.workers.process import clean_environment, report_errors
from ..render.workers.runner import Runner, WorkerOptions
from ..render.workers.slurm_scripts import SlurmRequest, write_script
from ..render.workers.verify_dataset import Findings, verify_data_set
from ..support import printer
from ..support.errors import IcyMoonError
from ..support.files import remove_leftover_parts, shorten
from ..support.number_text import format_count
from ..support.system import call_dependent, count_processors, kill_all, set_stop_handler, start
from ..support.terminal import (
    add_maps_option,
    add_own_matchers,
    add_repeatable_option,
    as_path,
    check_least,
    show_progress,
)
from .renderer_options import add_blender_option, add_cards_option

Say = Callable[..., None]


def add_batch_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``batch``."""
    parser.add_argument("plan", help="plan of the data set: a TOML file, or the name of a shipped one")
    parser.add_argument("--out", type=as_path, required=True, metavar="DATASET", help="folder of the data set")
    parser.add_argument(
        "--evaluate",
        metavar="METHODS",
        help="matchers for its pairs, separated by commas; they match finished pairs while others are rendered",
    )
    add_own_matchers(parser, "--evaluate")
    add_maps_option(parser)
    parser.add_argument("--evaluator", metavar="PYTHON", help="Python that matches them (this Python)")
    add_repeatable_option(
        parser, "--set", "sensor.KEY=VALUE", "camera response for matching, if it differs from the rendered one"
    )
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="render on the Dask cluster whose scheduler is there, as in "
        "tcp://host:8786, or on N of its processes here with local:N",
    )
    add_worker_options(parser)
    parser.set_defaults(run=_run_batch)


def add_work_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``work``."""
    parser.add_argument("dataset", type=as_path, metavar="DATASET", help="folder of the data set")
    parser.add_argument("--shard", default="1/1", metavar="I/N", help="shard I of N, counted from 1 (%(default)s)")
    add_worker_options(parser)
    parser.set_defaults(run=_run_work)


def add_slurm_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``slurm``."""
    parser.add_argument("plan", help="plan of the data set: a TOML file, or the name of a shipped one")
    parser.add_argument("--out", type=as_path, required=True, metavar="DATASET", help="folder that all machines see")
    parser.add_argument("--shards", type=int, required=True, metavar="N", help="shards, each a job of the array")
    parser.add_argument("--at-once", type=int, default=0, metavar="N", help="shards that run at the same time (all)")
    parser.add_argument("--cpus", type=int, default=8, metavar="N", help="processors of each (%(default)s)")
    parser.add_argument("--memory", default="8G", help="memory of each (%(default)s)")
    parser.add_argument("--time", default="04:00:00", help="time of each; what is left then is requeued (%(default)s)")
    add_repeatable_option(
        parser, "--sbatch", "OPTION", "further option of sbatch, as in --sbatch=--partition=long; may repeat"
    )
    parser.add_argument("--python", default=sys.executable, help="Python on the cluster's machines (this Python)")
    parser.add_argument("--blender", default=sys.executable, help="Blender there, or a Python with bpy (this Python)")
    parser.set_defaults(run=_run_slurm)


def add_verify_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``verify``."""
    parser.add_argument("dataset", type=as_path, metavar="DATASET", help="folder of the data set")
    parser.add_argument(
        "--remove",
        action="store_true",
        help="remove broken pairs and leftovers, so that icymoon batch makes them again",
    )
    parser.add_argument("--json", action="store_true", help="print JSON lines")
    parser.set_defaults(run=_run_verify)


def add_worker_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for the number of worker processes, their programs, and their messages."""
    parser.add_argument("--workers", type=int, metavar="N", help="processes that render (one for four processors)")
    parser.add_argument("--threads-per-worker", type=int, metavar="N", help="threads of each (all, divided evenly)")
    add_cards_option(parser)
    parser.add_argument(
        "--scenes-per-worker",
        type=int,
        default=DEFAULT_MAX_SCENES,
        metavar="N",
        help="scenes after which a process is replaced by a fresh one (%(default)s)",
    )
    add_blender_option(parser)
    parser.add_argument("--json", action="store_true", help="print what happens as JSON lines")


def parse_workers(options: argparse.Namespace) -> WorkerOptions:
    """Read the options of workers that ``add_worker_options`` added. Raises IcyMoonError for invalid values."""
    check_least(options, 1, "workers", "threads_per_worker", "scenes_per_worker")
    cards = choose_cards(options.cards)
    count = options.workers or (len(cards.numbers) if options.cards else 0) or choose_worker_count()
    threads = options.threads_per_worker or max(1, count_processors() // count)
    return WorkerOptions(count, threads, options.blender, options.scenes_per_worker, cards=cards)


@contextmanager
def _open_output(as_json: bool) -> Iterator[Say]:
    """Open the output for messages: standard output as JSON lines, or a progress bar."""
    if as_json:
        yield printer.emit
        return
    with show_progress("Starting Blender") as show:
        yield lambda kind, **facts: show({"type": kind, **facts})


def _raise_interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def render_missing(
    dataset: Path, pairs: list[PlannedPair], how: WorkerOptions, say: Say, dask: str | None = None
) -> int:
    """Render the missing pairs among ``pairs``. Returns the exit status: 1 if some pairs were set aside, else 0."""
    set_stop_handler(_raise_interrupt)
    failed: dict[str, str] = {}
    try:
        if dask:
            from ..render.workers import dask_cluster

            failed = dask_cluster.render_on_cluster(dask, dataset, pairs, how, say)
        else:
            runner = Runner(dataset, pairs, how, say)
            failed = runner.failed
            runner.run()
    except BaseException:
        with suppress(IcyMoonError):  # the error that ended the run is the one to report
            write_manifest(dataset, failed)
        raise
    write_manifest(dataset, failed)
    say("done", pairs=len(pairs) - len(failed), failed=failed)
    return 1 if failed else 0


def _freeze_plan(plan: str, dataset: Path, blender: str = "") -> datasets.FrozenPlan:
    """Freeze a plan into its folder. Returns the data set, with its pairs in render order. Raises IcyMoonError if
    ``blender``, where given, cannot render the pairs."""
    from ..render.plans.plan_file import find_plan, read_plan
    from .plan import check_plan

    read = read_plan(find_plan(plan))
    check_plan(read)
    if draws := read.describe_draws():
        printer.warn(draws)
    if unchecked := read.describe_unchecked():
        printer.warn(unchecked)
    for sentence in (*read.describe_stand_ins(), *read.describe_trajectories()):
        printer.warn(sentence)
    pairs = order_pairs(read.pairs())
    if blender and not (dataset / datasets.PLAN).exists():
        check_abilities((pair.settings for pair in pairs), blender)
    frozen = datasets.freeze_plan(dataset, pairs, read.text)
    if blender:
        check_abilities((pair.settings for pair in frozen.find_missing(dataset)), blender)
    return frozen


def _run_batch(options: argparse.Namespace) -> int:
    dataset = options.out.absolute()
    with report_errors(options.json):
        how = parse_workers(options)
        check_least(options, 0, "maps")
        if options.maps is not None and not options.evaluate:
            raise IcyMoonError("--maps is for matched pairs; add --evaluate with the matchers.")
        frozen = _freeze_plan(options.plan, dataset, "" if options.dask else options.blender)
        with _open_output(options.json) as say, _evaluate_meanwhile(dataset, options):
            if frozen.note:
                say("warning", message=frozen.note)
            status = render_missing(dataset, list(frozen.pairs), how, say, options.dask)
    some = options.evaluate and any(is_complete(pair.folder(dataset)) for pair in frozen.pairs)
    failed = _evaluate_pairs(dataset, options) if some else 0
    return _report_status(status, dataset, options.json) or failed


@contextmanager
def _evaluate_meanwhile(dataset: Path, options: argparse.Namespace) -> Iterator[None]:
    """Match pairs as they are completed, in a process of lower priority, if the options ask for it.

    At the end the process finishes its pair. If rendering is stopped, the process is ended at once. Its errors are not
    shown, because the evaluation that follows reports them.
    """
    if not options.evaluate:
        yield
        return
    out = dataset / "evaluation"
    command, environment = _make_evaluation_command(dataset, options, "--follow")
    try:
        process = start(
            command, environment, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
    except OSError:  # the evaluation that follows reports the error
        yield
        return
    try:
        yield
        assert process.stdin is not None
        process.stdin.close()
        process.wait()
    finally:
        kill_all(process)
        for folder in (out, *(out / "pairs").glob("*/")):
            remove_leftover_parts(folder)  # the ended process may leave half-written files


def _evaluate_pairs(dataset: Path, options: argparse.Namespace) -> int:
    """Match the pairs in another process, which prints its own messages; return its exit status."""
    return call_dependent(*_make_evaluation_command(dataset, options, *(["--json-lines"] if options.json else [])))


def _make_evaluation_command(
    dataset: Path, options: argparse.Namespace, *more: str
) -> tuple[list[str], dict[str, str] | None]:
    """Return the command that matches the pairs, and its environment (None: ours)."""
    words = [word for flag in ("set", "own") for text in getattr(options, flag) for word in (f"--{flag}", text)]
    words += [] if options.maps is None else ["--maps", str(options.maps)]
    return python_command(
        options.evaluator or sys.executable,
        "stereo",
        "evaluate",
        str(dataset),
        "--methods",
        options.evaluate,
        "--out",
        str(dataset / "evaluation"),
        *words,
        *more,
    ), clean_environment() if options.evaluator else None


def _report_status(status: int, dataset: Path, as_json: bool) -> int:
    if status:
        printer.warn(
            f"some pairs of {dataset} were set aside, named above and in its manifest.json; run the same "
            "command again to try them once more."
        )
    elif not as_json:
        printer.say(str(dataset))
    return status


def parse_shard(text: str) -> tuple[int, int]:
    """Parse a shard ``I/N``; return I and N. Raises IcyMoonError for any other text."""
    stated = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text)
    if not stated or not 1 <= int(stated[1]) <= int(stated[2]):
        raise IcyMoonError(f"--shard is {shorten(text)!r}; write it as I/N with I from 1 to N, as in 3/8.")
    return int(stated[1]), int(stated[2])


def _run_work(options: argparse.Namespace) -> int:
    dataset = options.dataset.absolute()
    with report_errors(options.json):
        number, count = parse_shard(options.shard)
        how = parse_workers(options)
        pairs = choose_shard(datasets.read_frozen_plan(dataset).pairs, number, count)
        check_abilities((pair.settings for pair in pairs if not is_complete(pair.folder(dataset))), options.blender)
        with _open_output(options.json) as say:
            status = render_missing(dataset, pairs, how, say)
    return _report_status(status, dataset, options.json)


def _run_slurm(options: argparse.Namespace) -> int:
    check_least(options, 1, "shards", "cpus")
    dataset = options.out.absolute()
    frozen = _freeze_plan(options.plan, dataset)
    request = SlurmRequest(
        options.shards, options.at_once, options.cpus, options.memory, options.time, tuple(options.sbatch)
    )
    if frozen.note:
        printer.warn(frozen.note)
    script = write_script(dataset, frozen, request, options.python, options.blender)
    printer.say(
        f"sbatch {shlex.quote(str(script))}"
        if script
        else f"Nothing to render: {format_count(len(frozen.pairs), 'pair')} in {dataset}."
    )
    return 0


def _run_verify(options: argparse.Namespace) -> int:
    found = verify_data_set(options.dataset.absolute(), options.remove)
    for problem in found.problems:
        if options.json:
            printer.emit("problem", **problem.to_json())
        else:
            printer.say(printer.show_controls(problem.text))
    for note in found.notes:
        if options.json:
            printer.emit("note", message=note)
        else:
            printer.say(printer.show_controls(note))
    if options.json:
        printer.emit("result", pairs=found.pairs, complete=found.complete, problems=len(found.problems))
    elif not found.problems:
        printer.say(f"{format_count(found.complete, 'pair')}, all whole and as {_describe_reference(found)}.")
    if found.problems:
        raise IcyMoonError(
            f"{options.dataset}: {format_count(len(found.problems), 'problem')}, {found.complete} of "
            f"{format_count(found.pairs, 'pair')} whole and as {_describe_reference(found)}; "
            f"{_describe_fix(found, options.remove)}."
        )
    return 0


def _describe_reference(found: Findings) -> str:
    """Return the reference with which pairs are compared: "planned" or "stated"."""
    return "planned" if found.has_plan else "stated"


def _describe_fix(found: Findings, removed: bool) -> str:
    """Return a clause on the fix for a data set with problems."""
    if not found.has_plan and found.complete == found.pairs:
        return "follow the fix in each line"
    if not found.has_plan:
        return "render damaged pairs again"
    if not removed and any(problem.path for problem in found.problems):
        return "icymoon verify --remove removes damaged pairs, icymoon batch renders them again"
    return "follow the fix in each line, and run icymoon batch to make missing pairs"
