"""Studies of decisions on grounds by rays: their grounds and camera, their rows, and counts over grounds.

Terrains are gentle. The camera, the sensor and the place of the workspace are the same in all pairs, see
``default_lander``. Each ground has one pair, and a row is as from ``icymoon decide``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.stereo.decisions.calibration import Goal, calibrate_matchers
from icymoon.stereo.decisions.calibration_file import Calibration
from icymoon.stereo.decisions.calibration_pairs import StatedPair
from icymoon.stereo.decisions.guarantee import apply_calibration, bound_share
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.decisions.scores import THRESHOLDS
from icymoon.stereo.decisions.stored_maps import TRUE_DEPTH, UNLIKE
from icymoon.stereo.design.default_lander import GENTLE_TERRAINS
from icymoon.stereo.design.made_workspaces import draw_recipes
from icymoon.stereo.inference.scene_means import find_mean_intervals
from icymoon.stereo.learning.grounds import Recipe, Variety
from icymoon.support.arrays import Array
from icymoon.support.file_schemas import NUMBER, TABLE, TEXT, Maybe, Shape

Row = dict[str, Any]
VARIETY = Variety(GENTLE_TERRAINS, suns_deg=(16.0, 65.0))
RULES = read_rules()
ROW_SHAPE: dict[str, Shape] = {"status": TEXT, "error": TEXT, "numbers": Maybe(TABLE, null=True), "cpu_s": NUMBER}
CALIBRATION, TEST, LANDFORM = "calibration", "test", "landform"


def draw_grounds(seed: int, grounds: int, tests: int, landforms: int) -> dict[str, list[Recipe]]:
    """The recipes of each kind of grounds. Grounds that calibrate and grounds that test come by turns."""
    own = draw_recipes(seed, "ground", 2 * max(grounds, tests), VARIETY)
    return {
        CALIBRATION: own[::2][:grounds],
        TEST: own[1::2][:tests],
        LANDFORM: draw_recipes(seed, "landform", landforms, VARIETY),
    }


def state_grounds(rows: Sequence[Row]) -> dict[str, StatedPair]:
    """The statements of the pairs of rows: each pair is a separate ground."""
    return {row["pair"]: StatedPair(row["pair"], "", {}) for row in rows}


def calibrate(rows: Sequence[Row], goal: Goal) -> Calibration:
    """The calibration that ``decide --calibrate`` makes of these rows, without a file."""
    stated = state_grounds(rows)
    entries = calibrate_matchers(rows, stated, {row["method"]: "" for row in rows}, goal)
    return Calibration(Path(), goal, {}, {}, frozenset(stated), 1, entries)


def find_lost_shares(rows: Sequence[Row], threshold: float | None) -> Array:
    """The shares (grounds, 2) of safe cells that are lost on each ground with a safe one: by the rules alone, and
    without the guaranteed margin of the map.
    """
    found = []
    for row in rows:
        sites = row["numbers"]["sites"]
        _, safe, _, both = sites["cells"]
        if safe:
            alike = threshold is not None and row["guarantee"]["verdict"] != UNLIKE
            at = THRESHOLDS.index(threshold) if alike and threshold is not None else None
            kept = 0 if at is None else sites["taken_from"][at] - sites["unsafe_from"][at]
            found.append((1 - both / safe, 1 - kept / safe))
    return np.array(found).reshape(-1, 2)


def apply(calibration: Calibration, rows: Sequence[Row]) -> list[dict[str, Any]]:
    """For each method the counts of ``decide --calibration`` on other grounds, with ``lost``, the means of
    ``find_lost_shares``, and ``lost_bounds``.
    """
    marked, guarantee = apply_calibration(calibration, rows, state_grounds(rows))
    found = []
    for entry in guarantee["methods"]:
        own = [row for row in marked if row["method"] == entry["method"] and row["guarantee"]]
        lost = find_lost_shares(own, entry["map_threshold"])
        bounds = find_mean_intervals(lost, np.arange(len(lost)), np.array([True, True]))
        found.append(entry | {"lost": lost.mean(axis=0).tolist(), "lost_bounds": bounds.tolist()})
    return found


def count_choices(rows: Sequence[Row]) -> dict[str, dict[str, Any]]:
    """For each method, of the rules alone: the numbers of ``grounds``, of those with a site (``acted``), and of
    ``unsafe`` and ``dangerous`` choices, and the numbers of unsafe choices by the rule that ``fails`` first in truth,
    where rows state it.
    """
    found = {}
    for label in dict.fromkeys(row["method"] for row in rows):
        own = [row["numbers"] for row in rows if row["method"] == label and row["status"] == "ok"]
        sites = [each["sites"] for each in own]
        found[label] = {
            "grounds": len(own),
            "acted": sum(each["chosen"] is not None for each in sites),
            "unsafe": sum(each["unsafe_choice"] == 1 for each in sites),
            "dangerous": sum(each["dangerous_choice"] == 1 for each in sites),
            "fails": dict(Counter(each["fails"] for each in own if each.get("fails"))),
        }
    return found


def print_truth(kind: str, rows: Sequence[Row]) -> None:
    """The share of grounds that have a safe site in truth."""
    safe = [row["numbers"]["sites"]["cells"][1] > 0 for row in rows if row["method"] == TRUE_DEPTH]
    low, high = bound_share(sum(safe), len(safe), 0.05)
    print(f"{kind}: {sum(safe)} of {len(safe)} grounds have a safe site in truth ({low:.2f} to {high:.2f})")
