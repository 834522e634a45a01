"""How often verdicts and intervals are wrong, by the simulation of the manual, in short."""

import numpy as np
import pytest
from icymoon.benchmarks.stereo import inference_coverage as simulation

pytestmark = pytest.mark.filterwarnings("error")


RUNS = 300
#: The goals, and 3 standard errors of a share of so many data sets.
MOST_FALSE, MOST_MISSES = 0.065, 0.07
DOUBT = 3 * (0.07 * 0.93 / RUNS) ** 0.5


def uncentred(differences):
    """What the reports of version 3 did: the largest |t| of flips of the differences themselves."""
    scenes = len(differences)
    mean, error = differences.mean(axis=0), differences.std(axis=0, ddof=1) / scenes**0.5
    signs = np.array([[1 - 2 * (k >> place & 1) for place in range(scenes)] for k in range(2 ** (scenes - 1))])
    means = signs @ differences / scenes
    errors = np.sqrt(((differences**2).mean(axis=0) - means**2).clip(1e-12) / (scenes - 1))
    limit = np.quantile(np.abs(means / errors).max(axis=1), 0.95, method="higher")
    return mean - limit * error, mean + limit * error, np.abs(mean / error) > limit


@pytest.mark.parametrize("cell", [("beta", 0.25, 6, 2), ("exponential", 0.25, 8, 3), ("beta", 1.0, 10, 6)], ids=str)
def test_verdicts_and_intervals_hold(cell):
    false, misses, found = simulation.wrong(cell, RUNS)
    assert (false <= MOST_FALSE + DOUBT).all()
    assert (misses <= MOST_MISSES + DOUBT).all()
    assert found[-1] == 1.0  # a difference of 20 standard deviations


def test_flips_that_are_not_centred_would_not_pass():
    """They miss where methods really differ."""
    _, misses, _ = simulation.wrong(("lognormal", 1.0, 10, 6), RUNS, uncentred)
    assert (misses[2:] > MOST_MISSES + DOUBT).all()


def test_the_difference_without_an_effect_is_zero():
    for errors in simulation.ERRORS:
        drawn = simulation.draw_errors(np.random.default_rng(0), errors, 0.25, 4000, 2)
        apart = drawn[:, 0] - drawn[:, 1]
        assert np.median(apart[:2000] + apart[2000:]) == pytest.approx(0, abs=0.15 * apart.std())


@pytest.mark.long
@pytest.mark.parametrize(("methods", "scenes"), [(m, n) for m, those in simulation.SCENES.items() for n in those])
def test_all_cells_hold(methods, scenes):
    for cell in simulation.cells(methods, scenes):
        test_verdicts_and_intervals_hold(cell)
