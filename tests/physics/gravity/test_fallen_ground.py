"""Talus keeps its volume, rests at the angle of repose below what it broke from, and does not depend on the grid."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.gravity.failing_slopes import Strength
from icymoon.physics.gravity.fallen_ground import FallenGround, Grid, let_ground_fail

#: 7 m across: a cliff 1 m high in the middle.
WEAK = Strength(20.0, 35.0, 600.0, 1.315)


def make_cliff(grid: Grid) -> np.ndarray:
    """A cliff that bends, as heights above its foot to the south."""
    x, y = grid.axis_m[None, :], grid.axis_m[:, None]
    return np.where(y > 0.4 * np.sin(2.0 * x), 1.0, 0.0) + 0.02 * np.sin(9.0 * x) * np.cos(7.0 * y)


def fail(side: int = 160, ratio: float = 1.4, strength: Strength = WEAK) -> tuple[Grid, np.ndarray, FallenGround]:
    grid = Grid(side, 7.0 / side)
    fallen = let_ground_fail(make_cliff(grid), grid, strength, ratio)
    assert fallen is not None
    return grid, make_cliff(grid), fallen


def settle(fallen: FallenGround, hard: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    level, east, north = (np.broadcast_to(a, hard.shape).ravel() for a in (hard, x, y))
    standing, talus = fallen.settle(level, east, north, lambda x, y, which: np.zeros(len(which)), 0.0)
    return standing.reshape(hard.shape), talus.reshape(hard.shape)


def sample(fallen: FallenGround, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Ground before, standing ground and talus on other points than those of the grid, and their distance in metres."""
    fine = Grid(points, 7.0 / points)
    hard = make_cliff(fine)
    return (hard, *settle(fallen, hard, fine.axis_m[None, :], fine.axis_m[:, None]), fine.cell_m)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 1.4])
def test_talus_has_the_volume_of_what_broke_off_times_its_ratio(ratio):
    """On other points than those of the grid. The cliff is one cell wide on the grid, so 3 % of what breaks off is
    between its points."""
    _, _, fallen = fail(ratio=ratio)
    hard, standing, talus, cell = sample(fallen, 611)
    broken = float((hard - standing).sum()) * cell**2
    assert broken == pytest.approx(fallen.broken_m3, rel=0.04)
    assert float(talus.sum()) * cell**2 == pytest.approx(ratio * fallen.broken_m3, rel=0.02)


def test_talus_rests_at_the_angle_of_repose():
    """Where it covers the ground: the median within 1.5 degrees of repose, and 99 % at most 4 steeper."""
    _, _, fallen = fail()
    _, standing, talus, cell = sample(fallen, 640)
    north, east = np.gradient(standing + talus, cell)
    slope = np.degrees(np.arctan(np.hypot(north, east)))
    deep = talus > 0.1
    assert deep.sum() > 5000
    assert np.median(slope[deep]) == pytest.approx(35.0, abs=1.5)
    assert np.percentile(slope[deep], 99) < 39.0


def test_talus_lies_below_the_cliff():
    _, _, fallen = fail()
    hard, standing, talus, _ = sample(fallen, 400)
    assert talus.min() == 0.0
    assert (standing <= hard).all()
    # Most of it is on ground that did not break, lower than the edge of the cliff.
    below = (hard < 0.5) & (standing == hard)
    assert talus[below].sum() > 0.5 * talus.sum()
    # What fails takes more volume, but hardly rises above the edge.
    assert (standing + talus)[talus > 0].max() < 1.1
    # Far from the cliff there is none.
    axis = Grid(400, 7.0 / 400).axis_m
    assert not talus[np.abs(axis) > 2.5].any()


def test_another_grid_gives_the_same_talus():
    """Half the cells: the volume within 3 %, and heights within 2 cm in root mean square, 2 % of the cliff."""
    (_, _, coarse), (_, _, fine) = fail(128), fail(256)
    assert coarse.broken_m3 == pytest.approx(fine.broken_m3, rel=0.05)
    (_, first_hard, first, _), (_, second_hard, second, _) = sample(coarse, 500), sample(fine, 500)
    apart = (first_hard + first) - (second_hard + second)
    assert math.sqrt(float(np.mean(apart**2))) < 0.02


def test_equal_ground_gives_equal_talus():
    (_, _, first), (_, _, second) = fail(), fail()
    assert (first.top_m == second.top_m).all()
    assert first.factor == second.factor


def test_ground_that_its_strength_holds_does_not_fail():
    """The same cliff in the gravity of Enceladus."""
    grid = Grid(160, 7.0 / 160)
    assert let_ground_fail(make_cliff(grid), grid, Strength(20.0, 35.0, 600.0, 0.113), 1.4) is None


def test_level_ground_stays_bit_by_bit():
    """Away from what fails and falls, heights are untouched."""
    _, _, fallen = fail()
    hard, standing, _, _ = sample(fallen, 400)
    axis = Grid(400, 7.0 / 400).axis_m
    assert (standing[np.abs(axis) > 2.5] == hard[np.abs(axis) > 2.5]).all()
