"""The guarantee of a calibration of decisions, by simulation: grounds, decisions and calibrations, without renders.

    python benchmarks guaranteed_choices --grounds 600 --calibrations 2000

A population of grounds is drawn: waves, roughness that differs from place to place, and rocks. Stand-ins for matchers
see their heights with errors, and decide by the product's rules. A calibration draws grounds from the population, with
replacement, so its risk is the exact share of the population that gets an unsafe site. The columns are means over
calibrations: the risk, the share of calibrations whose risk exceeds alpha, and the share of grounds with a site. Then
the same on a population with other landforms, with and without the test of likeness.

Three scores are compared: the margin in units of the limit, which all versions before 0.4 had; the margin of today; and
distances to the limits in units of a stand-in's own errors of slope and roughness, from other grounds.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from icymoon.stereo.decisions.calibration import CHOICE, CONFORMAL, LEARN_THEN_TEST, MAX_UNLIKE_P, Goal, collect_losses
from icymoon.stereo.decisions.calibration_pairs import StatedPair
from icymoon.stereo.decisions.dem import Dem, Grid
from icymoon.stereo.decisions.rules import SiteRules, read_rules
from icymoon.stereo.decisions.safe_sites import Sites, find_rocks, judge_sites, measure_layers
from icymoon.stereo.decisions.scores import score_sites
from icymoon.stereo.decisions.workspace import FEATURES
from icymoon.stereo.inference.risk_control import compare_with_grounds
from icymoon.support.arrays import Array

Row = dict[str, Any]
CELLS, CELL_M = 50, 0.04
RULES: SiteRules = read_rules().site
#: Grounds that scale the third score, and the distance in errors that has the score 0.5.
SCALING_GROUNDS, HALF_Z = 30, 2.0
#: How many times as rough the other landforms are.
OTHER_ROUGHNESS = 1.5


@dataclass(frozen=True)
class StandIn:
    """Errors of a matcher: smoothing and width of the errors in cells, their standard deviation, and unknown cells."""

    blur_cells: float
    error_m: float
    width_cells: float
    unknown: float


STAND_INS = {
    "true depth": StandIn(0.0, 0.001, 0.0, 0.01),
    "BM-like": StandIn(1.2, 0.006, 1.5, 0.06),
    "SGBM-like": StandIn(0.3, 0.005, 1.0, 0.05),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--grounds", type=int, default=600, help="grounds of the population")
    parser.add_argument("--calibrations", type=int, default=2000, help="calibrations of each row")
    parser.add_argument("--sizes", type=int, nargs="+", default=[60, 120], help="grounds of a calibration")
    parser.add_argument("--alpha", type=float, default=0.05)
    parser.add_argument("--delta", type=float, default=0.05)
    parser.add_argument("--seed", type=int, default=0)


def smooth(values: Array, cells: float) -> Array:
    """Values blurred by a Gaussian of this standard deviation, with their old standard deviation."""
    if not cells:
        return values
    found = cv2.GaussianBlur(values, (0, 0), cells, borderType=cv2.BORDER_REFLECT)
    return np.asarray(found * (values.std() / found.std()))


def draw_ground(random: np.random.Generator, rough: float) -> Array:
    """Heights (CELLS, CELLS), m, of a ground that is ``rough`` times as rough as the others."""
    noise = [random.standard_normal((CELLS, CELLS)) for _ in range(3)]
    waves = smooth(noise[0], 8.0) * 0.05 * random.lognormal(0, 0.3)
    amplitude = 0.0104 * rough * np.exp(0.4 * smooth(noise[1], 5.0)) * random.lognormal(0, 0.4)
    height = waves + amplitude * smooth(noise[2], 0.8)
    row, column = np.mgrid[:CELLS, :CELLS]
    for _ in range(random.poisson(12)):
        radius = random.uniform(1.0, 3.5)
        far = np.hypot(row - random.uniform(0, CELLS), column - random.uniform(0, CELLS))
        height = np.maximum(height, height + CELL_M * np.sqrt(np.maximum(radius**2 - far**2, 0.0)))
    return height


def judge(height: Array, known: Array, rocks: Array | None = None) -> Sites:
    """The sites of heights on lit ground that an arm reaches, by the product's rules."""
    grid = Grid(CELL_M, CELLS, CELLS, 0.0, 0.0)
    dem = Dem(grid, np.where(known, height, np.nan), known.astype(int))
    everywhere = np.ones(height.shape)
    return judge_sites(measure_layers(dem, 90.0 * everywhere, everywhere, RULES, rocks), RULES)


def look(height: Array, stand_in: StandIn, random: np.random.Generator) -> Sites:
    """The sites that a stand-in finds."""
    noise, holes = random.standard_normal((2, CELLS, CELLS))
    seen = height if not stand_in.blur_cells else cv2.GaussianBlur(height, (0, 0), stand_in.blur_cells)
    seen = seen + stand_in.error_m * smooth(noise, stand_in.width_cells)
    holes = smooth(holes, 1.5)
    return judge(seen, holes < np.quantile(holes, 1 - stand_in.unknown))


def rank_by_limits(found: Sites, _errors: Mapping[str, float]) -> Array:
    """The margins of versions before 0.4."""
    known = (found.layers.known_share - RULES.known_share) / RULES.known_share
    return np.minimum(found.margin, np.where(found.safe, known, found.margin))


def rank_by_errors(found: Sites, errors: Mapping[str, float]) -> Array:
    """Distances to the limits of slope and roughness in units of their errors; other rules are conditions."""
    layers = found.layers
    z = np.minimum(
        (RULES.slope_deg - layers.slope_deg) / errors["slope_deg"],
        (RULES.roughness_m - layers.roughness_m) / errors["roughness_m"],
    )
    return np.where(found.safe, z / (z + HALF_Z), found.margin)


SCORES: dict[str, Callable[[Sites, Mapping[str, float]], Array]] = {
    "before 0.4": rank_by_limits,
    "today": lambda found, _errors: found.margin,
    "in errors": rank_by_errors,
}


def measure_errors(stand_in: StandIn, random: np.random.Generator) -> dict[str, float]:
    """The root mean square errors of slope and roughness on grounds of their own."""
    squares: dict[str, list[float]] = {"slope_deg": [], "roughness_m": []}
    for _ in range(SCALING_GROUNDS):
        height = draw_ground(random, 1.0)
        truth, found = judge(height, np.ones(height.shape, bool)), look(height, stand_in, random)
        for name, each in squares.items():
            each.append(float(np.nanmean((getattr(found.layers, name) - getattr(truth.layers, name)) ** 2)))
    return {name: float(np.sqrt(np.mean(each))) for name, each in squares.items()}


def decide(stand_in: StandIn, grounds: int, rough: float, random: np.random.Generator) -> dict[str, list[Row]]:
    """The rows of a stand-in on a population, as ``icymoon decide`` makes them, by score."""
    errors = measure_errors(stand_in, random)
    rows: dict[str, list[Row]] = {name: [] for name in SCORES}
    for k in range(grounds):
        height = draw_ground(random, rough)
        truth = judge(height, np.ones(height.shape, bool), find_rocks(height, CELL_M, RULES))
        found = look(height, stand_in, random)
        layers = found.layers
        numbers = (
            layers.known_share.mean(),
            np.nanmedian(layers.slope_deg),
            1000 * np.nanmedian(layers.roughness_m),
            (layers.rock_distance_m < RULES.rock_distance_m).mean(),
        )
        features = dict.fromkeys(FEATURES, 0.0) | dict(zip(FEATURES, map(float, numbers), strict=False))
        among = truth.layers.known_share > 1 - 1e-6  # the whole footprint is in the workspace
        for name, rank in SCORES.items():
            sites = score_sites(replace(found, margin=rank(found, errors)), truth, among)
            numbers_of = {"sites": sites, "features": features}
            rows[name].append({"pair": str(k), "method": "bm", "status": "ok", "numbers": numbers_of})
    return rows


def collect(rows: list[Row]) -> tuple[Array, Array, Array]:
    """Losses and acts (grounds, thresholds) of the choice, and features, of a population."""
    losses = collect_losses(rows, {row["pair"]: StatedPair(row["pair"], "", {}) for row in rows})
    return losses.choice, losses.acted, losses.features


def calibrate_often(
    losses: Array, size: int, goal: Goal, calibrations: int, random: np.random.Generator
) -> Iterator[tuple[int, Array]]:
    """The thresholds that calibrations of this size find, as indices, -1 for none, and their grounds."""
    for _ in range(calibrations):
        drawn = random.integers(0, len(losses), size)
        found = goal.find_threshold(losses[drawn])
        yield -1 if found is None else found, drawn


def summarise(
    own: tuple[Array, Array, Array],
    other: tuple[Array, Array, Array],
    size: int,
    goal: Goal,
    options: argparse.Namespace,
) -> dict[str, float]:
    """Means over calibrations: ``risk``, ``exceeds`` and ``acted`` on their population; on another one the risk
    (``shifted``) and ``acted_there``, the share of its grounds that is unlike (``flagged``) and the risk of the others
    (``left``).
    """
    random = np.random.default_rng([options.seed, size])
    found = list(calibrate_often(own[0], size, goal, options.calibrations, random))
    at = np.array([each for each, _ in found])
    risk, acted, shifted, acted_there = (
        np.where(at < 0, 0.0, values.mean(axis=0)[at]) for values in (own[0], own[1], other[0], other[1])
    )
    flagged, left = [], []
    for index, drawn in found[:20]:  # each compares all grounds of the other population
        p = np.array([compare_with_grounds(own[2][drawn], each).p for each in other[2]])
        flagged.append((p <= MAX_UNLIKE_P).mean())
        left.append(0.0 if index < 0 else (other[0][:, index] * (p > MAX_UNLIKE_P)).mean())
    return {
        "risk": float(risk.mean()),
        "exceeds": float((risk > goal.alpha).mean()),
        "acted": float(acted.mean()),
        "shifted": float(shifted.mean()),
        "acted_there": float(acted_there.mean()),
        "flagged": float(np.mean(flagged)),
        "left": float(np.mean(left)),
    }


def main(options: argparse.Namespace) -> None:
    """Simulate and print a table for each procedure."""
    columns = ("risk", "exceeds", "acted", "shifted", "acted_there", "flagged", "left")
    random = np.random.default_rng(options.seed)
    populations = {
        name: [decide(stand_in, options.grounds, rough, random) for rough in (1.0, OTHER_ROUGHNESS)]
        for name, stand_in in STAND_INS.items()
    }
    for procedure in (LEARN_THEN_TEST, CONFORMAL):
        goal = Goal(options.alpha, options.delta, procedure)
        print(f"\n{procedure}, {CHOICE}, alpha {goal.alpha:g}, delta {goal.delta:g}")
        print(f"{'stand-in':<12}{'score':<12}{'grounds':>8}" + "".join(f"{name:>13}" for name in columns))
        for name, (own, other) in populations.items():
            for score in SCORES:
                for size in options.sizes:
                    found = summarise(collect(own[score]), collect(other[score]), size, goal, options)
                    print(f"{name:<12}{score:<12}{size:>8}" + "".join(f"{found[key]:13.3f}" for key in columns))
