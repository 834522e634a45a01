"""The guarantee of a calibration of decisions, by grounds that matchers really see: pairs by rays, or rendered ones.

    python benchmarks guaranteed_grounds --out FOLDER
    python benchmarks guaranteed_grounds --decided GROUNDS/decisions TESTS/decisions LANDFORMS/decisions

Each ground has one pair. Some grounds calibrate, others of the same terrains test, and held-out landforms test again.
icynet was trained on grounds of another split, by the same ray engine. Terrains are gentle, see
``common/ray_grounds``, and the Sun stands at 16 to 65 degrees. Grounds with hanging shapes are left out. The camera,
the sensor and the place of the workspace are the same in all pairs. The rest is done by the functions of ``icymoon
decide``: search ranges, cells, gaps, rules and light. There is no arm, so every cell is in reach.

With ``--out`` a second start makes only the rows that are missing. With ``--decided`` nothing is made: the rows are of
``icymoon decide`` on rendered pairs, one of each ground, as of the plans ``datasets/decision_grounds``,
``decision_tests`` and ``decision_landforms``.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from icymoon.benchmarks.common.arguments import open_out_folder
from icymoon.benchmarks.common.ray_grounds import (
    CALIBRATION,
    LANDFORM,
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
from icymoon.stereo.decide import DECISIONS_VERSION
from icymoon.stereo.decisions.calibration import Goal, make_sentences
from icymoon.stereo.decisions.stored_maps import TRUE_DEPTH
from icymoon.stereo.decisions.workspace import Workspace
from icymoon.stereo.design.default_lander import LANDER, RAYS_PER_PIXEL
from icymoon.stereo.design.made_workspaces import (
    decide,
    name_pair,
    open_made_workspace,
    prepare_made_pair,
)
from icymoon.stereo.fusion.fuse import list_lidar_inputs
from icymoon.stereo.fusion.match_prepared import list_method_inputs
from icymoon.stereo.inference.risk_control import bound_risk
from icymoon.stereo.learning.grounds import (
    Ground,
    Recipe,
    build_ground,
    make_split_generator,
    release_ground,
)
from icymoon.stereo.learning.made_pairs import draw_light
from icymoon.stereo.matchers.methods import Method, parse_methods
from icymoon.stereo.report.row_log import RowLog
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import make_json_digest
from icymoon.support.version import version

METHODS = "bm,sgbm,sgbm_wls,jplv,icynet,sgbm+lidar:points=300"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--grounds", type=int, default=124, help="grounds that calibrate (%(default)s)")
    parser.add_argument("--tests", type=int, default=62, help="other grounds of the same terrains (%(default)s)")
    parser.add_argument("--landforms", type=int, default=60, help="grounds of held-out landforms (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the grounds (%(default)s)")
    parser.add_argument("--methods", default=METHODS, help="matchers (%(default)s)")
    parser.add_argument("--alpha", type=float, default=0.05, help="largest risk (%(default)s)")
    parser.add_argument("--delta", type=float, default=0.05, help="1 - confidence (%(default)s)")
    parser.add_argument("--out", type=Path, help="folder that keeps the rows (default: a temporary one)")
    parser.add_argument(
        "--decided", type=Path, nargs="+", metavar="FOLDER", help="decisions of rendered grounds: first what calibrates"
    )


def read_decided(folder: Path) -> list[Row]:
    """The rows of the decisions in a folder, as its report states them."""
    rows: list[Row] = json.loads((folder / "decisions.json").read_text(encoding="utf-8"))["rows"]
    return rows


def make_workspace_of_ground(ground: Ground) -> Workspace:
    """The workspace of the pair of a ground."""
    recipe = ground.recipe
    random = make_split_generator(recipe.seed, recipe.split, recipe.number, 4)
    light = draw_light(recipe.split, random, VARIETY)
    return open_made_workspace(ground, prepare_made_pair(ground, LANDER, light, RAYS_PER_PIXEL, random), RULES)


def make_rows(recipe: Recipe, methods: Sequence[Method], log: RowLog) -> list[Row]:
    """The rows of a ground by the true depth and the methods; missing ones are made and logged."""
    name = name_pair(recipe)
    wanted: dict[str, Method | None] = {TRUE_DEPTH: None} | {method.label: method for method in methods}
    inputs = DECISIONS_VERSION, version(), RULES.to_json()
    keys = {
        label: make_json_digest([*inputs, *([list_method_inputs(m), list_lidar_inputs(m, name)] if m else [])])
        for label, m in wanted.items()
    }
    rows = {label: log.find(name, label, key) for label, key in keys.items()}
    if not all(rows.values()):
        start = time.process_time()
        ground = build_ground(recipe)
        try:
            workspace = make_workspace_of_ground(ground)
        finally:
            release_ground(ground)
        for label in (label for label, row in rows.items() if row is None):
            row: Row = {"pair": name, "method": label, "key": keys[label], "status": "ok", "error": "", "numbers": None}
            try:
                row["numbers"] = decide(workspace, wanted[label])
            except IcyMoonError as error:
                row |= {"status": "failed", "error": str(error)}
            row["cpu_s"] = time.process_time() - start
            start = time.process_time()
            log.append(row)
            rows[label] = row
    return [row for row in rows.values() if row]


def print_choices(rows: Sequence[Row]) -> None:
    """A table of the choices by the rules alone, with a line for each method."""
    print(f"{'by the rules alone':<24}{'acts':>6}{'unsafe':>8}{'at most':>9}{'dangerous':>11}  first failed rule")
    for label, each in count_choices(rows).items():
        bound = bound_risk(each["unsafe"], each["grounds"], 0.05)
        fails = ", ".join(f"{name} {count}" for name, count in each["fails"].items())
        print(f"{label:<24}{each['acted']:>6}{each['unsafe']:>8}{bound:>9.3f}{each['dangerous']:>11}  {fails}")


def print_table(found: Sequence[Mapping[str, Any]]) -> None:
    """A table of the guarantee, with a line for each method."""
    columns = "margin", "acts", "unsafe", "at most", "unlike", "lost before", "lost after"
    widths = 8, 22, 8, 9, 8, 22, 22
    print(f"{'with a guarantee':<24}" + "".join(f"{name:>{wide}}" for name, wide in zip(columns, widths, strict=True)))
    for entry in found:
        low, high = entry["acted_bounds"]
        cells = (
            "none" if entry["threshold"] is None else f"{entry['threshold']:.2f}",
            f"{entry['acted'] / entry['grounds']:.2f} ({low:.2f} to {high:.2f})",
            f"{entry['unsafe']}",
            f"{entry['unsafe_bound']:.3f}",
            f"{entry['unlike']}",
            *(
                f"{mean:.2f} ({least:.2f} to {most:.2f})"
                for mean, (least, most) in zip(entry["lost"], entry["lost_bounds"], strict=True)
            ),
        )
        line = "".join(f"{cell:>{wide}}" for cell, wide in zip(cells, widths, strict=True))
        print(f"{entry['method']:<24}{line}")


def list_rows(options: argparse.Namespace) -> dict[str, list[Row]]:
    """The rows of each kind of grounds: of decisions that are there, or made by rays."""
    if options.decided:
        kinds = (CALIBRATION, TEST, LANDFORM)
        return {kind: read_decided(folder) for kind, folder in zip(kinds, options.decided, strict=False)}
    methods = parse_methods(options.methods)
    recipes = draw_grounds(options.seed, options.grounds, options.tests, options.landforms)
    with open_out_folder(options.out) as folder:
        log = RowLog(folder / "rows.jsonl", ROW_SHAPE)
        rows = {
            kind: [row for recipe in own for row in make_rows(recipe, methods, log)] for kind, own in recipes.items()
        }
    print(f"{sum(row['cpu_s'] for own in rows.values() for row in own):.0f} CPU seconds")
    return rows


def main(options: argparse.Namespace) -> None:
    """Calibrate on some grounds and print a table for each kind of the others."""
    goal = Goal(options.alpha, options.delta)
    goal.check()
    rows = list_rows(options)
    calibration = calibrate(rows[CALIBRATION], goal)
    print("\n".join(make_sentences(calibration.entries, goal)))
    for kind, own in rows.items():
        print()
        print_truth(kind, own)
        print_choices(own)
        if kind != CALIBRATION:
            print_table(apply(calibration, own))
