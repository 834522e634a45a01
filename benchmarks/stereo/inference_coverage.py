"""How often the verdicts and intervals over scenes are wrong, by simulation of what scenes are like.

    python benchmarks inference_coverage --runs 1000 --processes 2
    python benchmarks inference_coverage --runs 2000 --beyond

Each cell has so many data sets with seeds of their own. Errors of methods are drawn for each scene: normal, lognormal
(sd of the logarithm 1), exponential, or beta(0.3, 5), which is bounded and skewed. All methods have the same spread, or
the first one a quarter of it. They are shifted so that all typical differences are zero; then each method is worse than
the one before by 0, 1, 3 or 20 standard deviations. What an interval must contain is the pseudomedian of the
differences, the median of 4 million means of two, or zero if they are symmetric.

The tables are those of ``docs/theory/inference.md``: the worst of all cells with so many methods and scenes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from itertools import product
from typing import TypeVar

import numpy as np
from icymoon.stereo.inference import scene_means, typical_scene
from icymoon.support.arrays import Array

Draw = Callable[[np.random.Generator, tuple[int, ...]], Array]
#: Errors of a method in a scene: how they are drawn, their mean and their standard deviation.
ERRORS: dict[str, tuple[Draw, float, float]] = {
    "normal": (lambda random, shape: random.normal(5, 1, shape), 5.0, 1.0),
    "lognormal": (lambda random, shape: random.lognormal(0, 1, shape), np.exp(0.5), np.exp(0.5) * (np.e - 1) ** 0.5),
    "exponential": (lambda random, shape: random.exponential(1, shape), 1.0, 1.0),
    "beta": (lambda random, shape: random.beta(0.3, 5, shape), 0.3 / 5.3, (0.3 * 5 / 5.3**2 / 6.3) ** 0.5),
}
#: Errors beyond those for which the limit was chosen; their means are not used.
BEYOND: dict[str, tuple[Draw, float, float]] = {
    "29 % of scenes 50 times as hard": (
        lambda random, shape: np.where(random.random(shape) < 0.29, 50, 1) * random.lognormal(0, 0.5, shape),
        np.nan,
        1.0,
    ),
    "5 % of scenes 20 times as hard": (
        lambda random, shape: np.where(random.random(shape) < 0.05, 20, 1) * random.lognormal(0, 0.5, shape),
        np.nan,
        1.0,
    ),
    "t with 2 degrees of freedom": (lambda random, shape: random.standard_t(2, shape), np.nan, 1.0),
}
ALL_ERRORS = ERRORS | BEYOND
#: The spread of the first method, relative to the others.
SPREADS = (1.0, 0.25)
#: By how many standard deviations each method is worse than the one before.
EFFECTS = (0.0, 1.0, 3.0, 20.0)
#: Numbers of scenes by the number of methods, from the first with a verdict on.
SCENES = {2: (6, 7, 8, 10, 20, 50, 200), 3: (8, 9, 10, 20, 50, 200), 6: (10, 11, 12, 20, 50, 200)}
#: Shares of a scene: how they are drawn, and their mean.
SHARES: dict[str, tuple[Draw, float]] = {
    "beta(0.3, 5)": (ERRORS["beta"][0], 0.3 / 5.3),
    "beta(5, 5)": (lambda random, shape: random.beta(5, 5, shape), 0.5),
    "beta(0.5, 0.5)": (lambda random, shape: random.beta(0.5, 0.5, shape), 0.5),
    "zero in 0.8, else beta(1, 3)": (
        lambda random, shape: random.beta(1, 3, shape) * (random.random(shape) < 0.2),
        0.05,
    ),
    "zero in 0.9, else uniform": (lambda random, shape: random.random(shape) * (random.random(shape) < 0.1), 0.05),
    "yes in 0.05": (lambda random, shape: (random.random(shape) < 0.05) + 0.0, 0.05),
    "yes in 0.5": (lambda random, shape: (random.random(shape) < 0.5) + 0.0, 0.5),
}
Result = TypeVar("Result")
SCENES_OF_MEANS = (2, 3, 6, 10, 20, 30, 50, 100, 200)
#: Procedures of the comparisons, see ``wrong``: the bounds, and where methods are called different.
Procedure = Callable[[Array], tuple[Array, Array, Array]]


def typical(differences: Array) -> tuple[Array, Array, Array]:
    """The product's verdicts on the typical scene."""
    found = typical_scene.compare_in_typical_scene(differences, 0)
    return found.low, found.high, found.found


@cache
def typical_difference(errors: str, spread: float) -> float:
    """The pseudomedian of ``spread`` times an error less another error."""
    if spread == 1.0:
        return 0.0
    random, draw = np.random.default_rng(1), ALL_ERRORS[errors][0]
    found = []
    for _ in range(4):
        one, other = (draw(random, (2, 2**20)).sum(axis=0) for _ in range(2))
        found.append(np.median(spread * one - other) / 2)
    return float(np.mean(found))


def draw_errors(random: np.random.Generator, errors: str, spread: float, scenes: int, methods: int) -> Array:
    """Errors (scenes, methods) of methods without a typical difference."""
    drawn = ALL_ERRORS[errors][0](random, (scenes, methods))
    drawn[:, 0] = spread * drawn[:, 0] - typical_difference(errors, spread)
    return drawn


def differences_of(values: Array) -> Array:
    """The differences (…, comparisons) of every two methods (…, methods)."""
    one, other = zip(*typical_scene.list_comparisons(values.shape[-1]), strict=True)
    return values[..., list(one)] - values[..., list(other)]


def wrong(cell: tuple[str, float, int, int], runs: int, procedure: Procedure = typical) -> Array:
    """Of ``runs`` data sets of a cell (errors, spread, scenes, methods), the shares (3, EFFECTS): with a false verdict,
    with a bound that misses, and in which the first two methods are found to differ."""
    errors, spread, scenes, methods = cell
    counts = np.zeros((3, len(EFFECTS)))
    for run in range(runs):
        random = np.random.default_rng((scenes, methods, list(ALL_ERRORS).index(errors), int(spread == 1), run))
        drawn = draw_errors(random, errors, spread, scenes, methods)
        for k, effect in enumerate(EFFECTS):
            true = differences_of(shift := effect * ALL_ERRORS[errors][2] * np.arange(methods))
            low, high, found = procedure(differences_of(drawn + shift))
            rounding = 1e-9 * (1 + np.abs(true))
            side = np.sign(low + high)
            counts[:, k] += (
                (found & (side != np.sign(true))).any(),
                ((low > true + rounding) | (high < true - rounding)).any(),
                found[0],
            )
    return counts / runs


def wrong_means(errors: str, scenes: int, runs: int) -> float:
    """The share of intervals of one mean of ``scenes`` that miss it."""
    draw, mean, _ = ERRORS[errors]
    drawn = draw(np.random.default_rng((scenes, list(ERRORS).index(errors))), (scenes, runs))
    bounds = scene_means.find_mean_intervals(drawn, np.arange(scenes), np.zeros(runs, bool))
    return float(((bounds[:, 0] > mean) | (bounds[:, 1] < mean)).mean())


def wrong_shares(shares: str, scenes: int, runs: int, most_pairs: int) -> tuple[float, float]:
    """The share of intervals of a mean share that miss it, and their median width, with 1 to ``most_pairs`` pairs of a
    scene that have the same share."""
    draw, mean = SHARES[shares]
    random = np.random.default_rng((scenes, list(SHARES).index(shares)))
    pairs = np.repeat(np.arange(scenes), random.integers(1, most_pairs + 1, scenes))
    drawn = draw(random, (scenes, runs))[pairs]
    bounds = scene_means.find_mean_intervals(drawn, pairs, np.ones(runs, bool))
    return (
        float(((bounds[:, 0] > mean + 1e-12) | (bounds[:, 1] < mean - 1e-12)).mean()),
        float(np.median(bounds[:, 1] - bounds[:, 0])),
    )


def wrong_mean_differences(cell: tuple[str, float, int, int], runs: int) -> float:
    """The share of data sets in which an interval of a mean difference misses it."""
    errors, spread, scenes, methods = cell
    means = np.full(methods, ERRORS[errors][1])
    means[0] = spread * means[0] - typical_difference(errors, spread)
    true, misses = differences_of(means), 0
    for run in range(runs):
        random = np.random.default_rng((scenes, methods, list(ERRORS).index(errors), int(spread == 1), run))
        bounds = scene_means.find_simultaneous_intervals(
            differences_of(draw_errors(random, errors, spread, scenes, methods)), 0
        )
        misses += bool(((bounds[:, 0] > true) | (bounds[:, 1] < true)).any())
    return misses / runs


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    """What a cell gives, and its processor seconds."""
    began = time.process_time()
    return work(), time.process_time() - began


def cells(methods: int, scenes: int) -> list[tuple[str, float, int, int]]:
    """All cells with so many methods and scenes."""
    return [(errors, spread, scenes, methods) for errors, spread in product(ERRORS, SPREADS)]


def percent(shares: Array | list[float]) -> str:
    """Shares as whole and tenths of a percent."""
    return ", ".join(f"{100 * share:.1f}" for share in shares)


def rows(runs: int, pool: ProcessPoolExecutor) -> Iterator[tuple[str, float]]:
    """The lines of both tables, and the processor seconds that each took."""
    yield (
        (
            "| methods | scenes | false verdicts | joint coverage at "
            + ", ".join(f"{effect:g}" for effect in EFFECTS)
            + " sd | with normal errors | 1 sd is found |"
        ),
        0,
    )
    yield "|---|---|---|---|---|---|", 0
    for methods, numbers in SCENES.items():
        for scenes in numbers:
            those = cells(methods, scenes)
            done = list(pool.map(timed, [partial(wrong, cell, runs) for cell in those]))
            found = np.array([shares for shares, _ in done])
            yield (
                f"| {methods} | {scenes} | {percent([found[:, 0].max()])} | "
                f"{percent(1 - found[:, 1].max(axis=0))} | {percent([1 - found[0, 1].max()])} | "
                f"{percent([found[0, 2, 1]])} |",
                sum(seconds for _, seconds in done),
            )
    yield "", 0
    yield f"| scenes | shares | width | means: {', '.join(ERRORS)} | mean differences of 2, 3, 6 methods |", 0
    yield "|---|---|---|---|---|", 0
    for scenes in SCENES_OF_MEANS:
        done = list(
            pool.map(timed, [partial(wrong_shares, *each) for each in product(SHARES, [scenes], [2 * runs], [1, 4])])
        )
        told = scenes >= scene_means.FEWEST_FOR_MEAN
        means = list(pool.map(timed, [partial(wrong_means, errors, scenes, 2 * runs) for errors in ERRORS] * told))
        joint = (
            [
                list(
                    pool.map(
                        timed,
                        [partial(wrong_mean_differences, cell, max(1, runs // 4)) for cell in cells(methods, scenes)],
                    )
                )
                for methods in SCENES
            ]
            if told
            else []
        )
        yield (
            f"| {scenes} | {percent([1 - max(miss for (miss, _), _ in done)])} | "
            f"{np.median([width for (_, width), _ in done]):.2f} | "
            f"{percent([1 - miss for miss, _ in means]) or 'none'} | "
            f"{percent([1 - max(miss for miss, _ in each) for each in joint]) or 'none'} |",
            sum(seconds for each in (done, means, *joint) for _, seconds in each),
        )


def rows_beyond(runs: int, pool: ProcessPoolExecutor) -> Iterator[tuple[str, float]]:
    """The lines of the table of errors beyond, and the processor seconds that each took."""
    numbers = (6, 8, 12, 20, 200)
    yield f"| errors | spread of the first method | {' | '.join(f'{scenes} scenes' for scenes in numbers)} |", 0
    yield "|---|---" + "|---" * len(numbers) + "|", 0
    for errors, spread in product(BEYOND, (0.25, 0.0)):
        done = list(pool.map(timed, [partial(wrong, (errors, spread, scenes, 2), runs) for scenes in numbers]))
        shares = " | ".join(f"{100 * found[0, 0]:.1f}" for found, _ in done)
        yield f"| {errors} | {spread:g} | {shares} |", sum(seconds for _, seconds in done)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--runs", type=int, default=1000, help="data sets of each cell")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--beyond", action="store_true", help="false verdicts for errors of other kinds instead")


def main(options: argparse.Namespace) -> None:
    """Print the tables, all in %, and the processor time."""
    seconds = 0.0
    with ProcessPoolExecutor(options.processes) as pool:
        for line, own in (rows_beyond if options.beyond else rows)(options.runs, pool):
            print(line, flush=True)
            seconds += own
    print(f"\n{options.runs} data sets of each cell, {seconds / 60:.1f} processor minutes")
