"""The command line of the evaluation. Results go to standard output, all other messages to standard error."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ..plugins.installed import Found
from ..support import printer
from ..support.errors import IcyMoonError
from ..support.files import write_text
from ..support.number_text import format_count
from ..support.suggestions import suggest_nearest
from ..support.terminal import (
    Parser,
    add_json_lines,
    add_maps_option,
    add_own_matchers,
    add_repeatable_option,
    as_path,
    check_least,
    keep_progress,
    run_verb,
    show_progress,
    tell_events,
)
from .days_command import add_days_options, run_days_command
from .design_command import add_design_options, run_design
from .environment import packages
from .export import IMAGES, OPTIONS, Option, exports_with_blender, find_plugins, list_options, list_packages
from .train_command import add_train_options, run_train

if TYPE_CHECKING:
    from .decisions.calibrated_run import CalibrationOrder
    from .export.plug_in import PluginExport
    from .fusion_curves import PointSweep
    from .matchers.methods import Method
    from .report.schema import Report
    from .report.table_columns import Column

PROGRAM = "icymoon.stereo"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code: 0 for success, 1 for an error that the user can fix, 2 for wrong usage,
    130 if interrupted.
    """
    return run_verb(make_parser(), arguments, PROGRAM, "interrupted", _emit_error)


def _emit_error(parsed: argparse.Namespace, error: IcyMoonError) -> None:
    if getattr(parsed, "json_lines", False):
        printer.emit("error", message=" ".join(str(error).split()))


def _add_paths_argument(command: argparse.ArgumentParser, words: str = "pair folder or data set") -> None:
    command.add_argument("path", type=as_path, nargs="+", metavar="PAIR_OR_DATASET", help=words)


def _add_report_folder(command: argparse.ArgumentParser, in_data_set: str) -> None:
    """Add ``--out``. If ``in_data_set`` names a folder of the data set, ``--out`` is optional."""
    beside = f" ({in_data_set} in the data set)" if in_data_set else ""
    words = f"folder for the report{beside}"
    command.add_argument("--out", required=not in_data_set, type=as_path, help=words)


def _report_failures(messages: Sequence[str], what: str) -> None:
    """Raise IcyMoonError with the number of messages and the first one, if there are any."""
    if messages:
        raise IcyMoonError(f"{len(messages)} of the {what}, the first one: {messages[0]}")


def _add_match_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("--method", required=True, help="a method that the verb methods lists")
    command.add_argument("--left", required=True, type=as_path, help="left image, 8- or 16-bit PNG")
    command.add_argument("--right", required=True, type=as_path, help="right image, 8- or 16-bit PNG")
    add_repeatable_option(
        command, "--option", "KEY=VALUE", "option of the method, such as window=21 or preset=guiss", nargs="+"
    )
    command.add_argument(
        "--camera",
        type=as_path,
        metavar="PAIR",
        help="pair folder whose camera took the images: sets the search range, and an external program may ask for it",
    )
    command.add_argument(
        "--out",
        required=True,
        type=as_path,
        help="npz to write: disparity, float32 px, NaN where invalid, and other arrays of the method",
    )


def _add_metrics_arguments(command: argparse.ArgumentParser) -> None:
    what = command.add_mutually_exclusive_group(required=True)
    what.add_argument("--prediction", type=as_path, help="npy, planar depth in metres, NaN invalid")
    what.add_argument("--disparity", type=as_path, help="npy, or npz of match, disparity in px, NaN invalid")
    command.add_argument("--truth", required=True, type=as_path, help="npy of the same shape, planar depth in metres")
    command.add_argument(
        "--focal-baseline",
        type=float,
        metavar="PX_M",
        help="disparity times depth of the camera, px·m; adds the disparity metrics",
    )
    command.add_argument(
        "--guiss", action="store_true", help="add the numbers that the GUISS reference code would report, as guiss_..."
    )
    command.add_argument(
        "--bm-min-disparity",
        type=int,
        metavar="PX",
        help="with --guiss: the disparity is of StereoBM, with this least disparity (4 in the paper); "
        "an npz of match states it",
    )


def _add_truth_arguments(command: argparse.ArgumentParser) -> None:
    _add_paths_argument(command)
    command.add_argument("--out", required=True, type=as_path, help="folder for <pair>/truth.npz")


def _add_export_arguments(command: argparse.ArgumentParser) -> None:
    _add_paths_argument(command)
    what = command.add_mutually_exclusive_group(required=True)
    exports = find_plugins()
    what.add_argument(
        "--format",
        help="layout to write",
        type=lambda name: _name_accepted_plugin(name, exports),
        choices=tuple(exports.usable),
    )
    what.add_argument(
        "--for-prediction",
        action="store_true",
        help="write only what a method on another machine needs: images and camera of each pair, foreign ones too",
    )
    add_repeatable_option(
        command, "--set", "sensor.KEY=VALUE", "change the camera response that the pairs were rendered for"
    )
    command.add_argument("--out", required=True, type=as_path, help="folder for the files")
    *others, last = exports_with_blender()
    command.add_argument(
        "--blender",
        default=sys.executable,
        help=f"Blender, or a Python with bpy, that makes the ground for {', '.join(others)} and {last} (this Python)",
    )
    for option in OPTIONS:
        words = f"{option.description} of {_list_takers(option)} ({option.default})"
        command.add_argument(option.flag, type=float, metavar=option.metavar, help=words)
    add_json_lines(command)


def _list_takers(option: Option) -> str:
    """List, in words, the exports that take an option."""
    return " or ".join(name for name in find_plugins().usable if option in list_options(name))


def _add_develop_arguments(command: argparse.ArgumentParser) -> None:
    _add_paths_argument(command, "pair folder, or data set of pairs; may be several")
    add_repeatable_option(command, "--preset", "sensors/NAME", "a camera response that Icy Moon ships")
    add_repeatable_option(
        command,
        "--set",
        "sensor.KEY=VALUE",
        "one setting of the camera response, light.sun_scale, planet_scale or lamp_scales; may repeat",
    )
    command.add_argument("--out", required=True, type=as_path, help="folder for the images, a folder per pair in it")
    add_json_lines(command)


def _add_poses_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("bag", type=as_path, help="bag of ROS 1 (a file) or of ROS 2 (its folder)")
    command.add_argument("--topic", default="", help="topic of the poses (the only one that has any)")
    command.add_argument(
        "--frame", default="", help="moving frame, where the topic has several, as /tf does (the only one)"
    )
    command.add_argument("--out", required=True, type=as_path, help="text file of TUM's format to write")


def _name_accepted_plugin(name: str, found: Found) -> str:
    """Return the name of a plug-in. Raises argparse's error, which the user sees, for a refused plug-in."""
    if name in found.refused and name not in found.usable:
        raise argparse.ArgumentTypeError(found.refused[name])
    return name


def _run_check(parsed: argparse.Namespace) -> int:
    report = packages.check_packages()
    if report["ok"]:
        from .matchers import find_plugins

        found = find_plugins()
        report |= {
            "matchers": {name: plugin.release for name, plugin in found.added.items()},
            "refused": list(found.refused.values()),
        }
    printer.emit_json(report)
    if report["ok"]:
        return 0
    printer.warn(report["message"], PROGRAM)
    return 1


def _run_methods(parsed: argparse.Namespace) -> int:
    packages.require_modules("numpy", "cv2")
    from .matchers import describe_matcher, find_plugins
    from .matchers.lidar_options import LIDAR, describe_lidar_options

    if parsed.method == LIDAR:
        printer.say(describe_lidar_options())
        return 0
    if parsed.method:
        printer.say(describe_matcher(parsed.method))
        return 0
    found = find_plugins()
    unusable = list(found.refused.values())
    for number, name in enumerate(found.usable):  # a broken plug-in must not hide the others
        try:
            printer.say(f"{chr(10) if number else ''}{describe_matcher(name)}")
        except IcyMoonError as error:
            unusable.append(str(error))
    printer.say(f"{chr(10)}{describe_lidar_options()}")
    for sentence in unusable:
        printer.warn(sentence, PROGRAM)
    return 1 if unusable else 0


def _run_match(parsed: argparse.Namespace) -> int:
    packages.require_modules("numpy", "cv2")
    from ..render.pairs.pair_folder import read_pair
    from .images.bounded_decoding import decode
    from .images.disparity_files import encode_confidences
    from .images.image_files import read_png, write_disparity
    from .matchers import match
    from .matchers.methods import parse_key_value
    from .matchers.search_range import FIXED, find_known_ranges
    from .measure.confidence_metrics import OWN
    from .measure.measure_files import BM_MIN_DISPARITY

    options = dict(parse_key_value(text, "--option") for part in parsed.option for text in part)
    pair = read_pair(parsed.camera) if parsed.camera else None
    left, right = (read_png(path, decode) for path in (parsed.left, parsed.right))
    disparity, _, info = match(
        parsed.method,
        left,
        right,
        options,
        pair.camera if pair else None,
        find_known_ranges(pair.settings, None, bool(pair.data.get("edited_by_hand"))) if pair else {},
    )
    facts = {BM_MIN_DISPARITY: info["options"]["min_disparity"]} if parsed.method == "bm" else {}
    own = {} if info["confidence"] is None else {OWN: info["confidence"]}
    write_disparity(parsed.out, disparity, encode_confidences(own) | info["arrays"], **facts)
    if (searched := info["search"]) and searched.source == FIXED:
        printer.warn(
            f"the rig is unknown, so {parsed.method} searched {searched.least_px} to {searched.most_px} px; give "
            "--camera PAIR or state the range.",
            PROGRAM,
        )
    return 0


def _run_metrics(parsed: argparse.Namespace) -> int:
    packages.require_modules("numpy")
    from .measure.measure_files import measure_files

    numbers = measure_files(
        parsed.prediction, parsed.disparity, parsed.truth, parsed.focal_baseline, parsed.guiss, parsed.bm_min_disparity
    )
    printer.emit_json({key: value if math.isfinite(value) else None for key, value in numbers.items()})
    return 0


def _add_method_options(command: argparse.ArgumentParser) -> None:
    """Add the options that state methods and their camera response, except ``--methods``."""
    add_repeatable_option(
        command,
        "--method",
        "NAME=MATCHER:KEY=VALUE",
        "one more method, with a name of yours, as in mynet=resident:command=PROGRAM; may repeat",
    )
    add_repeatable_option(
        command, "--option", "METHOD.KEY=VALUE", "option for every use of a matcher, such as bm.window=21"
    )
    add_own_matchers(command)
    add_repeatable_option(
        command,
        "--set",
        "sensor.KEY=VALUE",
        "change the camera response that the pairs were rendered for, or light.sun_scale",
    )


def add_evaluate_options(command: argparse.ArgumentParser, out_needed: bool = True) -> None:
    """Add the arguments of the verb ``evaluate``, also for ``python -m icymoon``; ``run_evaluate`` reads them."""
    _add_paths_argument(command, "pair folder, data set of pairs, or foreign data such as KITTI's; may be several")
    command.add_argument(
        "--methods",
        help="matchers, separated by commas, with their own options, as in bm:window=21; "
        "or none, which --predictions alone mean (bm,sgbm, and icynet where PyTorch or ONNX Runtime is)",
    )
    _add_method_options(command)
    add_repeatable_option(
        command,
        "--predictions",
        "NAME=FOLDER",
        "disparities computed elsewhere: PAIR.pfm, .png, .npy or .exr for each pair; may repeat",
    )
    _add_report_folder(command, "" if out_needed else "evaluation")
    command.add_argument("--seed", type=int, default=0, help="seed of the tests that compare methods (%(default)s)")
    where = command.add_mutually_exclusive_group()
    where.add_argument(
        "--jobs",
        type=int,
        metavar="N",
        help="processes that measure pairs (one for each processor; one if a method needs more)",
    )
    where.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="measure on the Dask cluster whose scheduler is there, as in "
        "tcp://host:8786, or with N processes of Dask here: local:N",
    )
    command.add_argument(
        "--guiss",
        action="store_true",
        help="also show the numbers that the GUISS reference code would report, for comparison with published tables",
    )
    command.add_argument(
        "--points",
        action="store_true",
        help="also write the measured surfaces, as point clouds (ply) coloured by signed error",
    )
    add_maps_option(command)
    _add_confidence_option(command)
    add_json_lines(command)
    command.add_argument(
        "--follow",
        action="store_true",
        help="measure pairs of a data set as they are rendered, at a "
        "lower priority and without a report, until the standard input ends",
    )


def _add_confidence_option(command: argparse.ArgumentParser) -> None:
    """Add the option that ``_read_confidence_measures`` reads."""
    command.add_argument(
        "--confidence",
        default="own",
        metavar="MEASURES",
        help="how well confidence tells errors: own (what the matcher states), left-right (one more run of each "
        "matcher), sweep (three more), several with commas, or none (%(default)s)",
    )


def _choose_methods(parsed: argparse.Namespace) -> list[Method]:
    """Choose the methods of ``evaluate``. Return an empty list if only predictions are evaluated."""
    from .matchers.methods import list_default_methods, parse_methods

    chosen = ("" if parsed.predictions else list_default_methods()) if parsed.methods is None else parsed.methods
    if chosen.strip() == "none":
        chosen = ""
    some = chosen or parsed.method or not parsed.predictions
    return parse_methods(chosen, parsed.option, parsed.own, parsed.method) if some else []


def _check_maps(parsed: argparse.Namespace) -> None:
    """Raise IcyMoonError for an impossible cell size of maps."""
    if parsed.maps is not None and not (math.isfinite(parsed.maps) and parsed.maps >= 0):
        raise IcyMoonError(f"--maps is {parsed.maps:g}; give the size of a cell in metres, above 0, or no number.")


def _read_confidence_measures(text: str) -> list[str]:
    """Read the measures of ``--confidence``, in the order of a table. Raises IcyMoonError for another word."""
    from .measure.confidence_metrics import MEASURES

    words = {name.replace("_", "-"): name for name in MEASURES}
    stated = [word.strip() for word in text.split(",")]
    if stated == ["none"]:
        return []
    if "none" in stated:
        raise IcyMoonError(f"--confidence {text}: none stands alone; leave it out, or give nothing else.")
    if unknown := [word for word in stated if word not in words]:
        raise IcyMoonError(f"--confidence {unknown[0]}: {suggest_nearest(unknown[0], (*words, 'none'))}")
    return [name for word, name in words.items() if word in stated]


def _check_follow(parsed: argparse.Namespace) -> None:
    """Raise IcyMoonError for options that contradict ``--follow``."""
    if len(parsed.path) > 1 or parsed.predictions or parsed.dask or (parsed.jobs or 1) > 1:
        raise IcyMoonError(
            "--follow measures one data set in one process, without --predictions; give one folder "
            "and leave --predictions, --dask and --jobs out."
        )


def run_evaluate(parsed: argparse.Namespace) -> int:
    """Run ``evaluate`` with its parsed arguments; return the exit code."""
    packages.require_modules(*packages.PACKAGES)
    from .evaluate_while_rendering import measure_until_input_ends

    methods = _choose_methods(parsed)
    response = _read_response([], parsed.set)
    check_least(parsed, 0, "seed")
    check_least(parsed, 1, "jobs")
    _check_maps(parsed)
    if parsed.follow:
        _check_follow(parsed)
        measures = _read_confidence_measures(parsed.confidence)
        measure_until_input_ends(parsed.path[0], methods, parsed.out, response, parsed.points, parsed.maps, measures)
        return 0
    return _tell_report(parsed, _evaluate_methods(parsed, methods))


def _evaluate_methods(parsed: argparse.Namespace, methods: Sequence[Method]) -> Report:
    """Evaluate methods with the parsed options of ``evaluate``, and return the report."""
    from .evaluate import evaluate

    response = _read_response([], parsed.set)
    check_least(parsed, 0, "seed")
    check_least(parsed, 1, "jobs")
    measures = _read_confidence_measures(parsed.confidence)
    with tell_events("Evaluating", parsed.json_lines) as on_event:
        return evaluate(
            parsed.path,
            methods,
            parsed.out,
            response,
            on_event,
            parsed.seed,
            parsed.guiss,
            parsed.points,
            parsed.predictions,
            parsed.jobs,
            parsed.dask,
            parsed.maps,
            measures,
        )


def _tell_report(parsed: argparse.Namespace, report: Report) -> int:
    """Print the result of an evaluation; return the exit code."""
    path = (parsed.out / "report.html").resolve()
    if parsed.json_lines:
        printer.emit_json({"type": "result", "report": str(path), "rows": report["summary"], "notes": report["notes"]})
    else:
        if any(entry["pairs"] for entry in report["summary"]):
            _print_summary(report)
        printer.say(str(path))
    _report_failures([entry["message"] for entry in report["failed"]], "evaluations failed")
    return 0


def add_fuse_options(command: argparse.ArgumentParser, out_needed: bool = True) -> None:
    """Add the arguments of the verb ``fuse``, also for ``python -m icymoon``; ``run_fuse`` reads them."""
    _add_paths_argument(command, "pair folder or data set of pairs; may be several")
    command.add_argument(
        "--points", dest="counts", default="100,1000", metavar="N,N", help="numbers of range points (%(default)s)"
    )
    command.add_argument(
        "--noise-cm", default="2", metavar="CM,CM", help="standard deviations of the noise of ranges (%(default)s)"
    )
    command.add_argument(
        "--shift-px", default="0", metavar="PX,PX", help="errors of the points' alignment in the image (%(default)s)"
    )
    command.add_argument(
        "--ways",
        default="pick",
        metavar="RULE:GUIDE,RULE",
        help="how matchers use the points: pick, fill or stereo, and perhaps paint or search, as in "
        "fill,fill:paint,pick:search (%(default)s)",
    )
    command.add_argument(
        "--returns", metavar="FOLDER", help="folder that icymoon lidar wrote, in place of samples of the true depth"
    )
    command.add_argument(
        "--curves", action="store_true", help="only write fusion.csv and print the crossovers, which is faster"
    )
    command.add_argument("--points-seed", type=int, default=0, help="seed of the range points (%(default)s)")
    command.add_argument("--methods", default="sgbm", help="matchers, separated by commas (%(default)s)")
    _add_method_options(command)
    _add_report_folder(command, "" if out_needed else "fusion")
    command.add_argument("--seed", type=int, default=0, help="seed of the tests that compare methods (%(default)s)")
    command.add_argument("--jobs", type=int, metavar="N", help="processes that measure pairs (one for each processor)")
    _add_confidence_option(command)
    add_json_lines(command)
    command.set_defaults(predictions=[], dask=None, maps=None, points=False, guiss=False)


def run_fuse(parsed: argparse.Namespace) -> int:
    """Run ``fuse`` with its parsed arguments; return the exit code."""
    packages.require_modules(*packages.PACKAGES)
    from .fusion_curves import PointSweep, encode_curves, list_curves

    matchers = _choose_methods(parsed)
    if any(matcher.lidar is not None for matcher in matchers):
        raise IcyMoonError("For fuse, --methods takes matchers only, and --points adds range points; leave +lidar out.")
    shared = {"seed": str(parsed.points_seed)} | ({"returns": parsed.returns} if parsed.returns else {})
    sweep = PointSweep(
        _read_numbers("--points", parsed.counts, int),
        _read_numbers("--noise-cm", parsed.noise_cm, float),
        _read_numbers("--shift-px", parsed.shift_px, float),
        [(rule, guide or "none") for rule, _, guide in (way.partition(":") for way in parsed.ways.split(","))],
        shared,
    )
    methods = sweep.list_methods(matchers)
    report = None if parsed.curves else _evaluate_methods(parsed, methods)
    curves = list_curves(report["rows"] if report else _measure_curves(parsed, methods), methods)
    write_text(parsed.out / "fusion.csv", encode_curves(curves))
    if not parsed.json_lines:
        _print_crossovers(sweep, matchers, curves)
    if report:
        return _tell_report(parsed, report)
    printer.say(str((parsed.out / "fusion.csv").resolve()))
    return 0


def _measure_curves(parsed: argparse.Namespace, methods: Sequence[Method]) -> list[dict[str, Any]]:
    """Measure the rows of the curves only, without an evaluation."""
    from .evaluated_pairs import check_response, find_sources
    from .fusion_curves import measure_curves

    sources, response = find_sources(parsed.path), _read_response([], parsed.set)
    check_response(sources, response)
    with tell_events("Measuring", parsed.json_lines) as on_event:
        return measure_curves(sources, methods, response, on_event)


def _read_numbers(option: str, text: str, kind: Callable[[str], Any]) -> list[Any]:
    """Read the numbers of a comma-separated list. Raises IcyMoonError for another text."""
    try:
        return [kind(each) for each in text.split(",")]
    except ValueError:
        raise IcyMoonError(f"{option} is {text}; give numbers with commas between them, as in 100,1000.") from None


def _print_crossovers(sweep: PointSweep, matchers: Sequence[Method], curves: Sequence[dict[str, Any]]) -> None:
    """Print, for each pair and matcher, the number of points from which on the interpolation alone beats the
    matcher.
    """
    from .fusion_curves import METRICS, find_crossover
    from .matchers.methods import describe_method

    same = [
        row
        for row in curves
        if not row["points"] or (row["noise_cm"], row["shift_px"]) == (sweep.noise_cm[0], sweep.shift_px[0])
    ]
    rows = []
    for pair in dict.fromkeys(row["pair"] for row in curves):
        for matcher in matchers:
            if any(row["pair"] == pair and row["method"] == matcher.label for row in curves):
                found = [find_crossover(same, pair, matcher.label, metric) for metric in METRICS]
                cells = ["more" if each is None else str(each) for each in found]
                rows.append((pair, describe_method(matcher.label), *cells))
    printer.print_table(
        ("Pair", "Matcher", "> 1 px", "> 10 cm"), rows, "Points from which the interpolation alone beats the matcher"
    )


def add_decide_options(command: argparse.ArgumentParser, out_needed: bool = True) -> None:
    """Add the arguments of the verb ``decide``, also for ``python -m icymoon``; ``run_decide`` reads them."""
    _add_paths_argument(command, "pair folder or data set of pairs; may be several")
    command.add_argument(
        "--methods", default="bm,sgbm", help="matchers, separated by commas, as in evaluate (%(default)s)"
    )
    _add_method_options(command)
    command.add_argument(
        "--rules",
        type=as_path,
        metavar="FILE",
        help="TOML file with rules of your own for sites and pads, in place of shipped ones",
    )
    command.add_argument(
        "--cell-m", type=float, metavar="METRES", help="side of a cell, of pairs without true heights (0.02)"
    )
    _add_decision_inputs(command)
    _add_calibration_options(command)
    _add_report_folder(command, "" if out_needed else "decisions")
    command.add_argument(
        "--seed",
        type=int,
        default=0,
        help="seed of the errors of poses, and of the tests that compare matchers (%(default)s)",
    )
    add_json_lines(command)


def _add_decision_inputs(command: argparse.ArgumentParser) -> None:
    """Add the options that state how well the lander knows its pose, and which measurements it uses."""
    command.add_argument(
        "--pose-error-mm",
        type=float,
        default=0.0,
        metavar="MM",
        help="standard deviation of the camera's place as the lander knows it, on each axis (%(default)s)",
    )
    command.add_argument(
        "--pose-error-deg",
        type=float,
        default=0.0,
        metavar="DEG",
        help="standard deviation of the camera's direction as the lander knows it (%(default)s)",
    )
    command.add_argument(
        "--min-confidence",
        type=float,
        default=0.0,
        metavar="LIMIT",
        help="use no measurement of less confidence than this, from 0 to 1, by matchers that state one (%(default)s)",
    )
    command.add_argument(
        "--fuse-suns",
        action="store_true",
        help="decide once on the pairs of a site that one camera took in one pose under several Suns",
    )


def _check_decide_options(parsed: argparse.Namespace) -> None:
    """Raise IcyMoonError for numbers that ``decide`` cannot use."""
    check_least(parsed, 0, "pose_error_mm", "pose_error_deg", "seed")
    if parsed.cell_m is not None and not (math.isfinite(parsed.cell_m) and parsed.cell_m > 0):
        raise IcyMoonError(f"--cell-m is {parsed.cell_m}; give metres above 0.")
    if not 0 <= parsed.min_confidence <= 1:
        raise IcyMoonError(f"--min-confidence is {parsed.min_confidence:g}; give a number from 0 to 1.")


def _add_calibration_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--calibrate",
        type=as_path,
        metavar="FILE",
        help="calibrate on these grounds: write the margins from which on chosen sites are guaranteed",
    )
    command.add_argument("--alpha", type=float, help="with --calibrate: most risk of an unsafe choice (0.05)")
    command.add_argument("--delta", type=float, help="with --calibrate: one minus the confidence (0.05)")
    command.add_argument(
        "--procedure",
        choices=("learn-then-test", "conformal"),
        help="with --calibrate: how margins are chosen (learn-then-test); conformal takes fewer grounds, but holds "
        "only on average over calibrations",
    )
    command.add_argument(
        "--groups",
        metavar="TOPIC.KEY,TOPIC.KEY",
        help="with --calibrate: settings whose values make groups of grounds; each group gets the guarantee",
    )
    command.add_argument(
        "--calibration",
        type=as_path,
        metavar="FILE",
        help="file that --calibrate wrote on other grounds: guarantee chosen sites by it, or abstain",
    )


def _read_calibration_order(parsed: argparse.Namespace) -> CalibrationOrder | None:
    """Read which calibration to make; None without ``--calibrate``. Raises IcyMoonError for options of ``--calibrate``
    that are given without it.
    """
    from .decisions.calibrated_run import CalibrationOrder
    from .decisions.calibration import Goal

    stated = {key: getattr(parsed, key) for key in ("alpha", "delta", "procedure", "groups")}
    stated = {key: value for key, value in stated.items() if value is not None}
    if parsed.calibrate is None:
        if stated:
            raise IcyMoonError(f"--{next(iter(stated))} is an option of a calibration; add --calibrate FILE.")
        return None
    if "groups" in stated:
        stated["group_by"] = tuple(stated.pop("groups").split(","))
    return CalibrationOrder(parsed.calibrate, Goal(**stated))


def run_decide(parsed: argparse.Namespace) -> int:
    """Run ``decide`` with its parsed arguments; return the exit code."""
    packages.require_modules(*packages.PACKAGES)
    from .decide import PoseError, decide_pairs
    from .decisions.rules import read_rules
    from .matchers.methods import parse_methods

    _check_decide_options(parsed)
    methods = parse_methods(parsed.methods, parsed.option, parsed.own, parsed.method)
    response, order = _read_response([], parsed.set), _read_calibration_order(parsed)
    with tell_events("Deciding", parsed.json_lines) as on_event:
        report = decide_pairs(
            parsed.path,
            methods,
            parsed.out,
            read_rules(parsed.rules),
            response,
            on_event,
            parsed.cell_m,
            PoseError(parsed.pose_error_mm, parsed.pose_error_deg),
            parsed.seed,
            parsed.min_confidence,
            order,
            parsed.calibration,
            parsed.fuse_suns,
        )
    _tell_decisions(parsed, report)
    return 0


def _tell_decisions(parsed: argparse.Namespace, report: dict[str, Any]) -> None:
    """Print the result of ``decide``. Raises IcyMoonError if pairs failed."""
    path = (parsed.out / "decisions.html").resolve()
    if parsed.json_lines:
        printer.emit_json(
            {
                "type": "result",
                "report": str(path),
                "rows": report["summary"],
                "head": report["head"],
                "notes": report["notes"],
                "guarantee": report["guarantee"],
            }
        )
    else:
        _print_decisions(report)
        printer.say(str(path))
        if parsed.calibrate is not None:
            printer.say(str(parsed.calibrate.resolve()))
    _report_failures([entry["message"] for entry in report["failed"]], "decisions failed")


def _print_decisions(report: dict[str, Any]) -> None:
    """Print the summary of ``decide`` as a table, with its limits."""
    from .decisions.report import DEM_COLUMNS, OTHER_COLUMNS, SITE_COLUMNS, format_cell

    columns = (*SITE_COLUMNS[:6], DEM_COLUMNS[1], DEM_COLUMNS[3], DEM_COLUMNS[4], *OTHER_COLUMNS[2:])
    units = "sites" if report["provenance"].get("fuse_suns") else "pairs"
    _print_means(f"Means over {units}", report["summary"], columns, format_cell, narrowest=160)
    for sentence in (*report["head"], *report["notes"]):
        printer.say(sentence)


def _run_truth(parsed: argparse.Namespace) -> int:
    packages.require_modules("numpy", "cv2", "OpenEXR")
    from .export.layouts import write_truth

    bad = []
    for found in write_truth(parsed.path, parsed.out):
        printer.emit_json(found)
        bad += [] if found["ok"] else [found]
    if bad:
        raise IcyMoonError(
            f"{len(bad)} of the pairs cannot be trusted, the first one, {bad[0]['pair']}: "
            f"{'; '.join(bad[0]['problems'])}"
        )
    return 0


def _run_export(parsed: argparse.Namespace) -> int:
    needed = list_packages(parsed.format) if parsed.format else IMAGES
    packages.require_modules(*(name for name in needed if not (parsed.json_lines and name == "rich")))  # draws bars
    from .export.plug_in import PluginExport

    exporter = PluginExport(find_plugins().usable[parsed.format]) if parsed.format else None
    for option in OPTIONS:
        if getattr(parsed, option.key) is not None and option not in list_options(parsed.format or ""):
            raise IcyMoonError(
                f"{option.flag} is the {option.description}; give it with --format {_list_takers(option)}."
            )
    if exporter and exporter.reads_folders:
        _export_folders(exporter, parsed)
    else:
        _export_images(parsed)
    if parsed.json_lines:
        printer.emit("result", folder=str(parsed.out.resolve()))
    else:
        printer.say(str(parsed.out.resolve()))
    return 0


def _export_folders(exporter: PluginExport, parsed: argparse.Namespace) -> None:
    from ..render.pairs.pair_folder import find_pair_folders
    from .export.plug_in import FoldersContext

    folders = [folder for path in parsed.path for folder in find_pair_folders(path)]
    warn, progress = (_emit_warning, _emit_progress) if parsed.json_lines else (printer.warn, _show_progress_alone)
    options = {option.key: getattr(parsed, option.key) for option in OPTIONS}
    exporter.write_folders(folders, parsed.out, FoldersContext(parsed.blender, warn, progress, parsed.set, **options))


@contextmanager
def _show_progress_alone(title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Show a progress bar. Errors are raised instead of being shown on the bar."""
    with show_progress(title) as show:
        yield keep_progress(show)


@contextmanager
def _emit_progress(title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Emit the progress as lines of JSON."""
    yield keep_progress(printer.emit_json)


def _emit_warning(sentence: str) -> None:
    printer.emit("warning", message=sentence)


def _export_images(parsed: argparse.Namespace) -> None:
    from .export.layouts import export
    from .export_for_prediction import export_for_prediction

    response = _read_response([], parsed.set)
    with tell_events("Exporting", parsed.json_lines) as on_event:
        failed = (
            export_for_prediction(parsed.path, parsed.out, response, on_event)
            if parsed.for_prediction
            else export(parsed.path, parsed.format, parsed.out, response, on_event)
        )
    _report_failures(failed, "pairs could not be exported")


def _run_develop(parsed: argparse.Namespace) -> int:
    packages.require_modules("numpy", "cv2", "OpenEXR")
    from .reexpose import reexpose

    response = _read_response(parsed.preset, parsed.set)
    with tell_events("Developing", parsed.json_lines) as on_event:
        folders = reexpose(parsed.path, parsed.out, response, on_event)
    if parsed.json_lines:
        printer.emit_json({"type": "result", "folders": [str(folder.resolve()) for folder in folders]})
    else:
        printer.say(str(parsed.out.resolve()))
    return 0


def _run_poses(parsed: argparse.Namespace) -> int:
    packages.require_modules("numpy")
    from ..formats.trajectories import tum_text
    from .datasets.bag_poses import read_bag_poses

    found = read_bag_poses(parsed.bag, parsed.topic, parsed.frame)
    write_text(parsed.out, tum_text(found.stamps, found.poses, f"{parsed.bag.name}: {found.describe()}"))
    printer.say(f"{format_count(len(found.stamps), 'pose')} of {found.describe()}: {parsed.out}")
    return 0


def _read_response(presets: Sequence[str], overrides: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Read the settings of presets and ``--set``. Raises IcyMoonError for a setting that needs a new render."""
    from ..settings.description import merged, override
    from ..settings.preset_files import load_preset
    from ..settings.table import TOPICS

    settings = merged(*(load_preset(name) for name in presets), *(override(text) for text in overrides))
    for topic, values in settings.items():
        for key in values:
            if TOPICS[topic][key].effect != "response":
                raise IcyMoonError(
                    f"{topic}.{key} needs a new render; only settings of the sensor, light.sun_scale, "
                    "light.planet_scale, light.lamp_scales, light.irradiance_band, rig.distortion_* and "
                    "calibration_error.* can change here."
                )
    return settings


def _print_means(
    title: str,
    summary: Sequence[dict[str, Any]],
    columns: Sequence[Column],
    cell: Callable[[dict[str, Any], Column], str],
    narrowest: int = 120,
) -> None:
    """Print a table with a row for each method of a summary."""
    from .matchers.methods import describe_method

    rows = [(describe_method(entry["method"]), *(cell(entry, column) for column in columns)) for entry in summary]
    printer.print_table(("Method", *(column.title for column in columns)), rows, title, narrowest=narrowest)


def _print_summary(report: Report) -> None:
    """Print the summary of ``evaluate`` as two tables: over all pixels, with the ranks, and over the measured pixels.

    The best rank is bold if another method is significantly worse.
    """
    from .matchers.methods import describe_method
    from .report.table_columns import (
        MEASURED_COLUMNS,
        RANKING_METRIC,
        SECONDS_COLUMN,
        TOTAL_COLUMNS,
        format_plugin,
        format_rank,
        format_result,
        is_best,
        make_plugin_columns,
    )

    summary = report["summary"]
    pairs = max((entry["pairs"] for entry in summary), default=0)
    means = f"Means over {format_count(pairs, 'pair')}"
    for title, ranking, columns in (
        (f"{means}, all pixels with a true depth", RANKING_METRIC, (*TOTAL_COLUMNS, SECONDS_COLUMN)),
        (f"{means}, only the pixels that each method measured", "common_l1_m", (TOTAL_COLUMNS[0], *MEASURED_COLUMNS)),
    ):
        printer.print_table(
            ("Method", "Rank" if ranking == RANKING_METRIC else "Rank by L1", *(column.title for column in columns)),
            [
                (
                    describe_method(entry["method"]),
                    (format_rank(entry, ranking), "bold" if is_best(entry, ranking, summary) else ""),
                    *(format_result(entry, column) for column in columns),
                )
                for entry in summary
            ],
            title,
            narrowest=120,
        )
    if of_plugins := make_plugin_columns(report["plug_ins"]):
        _print_means(f"{means}, metrics of plug-ins", summary, of_plugins, format_plugin)
    if report["verdicts"]:
        printer.say(report["verdicts"])
    for note in report["notes"]:
        printer.say(note)


def _add_methods_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("method", nargs="?", help="only this one")


#: Each verb: its meaning, the function that adds its arguments (if any), and the function that runs it.
_COMMAND_BY_VERB: dict[
    str, tuple[str, Callable[[argparse.ArgumentParser], None] | None, Callable[[argparse.Namespace], int]]
] = {
    "check": ("report as one line of JSON whether this Python can evaluate", None, _run_check),
    "methods": ("list the matchers with their options", _add_methods_arguments, _run_methods),
    "match": ("match two images", _add_match_arguments, _run_match),
    "metrics": (
        "measure a depth or disparity map and print JSON; undefined metrics are null",
        _add_metrics_arguments,
        _run_metrics,
    ),
    "evaluate": ("match and measure pairs, and write a report", add_evaluate_options, run_evaluate),
    "decide": (
        "measure what a lander would decide by each matcher: heights, sites, landing pads",
        add_decide_options,
        run_decide,
    ),
    "design": (
        "compare suites of sensors by decision risk, energy and processor time, on grounds by rays",
        add_design_options,
        run_design,
    ),
    "fuse": (
        "join matchers with sparse range points, and compare both, by the number of points",
        add_fuse_options,
        run_fuse,
    ),
    "truth": (
        "write disparity, depth and visibility of both eyes, check that they fit the images, and print a line of "
        "JSON per pair",
        _add_truth_arguments,
        _run_truth,
    ),
    "export": ("write pairs and their truth in another layout", _add_export_arguments, _run_export),
    "develop": ("expose rendered pairs again as PNG, without a new render", _add_develop_arguments, _run_develop),
    "train": ("train a stereo network, and go on where it stopped", add_train_options, run_train),
    "days": (
        "let a lander look, choose, dig and verify on grounds by rays, one day after another",
        add_days_options,
        run_days_command,
    ),
    "poses": ("write the poses of a bag of ROS as a trajectory that plans follow", _add_poses_arguments, _run_poses),
}


def make_parser() -> argparse.ArgumentParser:
    """Make the parser of the command line."""
    parser = Parser(prog=f"python -m {PROGRAM}", description="Evaluate stereo on rendered pairs.")
    verbs = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (meaning, add_options, run) in _COMMAND_BY_VERB.items():
        command = verbs.add_parser(name, help=meaning)
        command.set_defaults(run=run)
        if add_options:
            add_options(command)
    return parser
