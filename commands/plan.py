"""The verb ``plan``: the pairs of a data set and their estimated cost, before anything starts."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path

from ..physics.camera.depth_accuracy import advise_on_principal_point
from ..physics.scene_requirements import advise_on_bake
from ..render.cost.blender_abilities import find_missing_feature, needs_full_build
from ..render.cost.estimate import estimate_plan
from ..render.cost.machine_speed import recall_speed
from ..render.pairs.pair_folder import is_complete
from ..render.plans.plan_file import Plan, find_plan, read_plan, read_plan_header
from ..render.plans.planned_pair import PlannedPair
from ..render.plans.stratified import find_varied_settings
from ..render.workers.process import report_errors
from ..settings.preset_files import plan_names
from ..support.number_text import format_count
from ..support.printer import emit, say, warn
from ..support.terminal import as_path, show_count

#: Number of sentences on principal points that are printed: one for each image size that a plan varies.
_MAX_ADVICE = 2


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``plan``."""
    parser.add_argument(
        "plan", nargs="?", help="TOML file, or the name of a shipped plan; without one these are listed"
    )
    parser.add_argument("--dry-run", action="store_true", help="print the number of pairs and their estimated cost")
    parser.add_argument(
        "--out",
        type=as_path,
        metavar="DATASET",
        help="folder of the data set; its finished pairs are counted, and their times improve the estimate",
    )
    parser.add_argument(
        "--blender",
        help="Blender, or a Python with bpy, that renders it; a dry run checks its "
        "abilities (this Python, if it has bpy)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON lines")
    parser.set_defaults(run=_run_plan)


def check_plan(plan: Plan) -> None:
    """Combine and check the pairs of a plan, and show the progress. Raises IcyMoonError as ``Plan.pairs`` does."""
    with show_count("Checking the plan") as show:
        plan.check(show)


def describe_pair(pair: PlannedPair, names: Sequence[tuple[str, str]]) -> str:
    """Describe a pair in one line: its id and its values of the settings that vary."""
    values = (f"{topic}.{key}={_shorten_value(pair.settings[topic][key])}" for topic, key in names)
    return "  ".join((pair.id, *values))


def _shorten_value(value: object) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list):
        return f"[{len(value)}]"
    return Path(value).name if isinstance(value, str) and "/" in value else str(value)


def _run_plan(options: argparse.Namespace) -> int:
    if options.plan is None:
        for name in plan_names():
            title, text = read_plan_header(find_plan(name))
            say(f"{name:42} {title}. {text}")
        return 0
    with report_errors(options.json):
        return _print_plan(options)


def _print_plan(options: argparse.Namespace) -> int:
    """Print the pairs or the estimate, and the pairs that cannot be rendered. Returns the exit status: 1 if there are
    any, else 0."""
    plan = read_plan(find_plan(options.plan))
    check_plan(plan)
    pairs = plan.pairs()
    if options.dry_run:
        _print_estimate(plan, pairs, options)
    else:
        _print_pairs(plan, pairs, options)
    return 1 if plan.refused() else 0


def _print_pairs(plan: Plan, pairs: Sequence[PlannedPair], options: argparse.Namespace) -> None:
    names = find_varied_settings(pairs)
    for pair in pairs:
        if options.json:
            emit("planned", id=pair.id, settings={f"{topic}.{key}": pair.settings[topic][key] for topic, key in names})
        else:
            say(describe_pair(pair, names))
    for name, why in plan.refused().items():
        if options.json:
            emit("refused", pair=name, message=why)
        else:
            warn(f"pair {name} cannot be rendered and will be set aside: {why}")


def _print_estimate(plan: Plan, pairs: Sequence[PlannedPair], options: argparse.Namespace) -> None:
    devices = {str(pair.settings.quality.device) for pair in pairs}
    speed = recall_speed(devices.pop()) if len(devices) == 1 else None
    found = estimate_plan(pairs, options.out.absolute() if options.out else None, speed)
    lack = _check_blender(pairs, options)
    unchecked = plan.describe_unchecked()
    told = [line for line in (plan.describe_splits(), plan.describe_draws()) if line]
    # Most plans have one image size, so most pairs give the same sentence.
    centred = dict.fromkeys(said for pair in pairs for said in advise_on_principal_point(pair.settings.rig))
    lines = [
        *lack,
        *found.lines(),
        *told,
        *plan.describe_stand_ins(),
        *plan.describe_trajectories(),
        *list(centred)[:_MAX_ADVICE],
        *_make_bake_lines(pairs),
        *_make_refusal_lines(plan),
    ]
    if options.json:
        emit("result", plan=str(plan.path), title=plan.title, unchecked=unchecked, **found.to_json() | {"lines": lines})
        return
    for line in (plan.title, *lines):
        say(line)
    if unchecked:
        say(unchecked)


def _check_blender(pairs: Sequence[PlannedPair], options: argparse.Namespace) -> list[str]:
    """Find why the Blender for the render cannot render the pairs. Returns a list of at most one sentence."""
    own = sys.executable if importlib.util.find_spec("bpy") else ""
    missing = [
        pair.settings for pair in pairs if not (options.out and is_complete(pair.folder(options.out.absolute())))
    ]
    blender = options.blender or own
    if blender:
        return [lack for lack in (find_missing_feature(missing, blender),) if lack]
    if any(map(needs_full_build, missing)):
        return ["Not every Blender can render it; name the one that is to with --blender, and it is asked."]
    return []


def _make_bake_lines(pairs: Sequence[PlannedPair]) -> list[str]:
    """Make a line on the pairs whose light is baked with too few samples, if any."""
    found = [said for pair in pairs for said in advise_on_bake(pair.settings)]
    return [f"In {len(found)} of {format_count(len(pairs), 'pair')}: {found[0]}"] if found else []


def _make_refusal_lines(plan: Plan) -> list[str]:
    """Make a line on the pairs that a render will set aside, with the reason for the first such pair, if any."""
    refused = plan.refused()
    if not refused:
        return []
    name, why = next(iter(refused.items()))
    return [f"{len(refused)} of them cannot be rendered and will be set aside, {name} first: {why}"]
