"""The error rates of verdicts and intervals over scenes, by simulation of scenes.

    python benchmarks inference_coverage --runs 4000 --processes 2
    python benchmarks inference_coverage --runs 10000 --beyond
    python benchmarks inference_coverage --runs 1000 --means

Each cell has ``--runs`` data sets. Errors of methods are drawn for each scene: normal, lognormal (sd of the logarithm
1), exponential, or beta(0.3, 5), which is bounded and skewed. All methods have the same spread, or the first one a
quarter, a tenth, or nothing of it. They are shifted so that all typical differences are zero. The true one is the
pseudomedian of the differences, the median of 4 million means of two, or zero if they are symmetric.

Methods that are worse by any amount are not drawn, since a shift of a method changes neither residuals nor limit: an
interval misses the true difference where it would miss zero. ``tests/stereo/inference/test_coverage.py`` shows it with
the product's intervals. Here p is counted for many data sets at once, and that test holds it equal to the product's.

The tables are in ``docs/theory/inference.md``: the worst of all cells with the same numbers of methods and scenes.
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
SPREADS = (1.0, 0.25, 0.1, 0.0)
#: Numbers of methods; how many scenes the tables have beyond the fewest that a verdict takes; and many scenes, which
#: take longer and have a quarter of the data sets.
METHODS = (2, 3, 4, 5, 6)
MORE, MANY = (0, 1), 20
#: Numbers of methods and spreads in the study of mean differences.
METHODS_OF_MEANS, SPREADS_OF_MEANS = (2, 3, 6), (1.0, 0.25)
#: Most scenes for which all flips are made, number of flips with more scenes, and most numbers held at once.
MAX_EXACT, FLIPS = 13, 5000
HELD = 10_000_000
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


def draw_errors(random: np.random.Generator, errors: str, spread: float, shape: tuple[int, ...]) -> Array:
    """Errors (…, scenes, methods) of methods without a typical difference."""
    drawn = ALL_ERRORS[errors][0](random, shape)
    drawn[..., 0] = spread * drawn[..., 0] - typical_difference(errors, spread)
    return drawn


def differences_of(values: Array) -> Array:
    """The differences (…, comparisons) of every two methods (…, methods)."""
    one, other = zip(*typical_scene.list_method_pairs(values.shape[-1]), strict=True)
    return values[..., list(one)] - values[..., list(other)]


@cache
def draw_signs(scenes: int) -> Array:
    """The signs (flips, scenes) of all flips but those with all signs turned, or of random ones."""
    flipped = (
        np.arange(2 ** (scenes - 1))[:, None] >> np.arange(scenes) & 1
        if scenes <= MAX_EXACT
        else np.random.default_rng(scenes).integers(0, 2, (FLIPS, scenes), np.int8)
    )
    return (1 - 2 * flipped).astype(np.float32)


def find_p(differences: Array) -> Array:
    """The adjusted p (data sets, comparisons) of continuous differences (data sets, scenes, comparisons)."""
    scenes = differences.shape[1]
    values = np.moveaxis(differences, 1, 2)
    one, other = np.triu_indices(scenes)
    sums = np.sort(values[..., one] + values[..., other], axis=-1)
    count = sums.shape[-1]
    observed = np.abs(2 * (sums > 0).sum(axis=-1) - count)
    apart = 2 * values - ((sums[..., count // 2] + sums[..., (count - 1) // 2]) / 2)[..., None]
    # The two scenes between which the centre lies are as far from it, but for rounding, and are ranked by their order.
    size = np.round(np.abs(apart) / np.abs(apart).max(axis=-1, keepdims=True), 10)
    ranks = 1 + np.argsort(np.argsort(size, axis=-1, kind="stable"), axis=-1, kind="stable")
    signed = np.where(apart < 0, -ranks, ranks).astype(np.float32)
    signs = draw_signs(scenes)
    found = np.empty(observed.shape)
    for k, those in enumerate(signed):
        largest = np.sort(np.abs(those @ signs.T).max(axis=0))
        found[k] = len(signs) - np.searchsorted(largest, observed[k] - 0.5)
    return np.maximum(found, 1) / len(signs)


def find_rates(cell: tuple[str, float, int, int], runs: int, worse_sd: float = 0.0) -> tuple[float, float]:
    """Of ``runs`` data sets of a cell (errors, spread, scenes, methods) the shares with a verdict, and with one on the
    first two methods; each method is ``worse_sd`` standard deviations worse than the one before."""
    errors, spread, scenes, methods = cell
    random = np.random.default_rng((scenes, methods, list(ALL_ERRORS).index(errors), SPREADS.index(spread)))
    comparisons = methods * (methods - 1) // 2
    limit = typical_scene.find_limit(comparisons) + 1e-12
    at_once = max(1, HELD // (comparisons * scenes * (scenes + 1)))
    shift = worse_sd * ALL_ERRORS[errors][2] * np.arange(methods)
    found, first = 0, 0
    for start in range(0, runs, at_once):
        drawn = draw_errors(random, errors, spread, (min(at_once, runs - start), scenes, methods))
        verdicts = find_p(differences_of(drawn + shift)) <= limit
        found, first = found + int(verdicts.any(axis=1).sum()), first + int(verdicts[:, 0].sum())
    return found / runs, first / runs


def measure_wrong_means(errors: str, scenes: int, runs: int) -> float:
    """The share of intervals of one mean of ``scenes`` that miss it."""
    draw, mean, _ = ERRORS[errors]
    drawn = draw(np.random.default_rng((scenes, list(ERRORS).index(errors))), (scenes, runs))
    bounds = scene_means.find_mean_intervals(drawn, np.arange(scenes), np.zeros(runs, bool))
    return float(((bounds[:, 0] > mean) | (bounds[:, 1] < mean)).mean())


def measure_wrong_shares(shares: str, scenes: int, runs: int, most_pairs: int) -> tuple[float, float]:
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


def measure_wrong_mean_differences(cell: tuple[str, float, int, int], runs: int) -> float:
    """The share of data sets in which an interval of a mean difference misses it."""
    errors, spread, scenes, methods = cell
    means = np.full(methods, ERRORS[errors][1])
    means[0] = spread * means[0] - typical_difference(errors, spread)
    true, misses = differences_of(means), 0
    for run in range(runs):
        random = np.random.default_rng((scenes, methods, list(ERRORS).index(errors), int(spread == 1), run))
        bounds = scene_means.find_simultaneous_intervals(
            differences_of(draw_errors(random, errors, spread, (scenes, methods))), 0
        )
        misses += bool(((bounds[:, 0] > true) | (bounds[:, 1] < true)).any())
    return misses / runs


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    """The result of a cell, and its processor seconds."""
    began = time.process_time()
    return work(), time.process_time() - began


def list_numbers_of_scenes(methods: int) -> list[int]:
    """The numbers of scenes in the tables, from the first with a verdict."""
    fewest = typical_scene.count_scenes_for_methods(methods)
    return [fewest + more for more in MORE] + [MANY]


def percent(shares: Array | list[float]) -> str:
    """Shares in percent with one decimal."""
    return ", ".join(f"{100 * share:.1f}" for share in shares)


def rows(runs: int, pool: ProcessPoolExecutor) -> Iterator[tuple[str, float]]:
    """The lines of the table of verdicts, and the processor seconds that each took."""
    yield (
        "| methods | scenes | "
        + " | ".join(f"spread {spread:g}" for spread in SPREADS)
        + " | joint coverage | with normal errors | 1 sd is found |",
        0,
    )
    yield "|---|---" + "|---" * len(SPREADS) + "|---|---|---|", 0
    for methods in METHODS:
        for scenes in list_numbers_of_scenes(methods):
            cells = [(errors, spread, scenes, methods) for errors, spread in product(ERRORS, SPREADS)]
            each = runs // 4 if scenes == MANY else runs
            shifted = partial(find_rates, ("normal", 1.0, scenes, methods), each, 1.0)
            done = list(pool.map(timed, [*(partial(find_rates, cell, each) for cell in cells), shifted]))
            false = np.array([rate for (rate, _), _ in done[:-1]]).reshape(len(ERRORS), len(SPREADS))
            yield (
                f"| {methods} | {scenes} | {' | '.join(f'{100 * worst:.1f}' for worst in false.max(axis=0))} | "
                f"{percent([1 - false.max()])} | {percent([1 - false[0].max()])} | {percent([done[-1][0][1]])} |",
                sum(seconds for _, seconds in done),
            )


def make_mean_rows(runs: int, pool: ProcessPoolExecutor) -> Iterator[tuple[str, float]]:
    """The lines of the table of shares and means, and the processor seconds that each took."""
    yield f"| scenes | shares | width | means: {', '.join(ERRORS)} | mean differences of 2, 3, 6 methods |", 0
    yield "|---|---|---|---|---|", 0
    for scenes in SCENES_OF_MEANS:
        done = list(
            pool.map(
                timed, [partial(measure_wrong_shares, *each) for each in product(SHARES, [scenes], [2 * runs], [1, 4])]
            )
        )
        told = scenes >= scene_means.FEWEST_FOR_MEAN
        means = list(
            pool.map(timed, [partial(measure_wrong_means, errors, scenes, 2 * runs) for errors in ERRORS] * told)
        )
        joint = (
            [
                list(
                    pool.map(
                        timed,
                        [
                            partial(
                                measure_wrong_mean_differences, (errors, spread, scenes, methods), max(1, runs // 4)
                            )
                            for errors, spread in product(ERRORS, SPREADS_OF_MEANS)
                        ],
                    )
                )
                for methods in METHODS_OF_MEANS
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


def make_rare_error_rows(runs: int, pool: ProcessPoolExecutor) -> Iterator[tuple[str, float]]:
    """The lines of the table of rare large errors, and the processor seconds that each took."""
    yield (
        "| errors | spread of the first method | methods | "
        + "".join(f"{more} more | " for more in MORE)
        + f"{MANY} scenes |",
        0,
    )
    yield "|---|---|---|---" + "|---" * len(MORE) + "|", 0
    for errors, spread, methods in product(BEYOND, (0.25, 0.0), (2, 4, 6)):
        numbers = list_numbers_of_scenes(methods)
        done = list(pool.map(timed, [partial(find_rates, (errors, spread, n, methods), runs) for n in numbers]))
        shares = " | ".join(f"{100 * found:.1f}" for (found, _), _ in done)
        yield f"| {errors} | {spread:g} | {methods} | {shares} |", sum(seconds for _, seconds in done)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--runs", type=int, default=4000, help="data sets of each cell")
    parser.add_argument("--processes", type=int, default=2)
    instead = parser.add_mutually_exclusive_group()
    instead.add_argument("--beyond", action="store_true", help="false verdicts for errors of other kinds instead")
    instead.add_argument("--means", action="store_true", help="the coverage of shares and means instead")


def main(options: argparse.Namespace) -> None:
    """Print the tables, all in %, and the processor time."""
    seconds = 0.0
    table = make_rare_error_rows if options.beyond else make_mean_rows if options.means else rows
    with ProcessPoolExecutor(options.processes) as pool:
        for line, own in table(options.runs, pool):
            print(line, flush=True)
            seconds += own
    print(f"\n{options.runs} data sets of each cell, {seconds / 60:.1f} processor minutes")
