"""Several Suns of one ground joined, against one Sun and against several images under one Sun: pairs by rays.

    python benchmarks fused_suns --seed 1 --out FOLDER

A lander takes images under the Suns of a day and digs under the last one. Each ground has these images by one camera in
one pose, and these arms:

* ``one``: an image under the last Sun. ``finer``: the same with 6.4 times the rays, as 64 samples are of 10.
* ``same``: four images under the last Sun with independent noise, whose disparities are joined: only noise differs.
* ``mean``: the mean of these four images, which is matched once.
* ``suns``: images under the four Suns of the day, whose disparities are joined. Noise and shadows differ.

All arms judge the light by an image under the last Sun, so they differ in heights only. Noise is of the rays, two for
each pixel, and of the sensor, whose fixed pattern is the same in all images.

Terrains and camera are as in ``guaranteed_grounds``. Counts are over grounds. With ``--out`` a second start
makes only the rows that are missing.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from icymoon.benchmarks.common.arguments import open_out_folder
from icymoon.benchmarks.common.ray_grounds import (
    CALIBRATION,
    ROW_SHAPE,
    RULES,
    TEST,
    VARIETY,
    Row,
    apply,
    calibrate,
    count_choices,
    draw_grounds,
    print_truth,
)
from icymoon.physics.light.ephemeris import find_positions, format_date
from icymoon.stereo.decide import DECISIONS_VERSION
from icymoon.stereo.decisions.calibration import Goal, has_margin
from icymoon.stereo.decisions.scores import THRESHOLDS
from icymoon.stereo.decisions.stored_maps import TRUE_DEPTH
from icymoon.stereo.decisions.workspace import DecisionMaps, Workspace, decide_from_depth
from icymoon.stereo.design.default_lander import LANDER, RAYS_PER_PIXEL
from icymoon.stereo.design.made_workspaces import (
    match_disparity,
    name_pair,
    open_made_workspace,
    prepare_made_pair,
    prepare_pair_again,
    summarise_decisions,
)
from icymoon.stereo.fusion.match_prepared import list_method_inputs
from icymoon.stereo.fusion.suns import join_disparities
from icymoon.stereo.inference.risk_control import make_monotone
from icymoon.stereo.inference.scene_means import find_mean_intervals
from icymoon.stereo.learning.grounds import (
    Ground,
    Recipe,
    build_ground,
    make_split_generator,
    release_ground,
)
from icymoon.stereo.learning.made_pairs import draw_light
from icymoon.stereo.matchers.methods import Method, parse_methods
from icymoon.stereo.measure.prepare_pair import PreparedPair
from icymoon.stereo.measure.row_metrics import disparity_to_depth
from icymoon.stereo.report.row_log import RowLog
from icymoon.support.arrays import Array
from icymoon.support.files import make_json_digest
from icymoon.support.version import version

METHODS = "bm,sgbm,icynet"
ONE, FINER, SAME, MEAN, SUNS = ARMS = "one", "finer", "same", "mean", "suns"
#: Number of Suns, and of images under one Sun.
COUNT = 4
#: Rays of the arm ``finer``, as 64 samples are of 10.
FINER_RAYS = round(6.4 * RAYS_PER_PIXEL)
#: Europa's solar day, hours, and the dates among which the start of a day is drawn.
DAY_H, FIRST_DATE, DATES_DAYS = 85.3, np.datetime64("2038-01-01T00:00", "m"), 3650
#: Latitudes of the lander, degrees north or south: the noon Sun is 65 to 30 degrees high.
LATITUDES_DEG = 25.0, 60.0
#: Least elevation of a Sun.
MIN_SUN_DEG = VARIETY.suns_deg[0]
#: Steps of a day at which the Sun's elevation is found.
_STEPS = 240
#: Height error from which a cell counts as wrong, m: half of a rock that the rules avoid.
WRONG_M = RULES.site.rock_height_m / 2
#: Increased when the same input gives other rows.
_VERSION = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--grounds", type=int, default=62, help="grounds that calibrate (%(default)s)")
    parser.add_argument("--tests", type=int, default=62, help="other grounds of the same terrains (%(default)s)")
    parser.add_argument(
        "--finer", type=int, default=15, help="grounds of each kind that have the arm finer (%(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the grounds (%(default)s)")
    parser.add_argument("--methods", default=METHODS, help="matchers (%(default)s)")
    parser.add_argument("--alpha", type=float, default=0.05, help="largest risk (%(default)s)")
    parser.add_argument("--delta", type=float, default=0.05, help="1 - confidence (%(default)s)")
    parser.add_argument("--out", type=Path, help="folder that keeps the rows (default: a temporary one)")


def draw_suns(random: np.random.Generator) -> Array:
    """Unit vectors (COUNT, 3), east, north and up, to the Suns of a day of a lander on Europa, in the order of time.

    They are at equal steps of the time in which the Sun is at least ``MIN_SUN_DEG`` high. The day starts anywhere, so
    the last Sun is as often one of the morning as one of the evening.
    """
    latitude = float(random.uniform(*LATITUDES_DEG) * random.choice([-1, 1]))
    longitude, day = float(random.uniform(-180, 180)), int(random.integers(DATES_DAYS))
    start = FIRST_DATE + np.timedelta64(24 * 60 * day, "m")
    dates = start + (np.arange(_STEPS) * DAY_H * 60 / _STEPS).astype("timedelta64[m]")
    found = np.array([find_positions("EUROPA", format_date(date), latitude, longitude).sun for date in dates])
    high = np.flatnonzero(found[:, 2] >= np.sin(np.radians(MIN_SUN_DEG)))
    gap = int(np.argmax(np.diff(high, prepend=high[-1] - _STEPS)))  # a day may start while the Sun is up
    share = (np.arange(COUNT) + random.random()) / COUNT
    daylight = found[np.roll(high, -gap)[(share * len(high)).astype(int)]]
    return np.roll(daylight, int(random.integers(COUNT)), axis=0)


def look_under_suns(ground: Ground, arms: Collection[str] = ARMS) -> tuple[Workspace, dict[str, list[PreparedPair]]]:
    """The workspace of the image under the last Sun, and the images of each arm. That image is the first of each arm
    but ``finer`` and ``mean``.
    """
    recipe = ground.recipe
    random = make_split_generator(recipe.seed, recipe.split, recipe.number, 4)
    light = draw_light(recipe.split, random, VARIETY)
    lights = [replace(light, sun=sun) for sun in draw_suns(random)[::-1]]
    first = prepare_made_pair(ground, LANDER, lights[0], RAYS_PER_PIXEL, random)

    def look_again(at: int, number: int, rays: int = RAYS_PER_PIXEL) -> PreparedPair:
        return prepare_pair_again(first, ground, lights[at], rays, random, number)

    same = [first, *(look_again(0, number) for number in range(1, COUNT))]
    return open_made_workspace(ground, first, RULES), {
        ONE: [first],
        SAME: same,
        MEAN: [average_images(same)],
        SUNS: [first, *(look_again(at, COUNT + at) for at in range(1, COUNT))],
        **({FINER: [look_again(0, 2 * COUNT, FINER_RAYS)]} if FINER in arms else {}),
    }


def average_images(pairs: Sequence[PreparedPair]) -> PreparedPair:
    """The first pair with the means of the images of all."""
    left, right = (
        np.rint(np.mean([getattr(pair, eye) for pair in pairs], axis=0)).astype(np.uint8) for eye in ("left", "right")
    )
    return replace(pairs[0], left=left, right=right)


def measure(workspace: Workspace, found: DecisionMaps) -> dict[str, object]:
    """The numbers of decisions, with ``wrong``, the share of the cells that the left image shows whose height is
    missing or errs by more than ``WRONG_M``.
    """
    among = workspace.reached & workspace.truth.dem.known & workspace.seen
    right = np.abs(found.dem.height_m - workspace.truth.dem.height_m)[among] <= WRONG_M
    return summarise_decisions(workspace, found) | {"wrong": float(1 - right.mean())}


def make_rows(
    recipe: Recipe, methods: Sequence[Method], logs: Mapping[str, RowLog], arms: Sequence[str] = ARMS
) -> dict[str, list[Row]]:
    """The rows of a ground by arm, of which ``one`` starts with the true depth. Missing ones are made and logged."""
    name, inputs = name_pair(recipe), [_VERSION, DECISIONS_VERSION, version(), RULES.to_json()]
    keys = {TRUE_DEPTH: make_json_digest(inputs)}
    keys |= {method.label: make_json_digest([*inputs, list_method_inputs(method)]) for method in methods}
    wanted = {arm: [TRUE_DEPTH] * (arm == ONE) + [method.label for method in methods] for arm in arms}
    rows = {arm: [logs[arm].find(name, label, keys[label]) for label in own] for arm, own in wanted.items()}
    if all(all(own) for own in rows.values()):
        return {arm: [row for row in own if row] for arm, own in rows.items()}
    made: dict[str, list[Row]] = {arm: [] for arm in arms}
    for arm, label, numbers, seconds in _measure_ground(recipe, methods, arms):
        row = {"pair": name, "method": label, "key": keys[label], "status": "ok", "error": ""}
        made[arm].append(row | {"numbers": numbers, "cpu_s": seconds})
        logs[arm].append(made[arm][-1])
    return made


def _measure_ground(
    recipe: Recipe, methods: Sequence[Method], arms: Sequence[str]
) -> list[tuple[str, str, dict[str, object], float]]:
    """Arm, method, numbers and processor seconds of each decision on a ground, counted from the decision before."""
    found, start = [], time.process_time()
    ground = build_ground(recipe)
    try:
        workspace, images = look_under_suns(ground, arms)
    finally:
        release_ground(ground)

    def add(arm: str, label: str, depth: Array) -> None:
        nonlocal start
        numbers = measure(workspace, decide_from_depth(workspace, depth))
        found.append((arm, label, numbers, time.process_time() - start))
        start = time.process_time()

    add(ONE, TRUE_DEPTH, workspace.prepared.truth)
    for method in methods:
        matched: dict[int, Array] = {}
        for arm in arms:
            for image in images[arm]:
                if id(image) not in matched:
                    matched[id(image)] = match_disparity(image, method)[0]
            joined = join_disparities(np.stack([matched[id(image)] for image in images[arm]]))
            add(arm, method.label, disparity_to_depth(workspace.prepared, joined))
    return found


def find_shares(rows: Sequence[Row]) -> tuple[Array, Array]:
    """The shares (grounds, thresholds) of safe cells that are lost, NaN without a safe cell, and of taken cells that
    are unsafe, 0 where none is taken, with at least each margin of ``THRESHOLDS``; the last one is for the rules
    alone.
    """
    lost, unsafe = [], []
    for row in rows:
        sites = row["numbers"]["sites"]
        taken, wrong = (np.array(sites[key], float) for key in ("taken_from", "unsafe_from"))
        safe = sites["cells"][1]
        lost.append(1 - (taken - wrong) / safe if safe else np.full(len(THRESHOLDS), np.nan))
        unsafe.append(np.divide(wrong, taken, out=np.zeros(len(THRESHOLDS)), where=taken > 0))
    return np.array(lost), np.array(unsafe)


def find_equal_margin(unsafe: Array, most: float) -> int:
    """The index of the lowest margin from which on the mean unsafe share (grounds, thresholds) is at most ``most``."""
    return int(np.flatnonzero(make_monotone(unsafe.mean(axis=0)[None])[0] <= most)[-1])


def state_mean(values: Array, shares: bool = False, digits: int = 3) -> str:
    """The mean of values (grounds,), NaN where undefined, with its 95 % interval over grounds."""
    low, high = find_mean_intervals(values[:, None], np.arange(len(values)), np.array([shares]))[0]
    return f"{np.nanmean(values):.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def select(rows: Sequence[Row], label: str) -> list[Row]:
    """Select the rows of a method by its label."""
    return [row for row in rows if row["method"] == label]


def list_numbers(rows: Sequence[Row]) -> dict[str, Array]:
    """The numbers (grounds,) of a method in one arm by the rules alone, NaN where undefined."""
    lost, unsafe = find_shares(rows)
    return {
        "RMSE, mm": 1000 * np.array([row["numbers"]["dem"]["rmse_m"] for row in rows], float),
        "wrong or missing": np.array([row["numbers"]["wrong"] for row in rows]),
        "lost": lost[:, -1],
        "unsafe share": unsafe[:, -1],
    }


def print_line(name: str, cells: Sequence[str]) -> None:
    """A line of a table."""
    print(f"  {name:<14}" + "".join(f"{cell:>28}" for cell in cells))


def print_rules(rows: Mapping[str, Sequence[Row]], label: str) -> None:
    """The numbers of the arms by the rules alone, their choices, and paired differences of arms."""
    own = {arm: select(each, label) for arm, each in rows.items()}
    numbers = {arm: list_numbers(each) for arm, each in own.items()}
    print_line("by rules alone", [*numbers[ONE], "acts, unsafe, dangerous"])
    for arm, found in numbers.items():
        choice = count_choices(own[arm])[label]
        cells = [state_mean(values, name != "RMSE, mm") for name, values in found.items()]
        counts = ", ".join(str(choice[key]) for key in ("acted", "unsafe", "dangerous"))
        print_line(arm, [*cells, f"{counts} of {choice['grounds']}"])
    for arm, base in ((SAME, ONE), (MEAN, ONE), (FINER, ONE), (SUNS, ONE), (SUNS, SAME), (SUNS, MEAN), (SUNS, FINER)):
        if {arm, base} <= numbers.keys():
            off = [state_mean(values - numbers[base][name]) for name, values in numbers[arm].items()]
            print_line(f"{arm} - {base}", off)


def print_equal_risk(halves: Sequence[Mapping[str, Sequence[Row]]], label: str) -> None:
    """The lost share of each arm with the margin whose unsafe share is at most that by one Sun and the rules alone. The
    margin of each half of the grounds is found on the other half.
    """
    shares = [{arm: find_shares(select(rows, label)) for arm, rows in half.items()} for half in halves]
    lost_one, unsafe_one = (np.concatenate([half[ONE][k][:, -1] for half in shares]) for k in (0, 1))
    columns = "margins", "lost", "lost - half of one's", "unsafe share", "unsafe share - one's"
    print_line("at equal risk", columns)
    for arm in shares[0]:
        limits = [float(other[ONE][1][:, -1].mean()) for other in reversed(shares)]
        found = [
            len(THRESHOLDS) - 1 if arm == ONE else find_equal_margin(other[arm][1], limit)
            for other, limit in zip(reversed(shares), limits, strict=True)
        ]
        lost, unsafe = (
            np.concatenate([half[arm][k][:, at] for half, at in zip(shares, found, strict=True)]) for k in (0, 1)
        )
        cells = [", ".join(f"{THRESHOLDS[at]:.2f}" for at in found), state_mean(lost, True)]
        cells += [state_mean(lost - lost_one / 2), state_mean(unsafe, True), state_mean(unsafe - unsafe_one)]
        print_line(arm, cells)


def print_guarantees(
    fit: Mapping[str, Sequence[Row]], test: Mapping[str, Sequence[Row]], label: str, goal: Goal
) -> None:
    """The choice with the margin that each arm's own calibration gives, on the test grounds, and the difference to one
    Sun of the share of grounds whose chosen site has it.
    """
    print_line("with guarantee", ["margin", "acts", "unsafe, at most", "unlike", "has margin - one's"])
    reached: dict[str, Array] = {}
    for arm, rows in test.items():
        own = select(rows, label)
        (entry,) = apply(calibrate(select(fit[arm], label), goal), own)
        threshold, (low, high) = entry["threshold"], entry["acted_bounds"]
        reached[arm] = np.array([has_margin(row["numbers"]["sites"], threshold) for row in own], float)
        cells = ["none" if threshold is None else f"{threshold:.2f}"]
        cells += [f"{entry['acted'] / entry['grounds']:.3f} ({low:.3f} to {high:.3f})"]
        cells += [f"{entry['unsafe']}, {entry['unsafe_bound']:.3f}", f"{entry['unlike']}"]
        print_line(arm, [*cells, state_mean(reached[arm] - reached[ONE])])


def make_all_rows(
    options: argparse.Namespace, methods: Sequence[Method], folder: Path
) -> dict[str, dict[str, list[Row]]]:
    """The rows of all grounds by kind and arm. Kinds come by turns, so that a run that is stopped has both."""
    recipes = draw_grounds(options.seed, options.grounds, options.tests, 0)
    rows: dict[str, dict[str, list[Row]]] = {kind: {arm: [] for arm in ARMS} for kind in (CALIBRATION, TEST)}
    logs = {arm: RowLog(folder / f"{arm}.jsonl", ROW_SHAPE) for arm in ARMS}
    turns = [(number, kind) for kind, own in recipes.items() for number in range(len(own))]
    for number, kind in sorted(turns):
        arms = [arm for arm in ARMS if arm != FINER or number < options.finer]
        for arm, made in make_rows(recipes[kind][number], methods, logs, arms).items():
            rows[kind][arm] += made
    return rows


def main(options: argparse.Namespace) -> None:
    """Make the grounds, and print tables for each matcher."""
    methods, goal = parse_methods(options.methods), Goal(options.alpha, options.delta)
    goal.check()
    with open_out_folder(options.out) as folder:
        rows = make_all_rows(options, methods, folder)
    halves = [{arm: own for arm, own in rows[kind].items() if arm != FINER} for kind in (CALIBRATION, TEST)]
    both = {arm: halves[0][arm] + halves[1][arm] for arm in halves[0]}
    finer = rows[CALIBRATION][FINER] + rows[TEST][FINER]
    names = {row["pair"] for row in finer}
    few = {arm: [row for row in own if row["pair"] in names] for arm, own in both.items()} | {FINER: finer}
    print_truth("all", both[ONE])
    suns = [row["numbers"]["features"]["Sun's elevation"] for row in select(both[ONE], TRUE_DEPTH)]
    print(f"the last Sun is {min(suns):.0f} to {max(suns):.0f} degrees high")
    for method in methods:
        print(f"\n{method.label}, {len(suns)} grounds")
        print_rules(both, method.label)
        print_equal_risk(halves, method.label)
        if min(options.grounds, options.tests) >= goal.fewest_grounds:
            print_guarantees(halves[0], halves[1], method.label, goal)
        if names:
            print(f"{method.label}, {len(names)} grounds with {FINER}")
            print_rules(few, method.label)
    print(f"\n{sum(row['cpu_s'] for own in (*both.values(), finer) for row in own):.0f} CPU seconds")
